"use strict";
// The panels beside the view, one per signal: they follow the animation's time; a click sets it.
(() => {
  const GS = GoughStewart;
  const { chart } = GS.page, { signals } = chart, $ = (id) => document.getElementById(id);
  const HEIGHT = 226, PAPER_WIDTH = 660, MARGIN = { l: 62, r: 14, t: 8, b: 26 };
  const coarse = matchMedia("(pointer: coarse)"), printing = () => document.documentElement.classList.contains("printing");
  const panels = new Map();  // by the signal's name, in the order of the page
  let range = [...chart.range];

  const element = (tag, attributes = {}, ...children) => {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) made.addEventListener(name.slice(2), value); else made.setAttribute(name, value);
    }
    made.append(...children);
    return made;
  };
  const pretty = (unit) => unit.replace("s2", "s²").replace("m2", "m²").replace(".", "·");
  const unitOf = (signal) => (signal.unit && signal.unit !== "1" ? pretty(signal.unit) : "");
  const boxes = () => [...document.querySelectorAll("input[data-record]")];
  const seen = (run) => !boxes().length || boxes()[run].checked;
  const titleOf = (signal) => signal.title + (GS.choices.from === null ? "" : `, difference from ${GS.records[GS.choices.from].name}`);

  const sample = (colour, dash) => {
    const line = `<line x1="0" y1="4" x2="30" y2="4" stroke="${colour || "currentColor"}" stroke-width="2" stroke-dasharray="${dash === "solid" ? "" : dash.replaceAll("px", "")}"/>`;
    const found = element("span", { class: "sample", "aria-hidden": "true" });
    found.innerHTML = `<svg width="30" height="8" viewBox="0 0 30 8">${line}</svg>`;
    return found;
  };

  const legend = (panel, drawn) => {
    const many = panel.signal.components.length > 1 || drawn.hasReference;
    const all = many ? drawn.entries.map(({ key, name, colour, dash }) => ({ key, name, colour, dash })) : [];
    if (drawn.hasReference) all.push({ key: "reference", name: "reference", colour: null, dash: GS.referenceDash });
    const items = all.map(({ key, name, colour, dash }) => element("li", {}, element("button", {
      type: "button", "aria-pressed": String(!panel.hidden.has(key)), title: `hide or show ${name}`,
      onclick: (event) => {
        if (!panel.hidden.delete(key)) panel.hidden.add(key);
        event.currentTarget.setAttribute("aria-pressed", String(!panel.hidden.has(key)));
        draw(panel);
      },
    }, sample(colour, dash), name)));
    if (drawn.limits.length) items.push(element("li", { class: "limit" }, sample(null, "8,2,2,2"), "limit"));
    panel.legend.replaceChildren(...items);
  };

  // The description of a chart for screen readers.
  const summary = (signal, drawn) => {
    const number = (value) => GS.fixed(value, drawn.digits), unit = unitOf(signal);
    const names = drawn.entries.map(({ name }) => name).join("; ");
    const values = drawn.smallest <= drawn.largest ? `values from ${number(drawn.smallest)} to ${number(drawn.largest)}${unit && ` ${unit}`}` : "no values";
    return `Chart of ${titleOf(signal)} over time from ${GS.short(chart.range[0])} to ${GS.short(chart.range[1])} s: ${names}${drawn.hasReference ? "; reference" : ""}; ${values}.`;
  };

  const layoutOf = (panel, drawn) => {
    const { ink, quiet } = GS.theme(), fixedrange = coarse.matches;
    return {
      ...GS.plotTheme(), height: HEIGHT, margin: MARGIN, showlegend: false, autosize: true,
      ...(printing() ? { width: PAPER_WIDTH } : {}),
      hovermode: coarse.matches ? false : "x unified", dragmode: coarse.matches ? false : "zoom",
      xaxis: { range: [...range], zeroline: false, fixedrange, ticksuffix: " s", showticksuffix: "last", nticks: 7 },
      yaxis: { range: drawn.range, zeroline: false, fixedrange, exponentformat: "power", minexponent: 5, nticks: 6 },
      font: { color: ink, size: 12 },
      shapes: drawn.limits.map((y) => ({
        type: "line", xref: "x domain", x0: 0, x1: 1, y0: y, y1: y, line: { color: quiet, width: 1.3, dash: "8px,2px,2px,2px" },
      })),
    };
  };

  const download = (panel) => {
    const { data, layout } = panel.plot, unit = unitOf(panel.signal);
    const text = titleOf(panel.signal).replaceAll("<", "&lt;") + (unit && ` [${unit}]`);
    const whole = { ...layout, title: { text, x: 0.01, font: { size: 15 } }, showlegend: data.length > 1, margin: { ...MARGIN, t: 40 } };
    Plotly.downloadImage({ data, layout: whole }, { format: "png", width: 1000, height: 420, filename: panel.signal.title.replace(/[^\w]+/g, "_") });
  };

  const configOf = (panel) => ({
    ...GS.quiet, doubleClick: false, displayModeBar: coarse.matches ? false : "hover",
    modeBarButtons: [[
      { name: "download", title: "Download plot as a PNG", icon: Plotly.Icons.camera, click: () => download(panel) },
      "zoom2d", "pan2d", { name: "reset", title: "Reset axes", icon: Plotly.Icons.home, click: reset },
    ]],
  });

  const place = (panel) => {
    const { l, w } = panel.plot._fullLayout._size;
    panel.place = { left: l, width: w };
    follow(panel, GS.player.time);
  };
  const follow = (panel, time) => {
    if (!panel.place) return;
    const share = (time - range[0]) / (range[1] - range[0] || 1);
    panel.cursor.hidden = !(share >= -1e-9 && share <= 1 + 1e-9);
    panel.cursor.style.transform = `translateX(${panel.place.left + share * panel.place.width}px)`;
  };
  GS.moveCursor = (time) => { for (const panel of panels.values()) follow(panel, time); };

  const draw = (panel) => {
    const { signal } = panel, drawn = GS.linesOf(signal, panel.hidden, seen, GS.theme().ink);
    panel.range = drawn.range;
    panel.title.textContent = `${titleOf(signal)} `;
    if (unitOf(signal)) panel.title.append(element("span", { class: "unit" }, unitOf(signal)));
    return Plotly.react(panel.plot, drawn.traces, layoutOf(panel, drawn), configOf(panel)).then(() => {
      const [picture, ...others] = panel.plot.querySelectorAll(".main-svg");
      picture.setAttribute("role", "img");
      picture.setAttribute("aria-label", summary(signal, drawn));
      for (const other of others) other.setAttribute("aria-hidden", "true");
      place(panel);
      return drawn;
    });
  };
  const redraw = (panel) => draw(panel).then((drawn) => { legend(panel, drawn); });
  const redrawAll = () => Promise.all([...panels.values()].map(redraw));

  // All panels show the same time range.
  const span = (to) => {
    if (to[0] === range[0] && to[1] === range[1]) return;
    range = to;
    for (const { plot } of panels.values()) {
      const shown = plot.layout.xaxis.range;
      if (shown[0] !== to[0] || shown[1] !== to[1]) Plotly.relayout(plot, { "xaxis.range": [...to] });
    }
    GS.moveCursor(GS.player.time);
  };
  const reset = () => {
    range = [...chart.range];
    for (const panel of panels.values()) Plotly.relayout(panel.plot, { "xaxis.range": [...range], "yaxis.range": [...panel.range] });
  };

  const seek = (panel, event) => {
    const x = event.clientX - panel.plot.getBoundingClientRect().left - panel.place.left, share = x / panel.place.width;
    if (share < 0 || share > 1 || event.target.closest(".modebar")) return;
    GS.player.seek(range[0] + share * (range[1] - range[0]));
  };

  const add = (name) => {
    const signal = signals[name];
    const panel = { signal, hidden: new Set(), title: element("h3"), legend: element("ul", { class: "key" }) };
    panel.plot = element("div", { class: "plot" });
    panel.cursor = element("div", { class: "cursor", hidden: "" });
    const remove = element("button", { type: "button", class: "remove", "aria-label": `remove the chart of ${signal.title}`, title: "remove this chart", onclick: () => drop(name) }, "×");
    const head = element("figcaption", {}, panel.title, remove, panel.legend);
    const box = element("div", { class: "plot-box" }, panel.plot, panel.cursor);
    panel.figure = element("figure", { class: "panel", "data-signal": name }, head, box);
    $("chart").append(panel.figure);
    panels.set(name, panel);
    let pressed = null;
    box.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; }, true);
    box.addEventListener("click", (event) => {
      if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4) seek(panel, event);
    }, true);
    return redraw(panel).then(() => {
      panel.plot.on("plotly_relayout", () => span(panel.plot.layout.xaxis.range.map(Number)));
      panel.plot.on("plotly_doubleclick", reset);
      panel.plot.on("plotly_afterplot", () => place(panel));
      return panel;
    });
  };
  const drop = (name) => {
    const { figure, plot } = panels.get(name), next = figure.nextElementSibling || figure.previousElementSibling;
    Plotly.purge(plot);
    figure.remove();
    panels.delete(name);
    (next ? next.querySelector(".remove") : $("add-chart")).focus();
    offer();
  };

  const option = (value, text, isDisabled = false) => element("option", { value, ...(isDisabled ? { disabled: "" } : {}) }, text);
  // Signals by group; those already on the page are disabled.
  const offer = () => {
    const groups = new Map();
    for (const [name, signal] of Object.entries(signals)) {
      if (!groups.has(signal.group)) groups.set(signal.group, []);
      const text = signal.title + (unitOf(signal) && ` [${unitOf(signal)}]`);
      groups.get(signal.group).push(option(name, text, panels.has(name)));
    }
    const lists = [...groups].map(([label, options]) => element("optgroup", { label }, ...options));
    $("add-chart").replaceChildren(option("", "choose a signal"), ...lists);
  };
  const choose = (id, key, texts, all) => {
    const select = $(id);
    select.replaceChildren(option("", all), ...texts.map((text, k) => option(String(k), text)));
    select.addEventListener("change", () => {
      GS.choices[key] = select.value === "" ? null : Number(select.value);
      redrawAll();
    });
  };

  // Called when the reader shows or hides a run.
  GS.showCurves = () => { if (panels.size) redrawAll(); };

  GS.charts = () => {
    choose("legs-shown", "legs", [1, 2, 3, 4, 5, 6].map((k) => `leg ${k}`), "all");
    choose("axes-shown", "axes", ["x, roll", "y, pitch", "z, yaw"], "all");
    const several = GS.records.length > 1;
    $("difference").parentElement.hidden = !several;
    if (several) choose("difference", "from", GS.records.map(({ name }) => `difference from ${name}`), "the runs");
    $("add-chart").addEventListener("change", () => {
      const name = $("add-chart").value;
      if (!name) return;
      add(name).then(({ figure }) => {
        offer();
        figure.scrollIntoView({ block: "nearest" });
      });
    });
    // a button handles the space bar itself
    document.querySelector(".curves").addEventListener("keydown", (event) => { if (event.target.closest("button")) event.stopPropagation(); });
    // paper has its own width; afterwards panels fit the screen again
    GS.onTheme(() => redrawAll().then(() => {
      if (!printing()) for (const { plot } of panels.values()) Plotly.Plots.resize(plot);
    }));
    coarse.addEventListener("change", redrawAll);
    Promise.all(chart.shown.map(add)).then(() => {
      offer();
      performance.mark("curves");
      GS.ready.curves = true;
    });
  };
})();
