"use strict";
// The page: play, what acts from outside, what the machine says, and frames.
(() => {
  const GS = GoughStewart, { engine } = GS, { given } = engine, $ = (id) => document.getElementById(id), MOST = 4000;
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches, points = [];
  let playing = !given.isOpen && !still, last = null, fresh = false, over = null, push = [0, 0, 0], frames = 0, rate = null, stage = null;

  // Charts; an open loop soon falls, so that it has fewer seconds.
  const span = given.isOpen ? Math.min(8, 2 * given.duration) : 8, { behind } = given, times = behind?.time;
  const DASHES = [[], [6, 2], [8, 2, 2, 2], [2, 2], [10, 2, 2, 2, 2, 2], [4, 2]];
  const legs = (from, values) => DASHES.map((dashes, k) => ({
    name: String(k + 1), value: (p) => p[from + k], behind: values?.map((row) => row[k]), colour: (theme) => theme.six[k], dashes,
  }));
  // elements of the pose from home, and of the reference
  const axes = (names, first, factor) => names.flatMap((name, j) => {
    const k = first + j, from = (value) => factor * (value - given.home[k]), colour = (theme) => theme.six[j];
    const actual = { name, value: (p) => from(p[1 + k]), behind: behind?.pose.map((pose) => from(pose[k])), colour };
    return given.isOpen ? [actual] : [actual, { name: `${name} reference`, value: (p) => from(p[19 + k]), colour, dashes: [5, 4] }];
  });
  const charts = [
    { title: "position from home", unit: "mm", least: 2, times, curves: axes(["x", "y", "z"], 0, 1000) },
    { title: "orientation from home", unit: "°", least: 0.2, times, curves: axes(["roll", "pitch", "yaw"], 3, 180 / Math.PI) },
    { title: "forces of the legs", unit: "N", least: 10, curves: legs(13), marks: given.forceLimit ? [given.forceLimit, -given.forceLimit] : [] },
    { title: "lengths of the legs", unit: "m", least: 0.004, times, curves: legs(7, behind?.length), marks: given.stroke || [] },
  ].filter(({ unit }) => given.isOpen || unit !== "°").map((chart) => GS.chart($("plots"), chart));
  $("behind").hidden = !behind;
  const ours = behind?.isPublished ? " They are ours, not the paper's: it prints its curves as pictures, which nobody has measured; its text has the forces, the start and the platform, which this experiment has." : "";
  $("behind").textContent = `Pale and thick behind the curves: the file's forces from the start, computed by the code of gough-stewart reproduce (DOP853 to 1e-12).${ours}`;

  // Play and restart.
  const speed = () => ($("speed").value === "fast" ? null : Number($("speed").value));
  const run = () => {
    engine.say("run", { playing: playing && !document.hidden, speed: speed() });
    $("play").textContent = playing ? "❚❚ pause" : "▶ play";
    rate = null;
    if (!playing) $("rate").textContent = "";
    fresh = true;
  };
  GS.restart = (plays = true) => {
    $("download-crash").hidden &&= !over;
    over = null;
    last = null;
    points.length = 0;
    engine.say("again");
    GS.reference.begun();
    $("over").hidden = true;
    playing = plays;
    run();
  };
  GS.reference.begun();
  const toggle = () => {
    if (over) { GS.restart(); return; }
    playing = !playing;
    run();
  };
  $("play").addEventListener("click", toggle);
  for (const id of ["restart", "over-restart"]) $(id).addEventListener("click", () => GS.restart());
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

  // Loads: a payload at the platform's centre of mass, gravity that is tilted about Y, a push at Op.
  const amount = (id, unit, act) => {
    const say = () => { $(`${id}-said`).textContent = `${GS.short(Number($(id).value))} ${unit}`; };
    $(id).addEventListener("input", () => { say(); act(Number($(id).value)); });
    say();
  };
  const most = given.platformMass, weight = most * Math.hypot(...given.g);
  Object.assign($("payload"), { min: 0, max: Number(most.toPrecision(2)), step: most / 100, value: 0 });
  amount("payload", "kg", (value) => engine.say("add", { name: "parameters", from: given.mass, values: [value] }));
  amount("tilt", "°", (value) => {
    const [x, , z] = given.g, [c, s] = [Math.cos(value * Math.PI / 180), Math.sin(value * Math.PI / 180)];
    engine.say("add", { name: "parameters", from: given.gravity, values: value ? [c * x + s * z - x, 0, c * z - s * x - z] : [0, 0, 0] });
  });
  for (const [id, direction] of [["push-x", [1, 0, 0]], ["push-y", [0, 1, 0]], ["push-z", [0, 0, -1]]]) {
    const button = $(id), force = direction.map((d) => 0.5 * weight * d);
    button.title = `${GS.short(0.5 * weight, 2)} N while it is held`;
    const shove = (on) => {
      if (on === (button.getAttribute("aria-pressed") === "true")) return;
      push = on ? force : [0, 0, 0];
      engine.say("add", { name: "inputs", from: 6, values: push });
      button.setAttribute("aria-pressed", String(on));
    };
    button.addEventListener("pointerdown", () => shove(true));
    for (const name of ["pointerup", "pointerleave", "pointercancel", "blur", "keyup"]) button.addEventListener(name, () => shove(false));
    button.addEventListener("keydown", (event) => { if (event.key === " " || event.key === "Enter") shove(true); });
  }
  // Faults: actuators without force, and frozen encoders, of which each has a length and its rate.
  const frozen = new Set();
  const faults = (id, places, label, chosen) => {
    for (let leg = 1; leg <= 6; leg++) {
      const button = GS.element("button", { type: "button", "aria-pressed": "false", "aria-label": `${label} ${leg}` }, String(leg));
      button.addEventListener("click", () => {
        const on = !chosen.delete(leg);
        if (on) chosen.add(leg);
        button.setAttribute("aria-pressed", String(on));
        for (const place of places) engine.say("add", { name: "faults", from: place + leg - 1, values: [Number(on)] });
      });
      $(id).append(button);
    }
  };
  faults("cut", [0], "failed actuator, leg", new Set());
  faults("freeze", [18, 24], "frozen encoder, leg", frozen);
  $("freezing").hidden = !given.reads.some((name) => name.startsWith("leg_"));

  // What limits it, in words.
  const limits = (message) => {
    const [low, high] = given.stroke || [-Infinity, Infinity], said = [];
    message.cut.forEach((is, leg) => { if (is) said.push(`the actuator of leg ${leg + 1} has failed`); });
    for (const leg of [...frozen].sort()) said.push(`the encoder of leg ${leg} is frozen`);
    last?.subarray(7, 13).forEach((length, leg) => { if (length < low || length > high) said.push(`leg ${leg + 1} ${length < low ? "below" : "beyond"} its stroke`); });
    message.limited.forEach((time, leg) => { if (time > 0 && !message.cut[leg]) said.push(`leg ${leg + 1} at 100 % of its force for ${GS.fixed(time, 1)} s`); });
    return said.slice(0, 4).join("; ") || "no limit is reached";
  };
  engine.on("rows", (message) => {
    const { time, failure, lost } = message, now = performance.now();
    for (let k = 0; k < message.points.length; k += message.size) points.push(message.points.subarray(k, k + message.size));
    points.splice(0, points.length - MOST);
    if (!built) setTimeout(build, 50);
    last = points[points.length - 1] || null;
    fresh = true;
    if (playing && rate && now - rate.at > 500) {
      const times = (time - rate.time) / (now - rate.at) * 1000;
      $("rate").textContent = `× ${GS.short(times, times < 10 ? 2 : 3)} of real time`;
      rate = null;
    }
    rate ??= { at: now, time };
    $("clock").textContent = `${GS.fixed(time, time < 1000 ? 2 : 0)} s`;
    $("lost").textContent = lost > 0 ? `${GS.short(lost, 2)} s of real time could not be kept` : "";
    const text = limits(message);
    if ($("limits").textContent !== text) $("limits").textContent = text;
    if (!message.ended || over) return;
    over = failure >= 5 && failure < 11 ? `leg ${failure - 4} has collapsed` : given.failures[failure] || "the experiment's run is at its end";
    $("over-text").textContent = `At ${GS.fixed(time, 2)} s: ${over}.`;
    $("over").hidden = false;
    $("play").textContent = "▶ restart";
  });
  engine.on("failed", ({ text }) => {
    $("over-text").textContent = `This browser cannot run the loop: ${text}`;
    $("over").hidden = false;
    $("over-restart").hidden = true;
  });
  engine.on("ready", () => {
    GS.ready.curves = true;
    GS.download.restore();
    run();
  });

  // The 3-D view comes once the loop runs, or soon, since software takes a second for its first picture.
  let built = false;
  const build = () => {
    if (built) return;
    built = true;
    try {
      stage = GS.liveStage($("view"));
      stage.colourBy($("colour").value);
    } catch (problem) {
      $("no-view").hidden = false;
      $("no-view").textContent = `This browser shows no 3-D graphics (WebGL): ${problem.message || problem}. The charts work without.`;
    }
    GS.ready.picture = fresh = true;
  };
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
    GS.reference.poll();
    if (stage?.view.soft && speed() === null && now - before < 0.8 * ENOUGH) return;
    if (fresh) {
      if (playing && frames > 30) keepUp(now - before);
      fresh = false;
      frames++;
      if (last) stage?.show(last, push);
      // charts by turns: each is drawn at a third of the frames
      const rests = Boolean(still || !playing || over);
      for (const draw of rests ? charts : [charts[turn++ % charts.length]]) draw(points, span, rests);
    }
    before = now;
    stage?.view.render();
  };
  GS.onTheme(() => { fresh = true; });
  engine.listen();
  requestAnimationFrame(frame);
  setTimeout(build, playing ? 1000 : 0);
  GS.live = { some, get frames() { return frames; }, get last() { return last && [...last]; }, get over() { return over; }, get playing() { return playing; } };
})();
