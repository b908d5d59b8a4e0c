"use strict";
// Colours of the legs, and their scale.
GoughStewart.prepareColours = () => {
  const GS = GoughStewart;
  const PUSH = [0.84, 0.37, 0.0], PULL = [0.0, 0.45, 0.7], REST = [0.80, 0.83, 0.86], PLAIN = [0.62, 0.67, 0.72];
  const mix = (a, b, share) => a.map((x, k) => x + share * (b[k] - x));
  const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
  const byForce = (force, largest) => {
    const share = Math.min(Math.abs(force) / largest, 1);
    return mix(REST, force < 0 ? PULL : PUSH, Math.sqrt(share));
  };
  const stops = GS.page.nearness.stops.map(([share, hex]) => [share, rgb(hex)]), beyond = rgb(GS.page.nearness.beyond);
  const byNearness = (near) => {
    if (near > 1 + 1e-9) return beyond;
    const k = stops.findIndex(([share]) => near <= share);
    if (k <= 0) return stops[0][1];
    const [[a, from], [b, to]] = [stops[k - 1], stops[k]];
    return mix(from, to, (near - a) / (b - a));
  };
  const LARGEST = GS.records.reduce((most, r) => (r.force || []).reduce((m, f) => Math.max(m, Math.abs(f)), most), 1e-12);
  const PALE = 0.82;
  const plain = (kind, record, at, leg) => {
    if (kind === "run") return rgb(GS.theme().six[record.run % 6]);
    if (kind === "force" && record.force) return byForce(record.force[6 * at.frame + leg], LARGEST);
    if (kind === "nearness" && record.nearness) return byNearness(record.nearness.values[6 * at.frame + leg]);
    return PLAIN;
  };
  // Legs that are not picked step back.
  GS.legColour = (kind, record, at, leg) => {
    const colour = plain(kind, record, at, leg), { leg: picked } = GS.state;
    return picked === null || picked === leg + 1 ? colour : mix(colour, GS.theme().dark ? [0.16, 0.19, 0.23] : [0.93, 0.94, 0.95], PALE);
  };
  GS.css = (colour) => `rgb(${colour.map((x) => Math.round(255 * x)).join(",")})`;
  GS.mixed = mix;
  const evenly = (n) => Array.from({ length: n }, (_, k) => k / (n - 1));
  // Title of the scale, its colours from low to high, and labels of its ends; undefined if there is no scale.
  GS.scale = (kind) => {
    if (kind === "force") {
      const colours = evenly(17).map((share) => byForce((2 * share - 1) * LARGEST, LARGEST));
      return { title: "actuator force", colours, low: `pulls ${GS.text(-LARGEST)} N`, high: `pushes ${GS.text(LARGEST)} N` };
    }
    const limits = [...new Set(GS.records.flatMap((r) => (r.nearness ? r.nearness.of : [])))].join(", ");
    if (kind !== "nearness" || !limits) return null;
    return { title: `nearest of ${limits}`, colours: evenly(21).map(byNearness), low: "middle", high: "limit" };
  };
};
