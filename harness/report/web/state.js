"use strict";
// What all views of the page share: time, marked time, zoom, picked leg and members; and the link that holds them.
(() => {
  const GS = GoughStewart, listeners = {};
  // time is set when the first records are known; hover is a time under the pointer, or null
  const state = {
    start: 0, end: 0, time: 0, hover: null, playing: false, speed: 1,
    region: null, zoom: null, leg: null, picked: null, members: null, slice: null, hiddenRuns: new Set(),
  };
  const same = (a, b) => a === b || (Array.isArray(a) && Array.isArray(b) && a.every((x, k) => x === b[k]))
    || (a instanceof Set && b instanceof Set && a.size === b.size && [...a].every((x) => b.has(x)));
  GS.state = state;
  // the scenes, once they are unpacked
  GS.records = [];
  // call back when one of these names changes
  GS.on = (names, callback) => { for (const name of names.split(" ")) (listeners[name] ??= new Set()).add(callback); };
  GS.set = (changes) => {
    const called = new Set();
    for (const [name, value] of Object.entries(changes)) {
      if (same(state[name], value)) continue;
      state[name] = value;
      for (const callback of listeners[name] || []) called.add(callback);
    }
    for (const callback of called) callback();
    if (called.size && !("hover" in changes)) remember();
  };
  // the time that charts and scene show
  GS.shownTime = () => (state.hover !== null && !state.playing ? state.hover : state.time);
  // the range of time of all charts
  GS.range = () => state.zoom || [state.start, state.end];
  const inside = ([a, b]) => {
    const [low, high] = [Math.max(Math.min(a, b), state.start), Math.min(Math.max(a, b), state.end)];
    return high > low ? [low, high] : null;
  };
  GS.mark = (region) => GS.set({ region: region && inside(region) });
  GS.zoomTo = (range) => {
    const found = range && inside(range);
    const whole = !found || (found[0] <= state.start && found[1] >= state.end);
    // no closer than a millionth of the whole
    const tooClose = found && found[1] - found[0] < 1e-6 * (state.end - state.start);
    if (!tooClose) GS.set({ zoom: whole ? null : found });
  };
  GS.pickLeg = (leg) => GS.set({ leg: state.leg === leg ? null : leg, picked: null });

  // The address holds them, as in report.html#t=1.5&zoom=1,2&mark=1.2,1.4&leg=3: how each is written, "" if it is not, and
  // how its numbers, or its text, are followed.
  const digits = (x) => String(Number(x.toPrecision(9))), listed = (values) => [...values ?? []].map(digits).join(",");
  const pair = (numbers) => (numbers.length === 2 ? numbers : null);
  const KEPT = {
    t: [() => digits(state.time), ([time]) => { if (time !== undefined) GS.set({ time: Math.min(Math.max(time, state.start), state.end) }); }],
    zoom: [() => listed(state.zoom), (ends) => GS.zoomTo(pair(ends))],
    mark: [() => listed(state.region), (ends) => GS.mark(pair(ends))],
    leg: [() => String(state.leg ?? ""), ([leg]) => GS.set({ leg: leg >= 1 && leg <= 6 ? leg : null })],
    pick: [() => encodeURIComponent(state.picked ?? ""), (_, text) => GS.set({ picked: text ? decodeURIComponent(text) : null })],
    members: [() => listed(state.members), (ids) => GS.set({ members: ids.length ? new Set(ids) : null })],
    slice: [() => String(state.slice ?? ""), ([slice]) => GS.set({ slice: Number.isInteger(slice) && slice >= 0 ? slice : null })],
    without: [() => listed(state.hiddenRuns), (runs) => GS.set({ hiddenRuns: new Set(runs) })],
  };
  GS.link = () => Object.entries(KEPT).map(([name, [write]]) => [name, write()]).filter(([, text]) => text).map((part) => part.join("=")).join("&");
  let waiting = 0;
  const remember = () => {
    if (state.playing) return;
    clearTimeout(waiting);
    waiting = setTimeout(() => { try { history.replaceState(null, "", `#${GS.link()}`); } catch { /* some viewers of files forbid it */ } }, 250);
  };
  // What the address asks for; true if it says where to stand.
  GS.follow = (address) => {
    const asked = new Map(address.replace(/^#/, "").split("&").map((part) => part.split("=")));
    const numbers = (name) => (asked.get(name) || "").split(",").filter(Boolean).map(Number).filter(Number.isFinite);
    for (const [name, [, follow]] of Object.entries(KEPT)) follow(numbers(name), asked.get(name));
    return numbers("t").length > 0;
  };
  GS.toggleRun = (run) => {
    const hidden = new Set(state.hiddenRuns);
    if (!hidden.delete(run)) hidden.add(run);
    GS.set({ hiddenRuns: hidden });
  };
})();
