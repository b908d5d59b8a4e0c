"use strict";
// Runs the machine's C in a worker: it only moves time and values.
// `timer` is null if no tick is to come, and 0 if its message is under way.
let c, at, given, start, timer = null;
let turned = false, analysis = null;
let playing = false, speed = 1, row = 0, ended = false, origin = 0, from = 0, lost = 0;
const writes = new Map(), limited = new Float64Array(6);
// What a hand adds to the experiment's own loads and faults, and what these are by themselves: from the begin, then from
// each of the experiment's changes on.
const LOADS = {
  parameters: { table: "change_parameters", parts: ["parameters"], sum: (own, by) => own + by },
  inputs: { table: "change_inputs", parts: ["inputs"], sum: (own, by) => own + by },
  faults: { table: "change_faults", parts: ["cut", "frozen"], sum: Math.max },
};
for (const load of Object.values(LOADS)) load.added = new Map();
// What a hand has cut and frozen, and given back: places in `cut` and `frozen`, and the row.
let faults = [];
// the step that is watched: axis, pose before, size, row, and what its response has been so far
let step = null;
// the last rows: time, signals (24), forces (6), the reference (24), and which legs are limited
const KEPT = 56, MINUTE = 60;
let ring = null, ringRows = 0, ringed = 0, thin = 1;
const BUDGET = 12, BEHIND = 250, POINTS = 64, SIZE = 26;
const clock = () => performance.now();

const unpacked = async (text) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
};
const place = (name) => c.machine_field(at, BigInt(given.fields[name])) >>> 0;
const numbers = (name, n) => new Float64Array(c.memory.buffer, place(name), n);

const begin = () => {
  new Uint8Array(c.memory.buffer, at, start.byteLength).set(new Uint8Array(start));
  const status = c.machine_open(at, BigInt(start.byteLength / 8));
  if (status !== 0n) throw new Error(`the machine cannot be opened: ${status}`);
  row = 0;
  ringed = 0;
  ended = false;
  limited.fill(0);
  for (const [name, values] of writes) for (const [k, value] of values) if (place(name)) numbers(name, k + 1)[k] = value;
  for (const load of Object.values(LOADS)) {
    load.size = given.sizes[load.parts.join()];
    load.own = [...load.parts.flatMap((part) => (place(part) ? [...numbers(part, given.sizes[part])] : []))];
    load.later = place(load.table) ? numbers(load.table, load.size * given.changes.length).slice() : null;
    for (const [k, by] of load.added) put(load, k, by);
  }
  if (turned) c.machine_turn(at);
  faults = [...LOADS.faults.added].filter(([, on]) => on).map(([place]) => ({ place, on: true, row: 0 }));
  step = null;
  hold();
};
// An element of a load, now and at all changes.
const put = (load, k, by) => {
  const { own, later, size, parts, sum } = load, past = later ? given.changes.filter((change) => change < row).length : 0;
  if (!own.length) return;
  const first = given.sizes[parts[0]], [part, i] = k < first ? [parts[0], k] : [parts[1], k - first];
  numbers(part, i + 1)[i] = sum(past ? later[(past - 1) * size + k] : own[k], by);
  const table = later && numbers(load.table, later.length);
  for (let j = 0; j < given.changes.length && table; j++) table[j * size + k] = sum(later[j * size + k], by);
};
// real time counts from here
const hold = () => { origin = clock(); from = row; };

// Of a step's response (y - from) / by: rise from 10 to 90 %, the largest, and what is left at the end of the watch.
const WATCHED = 3;
const follow = (index, pose) => {
  const y = (pose - step.from) / step.by, time = (index - step.row) * given.plantStep;
  if (step.low === null && y >= 0.1) step.low = time;
  if (step.high === null && y >= 0.9) step.high = time;
  step.highest = Math.max(step.highest, y);
  if (time < WATCHED) return;
  postMessage({ type: "response", axis: step.axis, by: step.by, rise: step.high === null ? null : step.high - step.low, overshoot: Math.max(0, step.highest - 1), last: y });
  step = null;
};

