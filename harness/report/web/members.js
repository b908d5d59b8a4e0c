"use strict";
// Members of an ensemble: those in a marked range of a chart of points stand out in all charts.
(() => {
  const GS = GoughStewart, { state } = GS;

  // The members whose points lie between two abscissae.
  GS.membersIn = (panel, [a, b]) => {
    const [low, high] = a < b ? [a, b] : [b, a], found = new Set();
    for (const { numbers } of panel.figure.parts) numbers.members?.forEach((member, k) => { if (numbers.x[k] >= low && numbers.x[k] <= high) found.add(member); });
    return found;
  };
  // Points of the members stand out.
  GS.showMembers = (panel) => {
    for (const { numbers, source } of panel.figure?.parts || []) {
      if (!numbers.members || panel.chart.kind !== "points") continue;
      const has = (k) => !state.members || state.members.has(numbers.members[k]);
      source.data = { ...source.data, alpha: numbers.y.map((_, k) => (has(k) ? 0.8 : 0.1)), size: numbers.y.map((_, k) => (state.members && has(k) ? 7 : 5)) };
    }
  };
  // The member nearest to a pixel, with its place in the chart.
  GS.nearest = (panel, event) => {
    const place = panel.figure.place(), box = panel.plot.getBoundingClientRect(), { x_range: X, y_range: Y } = panel.figure.figure;
    const logs = [panel.chart.x.scale, panel.chart.y.scale].map((each) => (each === "log" ? Math.log10 : (v) => v));
    const share = (v, range, f) => (f(v) - f(range.start)) / (f(range.end) - f(range.start));
    let best = null;
    panel.figure.parts.forEach(({ numbers, series }) => numbers.x.forEach((x, k) => {
      const px = place.left + share(x, X, logs[0]) * place.width, py = place.top + (1 - share(numbers.y[k], Y, logs[1])) * place.height;
      const away = Math.hypot(px - event.clientX + box.left, py - event.clientY + box.top);
      if (away < 14 && (!best || away < best.away)) best = { away, px, py, x, y: numbers.y[k], member: numbers.members?.[k], series };
    }));
    return best;
  };
  // The rows of tables that are about these members.
  GS.on("members", () => {
    for (const row of document.querySelectorAll("tr[data-member]")) row.classList.toggle("chosen", Boolean(state.members?.has(Number(row.dataset.member))));
  });
})();
