"use strict";
// The curves beside the view: they follow the animation's time, and a click on them sets it.
(() => {
  const GS = GoughStewart;
  let chart = null;

  // Where the plotting area is, and which times it shows; from the page itself, as the reader sees it.
  const area = () => {
    const panels = chart.querySelectorAll(".draglayer .nsewdrag");
    if (!panels.length) return null;
    const host = chart.getBoundingClientRect();
    const boxes = [...panels].map((panel) => panel.getBoundingClientRect());
    return {
      left: boxes[0].left - host.left, width: boxes[0].width,
      top: Math.min(...boxes.map((b) => b.top)) - host.top, bottom: Math.max(...boxes.map((b) => b.bottom)) - host.top,
      range: chart.layout.xaxis.range.map(Number),
    };
  };

  GS.moveCursor = (time) => {
    const place = chart && area(), cursor = document.getElementById("cursor");
    if (!place) return;
    const share = (time - place.range[0]) / (place.range[1] - place.range[0] || 1);
    const inside = share >= -1e-9 && share <= 1 + 1e-9;
    cursor.style.display = inside ? "block" : "none";
    cursor.style.left = `${place.left + share * place.width}px`;
    cursor.style.top = `${place.top}px`;
    cursor.style.height = `${place.bottom - place.top}px`;
  };

  // Curves of the records whose boxes are checked; a legend entry is that of the first of its curves to be seen.
  GS.showCurves = () => {
    const boxes = [...document.querySelectorAll("input[data-record]")];
    if (!chart || !boxes.length) return;
    const led = new Set(), { data } = GS.page.chart;
    const visible = data.map((line) => line.meta.some((record) => boxes[record].checked));
    const showlegend = data.map(({ legendgroup }, k) => {
      if (!legendgroup || !visible[k] || led.has(legendgroup)) return false;
      led.add(legendgroup);
      return true;
    });
    Plotly.restyle(chart, { visible, showlegend });
  };

  GS.charts = () => {
    const element = document.getElementById("chart");
    const { data, layout } = GS.page.chart;
    Plotly.newPlot(element, data, layout, GS.quiet).then(() => {
      chart = element;
      GS.moveCursor(GS.player.time);
      element.on("plotly_relayout", () => GS.moveCursor(GS.player.time));
      element.on("plotly_afterplot", () => GS.moveCursor(GS.player.time));
      let pressed = null;
      element.addEventListener("mousedown", (event) => { pressed = [event.clientX, event.clientY]; }, true);
      element.addEventListener("click", (event) => {
        const place = area(), x = event.clientX - element.getBoundingClientRect().left;
        const still = pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 4;
        const onPanel = event.target.closest && event.target.closest(".nsewdrag");
        if (!still || !onPanel) return;
        const share = (x - place.left) / place.width;
        GS.player.seek(place.range[0] + share * (place.range[1] - place.range[0]));
      }, true);
      GS.showCurves();
      performance.mark("curves");
      GS.ready.curves = true;
    });
  };
})();
