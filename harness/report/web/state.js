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

  // The address holds them: report.html#t=1.5&zoom=1,2&mark=1.2,1.4&leg=3
  const digits = (x) => String(Number(x.toPrecision(9)));
  GS.link = () => {
    const parts = [`t=${digits(state.time)}`];
    if (state.zoom) parts.push(`zoom=${state.zoom.map(digits).join(",")}`);
    if (state.region) parts.push(`mark=${state.region.map(digits).join(",")}`);
    if (state.leg) parts.push(`leg=${state.leg}`);
    if (state.picked) parts.push(`pick=${encodeURIComponent(state.picked)}`);
    if (state.members) parts.push(`members=${[...state.members].join(",")}`);
    if (state.slice !== null) parts.push(`slice=${state.slice}`);
    if (state.hiddenRuns.size) parts.push(`without=${[...state.hiddenRuns].join(",")}`);
    return parts.join("&");
  };
  let waiting = 0;
  const remember = () => {
    if (state.playing) return;
    clearTimeout(waiting);
    waiting = setTimeout(() => { try { history.replaceState(null, "", `#${GS.link()}`); } catch { /* some viewers of files forbid it */ } }, 250);
  };
  // What the address asks for; true if it says where to stand.
  GS.follow = (address) => {
    const asked = new Map(address.replace(/^#/, "").split("&").map((part) => part.split("=")).filter((pair) => pair.length === 2));
    const numbers = (name) => (asked.get(name) || "").split(",").filter(Boolean).map(Number).filter(Number.isFinite);
    const [time] = numbers("t"), zoom = numbers("zoom"), marked = numbers("mark"), [leg] = numbers("leg"), [slice] = numbers("slice");
    GS.zoomTo(zoom.length === 2 ? zoom : null);
    GS.mark(marked.length === 2 ? marked : null);
    GS.set({
      leg: leg >= 1 && leg <= 6 ? leg : null, picked: asked.has("pick") ? decodeURIComponent(asked.get("pick")) : null,
      slice: Number.isInteger(slice) && slice >= 0 ? slice : null,
      members: asked.has("members") ? new Set(numbers("members")) : null, hiddenRuns: new Set(numbers("without")),
    });
    if (time !== undefined) GS.set({ time: Math.min(Math.max(time, state.start), state.end) });
    return time !== undefined;
  };
  GS.toggleRun = (run) => {
    const hidden = new Set(state.hiddenRuns);
    if (!hidden.delete(run)) hidden.add(run);
    GS.set({ hiddenRuns: hidden });
  };
})();
