"use strict";
// Charts that scroll: the last seconds of some curves, drawn on a canvas.
(() => {
  const GS = GoughStewart, LEFT = 52, BOTTOM = 18;
  const nice = (span) => {
    const raw = span / 4, power = 10 ** Math.floor(Math.log10(raw));
    return power * [1, 2, 5, 10].find((step) => step * power >= raw);
  };
  // The pen of a canvas of some size, which is empty then.
  GS.pen = (canvas, width, height) => {
    const ratio = Math.min(devicePixelRatio, 2), pen = canvas.getContext("2d"), [w, h] = [width, height].map((size) => Math.round(size * ratio));
    if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = "11px system-ui, sans-serif";
    pen.lineWidth = 1;
    return pen;
  };
  // Draws a line through points [x, y].
  GS.stroke = (pen, points, dashes = []) => {
    pen.setLineDash(dashes);
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(x, y);
    pen.stroke();
  };
  // curves: name, value of a point, colour of a theme, dashes, and values behind it at the times; least: smallest span
  GS.chart = (host, { title, unit, curves, least, times = [], marks = [] }) => {
    const canvas = GS.element("canvas", { role: "img", "aria-label": `${title} [${unit}], the last seconds` });
    const key = GS.element("ul", { class: "key" }), said = GS.element("output", { class: "at" });
    const caption = GS.element("figcaption", {}, GS.element("h2", {}, `${title} [${unit}]`), said, key);
    host.append(GS.element("figure", { class: "plot-live" }, caption, canvas));
    let pointer = null, seen = true;
    new IntersectionObserver((entries) => { seen = entries[entries.length - 1].isIntersecting; }).observe(canvas);
    const paintKey = () => key.replaceChildren(...curves.map(({ name, colour, dashes }) => GS.element("li", {},
      GS.element("i", { style: `border-top: 3px ${dashes?.length ? "dashed" : "solid"} ${colour(GS.theme())}` }), name)));
    paintKey();
    GS.onTheme(paintKey);
    canvas.addEventListener("pointermove", (event) => { pointer = event.offsetX; });
    canvas.addEventListener("pointerleave", () => { pointer = null; said.textContent = ""; });
    // what moves is drawn only where it is seen
    return (points, span, rests) => {
      const width = canvas.clientWidth, height = canvas.clientHeight, theme = GS.theme();
      if (!(seen || rests) || !width) return;
      const begin = Math.max(0, (points.at(-1)?.[0] ?? 0) - span), end = begin + span;
      let first = points.length - 1, low = Infinity, high = -Infinity;
      while (first > 0 && points[first - 1][0] >= begin) first--;
      const reach = (value) => { low = Math.min(low, value); high = Math.max(high, value); };
      const shown = points.slice(Math.max(first, 0));
      for (const point of shown) for (const { value } of curves) reach(value(point));
      for (const { behind } of curves) behind?.forEach((value, k) => { if (times[k] >= begin && times[k] <= end) reach(value); });
      if (!Number.isFinite(high - low)) return;
      const middle = (low + high) / 2, half = Math.max((high - low) / 2, least / 2) * 1.08, pen = GS.pen(canvas, width, height);
      [low, high] = [middle - half, middle + half];
      const x = (t) => LEFT + (t - begin) / span * (width - LEFT - 6), y = (v) => (height - BOTTOM) * (1 - (v - low) / (high - low));
      pen.strokeStyle = theme.line;
      pen.fillStyle = theme.ink;
      pen.textAlign = "right";
      const step = nice(high - low), digits = Math.max(0, -Math.floor(Math.log10(step)));
      // by number: where a loop diverged, a step may be less than the last digit
      for (let k = Math.ceil(low / step); k <= high / step && k - low / step < 12; k++) {
        GS.stroke(pen, [[LEFT, y(k * step)], [width, y(k * step)]]);
        pen.fillText(GS.fixed(k * step, digits), LEFT - 5, Math.max(9, y(k * step) + 4));
      }
      pen.textAlign = "center";
      const apart = nice(span);
      for (let t = Math.ceil(begin / apart) * apart; t <= end; t += apart) pen.fillText(`${GS.short(t)} s`, Math.min(x(t), width - 12), height - 4);
      pen.save();
      pen.beginPath();
      pen.rect(LEFT, 0, width - LEFT, height - BOTTOM);
      pen.clip();
      pen.strokeStyle = theme.roles.limit;
      for (const value of marks) GS.stroke(pen, [[LEFT, y(value)], [width, y(value)]], [2, 3]);
      pen.lineWidth = 6;
      pen.globalAlpha = 0.3;
      for (const { behind, colour } of curves) {
        pen.strokeStyle = colour(theme);
        if (behind) GS.stroke(pen, behind.map((v, k) => [x(times[k]), y(v)]));
      }
      pen.lineWidth = 1.6;
      pen.globalAlpha = 1;
      for (const { value, colour, dashes } of curves) {
        pen.strokeStyle = colour(theme);
        GS.stroke(pen, shown.map((p) => [x(p[0]), y(value(p))]), dashes);
      }
      if (pointer !== null && pointer >= LEFT && shown.length) {
        const near = shown.reduce((best, p) => (Math.abs(x(p[0]) - pointer) < Math.abs(x(best[0]) - pointer) ? p : best));
        pen.strokeStyle = theme.ink;
        pen.lineWidth = 1;
        GS.stroke(pen, [[x(near[0]), 0], [x(near[0]), height]]);
        said.textContent = `${GS.fixed(near[0], 2)} s: ${curves.map((c) => `${c.name} ${GS.text(c.value(near), 3)}`).join(", ")}`;
      }
      pen.restore();
    };
  };
})();

