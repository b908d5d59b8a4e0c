"use strict";
// Pointer and keys on a chart: hover, click, drag to mark a range, double-click for the whole, Ctrl and wheel to zoom.
(() => {
  const GS = GoughStewart, CLICK = 4;

  // Abscissa of a pixel, and back; null off the plotted part unless `clamped`.
  GS.axisOf = (panel) => {
    const place = panel.figure?.place(), range = panel.group.range();
    if (!place || !range) return null;
    const isLog = panel.chart.x.scale === "log", f = isLog ? Math.log10 : (v) => v, [from, to] = range.map(f);
    return {
      place,
      x: (pixel, clamped = false) => {
        const share = (pixel - place.left) / place.width;
        if (!clamped && (share < 0 || share > 1)) return null;
        const at = from + Math.min(Math.max(share, 0), 1) * (to - from);
        return isLog ? 10 ** at : at;
      },
      pixel: (x) => place.left + (f(x) - from) / (to - from) * place.width,
    };
  };

  GS.point = (panel) => {
    const { plot, group } = panel;
    let from = null, moved = false;
    const at = (event, clamped) => GS.axisOf(panel)?.x(event.clientX - plot.getBoundingClientRect().left, clamped) ?? null;
    plot.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      from = { x: at(event, true), pixel: event.clientX };
      moved = false;
    }, true);
    plot.addEventListener("pointermove", (event) => {
      if (!from || event.buttons === 0) {
        if (event.pointerType !== "touch") group.hover(at(event, false), panel, event);
        return;
      }
      if (!moved && Math.abs(event.clientX - from.pixel) < CLICK) return;
      if (!moved) plot.setPointerCapture(event.pointerId);
      moved = true;
      group.mark([from.x, at(event, true)], panel);
    }, true);
    plot.addEventListener("pointerup", (event) => {
      if (from && !moved) { const x = at(event, false); if (x !== null) group.click(x, panel, event); }
      from = null;
    }, true);
    plot.addEventListener("pointercancel", () => { from = null; });
    plot.addEventListener("pointerleave", () => { if (!from) group.hover(null, panel); });
    plot.addEventListener("dblclick", () => { group.mark(null, panel); group.zoom(null); });
    plot.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      const x = at(event, true);
      if (x !== null) GS.zoomAbout(group, x, 1.25 ** (event.deltaY / 60), panel.chart.x.scale === "log");
    }, { passive: false });
    plot.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.key === "s") { event.preventDefault(); panel.figure.save(); return; }
      if (group.isTime) return;
      if (group.key(event, panel)) { event.preventDefault(); event.stopPropagation(); }
    });
  };

  // Zooms about an abscissa by a factor; more than 1 shows more.
  GS.zoomAbout = (group, x, factor, isLog = false) => {
    const f = isLog ? Math.log10 : (v) => v, g = isLog ? (v) => 10 ** v : (v) => v;
    group.zoom(group.range().map((end) => g(f(x) + factor * (f(end) - f(x)))));
  };
})();
