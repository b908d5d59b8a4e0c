"use strict";
// Playback: play, pause, speed, scrubbing; the whole page shows the same time.
(() => {
  const GS = GoughStewart;
  const $ = (id) => document.getElementById(id);
  GS.ready = { picture: false, curves: false };

  let view = null;
  try {
    view = GS.scene($("view"));
  } catch (problem) {
    $("no-view").hidden = false;
    $("no-view").textContent = `This browser shows no 3-D graphics (WebGL): ${problem.message || problem}. Curves and tables work without.`;
  }

  const longest = Math.max(...GS.records.map((r) => r.time.length));
  const digits = Math.max(2, Math.min(6, Math.ceil(-Math.log10((GS.end - GS.start) / Math.max(longest - 1, 1) || 1) + 0.3)));
  const player = { time: GS.start, playing: false, speed: 1 };
  GS.player = player;
  let before = 0, colour = "force", film = null;
  const write = GS.moment($("now"));

  // The clock changes every frame; its text for screen readers changes only when paused, or once a second.
  let spoken = "", resting = 0;
  const speak = (text) => {
    $("time").setAttribute("aria-valuetext", text);
    clearTimeout(resting);
    if (!player.playing) resting = setTimeout(() => { $("moment").textContent = text; }, 400);
  };
  const show = () => {
    const text = `${player.time.toFixed(digits)} of ${GS.end.toFixed(digits)} s`;
    $("time").value = player.time;
    $("clock").textContent = text;
    const key = player.playing ? Math.floor(player.time) : text;
    if (key !== spoken) speak(text);
    spoken = key;
    GS.moveCursor(player.time);
    write(player.time, colour);
    if (view) view.show(player.time);
  };
  player.seek = (time) => {
    player.time = Math.min(Math.max(time, GS.start), GS.end);
    show();
  };
  player.pause = () => {
    player.playing = false;
    $("play").textContent = "▶";
    $("play").setAttribute("aria-label", "play");
    speak($("clock").textContent);
  };
  player.play = () => {
    if (player.time >= GS.end) player.seek(GS.start);
    player.playing = true;
    before = 0;
    $("play").textContent = "❚❚";
    $("play").setAttribute("aria-label", "pause");
  };
  const toggle = () => (player.playing ? player.pause() : player.play());
  // the times of the frames of all records, sorted
  const moments = [...new Set(GS.records.flatMap((r) => [...r.time]))].sort((a, b) => a - b);
  const step = (forward) => {
    player.pause();
    const { time } = player;
    player.seek((forward ? moments.find((t) => t > time) : moments.findLast((t) => t < time)) ?? time);
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
    if (player.playing) {
      if (view && before && GS.ready.curves) keepUp(stamp - before);
      // a page that was hidden continues where it was
      const passed = before ? Math.min((stamp - before) / 1000, 0.25) : 0;
      before = stamp;
      const time = player.time + passed * player.speed;
      if (time < GS.end) player.seek(time);
      else if ($("repeat").checked && !film) player.seek(GS.start);
      else { player.seek(GS.end); player.pause(); }
    }
    if (view) view.render();
    if (film) film();
    if (!GS.ready.picture) {
      GS.ready.picture = true;
      performance.mark("first-picture");
    }
  };

  const strips = () => {
    const colours = { force_limited: "#000000", rate_limited: "#8a8a8a", stroke_exceeded: "#b3261e" };
    const seen = Object.keys(colours).filter((name) => GS.records.some((r) => (r.flags[name] || "").includes("1")));
    $("flag-key").innerHTML = seen.map((name) => `<span><i style="background:${colours[name]}"></i>${name.replace("_", " ")}</span>`).join("");
    const canvas = $("flags"), pen = canvas.getContext("2d"), width = canvas.width = canvas.clientWidth || 600;
    canvas.height = 6;
    GS.records.forEach((record) => Object.entries(record.flags).forEach(([name, up], row) => {
      pen.fillStyle = colours[name];
      for (let k = 0; k < up.length; k++) {
        if (up[k] !== "1") continue;
        const [from, to] = [record.time[k], record.time[k + 1]].map((t) => width * (t - GS.start) / (GS.end - GS.start || 1));
        pen.fillRect(from, 2 * row, Math.max(to - from, 1), 2);
      }
    }));
  };

  const colourBy = (kind) => {
    colour = kind;
    if (view) view.colourBy(kind);
    const scale = view && GS.scale(kind);
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
    if (view) view.enlarge(factor);
    show();
  };
  const showParts = () => {
    const [reference, path, frames] = ["ghost", "trail", "frames"].map((id) => $(id).checked);
    if (view) view.showParts({ reference, path, frames });
  };
  const record = () => {
    if (film) return player.pause();
    $("record").textContent = "stop recording";
    $("saved").textContent = "recording the animation once, from start to end";
    film = GS.video(view, player, () => {
      film = null;
      $("record").textContent = "record a video";
    });
    return undefined;
  };
  $("time").min = GS.start;
  $("time").max = GS.end;
  $("play").addEventListener("click", toggle);
  $("time").addEventListener("input", () => { player.pause(); player.seek(Number($("time").value)); });
  $("speed").addEventListener("change", () => { player.speed = Number($("speed").value); });
  $("colour").addEventListener("change", () => colourBy($("colour").value));
  $("from").addEventListener("change", () => view && view.look($("from").value));
  $("motion").addEventListener("change", () => enlarge(Number($("motion").value)));
  for (const id of ["ghost", "trail", "frames"]) $(id).addEventListener("change", showParts);
  $("ghost").parentElement.hidden = !GS.records.some((r) => r.reference);
  $("picture").addEventListener("click", () => GS.savePicture(view));
  $("record").addEventListener("click", record);
  $("picture").disabled = !view;
  $("record").disabled = !view || !GS.videoKind();
  if (view && !GS.videoKind()) $("saved").textContent = "This browser cannot record video.";
  // paper shows a picture of the present frame
  if (view) GS.onTheme(() => GS.compose(view, $("printed"), 1400));
  document.querySelector("#colour option[value=nearness]").disabled = !GS.records.some((r) => r.nearness);
  document.querySelector("#colour option[value=run]").hidden = GS.records.length === 1;
  document.querySelectorAll("input[data-record]").forEach((box) => box.addEventListener("change", () => {
    if (view) view.showMachine(Number(box.dataset.record), box.checked);
    GS.showCurves();
  }));
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("select, input[type=checkbox], summary") || event.ctrlKey || event.metaKey || event.altKey) return;
    const act = { " ": toggle, ArrowLeft: () => step(false), ArrowRight: () => step(true) }[event.key];
    if (!act) return;
    if (event.key === " " && event.target.closest("button")) return;  // the button handles the key itself
    event.preventDefault();
    act();
  });
  window.addEventListener("resize", strips);
  player.drawn = () => (view ? view.drawn() : null);
  player.stage = () => (view ? view.stage() : null);

  $("colour").value = GS.records.length > 1 ? "run" : "force";
  colourBy($("colour").value);
  strips();
  // report.html#t=1.5 opens paused at 1.5 s
  const asked = /[#&]t=([0-9.eE+-]+)/.exec(window.location.hash);
  if (asked) player.seek(Number(asked[1]));
  else {
    player.seek(GS.start);
    if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches && GS.end > GS.start) player.play();
  }
  requestAnimationFrame(tick);
})();