// Rows to before `to`, at most what a call keeps; points of them for curves, and the last row. Plain loops over numbers:
// at a hundred times real time, views and callbacks for each row take as long as the row.
const advance = (to, points, every) => {
  const first = row, next = Number(c.machine_run(at, BigInt(to)));
  if (next === first) { ended = true; return; }
  const n = next - first, signals = numbers("row_signals", 24 * n), forces = numbers("row_forces", 6 * n);
  const flags = new Uint8Array(c.memory.buffer, place("row_force_limited"), 6 * n), skipped = first % given.every;
  const planned = place("plan_reference") ? numbers("plan_reference", 30 * (skipped + n)) : null;
  for (let k = 0; k < n; k++) {
    const index = first + k, time = index * given.plantStep, wanted = 30 * (skipped + k);
    let mask = 0;
    for (let leg = 0; leg < 6; leg++) {
      if (flags[6 * k + leg]) mask |= 1 << leg;
      limited[leg] = flags[6 * k + leg] ? limited[leg] + given.plantStep : 0;
    }
    if (step) follow(index, signals[24 * k + step.axis]);
    if (index % thin === 0) {
      const to = (ringed++ % ringRows) * KEPT;
      ring[to] = time;
      for (let i = 0; i < 24; i++) ring[to + 1 + i] = signals[24 * k + i];
      for (let i = 0; i < 6; i++) ring[to + 25 + i] = forces[6 * k + i];
      if (planned) for (let i = 0; i < 24; i++) ring[to + 31 + i] = planned[wanted + i];
      ring[to + 55] = mask;
    }
    if (index % every !== 0 && !(next >= to && k === n - 1)) continue;
    points.push(time);
    for (let i = 0; i < 6; i++) points.push(signals[24 * k + i]);
    for (let i = 0; i < 6; i++) points.push(signals[24 * k + 12 + i]);
    for (let i = 0; i < 6; i++) points.push(forces[6 * k + i]);
    for (let i = 0; i < 6; i++) points.push(planned ? planned[wanted + i] : NaN);
    points.push(mask);
  }
  row = next;
  if (c.machine_ended(at) >= 0n) ended = true;
};

const tell = (points) => {
  const values = new Float64Array(points);
  postMessage({
    type: "rows", points: values, size: SIZE, time: row * given.plantStep, limited: [...limited], lost, cut: place("cut") ? [...numbers("cut", 6)] : [],
    ended, failure: ended ? Number(c.machine_failure(at)) : 0, speed,
  }, [values.buffer]);
};

const tick = () => {
  timer = null;
  if (!playing || ended) return;
  const begun = clock(), points = [], fast = !Number.isFinite(speed);
  let to = fast ? Infinity : from + Math.floor((begun - origin) / 1000 * speed / given.plantStep);
  if (!fast && begun - origin > 0 && to - row > BEHIND / 1000 * speed / given.plantStep) {
    lost += (to - row) * given.plantStep / speed;
    hold();
    to = row + 1;
  }
  // a point of the curves every 5 ms, or 20 ms where a chart's seconds go by in no time
  const every = Math.max(1, Math.round((fast ? 0.02 : 0.005) / given.plantStep), fast ? 0 : Math.ceil((to - row) / POINTS));
  while (row < to && !ended && clock() - begun < BUDGET) advance(Math.min(to, row + given.kept), points, every);
  if (points.length) tell(points);
  else if (ended) tell([]);
  again();
};
const channel = new MessageChannel();
channel.port1.onmessage = tick;
const again = () => {
  if (timer !== null || !playing || ended) return;
  if (Number.isFinite(speed)) timer = setTimeout(tick, 6);
  else {
    timer = 0;
    channel.port2.postMessage(0);
  }
};
// A message cannot be taken back: its tick comes, and goes on as is then wanted.
const stop = () => {
  if (!timer) return;
  clearTimeout(timer);
  timer = null;
};

// Poles and margins of the loop as it is, once nothing has been turned for a moment.
const analyse = (after) => {
  clearTimeout(analysis);
  analysis = setTimeout(() => {
    if (!given.turn.margins || Number(c.machine_margins(at))) return;
    postMessage({ type: "margins", values: numbers("turn_results", given.turn.poles + 4 * given.turn.most).slice() });
  }, after);
};

