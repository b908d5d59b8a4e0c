"use strict";
// The worker with the machine, and what it says. It starts before the other scripts are read.
(() => {
  const GS = GoughStewart, { worker: text, ...given } = GS.page.live, listeners = {}, waiting = new Map();
  const worker = new Worker(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
  const early = [];
  const pass = (message) => {
    for (const listener of listeners[message.type] || []) listener(message);
    waiting.get(message.type)?.(message);
    waiting.delete(message.type);
  };
  worker.onmessage = ({ data }) => { early.push(data); };
  const say = (type, more = {}) => worker.postMessage({ type, ...more });
  GS.engine = {
    given,
    say,
    on: (type, listener) => { (listeners[type] ??= []).push(listener); },
    ask: (type, answer, more) => new Promise((resolve) => { waiting.set(answer, resolve); say(type, more); }),
    // whoever listens is there: what was said so far, then what comes
    listen: () => {
      worker.onmessage = ({ data }) => pass(data);
      worker.onerror = (event) => pass({ type: "failed", text: event.message || "the worker stopped" });
      early.forEach(pass);
    },
  };
  say("open", { data: given });
})();
