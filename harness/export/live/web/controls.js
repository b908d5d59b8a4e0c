"use strict";
// A slider with its number.
(() => {
  const GS = GoughStewart;
  // `to` and `from` are the slider's place, 0 to 1, of a value, and back; a special value has a text of its own.
  GS.field = (host, { id, label, unit, step, to, from, text, set, valid = () => true, expected, special, said }) => {
    const slider = GS.element("input", { type: "range", id, min: 0, max: 1, step, "aria-label": `${label} ${unit}`.trim(), autocomplete: "off" });
    const number = GS.element("input", { type: "text", inputmode: "decimal", "aria-label": `${label}, as a number`, autocomplete: "off" });
    host.append(GS.element("div", { class: "axis" }, GS.element("label", { for: id }, label), slider, number, GS.element("span", { class: "unit" }, unit)));
    const shown = (value) => (special && value === special.value ? special.text : text(value));
    slider.addEventListener("input", () => {
      said.textContent = "";
      set(from(Number(slider.value)));
    });
    number.addEventListener("change", () => {
      const typed = number.value.trim(), value = typed === "" ? NaN : Number(typed.replace("−", "-").replace(",", "."));
      const isSpecial = special && (typed === "" || typed === special.text);
      if (!isSpecial && !(Number.isFinite(value) && valid(value))) {
        said.textContent = `${label} is '${number.value}'; expected ${expected}${special ? `, or ${special.text}` : ""}`;
        number.setAttribute("aria-invalid", "true");
        return;
      }
      said.textContent = "";
      number.removeAttribute("aria-invalid");
      set(isSpecial ? special.value : value);
    });
    return {
      show: (value) => {
        const share = special && value === special.value ? special.share : to(value);
        slider.value = Math.min(Math.max(share, 0), 1);
        slider.setAttribute("aria-valuetext", `${shown(value)} ${unit}`.trim());
        if (document.activeElement === number && number.getAttribute("aria-invalid")) return;
        number.removeAttribute("aria-invalid");
        number.value = shown(value);
      },
    };
  };
})();

