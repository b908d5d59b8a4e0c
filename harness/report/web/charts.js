"use strict";
// All charts: drawn when the reader comes near, with one cursor, one range and one marked part for charts of one axis.
(() => {
  const GS = GoughStewart, { element, page, state } = GS;
  const panels = [], groups = new Map();
  GS.panels = panels;
  // the charts that a reader sees first are drawn
  let hasDrawn;
  GS.firstDrawn = new Promise((done) => { hasDrawn = done; });

  // Charts over time share the time of the page.
  const timeGroup = {
    isTime: true, panels: [], range: GS.range, whole: () => [state.start, state.end], cursor: GS.shownTime, region: () => state.region, zoom: GS.zoomTo,
    hover: (x) => GS.set({ hover: x }),
    mark: (region) => GS.mark(region),
    click: (x) => GS.set({ hover: null, time: x }),
    key: () => false,
  };
  GS.timeGroup = timeGroup;
  // Charts over another axis, such as frequency, share a cursor among themselves.
  const groupOf = (chart) => {
    if (chart.isTime) return timeGroup;
    const isFunction = ["line", "step"].includes(chart.kind), isMap = chart.kind === "heat";
    const name = isFunction ? chart.x.title : isMap ? GS.heatKey(chart) : Symbol("own");
    if (!groups.has(name)) groups.set(name, isMap ? GS.heatGroup(name, fit) : freeGroup(isFunction));
    return groups.get(name);
  };
  const freeGroup = (isFunction) => {
    const own = { cursor: null, fixed: null, region: null, zoom: null };
    const whole = () => {
      const ends = group.panels.filter((p) => p.figure).map((p) => p.figure.whole());
      return ends.length ? [Math.min(...ends.map((e) => e[0])), Math.max(...ends.map((e) => e[1]))] : null;
    };
    const group = {
      isTime: false, panels: [], whole, region: () => own.region, cursor: () => own.cursor ?? own.fixed,
      range: () => own.zoom || whole(),
      zoom: (range) => {
        const all = whole(), [low, high] = range ? [Math.max(range[0], all[0]), Math.min(range[1], all[1])] : all;
        own.zoom = range && (low > all[0] || high < all[1]) && high > low ? [low, high] : null;
        group.panels.forEach(fit);
      },
      hover: (x) => { if (isFunction) { own.cursor = x; group.panels.forEach(follow); } },
      mark: (region) => {
        if (!isFunction) return;
        own.region = region && [...region].sort((a, b) => a - b);
        group.panels.forEach(follow);
      },
      click: (x) => { if (isFunction) { own.fixed = x; group.panels.forEach(follow); } },
      // arrows move the cursor
      key: ({ key }, panel) => {
        const range = group.range();
        if (!range) return false;
        const isLog = panel.chart.x.scale === "log", middle = isLog ? Math.sqrt(range[0] * range[1]) : (range[0] + range[1]) / 2;
        const at = own.fixed ?? middle, step = isLog ? (range[1] / range[0]) ** 0.01 : (range[1] - range[0]) / 100;
        const to = { ArrowLeft: isLog ? at / step : at - step, ArrowRight: isLog ? at * step : at + step, Home: range[0], End: range[1] }[key];
        if (to === undefined) return GS.rangeKey(key, group, at, isLog);
        own.fixed = Math.min(Math.max(to, range[0]), range[1]);
        group.panels.forEach(follow);
        return true;
      },
      clear: () => { own.region = own.fixed = null; group.panels.forEach(follow); },
    };
    return group;
  };

  // Cursor, marked part and values.
  const follow = (panel) => {
    const place = panel.figure?.place(), scale = panel.figure?.view?.frame.x_scale;
    if (!place) return;
    const x = panel.group.cursor(), region = panel.group.region(), right = place.left + place.width;
    const at = x === null || !panel.figure.isFunction ? NaN : scale.compute(x), isInside = at >= place.left - 0.5 && at <= right + 0.5;
    panel.cursor.hidden = !isInside;
    if (isInside) panel.cursor.style.transform = `translateX(${at}px)`;
    const ends = region && region.map((end) => Math.min(Math.max(scale.compute(end), place.left), right));
    panel.region.hidden = !ends || ends[1] - ends[0] < 0.5;
    if (ends) Object.assign(panel.region.style, { transform: `translateX(${ends[0]}px)`, width: `${ends[1] - ends[0]}px` });
    for (const each of [panel.cursor, panel.region]) Object.assign(each.style, { top: `${place.top}px`, height: `${place.height}px` });
    GS.legendValues(panel, x);
  };
  // Zooms about an abscissa by a factor; more than 1 shows more.
  GS.zoomAbout = (group, x, factor, isLog = false) => {
    const f = isLog ? Math.log10 : (v) => v, g = isLog ? (v) => 10 ** v : (v) => v;
    group.zoom(group.range().map((end) => g(f(x) + factor * (f(end) - f(x)))));
  };
  // Keys of an axis: [ and ] mark up to a place, + zooms to what is marked or about it, − out, 0 shows all; false for others.
  GS.rangeKey = (key, group, at, isLog) => {
    const region = group.region(), [low, high] = group.whole();
    if (key === "[") group.mark([at, region?.[1] > at ? region[1] : high]);
    else if (key === "]") group.mark([region?.[0] < at ? region[0] : low, at]);
    else if ((key === "+" || key === "=") && region) group.zoom(region);
    else if ("+=-".includes(key)) GS.zoomAbout(group, at, key === "-" ? 2 : 0.5, isLog);
    else if (key === "0") group.zoom(null);
    else return false;
    return true;
  };
  // What the pointer and Bokeh's tools do in one chart is done in all of its group; keys do the same.
  const listen = (panel) => {
    const { plot, group, chart, figure: { figure, heat } } = panel, { x_range: X } = figure;
    const inside = (x) => x >= X.start && x <= X.end, whole = () => { group.mark(null, panel); group.zoom(null); };
    figure.on_event("mousemove", ({ x, y }) => group.hover(inside(x) ? x : null, panel, y));
    figure.on_event("mouseleave", () => group.hover(null, panel));
    figure.on_event("tap", ({ x, y }) => { if (inside(x)) group.click(x, panel, y); });
    figure.on_event("selectiongeometry", ({ geometry, final }) => { if (final && geometry.type === "rect") group.mark([geometry.x0, geometry.x1], panel); });
    figure.on_event("rangesupdate", ({ x0, x1, y0, y1 }) => group.zoom(heat ? [[x0, x1], [y0, y1]] : [x0, x1]));
    figure.on_event("reset", whole);
    figure.on_event("doubletap", whole);
    plot.addEventListener("wheel", (event) => {
      if (!(event.ctrlKey || event.metaKey) || panel.figure.bars) return;
      event.preventDefault();
      event.stopPropagation();
      const box = plot.getBoundingClientRect(), { x_scale, y_scale } = panel.figure.view.frame, factor = 1.25 ** (event.deltaY / 60);
      const x = x_scale.invert(event.clientX - box.left);
      if (heat) group.about(panel, x, y_scale.invert(event.clientY - box.top), factor); else GS.zoomAbout(group, x, factor, chart.x.scale === "log");
    }, { passive: false, capture: true });
    plot.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.key === "s") { event.preventDefault(); panel.figure.save(); return; }
      if (!group.isTime && group.key(event, panel)) { event.preventDefault(); event.stopPropagation(); }
    });
    GS.watchMembers(panel);
    if (heat) group.load(panel);
  };
  const fit = (panel) => {
    if (!panel.figure) return;
    panel.figure.fit(panel.group.box ? panel.group.box() : panel.group.range());
    panel.stale = false;
    follow(panel);
  };
  GS.dressChart = (panel) => {
    if (!panel.figure) return;
    panel.figure.dress();
    GS.legend(panel);
    GS.legendValues(panel, panel.group.cursor());
    if (state.members) GS.markedBand(panel);
  };

  const draw = (panel) => (panel.drawn ??= (async () => {
    try {
      panel.figure = await GS.figure(panel.chart, panel.plot);
    } catch (problem) {
      // the other charts are drawn nevertheless
      panel.plot.textContent = `This chart cannot be drawn: ${problem.message || problem}`;
      console.error(problem);
      return panel;
    }
    panel.plot.append(panel.region, panel.cursor, panel.told);
    panel.group.panels.push(panel);
    GS.legend(panel);
    GS.showMembers(panel);
    if (state.members) { GS.markedBars(panel); GS.markedBand(panel); }
    // the figure finds its size in a frame of its own
    new ResizeObserver(() => requestAnimationFrame(() => { if (!GS.isPrinting()) fit(panel); })).observe(panel.plot);
    listen(panel);
    fit(panel);
    return panel;
  })());

  // A panel that waits to be drawn in a figure element of the page.
  const panelOf = (chart, host) => {
    const plot = host.querySelector(".plot"), hidden = (name) => element("div", { class: name, hidden: "" });
    const panel = {
      chart, host, plot, key: host.querySelector(".key"), group: groupOf(chart), figure: null, visible: false, stale: false,
      cursor: hidden("cursor"), region: hidden("region"), told: hidden("pointed"),
    };
    panels.push(panel);
    return panel;
  };
  const drop = (panel) => {
    for (const list of [panels, panel.group.panels]) if (list.includes(panel)) list.splice(list.indexOf(panel), 1);
  };
  const addPanel = (chart, host, then) => {
    const panel = panelOf(chart, host);
    panel.visible = true;
    draw(panel).then(then);
    return panel;
  };
  const seen = (panel) => panel.visible;
  GS.charts = async () => {
    await GS.timed;
    await GS.sliceBar?.();
    for (const host of document.querySelectorAll("figure.chart")) panelOf(page.charts[Number(host.dataset.chart)], host);
    const of = new Map(panels.map((panel) => [panel.host, panel]));
    const near = new IntersectionObserver((entries) => entries.forEach(({ target, isIntersecting }) => {
      const panel = of.get(target);
      panel.visible = isIntersecting;
      if (!isIntersecting) return;
      draw(panel).then(() => { if (!panel.figure) return; if (panel.stale) fit(panel); else follow(panel); });
    }), { rootMargin: "150px" });
    for (const panel of panels) near.observe(panel.host);
    GS.on("time hover", () => { for (const panel of timeGroup.panels) if (seen(panel) || !state.playing) follow(panel); });
    GS.on("region", () => timeGroup.panels.forEach(follow));
    GS.on("zoom", () => { for (const panel of timeGroup.panels) { if (seen(panel)) fit(panel); else panel.stale = true; } });
    GS.on("leg picked", () => panels.forEach((panel) => { if (panel.figure) { panel.figure.dress(); GS.legendState(panel); } }));
    GS.on("hiddenRuns", () => panels.forEach((panel) => { if (panel.figure) { panel.figure.dress(); GS.legendState(panel); fit(panel); } }));
    GS.on("slice", () => {
      for (const panel of panels) {
        if (!panel.figure?.heat) continue;
        panel.figure.heat.show(GS.sliceOf(panel.chart));
        GS.legend(panel);
      }
    });
    GS.on("members", () => panels.forEach((panel) => { GS.showMembers(panel); GS.markedBars(panel); GS.markedBand(panel); }));
    GS.onTheme(() => panels.forEach(GS.dressChart));
    GS.ownChart(addPanel, drop);
    GS.clearCharts = () => { for (const group of groups.values()) group.clear(); };
    // the charts in view first, or the one that comes next, then the others one by one, for paper and for a reader who scrolls
    const open = panels.filter(({ host }) => host.checkVisibility()), seenFirst = open.filter(({ host }) => host.getBoundingClientRect().top < innerHeight);
    await Promise.all((seenFirst.length ? seenFirst : open.slice(0, 1)).map(draw));
    performance.mark("curves");
    GS.ready.curves = true;
    hasDrawn();
    GS.drawRest = async () => {
      for (const panel of panels) {
        if (panel.drawn || !panel.host.checkVisibility()) continue;
        await new Promise((done) => { (window.requestIdleCallback || setTimeout)(done, { timeout: 400 }); });
        await draw(panel);
      }
    };
    // also of parts that are opened later
    document.addEventListener("toggle", GS.drawRest, true);
    await GS.drawRest();
    GS.ready.all = true;
  };

  // Paper: light colours, charts as drawings that fit the page, the 3-D view as a picture of the present moment.
  addEventListener("beforeprint", () => {
    GS.setPrinting(true);
    for (const panel of GS.panels || []) {
      if (!panel.host.checkVisibility()) continue;
      if (!panel.figure) {
        panel.paper = GS.element("p", { class: "paper" }, "This chart was not yet drawn: print once more.");
        panel.plot.after(panel.paper);
        continue;
      }
      GS.dressChart(panel);
      panel.paper = GS.element("div", { class: "paper", "aria-hidden": "true" }, panel.figure.drawing());
      panel.plot.after(panel.paper);
    }
    GS.printStage?.();
    GS.drawRest?.();
  });
  addEventListener("afterprint", () => {
    GS.setPrinting(false);
    for (const panel of GS.panels || []) {
      panel.paper?.remove();
      GS.dressChart(panel);
    }
  });
})();

