"use strict";
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
