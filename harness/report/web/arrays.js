"use strict";
// Unpacks the arrays of the page, each when it is first asked for (harness/report/packing.py packs them).
(() => {
  const { page } = GoughStewart, known = new Map();

  const inflated = async (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  };
  const even = ({ n, a, b }) => Float64Array.from({ length: n }, (_, k) => (k === n - 1 ? b : a + (b - a) * k / (n - 1)));
  const exact = async ({ n, d }) => {
    const planes = await inflated(d), bytes = new Uint8Array(8 * n);
    for (let p = 0; p < 8; p++) for (let k = 0; k < n; k++) bytes[8 * k + p] = planes[p * n + k];
    return new Float64Array(bytes.buffer);
  };
  const rounded = async ({ n, o, a, s, d, g }) => {
    const planes = await inflated(d), steps = new Int32Array(n), values = new Float64Array(n);
    for (let k = 0; k < n; k++) {
      const z = (planes[k] | planes[n + k] << 8 | planes[2 * n + k] << 16 | planes[3 * n + k] << 24) >>> 0;
      steps[k] = (z >>> 1) ^ -(z & 1);
    }
    for (let order = 0; order < o; order++) for (let k = 1; k < n; k++) steps[k] = steps[k] + steps[k - 1] | 0;
    for (let k = 0; k < n; k++) values[k] = a + s * steps[k];
    for (let k = 0; k < (g || []).length; k += 2) values.fill(NaN, g[k], g[k + 1]);
    return values;
  };

  // A promise of the numbers of an array.
  GoughStewart.array = (number) => {
    if (!known.has(number)) {
      const packed = page.arrays[number];
      known.set(number, Promise.resolve({ even, f8: exact, q: rounded }[packed.k](packed)));
    }
    return known.get(number);
  };
})();
