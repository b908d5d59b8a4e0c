"use strict";
// Members of an ensemble: those in a marked range of a chart of points stand out in all charts.
(() => {
  const GS = GoughStewart, { state } = GS;

  // Points of the picked members are selected in all charts of points; what the reader selects in one is picked.
  const ofMembers = (panel) => (panel.chart.kind === "points" ? panel.figure?.parts.filter(({ numbers }) => numbers.members) ?? [] : []);
  GS.showMembers = (panel) => {
    for (const { numbers, source } of ofMembers(panel)) {
      source.selected.indices = state.members ? [...numbers.members.keys()].filter((k) => state.members.has(numbers.members[k])) : [];
    }
  };
  GS.watchMembers = (panel) => {
    const parts = ofMembers(panel), pick = () => {
      const picked = new Set(parts.flatMap(({ numbers, source }) => [...source.selected.indices].map((k) => numbers.members[k])));
      GS.set({ members: picked.size ? picked : null });
    };
    for (const { source } of parts) source.selected.properties.indices.change.connect(pick);
  };
  // The rows of tables that are about these members.
  GS.on("members", () => {
    for (const row of document.querySelectorAll("tr[data-member]")) row.classList.toggle("chosen", Boolean(state.members?.has(Number(row.dataset.member))));
  });

  // What is known of the marked members beside all: how many, quantiles of the metrics, and the largest with its member.
  const quantile = (sorted, share) => {
    if (!sorted.length) return NaN;
    const at = share * (sorted.length - 1), low = Math.floor(at), high = Math.min(low + 1, sorted.length - 1);
    return sorted[low] + (at - low) * (sorted[high] - sorted[low]);
  };
  // Of a single member: its page, if there is one, and the command that runs it.
  const opened = () => {
    const { element } = GS, [id] = state.members, told = [];
    if (state.members.size !== 1) return told;
    const link = document.querySelector(`tr[data-member="${id}"] a`);
    if (link) told.push(element("p", {}, element("a", { href: link.getAttribute("href") }, `open the run of member ${id}`)));
    if (GS.page.members.repeat) told.push(element("p", {}, `Run member ${id} again, with the same numbers: `, element("code", {}, `${GS.page.members.repeat} ${id}`)));
    return told;
  };
  const summary = async () => {
    const { members } = GS.page, box = document.getElementById("marked");
    if (!members || !box) return;
    box.hidden = !state.members;
    if (!state.members) return;
    const ids = await GS.array(members.ids), has = [...ids].map((id) => state.members.has(id));
    const rows = await Promise.all(members.numbers.map(async ({ name, unit, factor, digits, values }) => {
      const all = (await GS.array(values)).map((v) => factor * v), sorted = (list) => list.filter(Number.isFinite).sort((a, b) => a - b);
      const own = sorted(all.filter((_, k) => has[k])), whole = sorted(all);
      const most = own.length ? ids[all.findIndex((v, k) => has[k] && v === own.at(-1))] : null;
      const cells = [quantile(own, 0.5), quantile(whole, 0.5), quantile(own, 0.95), quantile(whole, 0.95), own.at(-1) ?? NaN].map((v) => GS.short(v, digits));
      return [unit ? `${name} [${unit}]` : name, ...cells, most === null ? "–" : String(most)];
    }));
    const { element } = GS, heads = ["", "median", "of all", "95 %", "of all", "largest", "in member"];
    const table = GS.table(heads, rows, `${state.members.size} of ${ids.length} members are marked`);
    box.replaceChildren(element("div", { class: "sideways", role: "group", "aria-label": "marked members" }, table), ...opened());
    GS.fitTables();
  };
  GS.on("members", summary);

  // Of histograms of these metrics: the bars of the marked members within those of all.
  GS.markedBars = async (panel) => {
    const { members } = GS.page, found = members && panel.chart.kind === "histogram" && members.numbers.find(({ name }) => name === panel.chart.title);
    if (!found || !panel.figure) return;
    const [ids, values] = await Promise.all([GS.array(members.ids), GS.array(found.values)]), edges = panel.figure.data.x;
    const counts = new Float64Array(edges.length - 1);
    if (state.members) {
      values.forEach((value, k) => {
        const v = found.factor * value;
        if (!state.members.has(ids[k]) || !(v >= edges[0])) return;
        let bin = GS.rowAt(edges, v);
        if (bin === counts.length && v <= edges[bin] * (1 + 1e-12)) bin--;
        if (bin >= 0 && bin < counts.length) counts[bin]++;
      });
    }
    panel.figure.markBars(counts);
  };
})();

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
