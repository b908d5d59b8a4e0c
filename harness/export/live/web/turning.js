"use strict";
// What is turned while the loop runs, and what C says of the linear loop: poles and margins. No equation is here.
(() => {
  const GS = GoughStewart, $ = (id) => document.getElementById(id);
  // Where a slider stands for a value, 0 to 1, and back.
  const SCALES = {
    linear: [(v, a, b) => (v - a) / (b - a), (p, a, b) => a + p * (b - a)],
    log: [(v, a, b) => Math.log(v / a) / Math.log(b / a), (p, a, b) => a * (b / a) ** p],
    square: [(v, a, b) => Math.sqrt((v - a) / (b - a)), (p, a, b) => a + p * p * (b - a)],
  };
  GS.turning = ({ engine }) => {
    const { turn, forceLimit, largestForce } = engine.given, { wanted, names, mostDelay, sampleTime } = turn;
    const ms = 1000, um = 1e6, most = Math.max(forceLimit || 0, largestForce || 1);
    // key: label, unit, factor from SI, smallest, largest, scale; what an empty or extreme field means
    const kinds = {
      bandwidth: ["bandwidth", "Hz", 1, 0.2, 30, "log", turn.gains, { at: 0, text: "by gains" }],
      damping_ratio: ["damping ratio", "", 1, 0.05, 2, "linear", turn.gains],
      integral_time: ["integral time", "s", 1, 0.05, 10, "log", turn.integral],
      filter_time: ["filter", "ms", ms, 0.5 * sampleTime * ms, 100, "log", turn.gains, { at: 0, text: "auto" }],
      proportional: ["kp ×", "", 1, 0.1, 10, "log", turn.gains],
      derivative: ["kd ×", "", 1, 0.1, 10, "log", turn.gains],
      integral: ["ki ×", "", 1, 0.1, 10, "log", turn.integral],
      delay: ["delay", "samples", 1, 0, mostDelay, "linear", true],
      force_limit: ["force limit", "N", 1, 0.01 * most, 4 * most, "log", true, { at: null, text: "none" }],
      noise: ["noise", "µm", um, 0, 200, "square", !engine.given.isOpen],
      quantisation: ["quantisation", "µm", um, 0, 500, "square", !engine.given.isOpen],
    };
    const now = [...wanted], listeners = [];
    const shown = (key, value) => {
      const [, , factor, , , , , special] = kinds[key];
      return special && value === special.at ? special.text : GS.short(Number((value * factor).toPrecision(4)));
    };
    const fields = names.map((key, k) => {
      const [label, unit, factor, low, high, scale, has, special] = kinds[key];
      if (!has) return null;
      const id = `turn-${key}`, [to, from] = SCALES[scale];
      const slider = GS.element("input", { type: "range", id, min: 0, max: 1, step: key === "delay" ? 1 / mostDelay : 0.002, "aria-label": `${label} ${unit}`.trim(), autocomplete: "off" });
      const number = GS.element("input", { type: "text", inputmode: "decimal", "aria-label": `${label}, as a number`, autocomplete: "off" });
      slider.addEventListener("input", () => {
        const value = from(Number(slider.value), low, high) / factor;
        set(k, key === "delay" ? Math.round(value) : Number(value.toPrecision(3)));
      });
      number.addEventListener("change", () => {
        const text = number.value.trim(), value = Number(text.replace("−", "-").replace(",", "."));
        if (special && (text === "" || text === special.text)) { set(k, special.at); return; }
        if (text === "" || !Number.isFinite(value)) {
          $("turn-said").textContent = `${label} is '${number.value}'; expected a number${unit && ` of ${unit}`}${special ? `, or ${special.text}` : ""}`;
          number.setAttribute("aria-invalid", "true");
          return;
        }
        set(k, value / factor);
      });
      $("turned").append(GS.element("div", { class: "axis" }, GS.element("label", { for: id }, label), slider, number, GS.element("span", { class: "unit" }, unit)));
      const show = () => {
        number.removeAttribute("aria-invalid");
        number.value = shown(key, now[k]);
        const value = special && now[k] === special.at ? (key === "force_limit" ? high : low) : now[k] * factor;
        slider.value = Math.min(Math.max(to(value, low, high), 0), 1);
        slider.setAttribute("aria-valuetext", `${shown(key, now[k])} ${unit}`.trim());
      };
      show();
      return show;
    });
    let kept = [...now], waiting = 0;
    const send = (values) => {
      engine.write("turn_wanted", 0, values.map((value) => (value === null ? Infinity : value)));
      waiting++;
      engine.say("turn");
    };
    const set = (k, value) => {
      now[k] = value;
      $("turn-said").textContent = "";
      fields[k]?.();
      send(now);
      for (const listener of listeners) listener();
    };
    engine.on("turned", ({ status }) => {
      waiting = Math.max(0, waiting - 1);
      if (waiting) return;
      if (status === 0) { kept = [...now]; return; }
      const key = names[status - 1], why = key === "filter_time" ? "the derivative's filter would be faster than half a sample: a longer filter, or less bandwidth"
        : key === "integral_time" ? "the integral time is too short for these gains" : `${kinds[key][0]} is ${shown(key, now[status - 1])}, beyond its bounds`;
      now.splice(0, now.length, ...kept);
      for (const show of fields) show?.();
      $("turn-said").textContent = `not possible: ${why}; the last setting stays`;
      send(now);
    });
    const to = (values) => {
      values.forEach((value, k) => { now[k] = value; });
      for (const show of fields) show?.();
      send(now);
      for (const listener of listeners) listener();
    };
    $("turn-back").addEventListener("click", () => { $("turn-said").textContent = ""; to(wanted); });

    // What C found: see turning.h.
    const modes = (values, n, first) => {
      const canvas = $("poles"), pen = canvas.getContext("2d"), theme = GS.theme(), ratio = Math.min(devicePixelRatio, 2);
      const [width, height, left, bottom] = [230, 150, 24, 16];
      canvas.width = width * ratio;
      canvas.height = height * ratio;
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.font = "11px system-ui, sans-serif";
      pen.fillStyle = theme.ink;
      const [low, high] = [Math.min(values[first], 1), 0.5 / sampleTime];
      const x = (f) => left + (width - left - 8) * Math.log(Math.max(f, low) / low) / Math.log(2 * high / low);
      const y = (d) => (height - bottom) * (1 - (Math.min(Math.max(d, -0.2), 1) + 0.25) / 1.35);
      pen.strokeStyle = theme.line;
      pen.textAlign = "right";
      for (const d of [0, 0.5, 1]) {
        pen.strokeStyle = d ? theme.line : theme.roles.limit;
        GS.stroke(pen, [[left, y(d)], [width, y(d)]]);
        pen.fillText(String(d), left - 4, y(d) + 4);
      }
      pen.textAlign = "center";
      for (let f = 10 ** Math.ceil(Math.log10(low)); f <= high; f *= 10) pen.fillText(`${GS.short(f)} Hz`, x(f), height - 3);
      pen.lineWidth = 1.4;
      for (let k = 0; k < n; k++) {
        const [f, damping] = [values[first + 2 * k], values[first + 2 * k + 1]], [at, up] = [x(f), y(damping)];
        pen.strokeStyle = damping > 0 ? theme.ink : theme.roles.limit;
        for (const side of [-3, 3]) GS.stroke(pen, [[at - 3, up + side], [at + 3, up - side]]);
      }
    };
    let last = null;
    const show = (values) => {
      const [radius, , peak_s, peak_t] = values, stable = radius < 1, first = turn.poles + 2 * turn.most;
      $("margins").hidden = false;
      modes(values, values[turn.poles - 1], first);
      $("modes").textContent = stable
        ? `stable: slowest mode ${GS.short(values[first], 3)} Hz with a damping ratio of ${GS.short(values[first + 1], 2)}; peaks of S ${GS.fixed(peak_s, 2)} and T ${GS.fixed(peak_t, 2)}`
        : `unstable: a pole at |z| = ${radius.toPrecision(4)}, expected below 1`;
      $("leg-margins").replaceChildren(...[0, 1, 2, 3, 4, 5].map((leg) => {
        const [up, down, phase, delay, crossover] = values.subarray(4 + 5 * leg, 9 + 5 * leg);
        const text = (value, factor, digits, unit) => (Number.isFinite(value) ? `${GS.short(value * factor, digits)}${unit}` : value === Infinity ? "∞" : "–");
        const gain = stable ? `× ${text(down, 1, 2, "")} to ${text(up, 1, 3, "")}` : "–";
        return GS.element("tr", {}, GS.element("th", { scope: "row" }, String(leg + 1)), ...[gain, text(phase, 180 / Math.PI, 3, "°"), text(delay, 1000, 3, " ms"), text(crossover, 1, 3, " Hz")].map((each) => GS.element("td", {}, each)));
      }));
    };
    engine.on("margins", ({ values }) => { last = values; show(values); });
    GS.onTheme(() => { if (last) show(last); });
    return { now, names, to, onChange: (listener) => listeners.push(listener), get margins() { return last && [...last]; } };
  };
})();