// The reference by hand in six axes, by pads, sliders, keys and a game pad; or the forces of an open loop.
(() => {
  const GS = GoughStewart, { engine } = GS, { given } = engine, $ = (id) => document.getElementById(id), open = given.isOpen;
  const forces = given.forces.map((start, k) => ({ name: `leg ${k + 1}`, unit: "N", factor: 1, most: 2 * Math.max(...given.forces.map(Math.abs), 1), start }));
  const poses = ["x", "y", "z", "roll", "pitch", "yaw"].map((name, k) => {
    const [unit, factor] = k < 3 ? ["mm", 1000] : ["°", 180 / Math.PI];
    return { name, unit, factor, most: given.reach[k] * factor, start: 0 };
  });
  const axes = open ? forces : poses;
  // from home, in the unit that is shown
  const wanted = axes.map((axis) => axis.start);
  let taken = false, held = null, stepped = 2, out = false;
  const fields = axes.map(({ name, unit, most }, k) => GS.field($("axes"), {
    id: `axis-${k}`, label: name, unit, step: 0.005, to: (value) => (value / most + 1) / 2, from: (share) => (2 * share - 1) * most,
    text: (value) => GS.short(Number(value.toFixed(1))), expected: `a number from ${GS.short(-most)} to ${GS.short(most)} ${unit}`,
    set: (value) => set({ [k]: value }), said: $("said"),
  }));
  const show = () => {
    fields.forEach((field, k) => field.show(wanted[k]));
    for (const pad of pads) pad();
  };
  const take = () => {
    taken = true;
    if (!open) $("follows").textContent = "your hand";
  };
  const set = (values) => {
    for (const [k, value] of Object.entries(values)) {
      wanted[k] = Math.min(Math.max(value, -axes[k].most), axes[k].most);
      stepped = Number(k);
    }
    take();
    if (open) engine.say("forces", { values: [...wanted] });
    else engine.say("target", { values: wanted.map((value, k) => given.home[k] + value / axes[k].factor) });
    show();
  };
  // A pad moves two axes: by mouse or finger, while it is held.
  const pads = (open ? [] : [[0, 1], [5, 2], [3, 4]]).map(([i, j], number) => {
    const pad = $(`pad-${number}`), knob = pad.querySelector("i");
    const move = (event) => {
      const box = pad.getBoundingClientRect(), share = (at, size) => Math.min(Math.max(2 * at / size - 1, -1), 1);
      set({ [i]: share(event.clientX - box.left, box.width) * axes[i].most, [j]: -share(event.clientY - box.top, box.height) * axes[j].most });
    };
    pad.addEventListener("pointerdown", (event) => {
      pad.setPointerCapture(event.pointerId);
      held = pad;
      move(event);
      event.preventDefault();
    });
    pad.addEventListener("pointermove", (event) => { if (held === pad) move(event); });
    for (const end of ["pointerup", "pointercancel"]) pad.addEventListener(end, () => { held = null; });
    return () => {
      knob.style.left = `${50 + 50 * wanted[i] / axes[i].most}%`;
      knob.style.top = `${50 - 50 * wanted[j] / axes[j].most}%`;
    };
  });
  // A step of a tenth of the reach along the axis that was moved last, and back: past the filter.
  const step = () => {
    take();
    out = !out;
    const { name, unit, factor, most } = axes[stepped], by = (out ? 0.1 : -0.1) * most;
    wanted[stepped] = Math.min(Math.max(wanted[stepped] + by, -most), most);
    engine.say("jump", { axis: stepped, by: by / factor });
    show();
    $("said").textContent = `a step of ${GS.short(by, 3)} ${unit} along ${name}; its response follows in 3 s`;
  };
  engine.on("response", ({ axis, by, rise, overshoot, last }) => {
    const { name, unit, factor } = axes[axis], rose = rise === null ? "it has not come to 90 % in 3 s"
      : `rise time ${GS.short(1000 * rise, 3)} ms (10 to 90 %), overshoot ${GS.short(100 * overshoot, 2)} %`;
    $("said").textContent = `step of ${GS.short(by * factor, 3)} ${unit} along ${name}: ${rose}; ${GS.short(100 * (1 - last), 2)} % is left after 3 s`;
  });
  // Keys anywhere but in a field: W A S D and R F move, with Shift they turn; T makes a step.
  const KEYS = { a: [0, -1], d: [0, 1], w: [1, 1], s: [1, -1], r: [2, 1], f: [2, -1] };
  document.addEventListener("keydown", (event) => {
    const key = event.key.toLowerCase();
    if (!given.canTake || event.ctrlKey || event.metaKey || event.altKey || /^(input|select)$/i.test(event.target.tagName)) return;
    if (key === "t") step();
    if (!KEYS[key]) return;
    const [axis, sign] = KEYS[key], k = axis + (event.shiftKey ? 3 : 0);
    set({ [k]: wanted[k] + sign * axes[k].most / 20 });
    event.preventDefault();
  });
  // A game pad: sticks x and y, yaw and z; with a shoulder button roll and pitch.
  const DEAD = 0.12;
  let moves = false;
  const poll = () => {
    const pad = given.canTake && [...(navigator.getGamepads?.() || [])].find((connected) => connected?.connected);
    if (!pad) return;
    const [x, y, u, v] = [0, 1, 2, 3].map((k) => (Math.abs(pad.axes[k] || 0) > DEAD ? pad.axes[k] : 0)), was = moves;
    moves = Boolean(x || y || u || v);
    if (!moves && !was) return;
    const shares = pad.buttons[4]?.pressed || pad.buttons[5]?.pressed ? { 3: x, 4: -y } : { 0: x, 1: -y, 5: u, 2: -v };
    set(Object.fromEntries(Object.entries(shares).map(([k, share]) => [k, share * axes[k].most])));
  };
  $("centre").addEventListener("click", () => set(Object.fromEntries(axes.map((axis, k) => [k, axis.start]))));
  $("motion").addEventListener("click", () => GS.restart());
  $("step").addEventListener("click", step);
  for (const id of ["pads", "motion", "step"]) $(id).hidden = open;
  $("by-hand").hidden = !open && !given.canTake;
  if (open) {
    $("reference-title").textContent = "Forces";
    $("centre").textContent = "the experiment's forces";
  }
  GS.reference = {
    poll,
    wanted: () => (taken || open ? [...wanted] : null),
    to: (values) => set(Object.fromEntries(values.map((value, k) => [k, value ?? 0]))),
    begun: () => {
      taken = false;
      out = false;
      if (!open) wanted.fill(0);
      $("follows").textContent = open ? "constant forces" : "the experiment's reference";
      show();
    },
  };
})();

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
