"use strict";
// Charts of one metric over all members: histogram, scatter, sensitivity; signals over time as bands.
(() => {
  const GS = GoughStewart, { page, numbers, short } = GS;
  const [, orange, , , sky] = page.colours;
  const chart = (id, traces, name, x, y, more) => GS.plot(document.getElementById(id), traces, {
    height: 330, margin: { l: 62, r: 14, t: 10, b: 46 }, showlegend: false,
    ...more,
    xaxis: { zeroline: false, title: { text: x, standoff: 6 }, ...more?.xaxis },
    yaxis: { zeroline: false, title: { text: y, standoff: 6 }, ...more?.yaxis },
  }, name);
  const named = (shown) => (shown.unit ? `${shown.text} [${shown.unit}]` : shown.text);
  const lazy = (list) => list.map((each) => ({ ...each, get data() { return (this.kept ??= Array.from(numbers(this.values))); } }));
  const metrics = lazy(page.metrics), inputs = lazy(page.inputs);
  const member = Array.from(numbers(page.member)), completed = Array.from(numbers(page.completed));
  const kinds = () => [["completed", GS.theme().accent, 1], ["ended early", orange, 0]];
  const of = (values, flag) => values.filter((_, k) => completed[k] === flag);
  const axis = (values, shown) => ({ range: GS.widened(values, shown.least) });

  const select = (id, list) => {
    const box = document.getElementById(id);
    for (const each of list) box.add(new Option(named(each)));
    box.parentElement.hidden = list.length === 0;
    box.addEventListener("change", draw);
    return () => list[box.selectedIndex];
  };
  const chosen = { metric: select("metric", metrics), input: select("input", inputs), signal: select("signal", page.signals) };
  document.getElementById("metric").selectedIndex = Math.max(0, page.metrics.findIndex((m) => m.name === page.by));

  // Labels of quantiles that are close together are aligned away from each other.
  const lean = ["right", "center", "left"];
  const histogram = (metric) => {
    const { quiet } = GS.theme();
    const traces = kinds().map(([name, colour, flag]) => ({ type: "histogram", x: of(metric.data, flag), name, marker: { color: flag ? sky : colour }, nbinsx: 50 }));
    const shapes = metric.marks.map((mark) => ({ type: "line", x0: mark.value, x1: mark.value, yref: "paper", y0: 0, y1: 1, line: { width: 1, dash: "dash", color: quiet } }));
    const annotations = metric.marks.map((mark, k) => ({ x: mark.value, yref: "paper", y: 1, yanchor: "bottom", xanchor: lean[k], showarrow: false, text: `${mark.text}: ${short(mark.value)}`, font: { size: 10 } }));
    chart("histogram", traces, `histogram of ${named(metric)}`, named(metric), "members",
      { barmode: "stack", shapes, annotations, margin: { l: 62, r: 14, t: 22, b: 46 }, xaxis: axis(metric.data, metric) });
  };
  const scatter = (metric, input) => {
    // SVG: plotly's WebGL points need `eval`, which the policy of this page forbids
    const traces = input ? kinds().map(([name, color, flag]) => ({
      type: "scatter", mode: "markers", name, x: of(input.data, flag), y: of(metric.data, flag), customdata: of(member, flag),
      marker: { color, size: 4, opacity: 0.6 }, hovertemplate: "member %{customdata}<br>%{x:.4~g}, %{y:.4~g}<extra></extra>",
    })) : [];
    chart("scatter", traces, input ? `${named(metric)} against ${named(input)}` : "no varied number", input ? named(input) : "", named(metric),
      { xaxis: input && axis(input.data, input), yaxis: axis(metric.data, metric) });
  };
  const bands = (signal) => {
    if (!signal) return;
    const { accent, quiet } = GS.theme();
    const values = (name) => Array.from(numbers(signal[name]));
    const line = (name, extra) => ({
      type: "scatter", mode: "lines", x: Array.from(numbers(page.time)), y: values(name), name, line: { width: 0 },
      hovertemplate: `%{y:.4~g} (${name})<extra></extra>`, ...extra,
    });
    const filled = (alpha) => ({ fill: "tonexty", fillcolor: `${accent}${alpha}` });
    const thin = { line: { width: 0.8, color: quiet } };
    const traces = [
      line("lowest", thin), line("q05", {}), line("q95", filled("33")), line("q25", {}), line("q75", filled("4d")),
      line("q50", { line: { width: 2, color: accent } }), line("highest", thin),
    ];
    chart("bands", traces, `${named(signal)} over time, as bands of the members`, "time [s]", named(signal),
      { hovermode: "x", yaxis: axis([...values("lowest"), ...values("highest")], signal) });
  };
  const sensitivity = (metric) => {
    const found = page.sensitivity[metric.name];
    document.getElementById("remark").textContent = found ? found.remark : "not available for this metric";
    const bars = (found ? found.bars : []).map((bar) => ({
      type: "bar", orientation: "h", name: bar.name, x: bar.values, y: found.inputs, marker: { color: bar.name === "in total" ? sky : GS.theme().accent },
      error_x: { type: "data", array: bar.confidence, thickness: 1, width: 3, color: GS.theme().ink }, hovertemplate: "%{y}: %{x:.3f}<extra></extra>",
    }));
    chart("sensitivity", bars, `sensitivity of ${named(metric)}`, found ? found.axis : "", "",
      { showlegend: bars.length > 1, legend: { orientation: "h", y: 1, yanchor: "bottom" }, margin: { l: 20, r: 14, t: 30, b: 46 },
        xaxis: { zeroline: true }, yaxis: { autorange: "reversed", automargin: true } });
  };
  function draw() {
    const metric = chosen.metric();
    histogram(metric);
    scatter(metric, chosen.input());
    bands(chosen.signal());
    sensitivity(metric);
  }
  draw();
  GS.onTheme(draw);
})();
