// Plays sessions in the worker of live pages, without a browser: node session.mjs SESSIONS.json OUT.json
// SESSIONS has the data of pages and, of each session, its page and the messages that its hand sends; one of type "hear"
// waits until the worker says `what`. OUT has what the worker said in each, by the type of message.
import * as fs from "node:fs";
import process from "node:process";
import vm from "node:vm";

const [from, to] = process.argv.slice(2), { pages, sessions } = JSON.parse(fs.readFileSync(from, "utf8"));
const play = async ({ page, messages }) => {
  const { worker, ...data } = pages[page], said = {};
  let hear = () => {};
  const context = vm.createContext({
    atob, Blob, DecompressionStream, MessageChannel, performance, Response, setTimeout, clearTimeout, structuredClone, onmessage: null,
    postMessage: ({ points, values, ...message }) => {
      if (message.type === "failed") throw new Error(message.text);
      (said[message.type] ??= []).push({ ...message, values: values && [...values] });
      hear(message.type);
    },
  });
  vm.runInContext(worker, context);
  const until = (type) => new Promise((resolve) => { hear = (heard) => { if (heard === type) resolve(); }; });
  for (const message of [{ type: "open", data }, ...messages, { type: "state" }]) {
    const heard = message.type === "hear" ? until(message.what) : message.type === "state" ? until("state") : null;
    if (message.type !== "hear") context.onmessage({ data: message });
    await heard;
  }
  return said;
};
const out = [];
for (const session of sessions) out.push(await play(session));
fs.writeFileSync(to, JSON.stringify(out));
process.exit(0);
