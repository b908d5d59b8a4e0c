"use strict";
// Runs the machine's C in a worker: it only moves time and values. What a hand does acts from the next sample on.
// `timer` is null if no tick is to come, and 0 if its message is under way.
let c, at, given, start, timer = null, analysis = null;
let playing = false, speed = 1, row = 0, ended = false, origin = 0, from = 0, lost = 0;
const limited = new Float64Array(6);
// What a hand has set, which stays when the loop begins again: tuned settings, forces of an open loop, and what it adds
// to the experiment's own loads and faults, by place.
const hand = { wanted: null, forces: null, parameters: new Map(), inputs: new Map(), faults: new Map() };
const LOADS = {
  parameters: { table: "change_parameters", parts: ["parameters"], sum: (own, by) => own + by },
  inputs: { table: "change_inputs", parts: ["inputs"], sum: (own, by) => own + by },
  faults: { table: "change_faults", parts: ["cut", "frozen"], sum: Math.max },
};
// the session since the begin, and the last one that ended early; the step that is watched
let session = null, crashed = null, step = null;
// what is kept of rows: time, signals (24), forces (6), the reference (24), and which legs are limited; a point of a curve
const KEPT = 56, MINUTE = 60, SIZE = 26;
// a tick computes for so long [ms], time that is more late than this is lost [ms]; points of a message
const BUDGET = 12, BEHIND = 250, POINTS = 64;
// a step's response is watched for so long [s]
const WATCHED = 3;
const clock = () => performance.now();

const unpacked = async (text) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
};
const place = (name) => c.machine_field(at, BigInt(given.fields[name])) >>> 0;
const numbers = (name, n) => new Float64Array(c.memory.buffer, place(name), n);
const used = () => (place("turn_used") ? [...numbers("turn_used", 25)] : []);
const limitOf = (wanted) => (wanted ?? given.turn.wanted)[given.turn.names.indexOf("force_limit")] ?? Infinity;
const log = (event) => session.events.push({ row, ...event });

const begin = () => {
  new Uint8Array(c.memory.buffer, at, start.byteLength).set(new Uint8Array(start));
  const status = c.machine_open(at, BigInt(start.byteLength / 8));
  if (status !== 0n) throw new Error(`the machine cannot be opened: ${status}`);
  const isCrash = session && ended;
  if (isCrash) crashed = { ...session, row };
  const ring = session && !isCrash ? session.ring : new Float64Array(KEPT * ringRows());
  row = 0;
  ended = false;
  step = null;
  limited.fill(0);
  session = { events: [], ring, ringed: 0, failure: 0 };
  for (const [name, load] of Object.entries(LOADS)) {
    load.size = given.sizes[load.parts.join()];
    load.own = load.parts.flatMap((part) => (place(part) ? [...numbers(part, given.sizes[part])] : []));
    load.later = place(load.table) ? numbers(load.table, load.size * given.changes.length).slice() : null;
    for (const [k, by] of hand[name]) put(name, k, by);
  }
  session.own = { first: LOADS.parameters.own, later: LOADS.parameters.later };
  if (hand.wanted || hand.forces) beginAs();
  hold();
};
// Tuned settings and forces from the begin on: the forces before the first command are those that these allow.
const beginAs = () => {
  const forces = (hand.forces ?? given.startForce).map((force) => Math.max(-limitOf(hand.wanted), Math.min(force, limitOf(hand.wanted))));
  for (const [name, size] of Object.entries({ planned: 6, target: 6, driven: 12, acting: 6, delayed: 6 * (given.turn.mostDelay + 1) })) {
    if (place(name)) for (let k = 0; k < size; k += 6) numbers(name, size).set(forces, k);
  }
  if (hand.forces) setForces(hand.forces);
  if (hand.wanted) tune(hand.wanted);
};
const setForces = (values) => {
  numbers("feedforward", 6).set(values);
  log({ kind: "forces", values });
};
const tune = (wanted) => {
  const field = numbers("turn_wanted", wanted.length), before = field.slice();
  field.set(wanted.map((value) => value ?? Infinity));
  const status = Number(c.machine_turn(at));
  if (status) field.set(before);
  else log({ kind: "tuned", wanted, used: used() });
  return status;
};
// An element of a load, now and at all changes.
const put = (name, k, by) => {
  const { own, later, size, parts, sum, table } = LOADS[name], changes = given.changes;
  const past = later ? changes.filter((change) => change < row).length : 0;
  if (!own.length) return;
  const first = given.sizes[parts[0]], [part, i] = k < first ? [parts[0], k] : [parts[1], k - first];
  numbers(part, i + 1)[i] = sum(past ? later[(past - 1) * size + k] : own[k], by);
  for (let j = 0; later && j < changes.length; j++) numbers(table, later.length)[j * size + k] = sum(later[j * size + k], by);
  log({ kind: name, place: k, by });
};
// real time counts from here
const hold = () => { origin = clock(); from = row; };
const thin = () => Math.max(1, Math.round(0.001 / given.plantStep));
const ringRows = () => Math.min(60001, Math.ceil(MINUTE / given.plantStep / thin()) + 1);
const wholeSamples = (rows) => Math.ceil(rows / given.every) * given.every;

