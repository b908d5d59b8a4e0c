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

  // Series that share an item: those of a component of several runs, and references that look the same.
  const grouped = (chart, several) => {
    const groups = new Map();
    chart.series.forEach((series, k) => {
      const isReference = ownerOf(chart, series) >= 0, look = GS.look(series), own = several ? series.component || series.name : named(series);
      const name = isReference ? "reference" : own, key = several ? name : isReference ? `reference ${look.colour}` : k;
      if (!groups.has(key)) groups.set(key, { name, isReference, look: several ? { ...look, colour: GS.theme().ink, width: 1.5 } : look, indices: [] });
      if (several || !isReference || !groups.get(key).indices.length) groups.get(key).indices.push(k);
    });
    return [...groups.values()].sort((a, b) => a.isReference - b.isReference);
  };

  // Fills the list of a panel; of several runs, an item has the values of all, after the colours of the runs.
  GS.legend = (panel) => {
    const { chart, key } = panel, isBlock = !["line", "step"].includes(chart.kind), isHeat = chart.kind === "heat";
    const several = !isBlock && page.runs.length > 1 && chart.series.every((series) => series.run !== undefined), rows = [];
    panel.items = [];
    if (panel.figure?.heat) rows.push(...GS.heatLegend(panel));
    if (several) rows.push(...[...new Set(chart.series.map((series) => series.run))].map((run) => element("li", { class: "run" }, swatch(run), page.runs[run])));
    for (const { name, isReference, look, indices } of isHeat ? [] : grouped(chart, several)) {
      const [first] = indices, isBand = chart.series[first].role === "band";
      // bands lie over each other, the widest first
      const shade = isBand ? 1 - 0.78 ** chart.series.slice(0, first + 1).filter((each) => each.role === "band").length : 1;
      const button = element("button", { type: "button", title: `pick ${name} in all charts`, onclick: () => pick(chart.series[first]) }, sample(look, look.width + 0.5, isBlock || isBand, shade), element("span", {}, name));
      const item = element("li", {}, button);
      for (const k of indices) {
        const series = chart.series[k], value = element("output", { class: "value" }), beside = several ? -1 : chart.series.findIndex((each) => ownerOf(chart, each) === k);
        if (!isReference) item.append(...(several ? [swatch(series.run)] : []), value);
        panel.items.push({ series, button, item, value, index: isReference ? -1 : k, beside });
      }
      rows.push(item);
    }
    const mark = (role, dashes, width, text) => element("li", { class: "mark" }, sample({ colour: GS.theme().roles[role], dashes }, width, !width), text);
    rows.push(...chart.marks.map(({ role, dashes, text }) => mark(role, dashes, 1.6, text)));
    rows.push(...chart.strips.map(({ name, role, share }) => mark(role, [], 0, `${name}, ${share}`)));
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

  // A value without digits below the resolution of display, half of the smallest axis, or of the curve.
  const shown = (value, { span, least, digits, labels }) => {
    const step = Math.max(span / 2, least);
    return labels?.[value] ?? GS.short(Math.round(value / step) * step, digits);
  };
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
