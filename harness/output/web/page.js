"use strict";
// What the scripts of all pages share: the data, how numbers were packed, how they are written, what plots offer.
const GoughStewart = (() => {
  const KINDS = { f8: Float64Array, f4: Float32Array, i4: Int32Array, i1: Int8Array };
  const minus = (text) => (Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−"));
  const significant = (x) => (Math.abs(x) >= 9999.5 ? x.toFixed(0) : x.toPrecision(4));
  return {
    page: JSON.parse(document.getElementById("data").textContent),
    numbers: (packed) => new KINDS[packed.dtype](Uint8Array.from(atob(packed.bdata), (c) => c.charCodeAt(0)).buffer),
    // so many digits behind the point
    fixed: (x, digits) => minus(x.toFixed(digits)),
    // four significant digits, always, so that a number that changes does not jump
    text: (x) => minus(significant(x)),
    // four significant digits at most
    short: (x) => (Number.isFinite(x) ? minus(String(Number(significant(x)))) : x > 0 ? "∞" : "–"),
    // only buttons that serve here; others would offer to send the data somewhere
    quiet: { displaylogo: false, responsive: true, modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]] },
  };
})();