// A chart of the reader's own: any signals over time, read at two cursors, saved as rows.
(() => {
  const GS = GoughStewart, { element, page, state } = GS, host = document.getElementById("own"), chosen = [];
  GS.ownChart = () => {};
  if (!host) return;
  const [select, empty, csv, place, table] = ["select", ".empty", ".rows", ".place", ".sideways"].map((part) => host.querySelector(part));
  let panel = null;

  const unitOf = ({ name, y }) => (y.unit ? `${name} [${y.unit}]` : name);
  // The values at both ends of the marked time, their difference, and what lies between.
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
    const draw = () => {
      if (panel) close(panel);
      panel = null;
      for (const button of [empty, csv]) button.disabled = !chosen.length;
      if (!chosen.length) { place.replaceChildren(); read(); return; }
      const units = [...new Set(chosen.map(({ y }) => y.unit))], [{ y, time }] = chosen;
      // the words of the axis, if all signals are of one chart
      const title = chosen.every((signal) => signal.y === y) ? y.title : `[${y.unit || 1}]`;
      const figure = element("figure", { class: "chart line" }, element("figcaption", {}, element("ul", { class: "key" })), element("div", { class: "plot", tabindex: 0, role: "group", "aria-label": "Your own chart" }));
      place.replaceChildren(figure);
      panel = open({ title: "your own chart", kind: "line", isTime: true, x: time, y: { ...y, title, scale: "linear" }, series: chosen.map((series, k) => ({ ...series, look: { colour: k % 6, dashes: k < 6 ? [] : [6, 3] } })), marks: [], spans: [], strips: [], units }, figure, read);
    };
    select.addEventListener("change", () => {
      if (!select.value) return;
      const [k, j] = select.value.split(",").map(Number), chart = page.charts[k], series = chart.series[j], name = `${chart.title}: ${series.name}`;
      select.value = "";
      if (chosen.some((signal) => signal.name === name)) return;
      chosen.push({ name, component: name, role: "actual", values: series.values, x: series.x ?? chart.x.values, y: chart.y, time: chart.x, step: chart.kind === "step" });
      draw();
    });
    empty.addEventListener("click", () => { chosen.length = 0; draw(); });
    csv.addEventListener("click", save);
    GS.on("region", read);
    read();
  };
})();
