"use strict";
// How series look, and the emphasis of what the reader has picked.
(() => {
  const GS = GoughStewart, { page, state } = GS, WIDTH = 1.7, STRIPE = 9, PALE = 0.16;

  // Colour, dashes and width of a series in the present theme (harness/report/chart.py chooses them).
  GS.look = ({ look: { colour, dashes }, run }) => {
    const { roles, six } = GS.theme();
    // earlier runs are wide and pale under later ones, so that both are seen where they coincide
    const over = run === undefined ? 0 : Math.max(page.runs.length - 1 - run, 0), width = WIDTH + over * Math.min(3.2, 7 / (page.runs.length - 1));
    return { colour: roles[colour] ?? six[colour], dashes: dashes.map((each) => Math.max(1, each * WIDTH)), width: over ? width : WIDTH, alpha: over ? 0.6 : 1 };
  };

  const xOf = (chart, k) => chart.series[k].x ?? chart.x.values;
  // Full lines that coincide are drawn in turns of dashes, so that each is seen; returns the members of each group.
  GS.coinciding = (chart, all) => {
    const groups = [];
    all.forEach((series, k) => {
      if ((chart.kind !== "line" && chart.kind !== "step") || chart.series[k].role === "band") return;
      if (GS.look(chart.series[k]).dashes.length) return;
      const equal = ([first]) => {
        const a = all[first].y, b = series.y;
        if (xOf(chart, first) !== xOf(chart, k) || chart.series[first].run !== chart.series[k].run || a.length !== b.length) return false;
        return b.every((value, i) => Math.abs(value - a[i]) < chart.y.least || (Number.isNaN(value) && Number.isNaN(a[i])));
      };
      const group = groups.find(equal);
      if (group) group.push(k); else groups.push([k]);
    });
    return groups.filter((group) => group.length > 1);
  };
  GS.striped = (look, place, count) => ({ ...look, dashes: [STRIPE, STRIPE * (count - 1)], offset: -STRIPE * place, width: look.width + 0.4 });

  // A name that picks the same series in all charts.
  GS.keyOf = (series) => [series.role, series.component || series.name].join(" ");
  // 1 for a series that stands out, −1 for one that steps back, 0 where nothing is picked.
  GS.emphasis = (series) => {
    if (state.leg !== null) return series.leg === undefined ? 0 : series.leg === state.leg ? 1 : -1;
    if (state.picked !== null) return GS.keyOf(series) === state.picked ? 1 : -1;
    return 0;
  };
  GS.alpha = (series) => (GS.emphasis(series) < 0 ? PALE : 1);
  GS.isHidden = (series) => series.run !== undefined && state.hiddenRuns.has(series.run);
})();

// Rows of a curve that a screen can show: the smallest and the largest of each column of pixels, or all rows if few.
(() => {
  const { rowAt } = GoughStewart;
  // [x, …values] of the rows between two ends, and one beyond each; every kept row has all its values.
  GoughStewart.reduced = (xs, columns, from, to, buckets) => {
    const first = Math.max(rowAt(xs, from), 0), last = Math.min(rowAt(xs, to) + 1, xs.length - 1), n = last - first + 1;
    if (n <= 2 * buckets) return [xs, ...columns].map((each) => each.subarray(first, last + 1));
    const kept = [first], width = n / buckets;
    for (let b = 0; b < buckets; b++) {
      const start = first + Math.floor(b * width), end = Math.min(first + Math.floor((b + 1) * width), last + 1), rows = new Set();
      for (const values of columns) {
        let least = -1, most = -1;
        for (let k = start; k < end; k++) {
          const value = values[k];
          // a gap stays a gap
          if (Number.isNaN(value)) { rows.add(k); k = nextNumber(values, k, end) - 1; continue; }
          if (least < 0 || value < values[least]) least = k;
          if (most < 0 || value > values[most]) most = k;
        }
        if (least >= 0) rows.add(least).add(most);
      }
      kept.push(...[...rows].sort((a, b) => a - b));
    }
    kept.push(last);
    return [xs, ...columns].map((each) => Float64Array.from(kept, (k) => each[k]));
  };
  const nextNumber = (values, from, end) => {
    let k = from + 1;
    while (k < end && Number.isNaN(values[k])) k++;
    return k;
  };
})();