// Of a step's response (y - from) / by: rise from 10 to 90 %, the largest, and what is left at the end of the watch.
const follow = (index, pose) => {
  const y = (pose - step.from) / step.by, time = (index - step.row) * given.plantStep;
  if (step.low === null && y >= 0.1) step.low = time;
  if (step.high === null && y >= 0.9) step.high = time;
  step.highest = Math.max(step.highest, y);
  if (time < WATCHED) return;
  const rise = step.high === null ? null : step.high - step.low;
  postMessage({ type: "response", axis: step.axis, by: step.by, rise, overshoot: Math.max(0, step.highest - 1), last: y });
  step = null;
};

// Rows to before `to`, at most what a call keeps; points of them for curves, and the last row. Plain loops over numbers:
// at a hundred times real time, views and callbacks for each row take as long as the row.
const advance = (to, points, every) => {
  const most = Math.floor(given.kept / given.every) * given.every || given.kept, skipped = row % given.every;
  const first = row, ran = Number(c.machine_run(at, BigInt(Math.min(to, row + most)))), end = Number(c.machine_ended(at));
  ended = end >= 0 || ran === first;
  if (ended) session.failure = Number(c.machine_failure(at));
  // the row of its end is the last one
  const next = end < 0 ? ran : Math.max(end + 1, first);
  const n = next - first, signals = numbers("row_signals", 24 * n), forces = numbers("row_forces", 6 * n);
  const flags = new Uint8Array(c.memory.buffer, place("row_force_limited"), 6 * n);
  const planned = place("plan_reference") ? numbers("plan_reference", 30 * (skipped + n)) : null, { ring } = session, nth = thin();
  for (let k = 0; k < n; k++) {
    const index = first + k, time = index * given.plantStep;
    let mask = 0;
    for (let leg = 0; leg < 6; leg++) {
      if (flags[6 * k + leg]) mask |= 1 << leg;
      limited[leg] = flags[6 * k + leg] ? limited[leg] + given.plantStep : 0;
    }
    if (step) follow(index, signals[24 * k + step.axis]);
    if (index % nth === 0) {
      const place = (session.ringed++ * KEPT) % ring.length;
      ring[place] = time;
      for (let i = 0; i < 24; i++) ring[place + 1 + i] = signals[24 * k + i];
      for (let i = 0; i < 6; i++) ring[place + 25 + i] = forces[6 * k + i];
      if (planned) for (let i = 0; i < 24; i++) ring[place + 31 + i] = planned[30 * (skipped + k) + i];
      ring[place + 55] = mask;
    }
    if (index % every !== 0 && !((ended || next >= to) && k === n - 1)) continue;
    points.push(time);
    for (let i = 0; i < 6; i++) points.push(signals[24 * k + i]);
    for (let i = 0; i < 6; i++) points.push(signals[24 * k + 12 + i]);
    for (let i = 0; i < 6; i++) points.push(forces[6 * k + i]);
    for (let i = 0; i < 6; i++) points.push(planned ? planned[30 * (skipped + k) + i] : NaN);
    points.push(mask);
  }
  row = next;
};

