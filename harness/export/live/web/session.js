"use strict";
// A session as files: its rows as a record, and an experiment that does the same, with what a hand did at its times.
const bare = (key) => (/^[\w-]+$/.test(key) ? key : JSON.stringify(key));
const isTable = (value) => value !== null && typeof value === "object" && !Array.isArray(value);
const entriesOf = (table) => Object.entries(table).filter(([, value]) => value !== null && value !== undefined);
const inline = (value) => {
  if (Array.isArray(value)) return `[${value.map(inline).join(", ")}]`;
  if (isTable(value)) return `{ ${entriesOf(value).map(([key, inner]) => `${bare(key)} = ${inline(inner)}`).join(", ")} }`;
  return typeof value === "number" && !Number.isFinite(value) ? (value > 0 ? "inf" : "-inf") : JSON.stringify(value);
};
// TOML of plain values: keys, then tables and lists of tables; what is deeper is written inline.
const toml = (file) => {
  const isList = (value) => Array.isArray(value) && value.length > 0 && value.every(isTable);
  const lines = (table) => entriesOf(table).map(([key, value]) => `${bare(key)} = ${inline(value)}\n`).join("");
  const parts = [lines(Object.fromEntries(entriesOf(file).filter(([, value]) => !isTable(value) && !isList(value))))];
  for (const [key, value] of entriesOf(file)) {
    if (isTable(value)) parts.push(`\n[${bare(key)}]\n${lines(value)}`);
    else if (isList(value)) parts.push(...value.map((element) => `\n[[${bare(key)}]]\n${lines(element)}`));
  }
  return parts.join("");
};

