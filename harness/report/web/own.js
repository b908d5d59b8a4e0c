"use strict";
// A chart of the reader's own: any signals over time, read at two cursors, saved as rows.
(() => {
  const GS = GoughStewart, { element, page, state } = GS, host = document.getElementById("own"), chosen = [];
  let panel = null;

  const unitOf = ({ name, y }) => (y.unit ? `${name} [${y.unit}]` : name);
  // The values at both ends of the marked time, their difference, and what lies between.
  const table = element("div", { class: "sideways", role: "group", "aria-label": "values at the cursors" });
  const read = () => {
    const parts = panel?.figure?.parts ?? [], { region } = state;
    table.hidden = !parts.length || !region;
    if (table.hidden) return;
    const heads = ["", ...region.map((t) => `at ${GS.short(t, 6)} s`), "difference", "smallest", "largest", "mean"];
    const rows = parts.map(({ series, numbers: { x, y } }) => {
      const [from, to] = region.map((t) => Math.max(GS.rowAt(x, t + 1e-12), 0)), between = y.subarray(from, to + 1).filter(Number.isFinite);
      const mean = between.reduce((sum, v) => sum + v, 0) / between.length, ends = [from, to].map((k) => y[k]);
      const extremes = between.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
      return [unitOf(series), ...[...ends, ends[1] - ends[0], ...extremes, mean].map((v) => GS.short(v, series.y.digits))];
    });
    table.replaceChildren(GS.table(heads, rows));
  };

  // Rows of the marked time, or of what is shown, at the times of all signals; a signal holds its value between its own.
  const rows = () => {
    const { parts } = panel.figure, [from, to] = state.region || GS.range();
    const times = [...new Set(parts.flatMap(({ numbers }) => [...numbers.x]))].filter((t) => t >= from && t <= to).sort((a, b) => a - b);
    const quoted = (text) => `"${text.replaceAll('"', '""')}"`, at = ({ numbers: { x, y } }, t) => { const k = GS.rowAt(x, t); return k < 0 || !Number.isFinite(y[k]) ? "" : y[k]; };
    return [["time [s]", ...parts.map(({ series }) => unitOf(series))].map(quoted), ...times.map((t) => [t, ...parts.map((part) => at(part, t))])];
  };
  const save = () => {
    const text = rows().map((cells) => cells.join(",")).join("\n"), href = URL.createObjectURL(new Blob([`${text}\n`], { type: "text/csv" }));
    element("a", { href, download: `${page.title}.csv` }).click();
    setTimeout(() => URL.revokeObjectURL(href), 1000);
  };

  // Fills its section; `open` and `close` make and drop a panel of charts.js.
  GS.ownChart = (open, close) => {
    const charts = page.charts.filter((chart) => chart.isTime);
    if (!host || !charts.length) return;
    const signals = charts.map((chart) => chart.series.filter(({ role }) => role !== "band").map((series) => ({
      name: `${chart.title}: ${series.name}`, component: `${chart.title} ${series.name}`, role: "actual", values: series.values, x: series.x ?? chart.x.values, y: chart.y, step: chart.kind === "step",
    })));
    const options = charts.map((chart, k) => element("optgroup", { label: chart.title }, ...signals[k].map(({ name }, j) => element("option", { value: `${k},${j}` }, name))));
    const select = element("select", { id: "signals", autocomplete: "off" }, element("option", { value: "" }, "add a signal …"), ...options);
    const empty = element("button", { type: "button", disabled: "" }, "empty"), csv = element("button", { type: "button", disabled: "" }, "save rows as CSV"), place = element("div", {});
    const draw = () => {
      if (panel) close(panel);
      panel = null;
      for (const button of [empty, csv]) button.disabled = !chosen.length;
      if (!chosen.length) { place.replaceChildren(); read(); return; }
      const units = [...new Set(chosen.map(({ y }) => y.unit))], [{ y }] = chosen;
      const figure = element("figure", { class: "chart line" }, element("figcaption", {}, element("ul", { class: "key" })), element("div", { class: "plot" }));
      place.replaceChildren(figure);
      panel = open({ title: "your own chart", kind: "line", isTime: true, x: charts[0].x, y: { ...y, title: `[${y.unit || 1}]`, scale: "linear" }, series: chosen.map((series) => ({ ...series })), marks: [], spans: [], strips: [], units }, figure, read);
    };
    select.addEventListener("change", () => {
      const [k, j] = select.value.split(",").map(Number), signal = signals[k]?.[j];
      select.value = "";
      if (signal && !chosen.includes(signal)) { chosen.push(signal); draw(); }
    });
    empty.addEventListener("click", () => { chosen.length = 0; draw(); });
    csv.addEventListener("click", save);
    const hint = "Any signals over time in one chart. Mark a time (drag, or [ and ]) to read them at its two ends; rows are those of the marked time.";
    host.replaceChildren(element("details", {}, element("summary", {}, "Your own chart"),
      element("p", { class: "hint" }, hint), element("div", { class: "controls" }, element("label", { for: "signals" }, "signals"), select, empty, csv), place, table));
    host.hidden = false;
    GS.on("region", read);
    read();
  };
})();
