"use strict";
// What a hand does: the reference in six axes by pads, sliders, keys and a game pad; or the forces of an open loop.
(() => {
  const GS = GoughStewart, $ = (id) => document.getElementById(id);
  GS.hand = ({ engine, restart }) => {
    const { given } = engine, DEGREE = Math.PI / 180;
    const open = given.isOpen;
    const axes = open
      ? [1, 2, 3, 4, 5, 6].map((leg, k) => ({ name: `leg ${leg}`, unit: "N", factor: 1, most: 2 * Math.max(...given.forces.map(Math.abs), 1), start: given.forces[k], digits: 1 }))
      : ["x", "y", "z", "roll", "pitch", "yaw"].map((name, k) => ({
        name, unit: k < 3 ? "mm" : "°", factor: k < 3 ? 1000 : 1 / DEGREE, most: given.reach[k] * (k < 3 ? 1000 : 1 / DEGREE), start: 0, digits: 1,
      }));
    // from home, in the unit that is shown
    const wanted = axes.map((axis) => axis.start);
    const listeners = [];
    let taken = false, held = null, stepped = 2, out = false;
    const take = () => {
      if (taken || open) return;
      taken = true;
      engine.say("take");
      $("follows").textContent = "your hand";
    };
    const send = () => {
      if (open) engine.write("feedforward", 0, [...wanted]);
      else engine.write("plan_target", 0, wanted.map((value, k) => given.home[k] + value / axes[k].factor), false);
    };
    const clipped = (k, value) => Math.min(Math.max(value, -axes[k].most), axes[k].most);
    const fields = axes.map((axis, k) => {
      const id = `axis-${k}`, at = { min: -axis.most, max: axis.most, step: axis.most / 100, value: axis.start, autocomplete: "off" };
      const slider = GS.element("input", { type: "range", id, "aria-label": `${axis.name} [${axis.unit}]`, ...at });
      const number = GS.element("input", { type: "text", inputmode: "decimal", value: GS.short(axis.start), "aria-label": `${axis.name} [${axis.unit}], as a number`, autocomplete: "off" });
      slider.addEventListener("input", () => set({ [k]: Number(slider.value) }));
      number.addEventListener("change", () => {
        const value = number.value.trim() === "" ? NaN : Number(number.value.replace("−", "-").replace(",", "."));
        if (!Number.isFinite(value)) {
          $("said").textContent = `${axis.name} is '${number.value}'; expected a number from ${GS.short(-axis.most)} to ${GS.short(axis.most)} ${axis.unit}`;
          number.setAttribute("aria-invalid", "true");
          show();
          return;
        }
        $("said").textContent = "";
        set({ [k]: value });
      });
      $("axes").append(GS.element("div", { class: "axis" }, GS.element("label", { for: id }, axis.name), slider, number, GS.element("span", { class: "unit" }, axis.unit)));
      return { slider, number };
    });
    const show = () => fields.forEach(({ slider, number }, k) => {
      slider.value = wanted[k];
      if (document.activeElement !== number || number.getAttribute("aria-invalid") !== "true") number.value = GS.short(Number(wanted[k].toFixed(axes[k].digits)));
      for (const pad of pads) pad.place();
    });
    const set = (values) => {
      for (const [k, value] of Object.entries(values)) {
        wanted[k] = clipped(k, value);
        stepped = Number(k);
        fields[k].number.removeAttribute("aria-invalid");
      }
      take();
      send();
      show();
      for (const listener of listeners) listener();
    };
    // A pad moves two axes: by mouse or finger, while it is held.
    const pad = (element, [i, j]) => {
      const knob = element.querySelector("i");
      const move = (event) => {
        const box = element.getBoundingClientRect();
        const share = (value) => Math.min(Math.max(2 * value - 1, -1), 1);
        set({ [i]: share((event.clientX - box.left) / box.width) * axes[i].most, [j]: -share((event.clientY - box.top) / box.height) * axes[j].most });
      };
      element.addEventListener("pointerdown", (event) => {
        element.setPointerCapture(event.pointerId);
        held = element;
        move(event);
        event.preventDefault();
      });
      element.addEventListener("pointermove", (event) => { if (held === element && element.hasPointerCapture(event.pointerId)) move(event); });
      for (const end of ["pointerup", "pointercancel"]) element.addEventListener(end, () => { held = null; });
      return { place: () => {
        knob.style.left = `${50 + 50 * wanted[i] / axes[i].most}%`;
        knob.style.top = `${50 - 50 * wanted[j] / axes[j].most}%`;
      } };
    };
    const pads = open ? [] : [pad($("pad-0"), [0, 1]), pad($("pad-1"), [5, 2]), pad($("pad-2"), [3, 4])];
    $("pads").hidden = open;
    // Keys anywhere but in a field: W A S D and R F move, with Shift they turn; T makes a step.
    const KEYS = { a: [0, -1], d: [0, 1], w: [1, 1], s: [1, -1], r: [2, 1], f: [2, -1] };
    document.addEventListener("keydown", (event) => {
      const key = event.key.toLowerCase(), found = KEYS[key];
      if (open || event.ctrlKey || event.metaKey || event.altKey || /^(input|select)$/i.test(event.target.tagName)) return;
      if (key === "t") step();
      if (!found) return;
      const k = found[0] + (event.shiftKey ? 3 : 0);
      set({ [k]: wanted[k] + found[1] * axes[k].most / 20 });
      event.preventDefault();
    });
    // A game pad: sticks x and y, yaw and z; with a shoulder button roll and pitch.
    const DEAD = 0.12;
    let used = false;
    const poll = () => {
      const found = open ? null : [...(navigator.getGamepads?.() || [])].find((each) => each && each.connected);
      if (!found) return;
      const stick = (k) => (Math.abs(found.axes[k] || 0) > DEAD ? found.axes[k] : 0), turns = found.buttons[4]?.pressed || found.buttons[5]?.pressed;
      const [x, y, u, v] = [0, 1, 2, 3].map(stick);
      if (!x && !y && !u && !v && !used) return;
      used = Boolean(x || y || u || v);
      const values = turns ? { 3: x, 4: -y } : { 0: x, 1: -y, 5: u, 2: -v };
      set(Object.fromEntries(Object.entries(values).map(([k, share]) => [k, share * axes[k].most])));
    };
    $("centre").addEventListener("click", () => set(Object.fromEntries(axes.map((axis, k) => [k, open ? axis.start : 0]))));
    $("motion").hidden = open;
    $("motion").addEventListener("click", () => restart());
    $("hand-title").textContent = open ? "The six forces" : "Move it";
    $("centre").textContent = open ? "the experiment's forces" : "back to home";
    show();
    // A step of a tenth of the reach along the axis that was moved last, and back: past the filter.
    const step = () => {
      if (open) return;
      take();
      out = !out;
      const by = (out ? 0.1 : -0.1) * given.reach[stepped];
      wanted[stepped] = clipped(stepped, wanted[stepped] + by * axes[stepped].factor);
      engine.say("jump", { axis: stepped, by });
      show();
      $("said").textContent = `a step of ${GS.short(by * axes[stepped].factor, 3)} ${axes[stepped].unit} along ${axes[stepped].name}; its response follows in 3 s`;
    };
    engine.on("response", ({ axis, by, rise, overshoot, last }) => {
      const { name, unit, factor } = axes[axis], size = `${GS.short(by * factor, 3)} ${unit} along ${name}`;
      const rose = rise === null ? "it has not come to 90 % in 3 s" : `rise time ${GS.short(1000 * rise, 3)} ms (10 to 90 %), overshoot ${GS.short(100 * overshoot, 2)} %`;
      $("said").textContent = `step of ${size}: ${rose}; ${GS.short(100 * (1 - last), 2)} % is left after 3 s`;
    });
    $("step").addEventListener("click", step);
    $("step").hidden = open;
    return {
      poll,
      taken: () => taken,
      wanted: () => [...wanted],
      to: (values) => set(Object.fromEntries(values.map((value, k) => [k, value ?? 0]))),
      onChange: (listener) => listeners.push(listener),
      begun: () => {
        taken = false;
        out = false;
        if (!open) wanted.fill(0);
        $("follows").textContent = open ? "constant forces" : "the experiment's motion";
        show();
      },
    };
  };
})();
