"use strict";
// What the colour of a leg means.
(() => {
  const GS = GoughStewart;
  const PUSH = [0.84, 0.37, 0.0], PULL = [0.0, 0.45, 0.7], REST = [0.80, 0.83, 0.86];
  const mix = (a, b, share) => a.map((x, k) => x + share * (b[k] - x));
  const byForce = (force, largest) => {
    const share = Math.min(Math.abs(force) / largest, 1);
    return mix(REST, force < 0 ? PULL : PUSH, Math.sqrt(share));
  };
  // green to half of a limit, amber at 80 %, red from there on
  const byNearness = (near) => {
    const stops = [[0, [0.18, 0.55, 0.34]], [0.5, [0.45, 0.68, 0.28]], [0.8, [0.93, 0.68, 0.13]], [1, [0.78, 0.10, 0.10]]];
    if (near >= 1) return [0.55, 0.0, 0.25];
    const k = stops.findIndex((stop) => near <= stop[0]);
    if (k <= 0) return stops[0][1];
    const [[a, from], [b, to]] = [stops[k - 1], stops[k]];
    return mix(from, to, (near - a) / (b - a));
  };
  const LARGEST = GS.records.reduce((most, r) => r.force.reduce((m, f) => Math.max(m, Math.abs(f)), most), 1e-12);
  const css = (rgb) => `rgb(${rgb.map((x) => Math.round(255 * x)).join(",")})`;
  GS.legColour = (kind, record, at, leg) => {
    if (kind === "force") return byForce(record.force[6 * at.frame + leg], LARGEST);
    if (kind === "nearness" && record.nearness) return byNearness(record.nearness.values[6 * at.frame + leg]);
    return [0.62, 0.67, 0.72];
  };
  GS.css = css;
  GS.mixed = mix;
  const evenly = (n) => Array.from({ length: n }, (_, k) => k / (n - 1));
  GS.legend = (kind) => {
    const bar = (colours) => `<i style="background:linear-gradient(90deg,${colours.map(css).join(",")})"></i>`;
    if (kind === "force") {
      const steps = evenly(17).map((share) => byForce((2 * share - 1) * LARGEST, LARGEST));
      return `actuator force${bar(steps)}pulls ${GS.text(-LARGEST)} N <span>pushes ${GS.text(LARGEST)} N</span>`;
    }
    const limits = [...new Set(GS.records.flatMap((r) => (r.nearness ? r.nearness.of : [])))].join(", ");
    if (kind === "nearness" && limits) {
      return `nearest of ${limits}${bar(evenly(21).map((share) => byNearness(0.999 * share)))}middle <span>limit</span>`;
    }
    return "";
  };
})();