const tell = (points) => {
  const values = new Float64Array(points), cut = place("cut") ? [...numbers("cut", 6)] : [];
  const { failure } = session;
  postMessage({ type: "rows", points: values, size: SIZE, time: row * given.plantStep, limited: [...limited], lost, cut, ended, failure, speed }, [values.buffer]);
};
const tick = () => {
  timer = null;
  if (!playing || ended) return;
  const begun = clock(), points = [], fast = !Number.isFinite(speed);
  let to = fast ? Infinity : wholeSamples(from + Math.floor((begun - origin) / 1000 * speed / given.plantStep));
  if (!fast && begun - origin > 0 && to - row > BEHIND / 1000 * speed / given.plantStep) {
    lost += (to - row) * given.plantStep / speed;
    hold();
    to = row + given.every;
  }
  // a point of the curves every 5 ms, or 20 ms where a chart's seconds go by in no time
  const every = Math.max(1, Math.round((fast ? 0.02 : 0.005) / given.plantStep), fast ? 0 : Math.ceil((to - row) / POINTS));
  while (row < to && !ended && (clock() - begun < BUDGET || row % given.every)) advance(Number.isFinite(to) ? to : row + given.kept, points, every);
  if (points.length || ended) tell(points);
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
// Poles and margins of the loop as it is, once nothing has been tuned for a moment.
const analyse = (after) => {
  clearTimeout(analysis);
  analysis = setTimeout(() => {
    if (!given.turn.margins || Number(c.machine_margins(at))) return;
    postMessage({ type: "margins", values: numbers("turn_results", given.turn.poles + 4 * given.turn.most).slice() });
  }, after);
};
// Whether the hand has the reference: from its first target on, if the machine plans its motion.
const takes = () => {
  if (!given.canTake) return false;
  if (!session.isByHand) {
    c.machine_take(at);
    step = null;
    session.isByHand = true;
  }
  return true;
};
const logTarget = (jumps) => log({ kind: "target", values: [...numbers("plan_target", 6)], jumps });

const answers = {
  open: async (message) => {
    given = message.data;
    const module = unpacked(given.wasm);
    start = await unpacked(given.block);
    const { instance } = await WebAssembly.instantiate(await module, {});
    c = instance.exports;
    if (c._initialize) c._initialize();
    at = (c.__heap_base.value + 15) & ~15;
    c.memory.grow(Math.ceil((at + start.byteLength) / 65536));
    begin();
    postMessage({ type: "ready" });
    analyse(300);
  },
  run: (message) => {
    stop();
    ({ playing } = message);
    speed = message.speed ?? Infinity;
    hold();
    again();
  },
  again: () => {
    stop();
    begin();
    again();
  },
  // a payload, gravity, a push: to the experiment's own; faults: 1 or 0
  add: ({ name, from: first, values }) => values.forEach((by, k) => {
    hand[name].set(first + k, by);
    put(name, first + k, by);
  }),
  forces: ({ values }) => {
    hand.forces = values;
    if (row) setForces(values);
    else beginAs();
  },
  // settings of the loop: 0, or 1 and the position of the first that is refused
  tune: ({ values }) => {
    const status = tune(values);
    if (!status) hand.wanted = values;
    if (!status && !row) beginAs();
    postMessage({ type: "tuned", status });
    analyse(120);
  },
  target: ({ values }) => {
    if (!takes()) return;
    numbers("plan_target", 6).set(values);
    logTarget(0);
  },
  // the reference jumps along one axis: a step, past the hand's filter
  jump: ({ axis, by }) => {
    if (!takes()) return;
    const target = numbers("plan_target", 6), smoothed = numbers("plan_smoothed", 18);
    step = { axis, by, from: smoothed[axis], row, low: null, high: null, highest: 0 };
    target[axis] += by;
    smoothed[axis] += by;
    logTarget(1);
  },
  // some rows at once, by no clock
  some: ({ rows }) => {
    const points = [], to = wholeSamples(row + rows), every = Math.max(1, Math.round(0.005 / given.plantStep), Math.ceil(rows / POINTS));
    while (row < to && !ended) advance(to, points, every);
    hold();
    tell(points);
    postMessage({ type: "advanced" });
  },
  files: ({ ofCrash }) => postMessage({ type: "written", files: filesOf(given, ofCrash && crashed ? crashed : { ...session, row }) }),
  state: () => postMessage({ type: "state", memory: c.memory.buffer.byteLength, row, lost, inputs: [...numbers("inputs", given.sizes.inputs)] }),
};
let done = Promise.resolve();
onmessage = ({ data }) => {
  done = done.then(() => answers[data.type](data)).catch((error) => postMessage({ type: "failed", text: String(error.message || error) }));
};
