"use strict";
// The page: play, what acts from outside, what the machine says, and frames.
(() => {
  const GS = GoughStewart, { engine } = GS, { given } = engine, $ = (id) => document.getElementById(id);
  const history = GS.history();
  let playing = !given.isOpen && !matchMedia("(prefers-reduced-motion: reduce)").matches, last = null, fresh = false, over = null;
  let push = [0, 0, 0], frames = 0, rate = null;
  // seconds of the charts: an open loop soon falls
  const span = given.isOpen ? Math.min(8, 2 * given.duration) : 8;
  const FAILURES = given.failures;
  let stage = null;
  try {
    stage = GS.liveStage($("view"));
  } catch (problem) {
    $("no-view").hidden = false;
    $("no-view").textContent = `This browser shows no 3-D graphics (WebGL): ${problem.message || problem}. The charts work without.`;
  }

  const { behind } = given, times = behind?.time;
  const six = (from, of) => Array.from({ length: 6 }, (_, k) => ({
    name: String(k + 1), value: (p) => p[from + k], behind: of?.map((values) => values[k]), colour: (theme) => theme.six[k], dashes: [[], [6, 2], [8, 2, 2, 2], [2, 2], [10, 2, 2, 2, 2, 2], [4, 2]][k],
  }));
  // an element of the pose from home, and what is wanted of it
  const axis = (name, k, factor) => {
    const from = (value) => factor * (value - given.home[k]), colour = (theme) => theme.six[k % 3];
    const own = { name, value: (p) => from(p[1 + k]), behind: behind?.pose.map((pose) => from(pose[k])), colour };
    return given.isOpen ? [own] : [own, { name: `${name} wanted`, value: (p) => from(p[19 + k]), colour, dashes: [5, 4] }];
  };
  const plots = [
    GS.plot($("plots"), { title: "position from home", unit: "mm", least: 2, times, curves: [...axis("x", 0, 1000), ...axis("y", 1, 1000), ...axis("z", 2, 1000)] }),
    ...(given.isOpen ? [GS.plot($("plots"), {
      title: "orientation from home", unit: "°", least: 0.2, times, curves: ["roll", "pitch", "yaw"].flatMap((name, k) => axis(name, 3 + k, 180 / Math.PI)),
    })] : []),
    GS.plot($("plots"), {
      title: "forces of the legs", unit: "N", least: 10, curves: six(13),
      marks: () => (given.forceLimit ? [{ value: given.forceLimit, role: "limit" }, { value: -given.forceLimit, role: "limit" }] : []),
    }),
    GS.plot($("plots"), {
      title: "lengths of the legs", unit: "m", least: 0.004, times, curves: six(7, behind?.length),
      marks: () => (given.stroke || []).map((value) => ({ value, role: "limit" })),
    }),
  ];

  $("behind").hidden = !behind;
  if (behind) $("behind").textContent = `Pale and thick behind the curves: the file's forces from the start, computed by the code of gough-stewart reproduce (DOP853 to 1e-12).${behind.isPublished ? " They are ours, not the paper's: it prints its curves as pictures, which nobody has measured; its text has the forces, the start and the platform, which this experiment has." : ""}`;

  const speed = () => ($("speed").value === "fast" ? null : Number($("speed").value));
  const run = () => {
    engine.say("run", { playing: playing && !document.hidden, speed: speed() });
    $("play").textContent = playing ? "❚❚ pause" : "▶ play";
    rate = null;
    if (!playing) $("rate").textContent = "";
    fresh = true;
  };
  const restart = (plays = true) => {
    over = null;
    last = null;
    history.clear();
    engine.say("again");
    hand.begun();
    $("over").hidden = true;
    playing = plays;
    run();
  };
  const hand = GS.hand({ engine, restart });
  hand.begun();
  const turning = GS.turning({ engine });
  const toggle = () => {
    if (over) { restart(); return; }
    playing = !playing;
    run();
  };
  $("play").addEventListener("click", toggle);
  $("again").addEventListener("click", () => restart());
  $("over-again").addEventListener("click", () => restart());
  $("speed").addEventListener("change", run);
  $("colour").addEventListener("change", () => { stage?.colourBy($("colour").value); fresh = true; });
  document.addEventListener("visibilitychange", run);
  // by samples, while it is paused
  const some = (rows) => engine.ask("some", "advanced", { rows });
  document.addEventListener("keydown", (event) => {
    if (event.key === "." && !playing && !over && !/^(input|select)$/i.test(event.target.tagName)) some(given.every);
    if (event.key !== " " || /^(input|select|button|summary)$/i.test(event.target.tagName)) return;
    toggle();
    event.preventDefault();
  });

  // What acts from outside: a payload at the platform's centre of mass, a push at Op, gravity that is tilted about Y.
  const amount = (id, unit, act) => {
    const tell = () => {
      const value = Number($(id).value);
      $(`${id}-said`).textContent = `${GS.short(value)} ${unit}`;
      act(value);
    };
    $(id).addEventListener("input", tell);
    $(`${id}-said`).textContent = `${GS.short(Number($(id).value))} ${unit}`;
  };
  const most = given.platformMass;
  Object.assign($("payload"), { min: 0, max: Number(most.toPrecision(2)), step: most / 100, value: 0 });
  amount("payload", "kg", (value) => engine.add("parameters", given.mass, [value]));
  // what acts of it now: the mass and gravity as they were written, and the sliders
  const outside = () => {
    const angle = Number($("tilt").value) * Math.PI / 180, [x, y, z] = given.g, [c, s] = [Math.cos(angle), Math.sin(angle)];
    return { mass: given.platformMass + Number($("payload").value), gravity: angle ? [c * x + s * z, y, c * z - s * x] : given.g, sliders: { payload: Number($("payload").value), tilt: Number($("tilt").value) } };
  };
  amount("tilt", "°", () => engine.add("parameters", given.gravity, outside().gravity.map((g, k) => g - given.g[k])));
  const home = GS.home({ engine, outside, hand, turning });
  const weight = given.platformMass * Math.hypot(...given.g);
  const shove = (force) => {
    push = force;
    engine.add("inputs", 6, force);
  };
  for (const [id, direction] of [["push-x", [1, 0, 0]], ["push-y", [0, 1, 0]], ["push-z", [0, 0, -1]]]) {
    const force = direction.map((d) => 0.5 * weight * d), button = $(id);
    button.title = `${GS.short(0.5 * weight, 2)} N while it is held`;
    const start = () => { shove(force); button.setAttribute("aria-pressed", "true"); };
    const end = () => { shove([0, 0, 0]); button.setAttribute("aria-pressed", "false"); };
    button.addEventListener("pointerdown", start);
    for (const name of ["pointerup", "pointerleave", "pointercancel", "blur"]) button.addEventListener(name, end);
    button.addEventListener("keydown", (event) => { if ((event.key === " " || event.key === "Enter") && !event.repeat) start(); });
    button.addEventListener("keyup", end);
  }

  // Legs whose force is cut, and encoders that stay: length and its rate are of one encoder.
  const broken = { cut: new Set(), freeze: new Set() };
  const faults = (id, places, label) => {
    for (let leg = 1; leg <= 6; leg++) {
      const button = GS.element("button", { type: "button", "aria-pressed": "false", "aria-label": `${label} ${leg}` }, String(leg));
      button.addEventListener("click", () => {
        const on = !broken[id].has(leg);
        if (on) broken[id].add(leg);
        else broken[id].delete(leg);
        button.setAttribute("aria-pressed", String(on));
        engine.say("fail", { places: places(leg - 1), on });
      });
      $(id).append(button);
    }
  };
  faults("cut", (k) => [k], "no force in leg");
  faults("freeze", (k) => [18 + k, 24 + k], "the encoder stays, leg");
  $("freezing").hidden = !given.reads.some((name) => name.startsWith("leg_"));

  // What limits it, in words.
  const limits = (message) => {
    const said = [];
    message.limited.forEach((time, leg) => { if (time > 0 && !message.cut[leg]) said.push(`leg ${leg + 1} at 100 % of its force for ${GS.fixed(time, 1)} s`); });
    message.cut.forEach((is, leg) => { if (is) said.push(`leg ${leg + 1} has no force`); });
    for (const leg of [...broken.freeze].sort()) said.push(`encoder ${leg} stays`);
    if (last && given.stroke) {
      for (let leg = 0; leg < 6; leg++) {
        const length = last[7 + leg], [low, high] = given.stroke;
        if (length < low || length > high) said.push(`leg ${leg + 1} ${length < low ? "below" : "beyond"} its stroke`);
      }
    }
    return said.length ? said.slice(0, 4).join("; ") : "no limit is reached";
  };
  const ends = (message) => {
    const { failure, time } = message, leg = failure >= 5 && failure < 11 ? failure - 4 : 0;
    over = leg ? `leg ${leg} has collapsed` : FAILURES[failure] || "the experiment's run is at its end";
    $("over-text").textContent = `At ${GS.fixed(time, 2)} s: ${over}.`;
    $("over").hidden = false;
    $("play").textContent = "▶ play";
  };
  engine.on("rows", (message) => {
    history.add(message.points, message.size);
    last = history.points[history.points.length - 1] || null;
    fresh = true;
    const now = performance.now();
    if (playing && rate && now - rate.at > 500) {
      const times = (message.time - rate.time) / (now - rate.at) * 1000;
      $("rate").textContent = `× ${GS.short(times, times < 10 ? 2 : 3)} of real time`;
      rate = { at: now, time: message.time };
    }
    rate ??= { at: now, time: message.time };
    $("clock").textContent = `${GS.fixed(message.time, message.time < 1000 ? 2 : 0)} s`;
    $("lost").textContent = message.lost > 0 ? `${GS.short(message.lost, 2)} s of real time could not be kept` : "";
    const text = limits(message);
    if ($("limits").textContent !== text) $("limits").textContent = text;
    if (message.ended && !over) ends(message);
  });
  engine.on("failed", ({ text }) => {
    $("over-text").textContent = `This browser cannot run the loop: ${text}`;
    $("over").hidden = false;
    $("over-again").hidden = true;
  });
  engine.on("ready", () => {
    GS.ready.picture = GS.ready.curves = true;
    home.restore();
    run();
  });

  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  // Pictures in software take the loop's processor: fewer where it is to be fast, and coarser ones where they are late.
  const ENOUGH = 1000 / 30, gaps = [];
  let turn = 0, before = 0;
  const keepUp = (gap) => {
    if (gap < 1000) gaps.push(gap);
    if (gaps.length < 12) return;
    const mean = gaps.reduce((sum, each) => sum + each, 0) / gaps.length;
    gaps.length = 0;
    if (mean > (speed() === null ? 1.1 : 0.9) * ENOUGH) stage?.view.simpler();
  };
  const frame = (now) => {
    requestAnimationFrame(frame);
    hand.poll();
    if (stage?.view.soft && speed() === null && now - before < 0.8 * ENOUGH) return;
    if (fresh && last) {
      if (playing && frames > 30) keepUp(now - before);
      fresh = false;
      frames++;
      stage?.show(last, push);
      // charts by turns: each is drawn at a third of the frames
      const rests = Boolean(still || !playing || over);
      for (const plot of rests ? plots : [plots[turn++ % plots.length]]) plot.draw(history.points, span, rests);
    }
    before = now;
    stage?.view.render();
  };
  GS.onTheme(() => { fresh = true; });
  requestAnimationFrame(frame);
  GS.live = { turning, some, home, restart, get frames() { return frames; }, get last() { return last && [...last]; }, get over() { return over; }, get playing() { return playing; }, history: history.points };
})();
