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
    isTime: true, panels: [], range: GS.range, cursor: GS.shownTime, region: () => state.region, zoom: GS.zoomTo,
    hover: (x) => GS.set({ hover: x }),
    mark: (region) => GS.mark(region),
    click: (x) => GS.set({ hover: null, time: x }),
    key: () => false,
  };
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
    const canZoom = (panel) => panel.chart.kind !== "bars";
    const group = {
      isTime: false, panels: [], region: () => own.region, cursor: () => own.cursor ?? own.fixed,
      range: () => own.zoom || whole(),
      zoom: (range) => {
        if (!canZoom(group.panels[0])) return;
        const all = whole(), [low, high] = range ? [Math.max(range[0], all[0]), Math.min(range[1], all[1])] : all;
        own.zoom = range && (low > all[0] || high < all[1]) && high > low ? [low, high] : null;
        group.panels.forEach(fit);
      },
      hover: (x, panel, event) => {
        if (isFunction) { own.cursor = x; group.panels.forEach(follow); } else if (panel.chart.kind === "points") tell(panel, x === null ? null : GS.nearest(panel, event));
      },
      mark: (region, panel) => {
        if (!canZoom(panel)) return;
        own.region = region && [...region].sort((a, b) => a - b);
        if (panel.chart.kind === "points") GS.set({ members: region ? GS.membersIn(panel, region) : null });
        group.panels.forEach(follow);
      },
      click: (x, panel, event) => {
        if (isFunction) { own.fixed = x; group.panels.forEach(follow); return; }
        const found = panel.chart.kind === "points" && GS.nearest(panel, event);
        own.region = null;
        if (found && found.member !== undefined) GS.set({ members: new Set([found.member]) }); else if (state.members) GS.set({ members: null });
        group.panels.forEach(follow);
      },
      // arrows move the cursor; [ and ] mark; + and 0 zoom
      key: ({ key }, panel) => {
        const range = group.range();
        if (!range) return false;
        const isLog = panel.chart.x.scale === "log", middle = isLog ? Math.sqrt(range[0] * range[1]) : (range[0] + range[1]) / 2;
        const at = own.fixed ?? middle, step = isLog ? (range[1] / range[0]) ** 0.01 : (range[1] - range[0]) / 100;
        const to = { ArrowLeft: isLog ? at / step : at - step, ArrowRight: isLog ? at * step : at + step, Home: range[0], End: range[1] }[key];
        if (to !== undefined) own.fixed = Math.min(Math.max(to, range[0]), range[1]);
        else if (key === "[") group.mark([at, Math.max(own.region?.[1] ?? range[1], at)], panel);
        else if (key === "]") group.mark([Math.min(own.region?.[0] ?? range[0], at), at], panel);
        else if (key === "+") { if (own.region) group.zoom(own.region); else GS.zoomAbout(group, at, 0.5, isLog); }
        else if (key === "-") GS.zoomAbout(group, at, 2, isLog);
        else if (key === "0") group.zoom(null);
        else return false;
        group.panels.forEach(follow);
        return true;
      },
      clear: () => { own.region = own.fixed = null; group.panels.forEach(follow); },
    };
    return group;
  };

  // What the pointer is at, in a chart of points.
  const tell = (panel, found) => {
    panel.told.hidden = !found;
    if (!found) return;
    const { x, y, digits } = { ...panel.chart, digits: 4 };
    const member = found.member === undefined ? "" : `member ${found.member}: `;
    panel.told.textContent = `${member}${GS.short(found.x, digits)} ${x.unit}, ${GS.short(found.y, digits)} ${y.unit}`;
    const left = Math.min(found.px + 8, panel.plot.clientWidth - panel.told.offsetWidth - 4);
    panel.told.style.transform = `translate(${left}px, ${Math.max(found.py - 30, 0)}px)`;
  };

  // Cursor, marked part and values.
  const follow = (panel) => {
    const scale = GS.axisOf(panel);
    if (!scale) return;
    const { place } = scale, x = panel.group.cursor(), region = panel.group.region(), right = place.left + place.width;
    const inside = (pixel) => pixel >= place.left - 0.5 && pixel <= right + 0.5;
    const at = x === null || !panel.figure.isFunction ? NaN : scale.pixel(x);
    panel.cursor.hidden = !inside(at);
    if (inside(at)) panel.cursor.style.transform = `translateX(${at}px)`;
    const ends = region && region.map((end) => Math.min(Math.max(scale.pixel(end), place.left), right));
    panel.region.hidden = !ends || ends[1] - ends[0] < 0.5;
    if (ends) Object.assign(panel.region.style, { transform: `translateX(${ends[0]}px)`, width: `${ends[1] - ends[0]}px` });
    for (const each of [panel.cursor, panel.region]) Object.assign(each.style, { top: `${place.top}px`, height: `${place.height}px` });
    GS.legendValues(panel, x);
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

  // The description of a chart for screen readers.
  const summary = (panel) => {
    const { chart, figure } = panel;
    if (figure.heat) return `Map of ${chart.title} over ${chart.x.title} and ${chart.rows.title}: ${figure.heat.map.told}. Arrows go from value to value.`;
    const names = chart.series.map((each) => each.name).slice(0, 12).join("; ");
    let low = Infinity, high = -Infinity;
    for (const { numbers } of figure.parts) for (const v of numbers.y) { if (v < low) low = v; if (v > high) high = v; }
    const values = low <= high ? `values from ${GS.short(low)} to ${GS.short(high)} ${chart.y.unit}`.trim() : "no values";
    const told = [...chart.spans.map((span) => span.text), ...chart.strips.map(({ name, share }) => `${name}, ${share} of the time`)];
    return `Chart of ${chart.title} over ${chart.x.title}: ${[names, values, ...told].join("; ")}.`;
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
    panel.plot.setAttribute("aria-label", summary(panel));
    panel.group.panels.push(panel);
    GS.legend(panel);
    panel.key.before(element("button", {
      type: "button", class: "save", title: "save this chart as PNG (s)", "aria-label": `save ${panel.chart.title} as PNG`, onclick: () => panel.figure.save(),
    }, "PNG"));
    GS.showMembers(panel);
    if (state.members) { GS.markedBars(panel); GS.markedBand(panel); }
    // the figure finds its size in a frame of its own
    new ResizeObserver(() => requestAnimationFrame(() => { if (!GS.isPrinting()) fit(panel); })).observe(panel.plot);
    if (panel.figure.heat) GS.pointHeat(panel); else GS.point(panel);
    fit(panel);
    return panel;
  })());

  const seen = (panel) => panel.visible;
  GS.charts = async () => {
    await GS.timed;
    await GS.sliceBar();
    for (const host of document.querySelectorAll("figure.chart")) {
      const chart = page.charts[Number(host.dataset.chart)], plot = host.querySelector(".plot");
      Object.assign(plot, { tabIndex: 0 });
      plot.setAttribute("role", "img");
      plot.setAttribute("aria-label", `Chart of ${chart.title}`);
      panels.push({
        chart, host, plot, key: host.querySelector(".key"), group: groupOf(chart), figure: null, visible: false, stale: false,
        cursor: element("div", { class: "cursor", hidden: "" }), region: element("div", { class: "region", hidden: "" }), told: element("div", { class: "pointed", hidden: "" }),
      });
    }
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
})();
