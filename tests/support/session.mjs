// Plays sessions in the worker of live pages, without a browser: node session.mjs SESSIONS.json OUT.json
// SESSIONS has the data of pages and, of each session, its page and the messages that its hand sends.
import * as fs from "node:fs";
import process from "node:process";
import vm from "node:vm";

const [from, to] = process.argv.slice(2), { pages, sessions } = JSON.parse(fs.readFileSync(from, "utf8"));
const play = async ({ page, messages }) => {
  const { worker, ...data } = pages[page], waiting = new Map();
  const context = vm.createContext({
    atob, Blob, DecompressionStream, MessageChannel, performance, Response, setTimeout, clearTimeout, structuredClone, onmessage: null,
    postMessage: (message) => {
      if (message.type === "failed") throw new Error(message.text);
      waiting.get(message.type)?.(message);
    },
  });
  vm.runInContext(worker, context);
  const ask = (message, answer) => new Promise((resolve) => { waiting.set(answer, resolve); context.onmessage({ data: message }); });
  await ask({ type: "open", data }, "ready");
  for (const message of messages) context.onmessage({ data: message });
  return (await ask({ type: "files" }, "written")).files;
};
const out = [];
for (const session of sessions) out.push(await play(session));
fs.writeFileSync(to, JSON.stringify(out));
process.exit(0);
