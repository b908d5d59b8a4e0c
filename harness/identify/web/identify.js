"use strict";
// What an identification found: intervals, correlation, measured beside fitted, and what is left of each channel.
(() => {
  const { page, numbers, quiet } = GoughStewart;
  const font = { family: 'system-ui, "Segoe UI", sans-serif', size: 12, color: "#1d2733" };
  const layout = (title, more) => ({ title: { text: title, x: 0.02, font: { size: 14 } }, font, height: 380,
    margin: { l: 70, r: 20, t: 44, b: 46 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "#fff", ...more });
  const draw = (id, traces, title, more) => Plotly.newPlot(id, traces, layout(title, more), quiet);
  const names = page.names;
  const long = { automargin: true, tickfont: { size: 11 } };

  // Each in its own standard errors about the value found: where it was before, and how wide it is.
  draw("intervals", [
    { type: "scatter", mode: "markers", x: page.change, y: names, name: "found − before", marker: { color: "#0072B2", size: 8 },
      error_x: { type: "data", array: page.half, color: "#0072B2" }, hovertemplate: "%{y}: %{x:.4g} ± %{error_x.array:.2g} %<extra></extra>" },
  ], "Change by the estimate, % of scale, with 95 % intervals", { yaxis: { ...long, autorange: "reversed" }, xaxis: { title: { text: "%" } } });
  draw("correlation", [{ type: "heatmap", x: names, y: names, z: page.correlation, zmin: -1, zmax: 1, colorscale: "RdBu",
    hovertemplate: "%{x}, %{y}: %{z:.3f}<extra></extra>" }], "Correlation of the estimates",
  { yaxis: { ...long, autorange: "reversed" }, xaxis: { ...long } });

  if (!page.time) { for (const id of ["fit", "residuals"]) document.getElementById(id).remove(); return; }
  const time = Array.from(numbers(page.time));
  const channel = (packed, k) => { const all = numbers(packed); return time.map((_, i) => all[i * page.channels + k]); };
  const shapes = page.aside === null ? [] : [{ type: "rect", xref: "x", yref: "paper", x0: page.aside, x1: time[time.length - 1], y0: 0, y1: 1,
    fillcolor: "#000", opacity: 0.05, line: { width: 0 } }];
  const over = { shapes, xaxis: { title: { text: "time [s]; shaded: kept aside" } }, yaxis: { title: { text: page.unit } } };
  const fit = [], left = [];
  for (let k = 0; k < page.channels; k += 1) {
    const line = { color: page.colours[k % page.colours.length], width: 1.4 };
    const measured = channel(page.measured, k), fitted = channel(page.fitted, k), before = channel(page.before, k);
    fit.push({ x: time, y: measured, name: `${k + 1}`, legendgroup: `${k}`, line });
    fit.push({ x: time, y: fitted, name: `${k + 1} fitted`, legendgroup: `${k}`, showlegend: false, line: { ...line, dash: "dot" } });
    left.push({ x: time, y: measured.map((v, i) => v - before[i]), name: `${k + 1} before`, line: { ...line, width: 0.8 }, opacity: 0.45, visible: "legendonly" });
    left.push({ x: time, y: measured.map((v, i) => v - fitted[i]), name: `${k + 1}`, line });
  }
  draw("fit", fit, `${page.quantity}: measured, and fitted (dotted)`, over);
  draw("residuals", left, `${page.quantity}: what is left; that of the nominal platform by a click on the legend`, over);
})();
