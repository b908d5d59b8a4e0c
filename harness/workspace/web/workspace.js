"use strict";
// Maps over two coordinates, a volume over three; all maps share their range, and show all values at the pointer.
(() => {
  const GS = GoughStewart, { page, numbers, quiet, short } = GS;
  const [first, second, third] = page.swept;
  const axes = page.swept.map((axis) => Array.from(numbers(axis.values)));
  const limit = numbers(page.limit), behind = numbers(page.behind), clearance = numbers(page.clearance);
  const results = page.results.map((result) => ({ ...result, values: numbers(result.values) }));
  const depth = third ? axes[2].length : 1;
  const turning = { ...quiet, modeBarButtons: [["toImage", "orbitRotation", "tableRotation", "resetCameraDefault3d"]] };
  const unit = (name) => (name && name !== "°" ? ` ${name}` : name);

  // Rows along the second coordinate, as plotly.js expects.
  const plane = (k, of) => axes[1].map((_, j) => axes[0].map((_, i) => of((i * axes[1].length + j) * depth + k)));
  const axisTitle = (axis) => ({ text: `${axis.name} [${axis.unit}]`, standoff: 6 });
  const hoverTexts = (k) => axes[1].map((y, j) => axes[0].map((x, i) => {
    const at = (i * axes[1].length + j) * depth + k;
    const where = [[first, x], [second, y]].concat(third ? [[third, axes[2][k]]] : []);
    const lines = [where.map(([axis, value]) => `${axis.name} ${short(value)}${unit(axis.unit)}`).join(", ")];
    lines.push(`<b>${page.limits[limit[at]].text}</b>`);
    for (const r of results) lines.push(`${r.title} ${short(r.values[at])}${unit(r.unit)}`);
    return lines.join("<br>");
  }));

  // Colours of the present theme: the reachable region, and the empty part of maps of results.
  const reachedColour = () => GS.theme().card;
  const emptyColour = () => (GS.theme().dark ? "#2a343f" : "#f0f0f0");
  const limitColours = () => page.limits.flatMap((l, k) => {
    const colour = k ? l.colour : reachedColour();
    return [[k / page.limits.length, colour], [(k + 1) / page.limits.length, colour]];
  });
  // Colours extend beyond the border and are covered there, since the border is finer than the grid.
  const border = (k, isReach) => {
    const values = plane(k, (at) => clearance[at]);
    const all = { type: "contour", x: axes[0], y: axes[1], z: values, hoverinfo: "skip", showscale: false, showlegend: false };
    const line = { color: GS.theme().ink, width: 1.4 };
    const signs = new Set(values.flat().map((value) => value > 0));
    if (signs.size < 2) return { ...all, contours: { start: 0, end: 0, size: 1, coloring: "none" }, line };
    // plotly fills the part that violates a constraint
    return isReach
      ? { ...all, contours: { type: "constraint", operation: "<", value: 0 }, fillcolor: reachedColour(), line }
      : { ...all, contours: { type: "constraint", operation: ">", value: 0 }, fillcolor: emptyColour(), line };
  };
  const ticks = (result) => {
    if (!result.logarithmic) return {};
    const all = [1, 1.2, 1.5, 2, 3, 5, 7, 10, 20, 30, 50, 70, 100, 200, 300, 500, 700, 1000];
    let round = all.filter((v) => v >= result.low * 0.999 && v <= result.high * 1.001);
    if (round.length < 3) round = [0, 1, 2, 3, 4].map((s) => Number((result.low * (result.high / result.low) ** (s / 4)).toPrecision(3)));
    return { tickvals: round.map(Math.log10), ticktext: round.map(String) };
  };
  // Values far off the scale would spoil the interpolation next to them.
  const scaled = (result) => {
    const [low, high] = [result.low - (result.high - result.low), 2 * result.high];
    const [least, most] = result.logarithmic ? [result.low / 2, 2 * result.high] : [low, high];
    const bounded = (value) => Math.min(Math.max(Number.isNaN(value) ? most : value, least), most);
    return (at) => result.logarithmic ? Math.log10(bounded(result.values[at])) : bounded(result.values[at]);
  };
  const range = (result) => [result.low, result.high].map((v) => result.logarithmic ? Math.log10(v) : v);
  const heat = (result, k, text) => {
    const value = scaled(result), [low, high] = range(result);
    return {
      type: "heatmap", x: axes[0], y: axes[1], text, hovertemplate: "%{text}<extra></extra>",
      z: plane(k, value), zsmooth: "best", zmin: low, zmax: high, colorscale: result.colours,
      colorbar: { thickness: 12, outlinewidth: 0, tickfont: { size: 11 }, ...ticks(result) },
    };
  };
  const reach = (k, text) => ({
    type: "heatmap", x: axes[0], y: axes[1], text, hovertemplate: "%{text}<extra></extra>", z: plane(k, (at) => behind[at]),
    zmin: -0.5, zmax: page.limits.length - 0.5, colorscale: limitColours(), showscale: false,
  });
  // A cross with an outline, visible on any colour.
  const home = (k) => [[6, GS.theme().card], [2, GS.theme().ink]].map(([width, color]) => ({
    type: "scatter", mode: "markers", hoverinfo: "skip", showlegend: false,
    x: page.home ? [page.home.place[0]] : [], y: page.home ? [page.home.place[1]] : [],
    marker: { symbol: "cross-thin", size: 11, line: { width, color } },
    visible: Boolean(page.home) && page.home.level === k,
  }));

  const panels = [{ title: "reachable region", unit: "", trace: reach, isReach: true }];
  for (const r of results) panels.push({ title: r.title, unit: r.unit, trace: (k, text) => heat(r, k, text), isReach: false });
  const isEqual = first.unit === second.unit;
  const extent = (values) => [values[0], values.at(-1)];
  let level = page.level;
  for (const panel of panels) {
    const box = document.createElement("section"), heading = document.createElement("h2");
    panel.plot = document.createElement("div");
    box.className = "panel";
    heading.textContent = panel.title;
    if (panel.unit) heading.appendChild(Object.assign(document.createElement("small"), { textContent: `  ${panel.unit}` }));
    box.append(heading, panel.plot);
    document.getElementById("maps").appendChild(box);
  }
  const drawMaps = () => {
    const text = hoverTexts(level), { grid } = GS.theme();
    // hides colours at the edge of the cover
    const frame = { type: "rect", xref: "x domain", yref: "y domain", x0: 0, x1: 1, y0: 0, y1: 1, line: { width: 2, color: grid } };
    for (const panel of panels) {
      const layout = {
        height: 380, showlegend: false, margin: { l: 58, r: 12, t: 8, b: 46 }, plot_bgcolor: emptyColour(), shapes: [frame],
        // keep the zoom
        uirevision: "zoom",
        xaxis: { title: axisTitle(first), range: extent(axes[0]), zeroline: false, showgrid: false, constrain: "domain" },
        yaxis: { title: axisTitle(second), range: extent(axes[1]), zeroline: false, showgrid: false, constrain: "domain",
          ...(isEqual ? { scaleanchor: "x" } : {}) },
      };
      const name = `map of ${panel.title}${panel.unit && ` [${panel.unit}]`} over ${first.name} and ${second.name}`;
      GS.plot(panel.plot, [panel.trace(level, text), border(level, panel.isReach), ...home(level)], layout, name);
    }
  };
  // once all boxes have their widths
  drawMaps();
  GS.onTheme(drawMaps);

  // A zoom of one map zooms all.
  let isFollowing = false;
  for (const { plot } of panels) {
    plot.on("plotly_relayout", () => {
      if (isFollowing) return;
      isFollowing = true;
      const { xaxis, yaxis } = plot.layout;
      const others = panels.filter((panel) => panel.plot !== plot);
      const same = { "xaxis.range": [...xaxis.range], "yaxis.range": [...yaxis.range] };
      Promise.all(others.map((panel) => Plotly.relayout(panel.plot, same))).finally(() => { isFollowing = false; });
    });
  }
  if (!third) return;

  const volume = document.getElementById("volume"), slider = document.querySelector("#slice input");
  document.getElementById("stage").hidden = document.getElementById("slice").hidden = false;
  const condition = results.find((r) => r.logarithmic);
  const [low, high] = range(condition);
  const m = page.surface, part = m ? numbers(m.triangles) : [], vertex = m ? numbers(m.vertices) : [];
  const every = (array, from) => Array.from({ length: array.length / 3 }, (_, k) => array[3 * k + from]);
  const [x, y] = [extent(axes[0]), extent(axes[1])];
  const sheet = (k) => ({
    type: "mesh3d", x: [x[0], x[1], x[1], x[0]], y: [y[0], y[0], y[1], y[1]], z: Array(4).fill(axes[2][k]),
    i: [0, 0], j: [1, 2], k: [2, 3], color: GS.theme().accent, opacity: 0.14, hoverinfo: "skip", showscale: false,
  });
  const skin = {
    type: "mesh3d", x: every(vertex, 0), y: every(vertex, 1), z: every(vertex, 2),
    i: every(part, 0), j: every(part, 1), k: every(part, 2), intensity: m ? Array.from(numbers(m.colour)) : [],
    cmin: low, cmax: high, colorscale: condition.colours, flatshading: false,
    // keep small triangles: for a small volume in metres, they are below plotly's tolerances
    facenormalsepsilon: 0, vertexnormalsepsilon: 0,
    customdata: m ? Array.from(numbers(m.colour), (v) => short(10 ** v)) : [],
    // shaded parts keep at least this share of their colour
    lighting: { ambient: 0.8, diffuse: 0.4, specular: 0.05, roughness: 0.9, fresnel: 0 }, lightposition: { x: 3000, y: -4000, z: 8000 },
    colorbar: { title: { text: "condition<br>number" }, thickness: 14, len: 0.7, outlinewidth: 0, ...ticks(condition) },
    hovertemplate: page.swept.map((a, k) => `${a.name} %{${"xyz"[k]}:.4~g}${unit(a.unit)}`).join(", ")
      + "<br>condition number %{customdata}<extra></extra>",
  };
  const side = (axis) => ({ title: { text: `${axis.name} [${axis.unit}]` } });
  const drawVolume = () => {
    // from farther where the picture is narrow
    const far = Math.max(1, Math.min(2.2, 700 / volume.clientWidth));
    const scene = {
      xaxis: side(first), yaxis: side(second), zaxis: side(third), camera: { eye: { x: 1.5 * far, y: -1.7 * far, z: 0.8 * far }, center: { x: 0, y: 0, z: -0.1 } },
      aspectmode: page.swept.every((a) => a.unit === first.unit) ? "data" : "cube",
    };
    const layout = { scene, uirevision: "camera", margin: { l: 0, r: 0, t: 0, b: 0 } };
    const name = `reachable volume over ${page.swept.map((axis) => axis.name).join(", ")}, coloured by condition number`;
    GS.plot(volume, [skin, sheet(level)], layout, name, turning);
  };
  drawVolume();
  GS.onTheme(drawVolume);

  const place = () => {
    const text = `${short(axes[2][level])}${unit(third.unit)}`;
    document.querySelector("#slice output").textContent = text;
    slider.setAttribute("aria-valuetext", text);
  };
  const show = (k) => {
    level = k;
    drawMaps();
    Plotly.restyle(volume, { z: [sheet(k).z] }, [1]);
    place();
  };
  document.querySelector("#slice label").textContent = `slice at ${third.name}`;
  slider.max = depth - 1;
  slider.value = level;
  place();
  let waiting = false;
  slider.addEventListener("input", () => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; show(Number(slider.value)); });
  });
})();
