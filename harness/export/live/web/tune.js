"use strict";
// What is tuned while the loop runs, and what C says of the linear loop: poles and margins. No equation is here.
(() => {
  const GS = GoughStewart, { engine } = GS, $ = (id) => document.getElementById(id);
  const { turn, forceLimit, largestForce, isOpen } = engine.given, { wanted, names, mostDelay, sampleTime } = turn;
  // where a slider stands for a value, 0 to 1, and back
  const SCALES = {
    linear: [(v, a, b) => (v - a) / (b - a), (p, a, b) => a + p * (b - a)],
    log: [(v, a, b) => Math.log(v / a) / Math.log(b / a), (p, a, b) => a * (b / a) ** p],
    square: [(v, a, b) => Math.sqrt((v - a) / (b - a)), (p, a, b) => a + p * p * (b - a)],
  };
  const ms = 1000, um = 1e6, most = Math.max(forceLimit || 0, largestForce || 1), { gains, integral } = turn;
  const byGains = wanted[names.indexOf("bandwidth")] ? undefined : { value: 0, share: 0, text: "by gains" };
  // key: label, unit, factor from SI, smallest, largest, scale, whether it is there; a special value
  const kinds = {
    bandwidth: ["bandwidth", "Hz", 1, 0.2, 30, "log", gains, byGains],
    damping_ratio: ["damping ratio", "", 1, 0.05, 2, "linear", gains],
    integral_time: ["integral time", "s", 1, 0.05, 10, "log", integral],
    filter_time: ["filter", "ms", ms, 0.5 * sampleTime * ms, 100, "log", gains, { value: 0, share: 0, text: "auto" }],
    proportional: ["kp ×", "", 1, 0.1, 10, "log", gains],
    derivative: ["kd ×", "", 1, 0.1, 10, "log", gains],
    integral: ["ki ×", "", 1, 0.1, 10, "log", integral],
    delay: ["delay", "samples", 1, 0, mostDelay, "linear", true],
    force_limit: ["force limit", "N", 1, 0.01 * most, 4 * most, "log", true, { value: null, share: 1, text: "none" }],
    noise: ["noise", "µm", um, 0, 200, "square", !isOpen],
    quantisation: ["quantisation", "µm", um, 0, 500, "square", !isOpen],
  };
  const now = [...wanted];
  const text = (key, value) => GS.short(Number((value * kinds[key][2]).toPrecision(4)));
  const fields = names.map((key, k) => {
    const [label, unit, factor, low, high, scale, has, special] = kinds[key], [to, from] = SCALES[scale];
    // 0 stands for what the experiment states, which has a word
    const isPositive = key === "bandwidth" || key === "filter_time";
    const rounded = (value) => (key === "delay" ? Math.round(value) : Number(value.toPrecision(3)) / factor);
    return has && GS.field($("tuned"), {
      id: `tune-${key}`, label, unit, special, said: $("tune-said"), step: key === "delay" ? 1 / mostDelay : 0.002,
      to: (value) => to(value * factor, low, high), from: (share) => rounded(from(share, low, high)) * factor, text: (value) => text(key, value),
      valid: (value) => !isPositive || value > 0, expected: `a number${isPositive ? " above 0" : ""}${unit && ` of ${unit}`}`,
      set: (value) => set(k, value === special?.value ? value : value / factor),
    });
  });
  let kept = [...now], waiting = 0;
  const send = () => {
    fields.forEach((field, k) => { if (field) field.show(now[k]); });
    waiting++;
    engine.say("tune", { values: [...now] });
  };
  const to = (values) => {
    now.splice(0, now.length, ...values);
    send();
  };
  const set = (k, value) => to(now.map((old, j) => (j === k ? value : old)));
  engine.on("tuned", ({ status }) => {
    waiting--;
    if (waiting) return;
    if (status === 0) { kept = [...now]; return; }
    const key = names[status - 1], value = now[status - 1];
    const why = {
      filter_time: "the derivative's filter would be faster than half a sample: a longer filter, or less bandwidth",
      integral_time: "the integral time is too short for these gains",
    }[key] ?? `${kinds[key][0]} is ${value === null ? "none" : text(key, value)}, beyond its bounds`;
    now.splice(0, now.length, ...kept);
    send();
    $("tune-said").textContent = `not possible: ${why}; the last setting stays`;
  });
  $("tune-back").addEventListener("click", () => { $("tune-said").textContent = ""; to(wanted); });
  fields.forEach((field, k) => { if (field) field.show(now[k]); });

  // What C found, see machine.h: modes as damping ratio over frequency.
  const drawModes = (values, n, first) => {
    const canvas = $("poles"), theme = GS.theme(), [width, height, left, bottom] = [230, 150, 24, 16], pen = GS.pen(canvas, width, height);
    const [low, high] = [Math.min(values[first], 1), 0.5 / sampleTime];
    const x = (f) => left + (width - left - 8) * Math.log(Math.max(f, low) / low) / Math.log(2 * high / low);
    const y = (d) => (height - bottom) * (1 - (Math.min(Math.max(d, -0.2), 1) + 0.25) / 1.35);
    pen.fillStyle = theme.ink;
    pen.textAlign = "right";
    for (const d of [0, 0.5, 1]) {
      pen.strokeStyle = d ? theme.line : theme.roles.limit;
      GS.stroke(pen, [[left, y(d)], [width, y(d)]]);
      pen.fillText(String(d), left - 4, y(d) + 4);
    }
    pen.textAlign = "center";
    for (let f = 10 ** Math.ceil(Math.log10(low)); f <= high; f *= 10) pen.fillText(`${GS.short(f)} Hz`, x(f), height - 3);
    pen.lineWidth = 1.4;
    for (let k = first; k < first + 2 * n; k += 2) {
      const [f, damping] = [x(values[k]), values[k + 1]], up = y(damping);
      pen.strokeStyle = damping > 0 ? theme.ink : theme.roles.limit;
      for (const side of [-3, 3]) GS.stroke(pen, [[f - 3, up + side], [f + 3, up - side]]);
    }
  };
  let last = null;
  const show = (values) => {
    const [radius, , peakS, peakT] = values, stable = radius < 1, first = turn.poles + 2 * turn.most;
    $("margins").hidden = false;
    drawModes(values, values[turn.poles - 1], first);
    $("modes").textContent = stable
      ? `stable: slowest mode ${GS.short(values[first], 3)} Hz with a damping ratio of ${GS.short(values[first + 1], 2)}; peaks of S ${GS.fixed(peakS, 2)} and T ${GS.fixed(peakT, 2)}`
      : `unstable: a pole at |z| = ${radius.toPrecision(4)}, expected below 1`;
    const number = (value, factor, digits, unit) => (Number.isFinite(value) ? `${GS.short(value * factor, digits)}${unit}` : value === Infinity ? "∞" : "–");
    $("leg-margins").replaceChildren(...[0, 1, 2, 3, 4, 5].map((leg) => {
      const [up, down, phase, delay, crossover] = values.subarray(4 + 5 * leg, 9 + 5 * leg), gain = `× ${number(down, 1, 2, "")} to ${number(up, 1, 3, "")}`;
      const cells = [stable ? gain : "–", number(phase, 180 / Math.PI, 3, "°"), number(delay, 1000, 3, " ms"), number(crossover, 1, 3, " Hz")];
      return GS.element("tr", {}, GS.element("th", { scope: "row" }, String(leg + 1)), ...cells.map((cell) => GS.element("td", {}, cell)));
    }));
  };
  engine.on("margins", ({ values }) => { last = values; show(values); });
  GS.onTheme(() => { if (last) show(last); });
  GS.tune = { now, names, to, get margins() { return last && [...last]; } };
})();
