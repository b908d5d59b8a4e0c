// Runs a machine's block in WebAssembly to a row: node machine.mjs MODULE BLOCK ROWS OUT
import * as fs from "node:fs";
import process from "node:process";

const [code, block, rows, out] = process.argv.slice(2);
const instance = new WebAssembly.Instance(new WebAssembly.Module(fs.readFileSync(code)), {});
const c = instance.exports;
if (c._initialize) c._initialize();
const words = fs.readFileSync(block);
const at = (c.__heap_base.value + 15) & ~15;
c.memory.grow(Math.ceil((at + words.length) / 65536));
new Uint8Array(c.memory.buffer, at, words.length).set(words);
const status = c.machine_open(at, BigInt(words.length / 8));
if (status !== 0n) throw new Error(`the block cannot be opened: ${status}`);
while (c.machine_run(at, BigInt(rows)) < BigInt(rows));
fs.writeFileSync(out, new Uint8Array(c.memory.buffer, at, words.length));
