"use strict";
// Charts of an identification: intervals, correlation, measured and fitted, and residuals of each channel.
(() => {
  const GS = GoughStewart, { page, numbers } = GS;
  const place = (id) => document.getElementById(id);
  const draw = (id, traces, name, more) => GS.plot(place(id), traces,
    { height: 380, margin: { l: 70, r: 20, t: 30, b: 46 }, legend: { orientation: "h", y: 1, yanchor: "bottom" }, ...more }, name);
  const names = page.names;
  const long = { automargin: true, tickfont: { size: 11 } };

  const parameters = () => {
    const color = GS.theme().accent;
    draw("intervals", [{
      type: "scatter", mode: "markers", x: page.change, y: names, marker: { color, size: 8 }, error_x: { type: "data", array: page.half, color },
      hovertemplate: "%{y}: %{x:.4g} ± %{error_x.array:.2g} %<extra></extra>",
    }], "change of each parameter with its 95 % interval", { yaxis: { ...long, autorange: "reversed" }, xaxis: { title: { text: "%" } } });
    draw("correlation", [{ type: "heatmap", x: names, y: names, z: page.correlation, zmin: -1, zmax: 1, colorscale: "RdBu",
      hovertemplate: "%{x}, %{y}: %{z:.3f}<extra></extra>" }], "correlation of the estimates",
    { yaxis: { ...long, autorange: "reversed" }, xaxis: { ...long } });
  };

  if (!page.time) {
    for (const id of ["fit", "residuals"]) place(id).parentElement.remove();
    parameters();
    GS.onTheme(parameters);
    return;
  }
  const time = Array.from(numbers(page.time));
  const channels = (packed) => {
    const all = numbers(packed);
    return Array.from({ length: page.channels }, (_, k) => time.map((_, i) => all[i * page.channels + k]));
  };
  const measured = channels(page.measured), of = { fitted: channels(page.fitted), before: channels(page.before) };
  const line = (k) => ({ color: page.colours[k % page.colours.length], width: 1.4 });
  const over = () => ({
    xaxis: { title: { text: page.aside.length ? "time [s]; shaded: not fitted" : "time [s]" } },
    shapes: page.aside.map(([x0, x1]) => ({ type: "rect", xref: "x", yref: "paper", x0, x1, y0: 0, y1: 1,
      fillcolor: GS.theme().ink, opacity: 0.07, line: { width: 0 } })),
  });
  const headings = { fit: `${page.quantity}: measured (solid) and fitted (dotted)`, residuals: `${page.quantity}: residuals` };
  for (const [id, text] of Object.entries(headings)) place(id).parentElement.querySelector("h2").textContent = text;

  const residuals = () => {
    const model = of[place("which").value];
    const left = measured.map((values, k) => ({ type: "scatter", x: time, y: values.map((v, i) => v - model[k][i]), name: `${k + 1}`, line: line(k) }));
    draw("residuals", left, headings.residuals,
      { ...over(), yaxis: { title: { text: page.unit }, range: GS.widened(left.flatMap((each) => each.y), page.least) } });
  };
  const all = () => {
    parameters();
    const fit = measured.flatMap((values, k) => [
      { type: "scatter", x: time, y: values, name: `${k + 1}`, legendgroup: `${k}`, line: line(k) },
      { type: "scatter", x: time, y: of.fitted[k], name: `${k + 1} fitted`, legendgroup: `${k}`, showlegend: false, line: { ...line(k), dash: "dot" } },
    ]);
    draw("fit", fit, headings.fit, { ...over(), yaxis: { title: { text: page.unit } } });
    residuals();
  };
  place("which").addEventListener("change", residuals);
  all();
  GS.onTheme(all);
})();
