"use strict";
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
