"use strict";
// Shared by the scripts of all pages: data, packed numbers, number formats, theme, charts.
const GoughStewart = (() => {
  const KINDS = { f8: Float64Array, f4: Float32Array, i4: Int32Array, i1: Int8Array };
  const minus = (text) => (Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−"));
  const significant = (x) => (Math.abs(x) >= 9999.5 ? x.toFixed(0) : x.toPrecision(4));

  // Dark if the system is; paper is always light. The event comes before the browser applies the print rules.
  const root = document.documentElement, scheme = matchMedia("screen and (prefers-color-scheme: dark)"), listeners = [];
  const theme = () => {
    const style = getComputedStyle(root), colour = (name) => style.getPropertyValue(`--${name}`).trim();
    return {
      dark: scheme.matches && !root.classList.contains("printing"),
      ink: colour("ink"), quiet: colour("quiet"), line: colour("line"), paper: colour("paper"), card: colour("card"),
      accent: colour("blue"), grid: colour("line"),
    };
  };
  const changed = () => { for (const listener of listeners) listener(theme()); };
  scheme.addEventListener("change", changed);
  for (const [event, isPrinting] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(event, () => { root.classList.toggle("printing", isPrinting); changed(); });
  }

  // a swipe over a chart scrolls the page; buttons of the chart switch to zoom or turn
  const drags = matchMedia("(pointer: coarse)").matches ? { dragmode: false } : {};

  return {
    page: JSON.parse(document.getElementById("data").textContent),
    numbers: (packed) => new KINDS[packed.dtype](Uint8Array.from(atob(packed.bdata), (c) => c.charCodeAt(0)).buffer),
    // a fixed number of decimals
    fixed: (x, digits) => minus(x.toFixed(digits)),
    // always four significant digits, so that changing numbers do not jump
    text: (x) => minus(significant(x)),
    // four significant digits at most
    short: (x) => (Number.isFinite(x) ? minus(String(Number(significant(x)))) : x > 0 ? "∞" : "–"),
    // only useful buttons; some others would send the data to a server
    quiet: { displaylogo: false, responsive: true, modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]] },
    // colours of the present theme; light while printing
    theme,
    // call back when the colour scheme changes, and before and after printing
    onTheme: (callback) => { listeners.push(callback); },
    // plotly template of the theme; colours in a layout take precedence
    plotTheme: () => {
      const { ink, quiet, card, grid } = theme();
      const axis = { gridcolor: grid, zerolinecolor: grid, linecolor: grid, tickcolor: grid };
      const side = { ...axis, showbackground: false };
      return { template: { layout: {
        paper_bgcolor: card, plot_bgcolor: card, font: { family: 'system-ui, "Segoe UI", sans-serif', size: 12, color: ink },
        xaxis: axis, yaxis: axis, scene: { xaxis: side, yaxis: side, zaxis: side },
        hoverlabel: { align: "left", bgcolor: card, bordercolor: quiet, font: { color: ink } },
        modebar: { bgcolor: "rgba(0,0,0,0)", color: quiet, activecolor: ink },
      } } };
    },
    // both ends of an axis widened to a least span; undefined if plotly may choose
    widened: (values, least) => {
      const finite = values.filter(Number.isFinite);
      const low = finite.reduce((a, b) => Math.min(a, b), Infinity), high = finite.reduce((a, b) => Math.max(a, b), -Infinity);
      return high - low < least ? [(low + high - least) / 2, (low + high + least) / 2] : undefined;
    },
    // a chart in an element: in the colours of the theme, with a name for screen readers, every point of its lines drawn
    plot(element, traces, layout, name, config = this.quiet) {
      element.setAttribute("role", "figure");
      element.setAttribute("aria-label", name);
      const whole = traces.map((trace) => (trace.type === "scatter" ? { ...trace, line: { simplify: false, ...trace.line } } : trace));
      // browsers do not wait for charts that resize to the paper
      const size = root.classList.contains("printing") ? { width: element.clientWidth, autosize: false } : { autosize: true };
      return Plotly.react(element, whole, { ...this.plotTheme(), ...drags, ...layout, ...size }, config);
    },
  };
})();
