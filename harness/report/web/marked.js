"use strict";
// In charts over time of an ensemble: the band and the median of the marked members, and the worst of them as a line.
(() => {
  const GS = GoughStewart, { page, state } = GS;

  // The marked member with the largest value of the metric that the ensemble is judged by.
  const worstOf = async (ids) => {
    const { members } = page, [by] = members?.numbers || [];
    if (!by) return null;
    const [all, values] = await Promise.all([GS.array(members.ids), GS.array(by.values)]);
    let best = null;
    all.forEach((id, k) => {
      const badness = by.smallIsWorse ? -values[k] : values[k];
      if (ids.has(id) && Number.isFinite(badness) && (!best || badness > best.badness)) best = { id, badness };
    });
    return best && { id: best.id, text: `member ${best.id}: ${by.smallIsWorse ? "smallest" : "largest"} ${by.name}` };
  };
  const middle = (sorted) => (sorted.length ? (sorted[(sorted.length - 1) >> 1] + sorted[sorted.length >> 1]) / 2 : NaN);

  const curves = async (panel) => {
    const { samples, x: axis, y } = panel.chart, marked = state.members;
    if (!marked) return null;
    const [ids, x, values] = await Promise.all([samples.members, samples.x, samples.values].map(GS.array)), n = x.length;
    const rows = [...ids.keys()].filter((k) => marked.has(ids[k])), worst = await worstOf(new Set(rows.map((k) => ids[k])));
    const found = { x: x.map((v) => v * axis.factor), low: new Float64Array(n), high: new Float64Array(n), mid: new Float64Array(n), rows: rows.length, worst };
    for (let t = 0; t < n; t++) {
      const here = rows.map((k) => values[k * n + t] * y.factor).filter(Number.isFinite).sort((a, b) => a - b);
      found.low[t] = here[0] ?? NaN;
      found.high[t] = here.at(-1) ?? NaN;
      found.mid[t] = middle(here);
    }
    const at = worst ? ids.indexOf(worst.id) : -1;
    found.line = at < 0 ? x.map(() => NaN) : x.map((_, t) => values[at * n + t] * y.factor);
    return found;
  };

  // Draws them in a chart, or takes them away, and says what they are in its key.
  GS.markedBand = async (panel) => {
    if (!panel.chart.samples || !panel.figure) return;
    const found = await curves(panel), { figure } = panel.figure, F = (field) => ({ field });
    if (!panel.marked) {
      if (!found) return;
      const source = new Bokeh.ColumnDataSource({ data: { x: [], low: [], high: [], mid: [], line: [] } });
      panel.marked = {
        source, band: figure.varea({ x: F("x"), y1: F("low"), y2: F("high"), source }), mid: figure.line({ x: F("x"), y: F("mid"), source, line_width: 2 }),
        line: figure.line({ x: F("x"), y: F("line"), source, line_width: 1.6, line_dash: [5, 3] }),
      };
    }
    const { source, band, mid, line } = panel.marked, { roles } = GS.theme();
    band.glyph.setv({ fill_color: roles.nominal, fill_alpha: 0.35 });
    mid.glyph.line_color = roles.nominal;
    line.glyph.line_color = roles.bad;
    source.data = found ? { x: found.x, low: found.low, high: found.high, mid: found.mid, line: found.line } : { x: [], low: [], high: [], mid: [], line: [] };
    panel.markedCurves = found;
    GS.markedKey(panel);
  };

  // What they are, in the key of the chart.
  GS.markedKey = (panel) => {
    const found = panel.markedCurves, { roles } = GS.theme();
    for (const each of panel.key.querySelectorAll(".of-marked")) each.remove();
    if (!found) return;
    const count = found.rows === state.members.size ? `${found.rows} marked` : `${found.rows} of ${state.members.size} marked, whose signals the page keeps`;
    const items = [[`${count}: lowest to highest, and their median`, roles.nominal]];
    if (found.worst) items.push([found.worst.text, roles.bad]);
    panel.key.append(...items.map(([text, colour]) => GS.element("li", { class: "of-marked" }, GS.element("i", { style: `background:${colour}` }), text)));
  };
})();
