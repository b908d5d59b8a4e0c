"use strict";
// Lines of a panel, from a signal and the reader's choices: colours, dashes, names, ranges.
(() => {
  const GS = GoughStewart;
  const { signals } = GS.page.chart, { colours } = GS.page, runs = GS.records.length;
  const DASHES = ["solid", "9px,4px", "14px,3px,3px,3px", "4px,4px", "12px,3px,3px,3px,3px,3px", "20px,5px"];
  const REFERENCE = "1.5px,3px", WIDTH = 1.6, NEAR = 0.02, AIR = 0.06;

  // the reader's choices: one leg or axis (null for all), and the run to compare with (or null)
  GS.choices = { legs: null, axes: null, from: null };

  // Names of components as text: "x, y", "legs 1–3, 5".
  const words = (signal, members) => {
    if (signal.kind !== "legs") return members.map((k) => signal.components[k]).join(", ");
    const parts = [];
    for (const k of members) {
      const last = parts[parts.length - 1];
      if (last && last[1] === k - 1) last[1] = k; else parts.push([k, k]);
    }
    const texts = parts.map(([a, b]) => (a === b ? `${a + 1}` : `${a + 1}${b === a + 1 ? ", " : "–"}${b + 1}`));
    return `${members.length > 1 ? "legs" : "leg"} ${texts.join(", ")}`;
  };
  // A line equal to that of an earlier record is stored once.
  const owner = (lines, run) => (typeof lines[run] === "number" ? lines[run] : run);
  // plotly.js interprets some HTML and templates
  const plain = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll("%{", "%&#123;");
  const numbers = (packed, sign = 1) => ({ x: GS.numbers(packed.x), y: sign < 0 ? GS.numbers(packed.y).map((v) => -v) : GS.numbers(packed.y) });
  const isChosen = (signal, members) => {
    const chosen = GS.choices[signal.kind];
    return chosen === null || chosen === undefined || members.includes(chosen);
  };

  // The groups of components in a panel, each with its dash and, for a single run, its colour.
  const entries = (signal) => {
    const set = GS.choices.from === null ? signal.curves : signal.differences;
    return set.groups.map((members, group) => ({ group, members })).filter(({ members }) => isChosen(signal, members))
      .map((entry, k) => {
        const [first] = entry.members, turn = Math.floor(first / colours.length);
        return {
          ...entry, key: words(signal, entry.members), name: words(signal, entry.members),
          colour: runs > 1 ? null : colours[first % colours.length],
          dash: DASHES[(runs > 1 ? k : turn) % DASHES.length],
        };
      });
  };

  const curvesOf = (signal, entry, seen) => {
    const { from } = GS.choices, found = [];
    for (let run = 0; run < runs; run++) {
      if (!seen(run) || run === from) continue;
      const { lines } = from === null ? signal.curves : signal.differences;
      const line = from === null ? lines[owner(lines, run)] : lines[`${Math.min(run, from)},${Math.max(run, from)}`];
      if (!line) continue;
      const minus = from === null ? "" : ` − ${GS.records[from].name}`;
      const which = runs > 1 ? ` · ${GS.records[run].name}${minus}` : "";
      found.push({
        ...numbers(line[entry.group], from !== null && run < from ? -1 : 1),
        name: entry.name + which, run, key: entry.key,
        line: { color: entry.colour || colours[run], dash: entry.dash, width: WIDTH, shape: signal.holds ? "hv" : "linear" },
      });
    }
    return found;
  };

  // A reference shared by runs has the colour of text; a reference of one run has that run's colour.
  const referencesOf = (signal, seen, ink) => {
    const reference = GS.choices.from === null && signals[signal.reference];
    if (!reference) return [];
    const { groups, lines } = reference.curves, owners = new Set(), found = [];
    const isAlone = (run) => lines.filter((each, k) => each !== null && owner(lines, k) === owner(lines, run)).length === 1;
    for (let run = 0; run < runs; run++) {
      if (!seen(run) || lines[run] === null || owners.has(owner(lines, run))) continue;
      owners.add(owner(lines, run));
      groups.forEach((members, group) => {
        if (!isChosen(signal, members)) return;
        const line = { color: runs > 1 && isAlone(run) ? colours[run] : ink, dash: REFERENCE, width: 1.4 };
        found.push({ ...numbers(lines[owner(lines, run)][group]), name: "reference", run, key: "reference", line });
      });
    }
    return found;
  };

  // The range of values, at least the display resolution, and the limits near enough to be shown.
  const rangeOf = (signal, shown) => {
    const { least } = GS.choices.from === null ? signal.curves : signal.differences;
    let low = Infinity, high = -Infinity;
    for (const { y } of shown) for (const value of y) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
    if (!(low <= high)) [low, high] = [0, 0];
    const [smallest, largest] = [low, high], near = Math.max(high - low, NEAR * Math.max(Math.abs(low), Math.abs(high)), least);
    const limits = GS.choices.from === null ? signal.limits.filter((limit) => low - near <= limit && limit <= high + near) : [];
    [low, high] = [Math.min(low, ...limits), Math.max(high, ...limits)];
    const span = Math.max(high - low, least), middle = low + (high - low) / 2;
    return { range: [-1, 1].map((side) => middle + side * (0.5 + AIR) * span), limits, smallest, largest };
  };

  // All that a panel draws; `hidden` has the keys that the reader has switched off, `seen(run)` is true for visible runs.
  GS.linesOf = (signal, hidden, seen, ink) => {
    const all = entries(signal), references = referencesOf(signal, seen, ink);
    const curves = [...all.flatMap((entry) => curvesOf(signal, entry, seen)), ...references].filter((line) => !hidden.has(line.key));
    const { least } = GS.choices.from === null ? signal.curves : signal.differences;
    const digits = signal.holds ? 0 : Math.min(Math.max(0, Math.ceil(-Math.log10(least))), 9);
    const traces = curves.map(({ x, y, name, key, line, run }) => ({
      type: "scatter", x, y, name: plain(name), meta: { run, key },
      mode: x.length > 1 ? "lines" : "markers",
      // otherwise plotly.js omits points that it considers collinear
      line: { ...line, simplify: false },
      ...(key === "reference" ? { hoverinfo: "skip" } : { hovertemplate: `${plain(name)}: %{y:.${digits}~f}<extra></extra>` }),
    }));
    return { entries: all, hasReference: references.length > 0, traces, digits, ...rangeOf(signal, curves) };
  };
  GS.referenceDash = REFERENCE;
})();