const filesOf = (given, session) => {
  const { download, turn, plantStep, every, sizes } = given, { events, own } = session, GRAVITY = [0, 1, 2];
  const file = structuredClone(download.experiment), time = (row) => Number((row * plantStep).toPrecision(12));
  let end = Math.ceil(session.row / every) * every;
  if (given.endsWithRun) end = Math.min(end, Math.round(given.duration / plantStep));
  const duration = time(end), ofKind = (...kinds) => events.filter(({ kind, row }) => kinds.includes(kind) && row < end);
  // of what holds from a row on, the last that was said there
  const atRows = (found) => [...new Map(found.map((event) => [event.row, event])).values()];
  for (const name of ["change", "disturbance", "fault"]) if (file[name]) file[name] = file[name].filter(({ at }) => at < duration);
  const add = (name, table) => (file[name] ??= []).push(table);

  // the keys of settings that differ
  const named = (wanted) => Object.fromEntries(turn.names.map((name, k) => [name, wanted[k]])), original = named(turn.wanted);
  const controllerOf = (now, used) => {
    const controller = structuredClone(download.experiment.controller), isScaled = ["proportional", "derivative", "integral"].some((name) => now[name] !== 1);
    const gains = ["proportional_gain", "derivative_gain", "integral_gain"], rules = ["bandwidth", "damping_ratio", "integral_time"];
    if (isScaled && used.length) {
      for (const key of rules) delete controller[key];
      gains.slice(0, turn.integral ? 3 : 2).forEach((key, k) => { controller[key] = used.slice(6 * k, 6 * k + 6); });
      controller.derivative_filter = used[18];
    } else if (now.bandwidth > 0 && rules.some((name) => now[name] !== original[name])) {
      for (const key of gains) delete controller[key];
      for (const key of rules.slice(0, turn.integral ? 3 : 2)) controller[key] = now[key];
    }
    if (now.filter_time > 0) controller.derivative_filter = now.filter_time;
    return controller;
  };
  const settingsOf = (now, used, before) => {
    const differ = (...names) => names.some((name) => now[name] !== before[name]), encoders = (name) => (differ(name) ? { leg_length: now[name] } : undefined);
    return {
      controller: turn.gains && differ(...turn.names.slice(0, 7)) ? controllerOf(now, used) : undefined,
      delay: differ("delay") ? now.delay : undefined, force_limit: differ("force_limit") ? now.force_limit ?? "none" : undefined,
      noise: encoders("noise"), quantisation: encoders("quantisation"),
    };
  };
  let before = original;
  for (const { row, wanted, used } of atRows(ofKind("tuned"))) {
    const now = named(wanted), { controller, delay, force_limit, ...sensors } = settingsOf(now, used, before);
    before = now;
    if (row) {
      const settings = entriesOf({ controller, delay, force_limit, noise: sensors.noise && { ...file.sensors?.noise, ...sensors.noise }, quantisation: sensors.quantisation && { ...file.sensors?.quantisation, ...sensors.quantisation } });
      if (settings.length) add("change", { at: time(row), ...Object.fromEntries(settings) });
      continue;
    }
    if (controller) file.controller = controller;
    if (delay !== undefined) file.loop.delay = delay;
    if (force_limit !== undefined) file.actuators = { ...file.actuators, force_limit };
    for (const [key, sizes] of entriesOf(sensors)) file.sensors = { ...file.sensors, [key]: { ...file.sensors?.[key], ...sizes } };
  }
  for (const { row, values } of atRows(ofKind("forces"))) {
    const controller = { ...download.experiment.controller, force: values };
    if (row) add("change", { at: time(row), controller });
    else file.controller = controller;
  }

  // payload and gravity: what the experiment has at a row, and what the hand adds
  const loads = ofKind("parameters"), places = { platform_mass: [given.mass], gravity: GRAVITY.map((k) => given.gravity + k) };
  const ownAt = (row, k) => {
    const past = given.changes.filter((change) => change <= row).length;
    return past ? own.later[(past - 1) * sizes.parameters + k] : own.first[k];
  };
  const addedAt = (row, k) => loads.filter((load) => load.place === k && load.row <= row).at(-1)?.by ?? 0;
  const loadedAt = (row, names) => Object.fromEntries(names.map((name) => {
    const values = places[name].map((k) => ownAt(row, k) + addedAt(row, k));
    return [name, name === "gravity" ? values : values[0]];
  }));
  const moved = Object.keys(places).filter((name) => loads.some(({ place }) => places[name].includes(place)));
  for (const change of file.change ?? []) {
    const names = moved.filter((name) => name in (change.parameters ?? {}) || name in (change.factors ?? {}));
    for (const name of names) if (change.factors) delete change.factors[name];
    if (names.length) change.parameters = { ...change.parameters, ...loadedAt(Math.round(change.at / plantStep), names) };
  }
  for (const { row } of atRows(loads)) add("change", { at: time(row), parameters: loadedAt(row, moved) });
  file.change?.sort((one, other) => one.at - other.at);

  // pushes, and what was cut or frozen: from when to when
  const spans = (found) => found.flatMap((event, k) => {
    const next = found[k + 1]?.row ?? end;
    return event.by && next > event.row ? [{ ...event, at: time(event.row), lasts: Number((time(next) - time(event.row)).toPrecision(12)), isLast: next === end }] : [];
  });
  for (let axis = 0; axis < 3; axis++) {
    const pushes = atRows(ofKind("inputs").filter(({ place }) => place === 6 + axis));
    for (const { at, lasts, by } of spans(pushes)) add("disturbance", { at, duration: lasts, force: GRAVITY.map((k) => (k === axis ? by : 0)) });
  }
  for (let place = 0; place < sizes["cut,frozen"]; place++) {
    const leg = place % 6 + 1, signal = place < 24 ? "leg_length" : "leg_velocity";
    if (place >= 6 && !given.reads.includes(signal)) continue;
    for (const { at, lasts, isLast } of spans(atRows(ofKind("faults").filter((event) => event.place === place)))) {
      add("fault", { at, ...(isLast ? {} : { duration: lasts }), ...(place < 6 ? { cut: [leg] } : { freeze: { [signal]: [leg] } }) });
    }
  }

  // the reference by hand
  const targets = ofKind("target"), files = {};
  if (targets.length) {
    file.reference = { type: "by_hand", file: "targets.csv", sample_time: turn.sampleTime, motion: file.reference };
    const lines = targets.map(({ row, values, jumps }) => [time(row), ...values, jumps].join(","));
    files["targets.csv"] = `time,x,y,z,roll,pitch,yaw,jumps\n${lines.join("\n")}\n`;
  }
  // it runs as it did: nobody asked whether the machine can follow, and a command has to act before the end
  if (events.length) file.limits = { ...file.limits, reference: "warn" };
  file.loop.duration = Math.max(duration, time(every * (Math.max(file.loop.delay ?? 0, 0) + 2)));

  // the rows of the last minute, the oldest first
  const size = 56, { ring } = session, kept = Math.min(session.ringed, ring.length / size), first = session.ringed - kept;
  const names = ["position", "orientation", "velocity", "angular_velocity", "leg_length", "leg_velocity"];
  const numbered = (name) => Array.from({ length: /^(leg|actuator|flag)/.test(name) ? 6 : 3 }, (_, k) => `${name}[${k + 1}]`);
  const columns = [...names, "actuator_force", ...(given.isOpen ? [] : names.map((name) => `reference.${name}`)), "flag.force_limited"];
  const header = ["time", ...columns.flatMap((name) => (name.startsWith("reference.leg") ? numbered(name.slice(10)).map((leg) => `reference.${leg}`) : numbered(name)))];
  const rows = Array.from({ length: kept }, (_, k) => {
    const row = ring.subarray((first + k) * size % ring.length, (first + k) * size % ring.length + size), flags = row[55];
    return [...row.subarray(0, given.isOpen ? 31 : 55), ...[0, 1, 2, 3, 4, 5].map((leg) => String(Boolean(flags & (1 << leg))))].join(",");
  });
  const last = kept ? ring[(session.ringed - 1) * size % ring.length] : 0, cause = given.failures[session.failure] ?? null;
  const status = session.failure ? (cause?.includes("stroke") ? "stopped" : "diverged") : "completed";
  const more = { rows: kept, duration: last, plant_step: Math.max(1, Math.round(0.001 / plantStep)) * plantStep, outcome: { status, time: last, cause } };
  return {
    "record.csv": `${[header.join(","), ...rows].join("\n")}\n`, "metadata.json": `${JSON.stringify({ ...download.metadata, ...more }, null, 2)}\n`,
    "experiment.toml": toml(file), ...files,
  };
};