const answers = {
  open: async (message) => {
    given = message.data;
    start = await unpacked(given.block);
    const { instance } = await WebAssembly.instantiate(await unpacked(given.wasm), {});
    c = instance.exports;
    if (c._initialize) c._initialize();
    at = (c.__heap_base.value + 15) & ~15;
    c.memory.grow(Math.ceil((at + start.byteLength) / 65536));
    thin = Math.max(1, Math.round(0.001 / given.plantStep));
    ringRows = Math.min(60001, Math.ceil(MINUTE / given.plantStep / thin) + 1);
    ring = new Float64Array(KEPT * ringRows);
    begin();
    postMessage({ type: "ready" });
    analyse(300);
  },
  run: (message) => {
    stop();
    playing = message.playing;
    speed = message.speed ?? Infinity;
    hold();
    again();
  },
  again: () => {
    stop();
    begin();
    again();
  },
  // numbers of a field, kept when it begins again
  write: ({ name, from: first, values, keeps }) => {
    if (values.some(Number.isNaN) || !place(name)) return;
    numbers(name, first + values.length).set(values, first);
    if (!keeps) return;
    if (!writes.has(name)) writes.set(name, new Map());
    values.forEach((value, k) => writes.get(name).set(first + k, value));
  },
  // a payload, a push, gravity: to the experiment's own
  add: ({ name, from: first, values }) => {
    values.forEach((by, k) => {
      LOADS[name].added.set(first + k, by);
      put(LOADS[name], first + k, by);
    });
  },
  // legs without force and sensors that stay, with the row at which a hand did it
  fail: ({ places, on }) => {
    for (const k of places) {
      faults.push({ place: k, on, row });
      LOADS.faults.added.set(k, on ? 1 : 0);
      put(LOADS.faults, k, on ? 1 : 0);
    }
  },
  // some rows at once, by no clock
  some: ({ rows }) => {
    const points = [], to = row + rows, every = Math.max(1, Math.round(0.005 / given.plantStep), Math.ceil(rows / POINTS));
    while (row < to && !ended) advance(Math.min(to, row + given.kept), points, every);
    hold();
    tell(points);
    postMessage({ type: "advanced" });
  },
  used: () => postMessage({ type: "usedGains", used: place("turn_used") ? [...numbers("turn_used", 25)] : [] }),
  // the rows of the last minute, the oldest first
  kept: () => {
    const n = Math.min(ringed, ringRows), first = ringed - n, values = new Float64Array(KEPT * n);
    for (let k = 0; k < n; k++) values.set(ring.subarray(((first + k) % ringRows) * KEPT, ((first + k) % ringRows) * KEPT + KEPT), k * KEPT);
    postMessage({ type: "keptRows", values, size: KEPT, step: thin * given.plantStep, faults }, [values.buffer]);
  },
  // the reference jumps to a target along one axis: a step, past the hand's filter
  jump: ({ axis, by }) => {
    if (!place("plan_target")) return;
    const target = numbers("plan_target", 6), smoothed = numbers("plan_smoothed", 18);
    step = { axis, by, from: smoothed[axis], row, low: null, high: null, highest: 0 };
    target[axis] += by;
    smoothed[axis] += by;
  },
  // takes over what has been written of settings: 0, or 1 and the position of the first that is refused
  turn: () => {
    turned = true;
    const status = Number(c.machine_turn(at));
    postMessage({ type: "turned", status, used: place("turn_used") ? [...numbers("turn_used", 25)] : [] });
    analyse(120);
  },
  take: () => { step = null; c.machine_take(at); },
  // all rows from the beginning, for who compares them
  rows: ({ rows }) => {
    playing = false;
    begin();
    const found = new Float64Array(30 * rows);
    while (row < rows && !ended) {
      const first = row;
      advance(Math.min(rows, row + given.kept), [], 1e9);
      for (let k = 0; first + k < row; k++) {
        found.set(numbers("row_signals", 24 * (k + 1)).subarray(24 * k), 30 * (first + k));
        found.set(numbers("row_forces", 6 * (k + 1)).subarray(6 * k), 30 * (first + k) + 24);
      }
    }
    postMessage({ type: "allRows", values: found.subarray(0, 30 * row) });
  },
  state: () => postMessage({ type: "state", memory: c.memory.buffer.byteLength, row, lost, inputs: [...numbers("inputs", given.sizes.inputs)] }),
};
let done = Promise.resolve();
onmessage = ({ data }) => {
  done = done.then(() => answers[data.type](data)).catch((error) => postMessage({ type: "failed", text: String(error.message || error) }));
};
