"use strict";
// The legend of a chart: a sample, a name and the value at the cursor for each series; a click picks a series everywhere.
(() => {
  const GS = GoughStewart, { element, page, state } = GS;

  const sample = ({ colour, dashes, offset }, width, isBlock, alpha = 1) => {
    const found = element("span", { class: "sample", "aria-hidden": "true" });
    const shape = isBlock
      ? `<rect x="8" width="12" height="10" fill="${colour}" fill-opacity="${alpha}"/>`
      : `<line x1="0" y1="5" x2="28" y2="5" stroke="${colour}" stroke-width="${width}" stroke-dasharray="${dashes.join(" ")}" stroke-dashoffset="${offset || 0}"/>`;
    found.innerHTML = `<svg width="28" height="10" viewBox="0 0 28 10">${shape}</svg>`;
    return found;
  };
  const named = (series) => (series.run !== undefined && page.runs.length > 1 && !series.name.includes(page.runs[series.run]) ? `${series.name} · ${page.runs[series.run]}` : series.name);

  // The series whose reference this is; −1 if it is none.
  const ownerOf = (chart, series) => (series.role !== "reference" ? -1 : chart.series.findIndex((each) =>
    each.role !== "reference" && each.run === series.run && each.leg === series.leg && each.component === series.component));

  const pick = (series) => {
    if (series.leg !== undefined) GS.pickLeg(series.leg);
    else GS.set({ picked: state.picked === GS.keyOf(series) ? null : GS.keyOf(series), leg: null });
  };

  const swatch = (run) => element("i", { style: `background:var(--six-${run % 6})`, "aria-hidden": "true" });
  // Of several runs: one item per component with the values of all runs, after the colours of the runs.
  const ofRuns = (panel) => {
    const { chart } = panel, { ink } = GS.theme(), items = new Map(), runs = new Set();
    chart.series.forEach((series, k) => {
      const owner = ownerOf(chart, series), name = owner >= 0 ? "reference" : series.component || series.name;
      runs.add(series.run);
      if (!items.has(name)) {
        const { dashes } = GS.look(chart, series);
        const button = element("button", { type: "button", title: `pick ${name} in all charts`, onclick: () => pick(series) }, sample({ colour: ink, dashes }, 2, false), element("span", {}, name));
        items.set(name, { button, item: element("li", {}, button), isLast: owner >= 0 });
      }
      const { button, item } = items.get(name), value = element("output", { class: "value" });
      if (owner < 0) item.append(swatch(series.run), value);
      panel.items.push({ series, button, item, value, index: owner >= 0 ? -1 : k, beside: -1 });
    });
    const all = [...items.values()].sort((a, b) => a.isLast - b.isLast);
    return [...[...runs].map((run) => element("li", { class: "run" }, swatch(run), page.runs[run])), ...all.map(({ item }) => item)];
  };

  // Fills the list of a panel.
  GS.legend = (panel) => {
    const { chart, key } = panel, isBlock = !["line", "step"].includes(chart.kind);
    panel.items = [];
    const rows = [], last = [];
    if (panel.figure?.heat) rows.push(...GS.heatLegend(panel));
    const several = !isBlock && page.runs.length > 1 && chart.series.every((series) => series.run !== undefined);
    if (several) rows.push(...ofRuns(panel));
    else chart.series.forEach((series, k) => {
      if (chart.kind === "heat") return;
      const look = GS.look(chart, series), owner = ownerOf(chart, series);
      // many references look the same: one sample is enough, and each value stands beside its series
      if (owner >= 0 && chart.series.some((each, j) => j < k && ownerOf(chart, each) >= 0 && GS.look(chart, each).colour === look.colour)) return;
      // bands lie over each other, the widest first
      const shade = series.role === "band" ? 1 - 0.78 ** chart.series.slice(0, k + 1).filter((each) => each.role === "band").length : 1;
      const value = element("output", { class: "value" });
      const button = element("button", { type: "button", title: `pick ${named(series)} in all charts`, onclick: () => pick(series) }, sample(look, look.width + 0.5, isBlock || series.role === "band", shade), element("span", {}, owner >= 0 ? "reference" : named(series)));
      const item = element("li", {}, button, ...(owner >= 0 ? [] : [value]));
      const beside = owner >= 0 ? -1 : chart.series.findIndex((each) => ownerOf(chart, each) === k);
      panel.items.push({ series, button, item, value, index: owner >= 0 ? -1 : k, beside });
      (owner >= 0 ? last : rows).push(item);
    });
    rows.push(...last);
    for (const mark of chart.marks) {
      const colour = GS.theme().roles[mark.role], axis = mark.vertical ? chart.x : chart.y;
      const text = mark.said ? mark.text : `${mark.text} ${GS.short(mark.value * axis.factor)} ${axis.unit}`;
      rows.push(element("li", { class: "mark" }, sample({ colour, dashes: page.dashes[mark.role].map((d) => 3 * d) }, 1.6, false), text.trim()));
    }
    for (const { name, role, share } of chart.strips) {
      const look = { colour: GS.theme().roles[role], dashes: [] };
      rows.push(element("li", { class: "mark" }, sample(look, 2, true), `${name}, ${share}`));
    }
    key.replaceChildren(...rows);
    GS.legendState(panel);
    GS.markedKey(panel);
  };
  GS.legendState = (panel) => {
    for (const { series, button, item } of panel.items || []) {
      const stands = GS.emphasis(series);
      button.setAttribute("aria-pressed", String(stands > 0));
      item.classList.toggle("pale", stands < 0);
      if (page.runs.length < 2) item.hidden = GS.isHidden(series);
    }
  };

  // A value without digits below the resolution of display, which half of the smallest axis is.
  const shown = (value, { span, digits, labels }) => labels?.[value] ?? GS.short(Math.round(2 * value / span) * span / 2, digits);
  // The values at an abscissa, for lines; the nearest row at or before it.
  GS.legendValues = (panel, x) => {
    if (!panel.figure?.isFunction) return;
    const { y, series: all } = panel.chart;
    for (const { value, index, beside } of panel.items || []) {
      if (index < 0) continue;
      const { numbers } = panel.figure.parts[index], row = x === null ? -1 : GS.rowAt(numbers.x, x + 1e-9 * Math.abs(x));
      const at = row < 0 ? NaN : numbers.y[row], low = row >= 0 && numbers.low ? numbers.low[row] : NaN;
      const one = Number.isFinite(at) ? shown(at, y) : row < 0 ? "" : "–";
      const wanted = beside >= 0 && row >= 0 ? ` (${shown(panel.figure.parts[beside].numbers.y[row], y)})` : "";
      const text = Number.isFinite(low) && all[index].role === "band" ? `${shown(low, y)} … ${shown(numbers.high[row], y)}` : one + wanted;
      if (value.textContent !== text) value.textContent = text;
    }
  };
})();
