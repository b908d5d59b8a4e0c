"use strict";
// Starts the page, and plays: play, pause, speed, time slider, keys; the whole page shows the same time.
(() => {
  const GS = GoughStewart, { page, state } = GS, $ = (id) => document.getElementById(id), hasTime = Boolean($("play"));
  let view = null, write = null, before = 0, colour = "force", digits = 3, moments = [];

  const ends = async () => {
    let start = Infinity, end = -Infinity;
    const found = new Set(page.charts.filter((chart) => chart.isTime).flatMap((chart) => [...(chart.series.some((s) => s.x === undefined) ? [chart.x.values] : []), ...chart.series.map((s) => s.x)]));
    const arrays = await Promise.all([...found].filter((number) => number !== undefined).map(GS.array));
    for (const values of [...arrays, ...GS.records.map((r) => r.time)]) {
      if (!values.length) continue;
      start = Math.min(start, values[0]);
      end = Math.max(end, values[values.length - 1]);
    }
    const longest = Math.max(2, ...arrays.map((a) => a.length), ...GS.records.map((r) => r.time.length));
    digits = Math.max(2, Math.min(6, Math.ceil(-Math.log10((end - start) / (longest - 1) || 1) + 0.3)));
    const clocks = GS.records.length ? GS.records.map((r) => r.time) : arrays;
    moments = [...new Set(clocks.flatMap((t) => [...t]))].sort((a, b) => a - b);
    if (start <= end) Object.assign(state, { start, end, time: start });
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
    legAt: (x, y) => (view ? view.legAt(x, y) : null),
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

  const FLAGS = ["bad", "neutral", "marginal", "published", "measured"];
  const strips = () => {
    const names = [...new Set(GS.records.flatMap((r) => Object.entries(r.flags).filter(([, up]) => up.includes("1")).map(([name]) => name)))];
    const { roles } = GS.theme(), colourOf = (name) => roles[FLAGS[names.indexOf(name) % FLAGS.length]];
    $("flag-key").replaceChildren(...names.map((name) => {
      const swatch = GS.element("i", {});
      swatch.style.background = colourOf(name);
      return GS.element("span", {}, swatch, name.replaceAll("_", " "));
    }));
    const canvas = $("flags"), pen = canvas.getContext("2d"), width = canvas.width = canvas.clientWidth || 600;
    canvas.hidden = !names.length;
    canvas.height = 3 * names.length;
    GS.records.forEach((record) => names.forEach((name, row) => {
      pen.fillStyle = colourOf(name);
      const up = record.flags[name] || "";
      for (let k = 0; k < up.length; k++) {
        if (up[k] !== "1") continue;
        const [from, to] = [record.time[k], record.time[k + 1]].map((t) => width * (t - state.start) / (state.end - state.start || 1));
        pen.fillRect(from, 3 * row, Math.max(to - from, 1), 2);
      }
    }));
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
    if (scale) {
      $("legend").innerHTML = `<b></b><i style="background:linear-gradient(90deg,${scale.colours.map(GS.css).join(",")})"></i><span></span><span></span>`;
      [...$("legend").querySelectorAll("b, span")].forEach((part, k) => { part.textContent = [scale.title, scale.low, scale.high][k]; });
    }
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
    const several = GS.records.length > 1;
    document.querySelector("#colour option[value=force]").disabled = !GS.records.some((r) => r.force);
    document.querySelector("#colour option[value=nearness]").disabled = !GS.records.some((r) => r.nearness);
    document.querySelector("#colour option[value=run]").hidden = !several;
    $("ghost").parentElement.hidden = !GS.records.some((r) => r.reference);
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
    $("colour").value = several ? "run" : GS.records.some((r) => r.force) ? "force" : "plain";
    colourBy($("colour").value);
  };

  const runs = () => {
    if (page.runs.length < 2) return;
    const boxes = page.runs.map((name, k) => {
      const box = GS.element("input", { type: "checkbox", autocomplete: "off", onchange: () => GS.toggleRun(k) }), swatch = GS.element("i", { style: `background:var(--six-${k % 6})` });
      box.checked = true;
      return { box, label: GS.element("label", {}, box, swatch, name) };
    });
    $("runs").replaceChildren(...boxes.map(({ label }) => label));
    GS.on("hiddenRuns", () => boxes.forEach(({ box }, k) => { box.checked = !state.hiddenRuns.has(k); }));
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
  const zoomIn = () => (state.region ? GS.zoomTo(state.region) : GS.zoomAbout({ range: GS.range, zoom: GS.zoomTo }, state.time, 0.5));
  const clear = () => {
    GS.set({ region: null, leg: null, picked: null, members: null });
    GS.clearCharts?.();
  };
  const leap = (share) => { player.pause(); const [a, b] = GS.range(); player.seek(state.time + share * (b - a)); };
  const keys = (event) => {
    if (event.target.closest("select, input:not(#time), summary, textarea") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.closest("#view") && event.key !== " " && !/^[0-9\][]$|Escape/.test(event.key)) return;
    const { time, region, start, end } = state;
    const acts = {
      " ": toggle, ArrowLeft: () => (event.shiftKey ? leap(-0.1) : step(false)), ArrowRight: () => (event.shiftKey ? leap(0.1) : step(true)),
      Home: () => { player.pause(); player.seek(GS.range()[0]); }, End: () => { player.pause(); player.seek(GS.range()[1]); },
      "[": () => GS.mark([time, region && region[1] > time ? region[1] : end]), "]": () => GS.mark([region && region[0] < time ? region[0] : start, time]),
      "+": zoomIn, "=": zoomIn, "-": () => GS.zoomAbout({ range: GS.range, zoom: GS.zoomTo }, time, 2), 0: () => GS.zoomTo(null), Escape: clear,
    };
    const act = /^[1-6]$/.test(event.key) ? () => GS.pickLeg(Number(event.key)) : acts[event.key];
    if (!act || (event.key === " " && event.target.closest("button"))) return;  // a button handles the space bar itself
    event.preventDefault();
    act();
  };

  const controls = () => {
    $("time").min = state.start;
    $("time").max = state.end;
    $("play").addEventListener("click", toggle);
    $("time").addEventListener("input", () => { player.pause(); GS.set({ hover: null }); player.seek(Number($("time").value)); });
    $("speed").addEventListener("change", () => { player.speed = Number($("speed").value); });
    $("leg").addEventListener("change", () => GS.set({ leg: $("leg").value ? Number($("leg").value) : null, picked: null }));
    $("zoom-in").addEventListener("click", zoomIn);
    $("zoom-out").addEventListener("click", () => GS.zoomTo(null));
    $("clear").addEventListener("click", clear);
    $("link").addEventListener("click", copy);
    document.addEventListener("keydown", keys);
    addEventListener("resize", strips);
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
    GS.onTheme(strips);
    $("zoom-out").disabled = true;
    $("leg").parentElement.hidden = !GS.records.length && !page.charts.some((chart) => chart.series.some((s) => s.leg !== undefined));
    runs();
    strips();
  };

  // The range of time is known.
  GS.timed = (async () => {
    if (page.scenes.length) await GS.unpackScenes();
    await ends();
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
