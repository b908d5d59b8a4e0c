"use strict";
// Time: play, pause, speed, scrubbing; everything on the page shows one moment.
(() => {
  const GS = GoughStewart;
  const $ = (id) => document.getElementById(id);
  GS.ready = { picture: false, curves: false };
  const { fixed } = GS;

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
  let before = 0, colour = "force";

  // A table of the moment: pose, and leg by leg length and force.
  const now = GS.records.map((record) => {
    const table = document.createElement("table");
    const heads = ["", ...[1, 2, 3, 4, 5, 6].map((k) => `leg ${k}`)];
    const rows = ["force N", "length m", ...(record.nearness ? ["of limit %"] : [])];
    table.innerHTML = `<caption></caption><thead><tr>${heads.map((h) => `<th>${h}</th>`).join("")}</tr></thead><tbody>${
      rows.map((r) => `<tr><th scope="row">${r}</th>${"<td></td>".repeat(6)}</tr>`).join("")}</tbody>`;
    $("now").append(table);
    const title = GS.records.length > 1 ? `${record.name}: ` : "";
    return { record, caption: table.caption, title, cells: [...table.querySelectorAll("td")] };
  });
  const write = () => {
    for (const { record, caption, title, cells } of now) {
      const at = GS.frameAt(record, player.time);
      const [x, y, z] = GS.between(record.pose, 7, at).slice(0, 3).map((v) => fixed(v, 4));
      const turned = GS.between(record.orientation, 3, at).map((v) => `${fixed(180 / Math.PI * v, 2)}°`);
      caption.textContent = `${title}x ${x}  y ${y}  z ${z} m   roll ${turned[0]}  pitch ${turned[1]}  yaw ${turned[2]}`;
      for (let k = 0; k < 6; k++) {
        const dot = `<i style="background:${GS.css(GS.legColour(colour, record, at, k))}"></i>`;
        cells[k].innerHTML = dot + GS.text(record.force[6 * at.frame + k]);
        cells[6 + k].textContent = GS.between(record.length, 6, at)[k].toFixed(4);
        if (record.nearness) cells[12 + k].textContent = (100 * record.nearness.values[6 * at.frame + k]).toFixed(0);
      }
    }
  };

  const show = () => {
    $("time").value = player.time;
    $("clock").textContent = `${player.time.toFixed(digits)} of ${GS.end.toFixed(digits)} s`;
    GS.moveCursor(player.time);
    write();
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
  };
  player.play = () => {
    if (player.time >= GS.end) player.seek(GS.start);
    player.playing = true;
    before = 0;
    $("play").textContent = "❚❚";
    $("play").setAttribute("aria-label", "pause");
  };
  const toggle = () => (player.playing ? player.pause() : player.play());
  // the frames of all records, in their order
  const moments = [...new Set(GS.records.flatMap((r) => [...r.time]))].sort((a, b) => a - b);
  const step = (forward) => {
    player.pause();
    const { time } = player;
    player.seek((forward ? moments.find((t) => t > time) : moments.findLast((t) => t < time)) ?? time);
  };

  // Where frames come slowly, as without a graphics card, shadows and pixels are given up for motion.
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
      // a page that was out of sight goes on where it was
      const passed = before ? Math.min((stamp - before) / 1000, 0.25) : 0;
      before = stamp;
      const time = player.time + passed * player.speed;
      if (time < GS.end) player.seek(time);
      else if ($("repeat").checked) player.seek(GS.start);
      else { player.seek(GS.end); player.pause(); }
    }
    if (view) view.render();
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
    const text = view ? GS.legend(kind) : "";
    $("legend").hidden = !text;
    $("legend").innerHTML = text;
    show();
  };
  $("time").min = GS.start;
  $("time").max = GS.end;
  $("play").addEventListener("click", toggle);
  $("time").addEventListener("input", () => { player.pause(); player.seek(Number($("time").value)); });
  $("speed").addEventListener("change", () => { player.speed = Number($("speed").value); });
  $("colour").addEventListener("change", () => colourBy($("colour").value));
  $("from").addEventListener("change", () => view && view.look($("from").value));
  $("ghost").addEventListener("change", () => { if (view) view.showGhosts($("ghost").checked); show(); });
  $("trail").addEventListener("change", () => { if (view) view.showTrails($("trail").checked); show(); });
  $("frames").addEventListener("change", () => { if (view) view.showFrames($("frames").checked); show(); });
  $("ghost").parentElement.hidden = !GS.records.some((r) => r.reference);
  document.querySelector("#colour option[value=nearness]").disabled = !GS.records.some((r) => r.nearness);
  document.querySelectorAll("input[data-record]").forEach((box) => box.addEventListener("change", () => {
    if (view) view.showMachine(Number(box.dataset.record), box.checked);
    GS.showCurves();
  }));
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("select, input[type=checkbox], summary") || event.ctrlKey || event.metaKey || event.altKey) return;
    const act = { " ": toggle, ArrowLeft: () => step(false), ArrowRight: () => step(true) }[event.key];
    if (!act) return;
    if (event.key === " " && event.target.id === "play") return;  // a button does it by itself
    event.preventDefault();
    act();
  });
  window.addEventListener("resize", strips);
  player.drawn = () => (view ? view.drawn() : null);

  colourBy("force");
  strips();
  // report.html#t=1.5 stands still there
  const asked = /[#&]t=([0-9.eE+-]+)/.exec(window.location.hash);
  if (asked) player.seek(Number(asked[1]));
  else {
    player.seek(GS.start);
    if (!window.matchMedia("(prefers-reduced-motion: reduce)").matches && GS.end > GS.start) player.play();
  }
  requestAnimationFrame(tick);
})();
