"use strict";
// One figure of merit of all members: how it is spread, what it goes with; signals over time as bands.
(() => {
  const { page, numbers, quiet, short } = GoughStewart;
  const font = { family: 'system-ui, "Segoe UI", sans-serif', size: 12, color: "#1d2733" };
  const grid = { gridcolor: "#e6e9ed", zeroline: false };
  const [blue, orange, , , sky] = page.colours;
  const layout = (x, y, more) => ({
    height: 330, margin: { l: 62, r: 14, t: 10, b: 46 }, font, paper_bgcolor: "#fff", plot_bgcolor: "#fff", showlegend: false,
    xaxis: { ...grid, title: { text: x, standoff: 6 } }, yaxis: { ...grid, title: { text: y, standoff: 6 } }, ...more,
  });
  const named = (shown) => (shown.unit ? `${shown.text} [${shown.unit}]` : shown.text);
  const lazy = (list) => list.map((each) => ({ ...each, get data() { return (this.kept ??= Array.from(numbers(this.values))); } }));
  const metrics = lazy(page.metrics), inputs = lazy(page.inputs);
  const member = Array.from(numbers(page.member)), completed = Array.from(numbers(page.completed));
  const kinds = [["completed", blue, 1], ["ended early", orange, 0]];
  const of = (values, flag) => values.filter((_, k) => completed[k] === flag);

  const select = (id, list) => {
    const box = document.getElementById(id);
    for (const each of list) box.add(new Option(named(each)));
    box.parentElement.hidden = list.length === 0;
    box.addEventListener("change", draw);
    return () => list[box.selectedIndex];
  };
  const chosen = { metric: select("metric", metrics), input: select("input", inputs), signal: select("signal", page.signals) };
  document.getElementById("metric").selectedIndex = Math.max(0, page.metrics.findIndex((m) => m.name === page.by));

  const histogram = (metric) => {
    const traces = kinds.map(([name, colour, flag]) => ({ type: "histogram", x: of(metric.data, flag), name, marker: { color: flag ? sky : colour }, nbinsx: 50 }));
    const lines = metric.marks.map((mark) => ({ type: "line", x0: mark.value, x1: mark.value, yref: "paper", y0: 0, y1: 1, line: { width: 1, dash: "dash" } }));
    const notes = metric.marks.map((mark) => ({ x: mark.value, yref: "paper", y: 1, yanchor: "bottom", showarrow: false, text: `${mark.text} ${short(mark.value)}`, font: { size: 10 } }));
    const more = { barmode: "stack", shapes: lines, annotations: notes, margin: { l: 62, r: 14, t: 22, b: 46 } };
    Plotly.react("histogram", traces, layout(named(metric), "members", more), quiet);
  };
  const scatter = (metric, input) => {
    const traces = input ? kinds.map(([name, color, flag]) => ({
      type: "scattergl", mode: "markers", name, x: of(input.data, flag), y: of(metric.data, flag), customdata: of(member, flag),
      marker: { color, size: 4, opacity: 0.6 }, hovertemplate: "member %{customdata}<br>%{x:.4~g}, %{y:.4~g}<extra></extra>",
    })) : [];
    Plotly.react("scatter", traces, layout(input ? named(input) : "", named(metric)), quiet);
  };
  const bands = (signal) => {
    if (!signal) return;
    const line = (name, extra) => ({
      type: "scatter", mode: "lines", x: Array.from(numbers(page.time)), y: Array.from(numbers(signal[name])), name, line: { width: 0 },
      hovertemplate: `%{y:.4~g} (${name})<extra></extra>`, ...extra,
    });
    const filled = (alpha) => ({ fill: "tonexty", fillcolor: `rgba(0,114,178,${alpha})` });
    const thin = { line: { width: 0.8, color: "#777" } };
    const traces = [
      line("lowest", thin), line("q05", {}), line("q95", filled(0.2)), line("q25", {}), line("q75", filled(0.3)),
      line("q50", { line: { width: 2, color: blue } }), line("highest", thin),
    ];
    Plotly.react("bands", traces, layout("time [s]", named(signal), { hovermode: "x" }), quiet);
  };
  const sensitivity = (metric) => {
    const found = page.sensitivity[metric.name];
    document.getElementById("remark").textContent = found ? found.remark : "not known for this figure of merit";
    const bars = (found ? found.bars : []).map((bar) => ({
      type: "bar", orientation: "h", name: bar.name, x: bar.values, y: found.inputs, marker: { color: bar.name === "in total" ? sky : blue },
      error_x: { type: "data", array: bar.confidence, thickness: 1, width: 3 }, hovertemplate: "%{y}: %{x:.3f}<extra></extra>",
    }));
    const more = { showlegend: bars.length > 1, legend: { orientation: "h", y: 1.12 }, margin: { l: 180, r: 14, t: 20, b: 46 } };
    const drawn = layout(found ? found.axis : "", "", more);
    drawn.yaxis = { autorange: "reversed", automargin: true };
    Plotly.react("sensitivity", bars, drawn, quiet);
  };
  function draw() {
    const metric = chosen.metric();
    histogram(metric);
    scatter(metric, chosen.input());
    bands(chosen.signal());
    sensitivity(metric);
  }
  draw();
})();
