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

  // What is known of the marked members beside all: how many, quantiles of the metrics, and the largest with its member.
  const quantile = (sorted, share) => {
    if (!sorted.length) return NaN;
    const at = share * (sorted.length - 1), low = Math.floor(at), high = Math.min(low + 1, sorted.length - 1);
    return sorted[low] + (at - low) * (sorted[high] - sorted[low]);
  };
  // Of a single member: its page, if there is one, and the command that runs it.
  const opened = () => {
    const { element } = GS, [id] = state.members, told = [];
    if (state.members.size !== 1) return told;
    const link = document.querySelector(`tr[data-member="${id}"] a`);
    if (link) told.push(element("p", {}, element("a", { href: link.getAttribute("href") }, `open the run of member ${id}`)));
    if (GS.page.members.repeat) told.push(element("p", {}, `Run member ${id} again, with the same numbers: `, element("code", {}, `${GS.page.members.repeat} ${id}`)));
    return told;
  };
  const summary = async () => {
    const { members } = GS.page, box = document.getElementById("marked");
    if (!members || !box) return;
    box.hidden = !state.members;
    if (!state.members) return;
    const ids = await GS.array(members.ids), has = [...ids].map((id) => state.members.has(id));
    const rows = await Promise.all(members.numbers.map(async ({ name, unit, factor, digits, values }) => {
      const all = (await GS.array(values)).map((v) => factor * v), sorted = (list) => list.filter(Number.isFinite).sort((a, b) => a - b);
      const own = sorted(all.filter((_, k) => has[k])), whole = sorted(all);
      const most = own.length ? ids[all.findIndex((v, k) => has[k] && v === own.at(-1))] : null;
      const cells = [quantile(own, 0.5), quantile(whole, 0.5), quantile(own, 0.95), quantile(whole, 0.95), own.at(-1) ?? NaN].map((v) => GS.short(v, digits));
      return [unit ? `${name} [${unit}]` : name, ...cells, most === null ? "–" : String(most)];
    }));
    const { element } = GS, heads = ["", "median", "of all", "95 %", "of all", "largest", "in member"];
    const table = element("table", {},
      element("caption", {}, `${state.members.size} of ${ids.length} members are marked`),
      element("thead", {}, element("tr", {}, ...heads.map((head) => element(head ? "th" : "td", head ? { scope: "col", class: "n" } : {}, head)))),
      element("tbody", {}, ...rows.map(([name, ...cells]) => element("tr", {}, element("th", { scope: "row" }, name), ...cells.map((cell) => element("td", { class: "n" }, cell))))));
    box.replaceChildren(element("div", { class: "sideways", role: "group", "aria-label": "marked members" }, table), ...opened());
    GS.fitTables();
  };
  GS.on("members", summary);

  // Of histograms of these metrics: the bars of the marked members within those of all.
  GS.markedBars = async (panel) => {
    const { members } = GS.page, found = members && panel.chart.kind === "histogram" && members.numbers.find(({ name }) => name === panel.chart.title);
    if (!found || !panel.figure) return;
    const [ids, values] = await Promise.all([GS.array(members.ids), GS.array(found.values)]), edges = panel.figure.data.x;
    const counts = new Float64Array(edges.length - 1);
    if (state.members) {
      values.forEach((value, k) => {
        const v = found.factor * value;
        if (!state.members.has(ids[k]) || !(v >= edges[0])) return;
        let bin = GS.rowAt(edges, v);
        if (bin === counts.length && v <= edges[bin] * (1 + 1e-12)) bin--;
        if (bin >= 0 && bin < counts.length) counts[bin]++;
      });
    }
    panel.figure.markBars(counts);
  };
})();
