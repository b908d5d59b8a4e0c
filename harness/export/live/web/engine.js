"use strict";
// The worker with the machine, and what it says.
(() => {
  const GS = GoughStewart, given = GS.page.live, listeners = {}, waiting = new Map();
  const url = URL.createObjectURL(new Blob([given.worker], { type: "text/javascript" }));
  const worker = new Worker(url);
  const { worker: _text, ...data } = given;
  worker.onmessage = ({ data: message }) => {
    for (const listener of listeners[message.type] || []) listener(message);
    const answer = waiting.get(message.type);
    if (answer) { waiting.delete(message.type); answer(message); }
  };
  worker.onerror = (event) => { for (const listener of listeners.failed || []) listener({ text: event.message || "the worker stopped" }); };
  const say = (type, more = {}) => worker.postMessage({ type, ...more });
  GS.engine = {
    given,
    on: (type, listener) => { (listeners[type] ??= []).push(listener); },
    ask: (type, answer, more) => new Promise((resolve) => { waiting.set(answer, resolve); say(type, more); }),
    say,
    add: (name, from, values) => say("add", { name, from, values }),
    write: (name, from, values, keeps = true) => say("write", { name, from, values, keeps }),
  };
  say("open", { data });
})();
