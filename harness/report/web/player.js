"use strict";
// Starts the page, and plays: play, pause, speed, time slider, keys; the whole page shows the same time.
(() => {
  const GS = GoughStewart, { page, state } = GS, $ = (id) => document.getElementById(id), hasTime = Boolean($("play")), { start, end, digits } = page.clock;
  let view = null, write = null, before = 0, colour = "force", moments = [];

  const prepareClock = async () => {
    Object.assign(state, { start, end, time: start });
    const numbers = page.charts.filter((chart) => chart.isTime).flatMap((chart) => chart.series.map((series) => series.x ?? chart.x.values));
    const clocks = GS.records.length ? GS.records.map((r) => r.time) : await Promise.all([...new Set(numbers)].map(GS.array));
    moments = [...new Set(clocks.flatMap((t) => [...t]))].sort((a, b) => a - b);
  };

  // The clock changes every frame; its text for screen readers only when it rests.
  let resting = 0;
  const speak = (text) => {
    $("time").setAttribute("aria-valuetext", text);
    clearTimeout(resting);
    if (!state.playing) resting = setTimeout(() => { $("moment").textContent = text; }, 400);
  };
  const show = () => {
    const time = GS.shownTime(), text = `${time.toFixed(digits)} of ${state.end.toFixed(digits)} s`;
    $("time").value = time;
    if ($("clock").textContent !== text) {
      $("clock").textContent = text;
      if (!state.playing) speak(text);
    }
    if (write) write(time, colour);
    if (view) view.show(time);
  };
  const player = {
    get time() { return state.time; },
    get playing() { return state.playing; },
    get speed() { return state.speed; },
    set speed(value) { GS.set({ speed: value }); },
    seek: (time) => GS.set({ time: Math.min(Math.max(time, state.start), state.end) }),
    pause: () => GS.set({ playing: false }),
    play: () => {
      const [from, to] = state.region || [state.start, state.end];
      if (state.time >= to || state.time < from) player.seek(from);
      before = 0;
      GS.set({ playing: true, hover: null });
    },
    drawn: () => (view ? view.drawn() : null),
    stage: () => (view ? view.stage() : null),
  };
  GS.player = player;
  const toggle = () => (state.playing ? player.pause() : player.play());
  const step = (forward) => {
    player.pause();
    const { time } = state;
    player.seek((forward ? moments.find((t) => t > time + 1e-12) : moments.findLast((t) => t < time - 1e-12)) ?? time);
  };

  // If frames are slow, as without a graphics card, reduce resolution and shadows.
  const gaps = [];
  const keepUp = (gap) => {
    gaps.push(gap);
    if (gaps.length < 12) return;
    const mean = gaps.reduce((sum, each) => sum + each, 0) / gaps.length;
    gaps.length = 0;
    if (mean > 80) view.simpler();
  };
  const tick = (stamp) => {
    requestAnimationFrame(tick);
    if (state.playing) {
      if (view && before && GS.ready.curves) keepUp(stamp - before);
      // a page that was hidden continues where it was
      const passed = before ? Math.min((stamp - before) / 1000, 0.25) : 0, [from, to] = state.region || [state.start, state.end];
      before = stamp;
      const time = state.time + passed * state.speed;
      if (time < to) player.seek(time);
      else if ($("repeat").checked || state.region) player.seek(from);
      else { player.seek(to); player.pause(); }
    }
    if (view) view.render();
    if (!GS.ready.picture) {
      GS.ready.picture = true;
      performance.mark("first-picture");
    }
  };

  const loop = () => {
    const { region, start, end } = state, share = (t) => 100 * (t - start) / (end - start || 1);
    $("loop").hidden = !region;
    if (region) Object.assign($("loop").style, { left: `${share(region[0])}%`, width: `${share(region[1]) - share(region[0])}%` });
  };

  // The 3-D view and its options.
  const colourBy = (kind) => {
    colour = kind;
    view.colourBy(kind);
    const scale = GS.scale(kind);
    $("legend").hidden = !scale;
    if (scale) GS.colourKey(scale.title, scale.colours.map(GS.css), [scale.low, scale.high]);
    show();
  };
  const enlarge = (factor) => {
    $("enlarged").hidden = factor === 1;
    $("enlarged").textContent = `motion drawn ${factor} times larger`;
    view.enlarge(factor);
    show();
  };
  const stage = () => {
    GS.prepareColours();
    write = GS.moment($("now"));
    try {
      GS.prepareBodies();
      GS.prepareScene();
      view = GS.scene($("view"));
    } catch (problem) {
      $("no-view").hidden = false;
      $("no-view").textContent = `This browser shows no 3-D graphics (WebGL): ${problem.message || problem}. Charts and tables work without.`;
      document.querySelector(".stage-options").hidden = true;
      return;
    }
    const showParts = () => {
      const [reference, path, frames] = ["ghost", "trail", "frames"].map((id) => $(id).checked);
      view.showParts({ reference, path, frames });
    };
    $("colour").addEventListener("change", () => colourBy($("colour").value));
    $("from").addEventListener("change", () => view.look($("from").value));
    $("motion").addEventListener("change", () => enlarge(Number($("motion").value)));
    for (const id of ["ghost", "trail", "frames"]) $(id).addEventListener("change", showParts);
    $("picture").addEventListener("click", () => GS.element("a", { href: view.copy().toDataURL(), download: `${document.title} ${state.time.toFixed(digits)} s.png` }).click());
    let pressed = null;
    view.canvas.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
    view.canvas.addEventListener("click", (event) => {
      if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
      const box = view.canvas.getBoundingClientRect(), leg = view.legAt(event.clientX - box.left, event.clientY - box.top);
      GS.set({ leg: leg === state.leg ? null : leg, picked: null });
    });
    GS.on("leg", () => colourBy(colour));
    GS.on("hiddenRuns", () => GS.records.forEach((r, k) => view.showMachine(k, !state.hiddenRuns.has(r.run))));
    GS.onTheme(() => colourBy(colour));
    // paper shows a picture of the present moment
    GS.printStage = () => view.copy($("printed"));
    colourBy($("colour").value);
  };

  const runs = () => {
    const boxes = [...$("runs").querySelectorAll("input")];
    boxes.forEach((box, k) => box.addEventListener("change", () => GS.toggleRun(k)));
    GS.on("hiddenRuns", () => boxes.forEach((box, k) => { box.checked = !state.hiddenRuns.has(k); }));
  };
  const copy = async () => {
    const address = `${location.href.split("#")[0]}#${GS.link()}`;
    try {
      await navigator.clipboard.writeText(address);
      $("linked").textContent = "copied";
    } catch {
      history.replaceState(null, "", `#${GS.link()}`);
      $("linked").textContent = "the address of this page is the link";
    }
  };
  const clear = () => {
    GS.set({ region: null, leg: null, picked: null, members: null });
    GS.clearCharts?.();
  };
  const leap = (share) => { player.pause(); const [a, b] = GS.range(); player.seek(state.time + share * (b - a)); };
  const keys = (event) => {
    if (event.target.closest("select, input:not(#time), summary, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.closest("#view") && event.key !== " " && !/^[0-9\][]$|Escape/.test(event.key)) return;
    if (event.key === " " && event.target.closest("button")) return;  // a button handles the space bar itself
    const acts = {
      " ": toggle, ArrowLeft: () => (event.shiftKey ? leap(-0.1) : step(false)), ArrowRight: () => (event.shiftKey ? leap(0.1) : step(true)),
      Home: () => { player.pause(); player.seek(GS.range()[0]); }, End: () => { player.pause(); player.seek(GS.range()[1]); }, Escape: clear,
    };
    const act = /^[1-6]$/.test(event.key) ? () => GS.pickLeg(Number(event.key)) : acts[event.key];
    if (act) act(); else if (!GS.rangeKey(event.key, GS.timeGroup, state.time)) return;
    event.preventDefault();
  };

  const controls = () => {
    $("time").min = state.start;
    $("time").max = state.end;
    $("play").addEventListener("click", toggle);
    $("time").addEventListener("input", () => { player.pause(); GS.set({ hover: null }); player.seek(Number($("time").value)); });
    $("speed").addEventListener("change", () => { player.speed = Number($("speed").value); });
    $("leg").addEventListener("change", () => GS.set({ leg: $("leg").value ? Number($("leg").value) : null, picked: null }));
    $("zoom-in").addEventListener("click", () => GS.rangeKey("+", GS.timeGroup, state.time));
    $("zoom-out").addEventListener("click", () => GS.zoomTo(null));
    $("clear").addEventListener("click", clear);
    $("link").addEventListener("click", copy);
    document.addEventListener("keydown", keys);
    GS.on("time hover", show);
    GS.on("region", loop);
    GS.on("zoom", () => { $("zoom-out").disabled = !state.zoom; });
    GS.on("leg", () => { $("leg").value = state.leg ?? ""; });
    GS.on("playing", () => {
      $("play").textContent = state.playing ? "❚❚" : "▶";
      $("play").setAttribute("aria-label", state.playing ? "pause" : "play");
      clearTimeout(resting);
      if (!state.playing) speak($("clock").textContent);
    });
    $("zoom-out").disabled = true;
    runs();
  };

  // The range of time is known.
  GS.timed = (async () => {
    if (page.scenes.length) await GS.unpackScenes();
    await prepareClock();
  })();
  GS.started = (async () => {
    await GS.timed;
    if (hasTime) controls();
    // without a graphics card nothing else happens while the first picture is made, for half a second
    if (page.scenes.length && page.charts.length && GS.software()) await GS.firstDrawn;
    if (page.scenes.length) stage();
    const stands = GS.follow(location.hash);
    addEventListener("hashchange", () => { player.pause(); GS.follow(location.hash); });
    if (!hasTime) {
      document.addEventListener("keydown", (event) => { if (event.key === "Escape") clear(); });
      GS.ready.picture = true;
      return;
    }
    show();
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches || !GS.records.length || stands;
    if (!still && state.end > state.start) player.play();
    requestAnimationFrame(tick);
  })();
})();
