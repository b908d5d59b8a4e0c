"use strict";
// Shared by all scripts of the page: its data, numbers as text, colours of the theme.
const GoughStewart = (() => {
  const minus = (text) => (Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−"));
  const significant = (x, digits) => (Math.abs(x) >= 10 ** digits - 0.5 ? x.toFixed(0) : x.toPrecision(digits));
  const mix = (a, b, share) => a.map((x, k) => x + share * (b[k] - x));
  const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
  const page = JSON.parse(document.getElementById("data").textContent);
  const root = document.documentElement, listeners = [], $ = (id) => document.getElementById(id);

  // The theme that the reader chose, or that of the system; paper is always light.
  const dark = matchMedia("(prefers-color-scheme: dark)"), strong = matchMedia("(prefers-contrast: more)"), forced = matchMedia("(forced-colors: active)");
  let printing = false;
  // the ground is the system's where colours are forced, so it may be dark
  const ofSystem = () => (forced.matches && dark.matches ? "dark" : strong.matches || forced.matches ? "contrast" : dark.matches ? "dark" : "light");
  const chosen = () => $("theme").value || ofSystem();
  const theme = () => {
    const name = printing && chosen() === "dark" ? "light" : chosen(), colours = page.palette[name];
    const line = { light: "#dfe4ea", dark: "#3a4653", contrast: "#9a9a9a" }[name];
    return { name, dark: name === "dark", ink: colours.ink, paper: colours.ground, line, roles: colours.roles, six: colours.six, kinds: colours.kinds };
  };
  const changed = () => {
    root.dataset.theme = theme().name;
    for (const listener of listeners) listener(theme());
  };
  root.dataset.theme = theme().name;
  $("theme").addEventListener("change", changed);
  for (const query of [dark, strong, forced]) query.addEventListener("change", changed);

  return {
    page,
    // a fixed number of decimals
    fixed: (x, digits) => minus(x.toFixed(digits)),
    // always as many significant digits, so that changing numbers do not jump
    text: (x, digits = 4) => minus(significant(x, digits)),
    // as many significant digits at most
    short: (x, digits = 4) => (Number.isFinite(x) ? minus(String(Number(significant(x, digits)))) : x > 0 ? "∞" : "–"),
    theme,
    // colours [r, g, b], 0 to 1: of #rrggbb, a share of the way between two, between stops [share, #rrggbb], and for CSS
    rgb, mix,
    gradient: (stops) => (share) => {
      const k = stops.slice(1, -1).filter(([at]) => at < share).length, [[low, from], [high, to]] = stops.slice(k, k + 2);
      return mix(rgb(from), rgb(to), Math.min(Math.max((share - low) / (high - low), 0), 1));
    },
    css: (colour) => `rgb(${colour.map((x) => Math.round(255 * x)).join(",")})`,
    // call back when the colours change
    onTheme: (callback) => { listeners.push(callback); },
    setPrinting: (is) => {
      printing = is;
      root.dataset.theme = theme().name;
    },
    isPrinting: () => printing,
    // an element with attributes, listeners ("onclick") and children
    element: (tag, attributes = {}, ...children) => {
      const made = document.createElement(tag);
      for (const [name, value] of Object.entries(attributes)) {
        if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
        else if (value !== null) made.setAttribute(name, value);
      }
      made.append(...children);
      return made;
    },
    // the last row of rising values that is at or before x; −1 before the first
    rowAt: (xs, x) => {
      let low = -1, high = xs.length - 1;
      while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (xs[middle] <= x) low = middle; else high = middle - 1;
      }
      return low;
    },
    ready: { picture: false, curves: false },
  };
})();

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