// The 3-D view of the machine as it is now, and the reference as a ghost.
(() => {
  const GS = GoughStewart, { live } = GS.page, FRAMES = 3;
  GS.liveStage = (element) => {
    const turned = new THREE.Quaternion(), angles = new THREE.Euler();
    // R = Rz Ry Rx
    const pose = (values, to, at) => {
      turned.setFromEuler(angles.set(values[3], values[4], values[5], "ZYX"));
      to.set([values[0], values[1], values[2], turned.x, turned.y, turned.z, turned.w], at);
    };
    // two frames for the room that the view needs; the first is then that of now
    const record = {
      ...live.scene, index: 0, run: 0, name: "", time: new Float64Array([0, 1, 2]), orientation: null,
      pose: new Float64Array(7 * FRAMES), reference: new Float64Array(7 * FRAMES),
      force: new Float64Array(6 * FRAMES).fill(live.forceLimit || 1), external_force: new Float64Array(3 * FRAMES).fill(1),
      nearness: { of: ["stroke", "force"], values: new Float64Array(6 * FRAMES) },
    };
    const far = live.behind?.pose ?? [];
    [0, 1, -1].forEach((sign, k) => {
      const near = live.home.map((x, axis) => (axis < 3 ? x + sign * 0.8 * live.reach[axis] : x));
      const at = (k && far.at([0, -1, Math.floor(far.length / 2)][k])) || near;
      for (const poses of [record.pose, record.reference]) pose(at, poses, 7 * k);
    });
    record.home = [...record.pose.subarray(0, 7)];
    GS.records.push(record);
    GS.prepareColours();
    GS.prepareBodies();
    GS.prepareScene();
    const view = GS.scene(element);
    for (const values of [record.force, record.external_force]) values.fill(0); // what was there gave the scales
    view.colourBy("nearness");
    view.show(0); // colours of instances have to be there at the first picture
    view.showParts({ reference: !live.isOpen, path: false, frames: true });
    const [low, high] = live.stroke || [-Infinity, Infinity], middle = (low + high) / 2;
    return {
      view,
      colourBy: view.colourBy,
      // of a point: time, pose, lengths, forces, reference
      show: (point, push) => {
        pose(point.subarray(1, 7), record.pose, 0);
        if (Number.isFinite(point[19])) pose(point.subarray(19, 25), record.reference, 0);
        for (let leg = 0; leg < 6; leg++) {
          const force = record.force[leg] = point[13 + leg], near = live.stroke ? Math.abs(point[7 + leg] - middle) / (high - middle) : 0;
          record.nearness.values[leg] = Math.max(near, live.forceLimit ? Math.abs(force) / live.forceLimit : 0);
        }
        record.external_force.set(push, 0);
        view.show(0);
      },
    };
  };
})();
