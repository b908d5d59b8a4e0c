"use strict";
// Charts that scroll: the last seconds of some curves, drawn on a canvas.
(() => {
  const GS = GoughStewart, MOST = 4000;
  const nice = (span) => {
    const raw = span / 4, power = 10 ** Math.floor(Math.log10(raw));
    return power * [1, 2, 5, 10].find((step) => step * power >= raw);
  };
  // Draws a line through points [[x, y], …] on a canvas.
  GS.stroke = (pen, points) => {
    pen.beginPath();
    for (const [x, y] of points) pen.lineTo(x, y);
    pen.stroke();
  };
  // curves: name, value of a point, colour of a theme, dashes, and values behind it at the times; least: smallest span
  GS.plot = (host, { title, unit, curves, least, times = [], marks = () => [] }) => {
    const canvas = GS.element("canvas", { role: "img", "aria-label": `${title} [${unit}], the last seconds` });
    const key = GS.element("ul", { class: "key" }), said = GS.element("output", { class: "at" });
    const caption = GS.element("figcaption", {}, GS.element("h2", {}, `${title} [${unit}]`), said, key);
    host.append(GS.element("figure", { class: "plot-live" }, caption, canvas));
    const pen = canvas.getContext("2d");
    let pointer = null, seen = true;
    new IntersectionObserver((entries) => { seen = entries[entries.length - 1].isIntersecting; }).observe(canvas);
    const paintKey = () => key.replaceChildren(...curves.map((curve) => {
      const line = GS.element("i");
      line.style.borderTop = `3px ${curve.dashes?.length ? "dashed" : "solid"} ${curve.colour(GS.theme())}`;
      return GS.element("li", {}, line, curve.name);
    }));
    paintKey();
    GS.onTheme(paintKey);
    canvas.addEventListener("pointermove", (event) => { pointer = event.offsetX; });
    canvas.addEventListener("pointerleave", () => { pointer = null; said.textContent = ""; });
    // what moves is drawn only where it is seen
    const draw = (points, span, rests) => {
      const width = canvas.clientWidth, height = canvas.clientHeight, ratio = Math.min(devicePixelRatio, 2), theme = GS.theme();
      if (!(seen || rests) || !width || !points.length) return;
      if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
        canvas.width = Math.round(width * ratio);
        canvas.height = Math.round(height * ratio);
      }
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.clearRect(0, 0, width, height);
      const begin = Math.max(0, points[points.length - 1][0] - span), end = begin + span, left = 52, bottom = 18;
      let first = points.length - 1;
      while (first > 0 && points[first - 1][0] >= begin) first--;
      let low = Infinity, high = -Infinity;
      for (let k = first; k < points.length; k++) for (const { value } of curves) {
        const y = value(points[k]);
        if (y < low) low = y;
        if (y > high) high = y;
      }
      // of what is behind: the times in view
      const since = times.findIndex((t) => t >= begin), until = times.filter((t) => t <= end).length;
      for (const { behind } of curves) for (let k = Math.max(since, 0); behind && since >= 0 && k < until; k++) {
        low = Math.min(low, behind[k]);
        high = Math.max(high, behind[k]);
      }
      if (!Number.isFinite(high - low)) return;
      const middle = (low + high) / 2, half = Math.max((high - low) / 2, least / 2) * 1.08;
      [low, high] = [middle - half, middle + half];
      const x = (t) => left + (t - begin) / span * (width - left - 6), y = (v) => (height - bottom) * (1 - (v - low) / (high - low));
      pen.font = "11px system-ui, sans-serif";
      pen.lineWidth = 1;
      pen.strokeStyle = theme.line;
      pen.fillStyle = theme.ink;
      pen.textAlign = "right";
      pen.setLineDash([]);
      const step = nice(high - low), digits = Math.max(0, -Math.floor(Math.log10(step)));
      // by number: where a loop diverged, a step may be less than the last digit
      for (let k = Math.ceil(low / step); k <= high / step && k - low / step < 12; k++) {
        const tick = k * step;
        GS.stroke(pen, [[left, y(tick)], [width, y(tick)]]);
        pen.fillText(GS.fixed(tick, digits), left - 5, Math.max(9, y(tick) + 4));
      }
      pen.textAlign = "center";
      const apart = nice(span);
      for (let tick = Math.ceil(Math.max(begin, 0) / apart) * apart; tick <= end; tick += apart) pen.fillText(`${GS.short(tick)} s`, Math.min(x(tick), width - 12), height - 4);
      pen.save();
      pen.beginPath();
      pen.rect(left, 0, width - left, height - bottom);
      pen.clip();
      for (const { value, role } of marks()) {
        pen.strokeStyle = theme.roles[role];
        pen.setLineDash([2, 3]);
        GS.stroke(pen, [[left, y(value)], [width, y(value)]]);
      }
      pen.lineWidth = 6;
      pen.globalAlpha = 0.3;
      pen.setLineDash([]);
      for (const { behind, colour } of curves) {
        if (!behind) continue;
        pen.strokeStyle = colour(theme);
        GS.stroke(pen, behind.map((v, k) => [x(times[k]), y(v)]));
      }
      pen.globalAlpha = 1;
      pen.lineWidth = 1.6;
      for (const { value, colour, dashes } of curves) {
        pen.strokeStyle = colour(theme);
        pen.setLineDash(dashes || []);
        pen.beginPath();
        for (let k = first; k < points.length; k++) pen.lineTo(x(points[k][0]), y(value(points[k])));
        pen.stroke();
      }
      if (pointer !== null && pointer >= left) {
        const t = begin + (pointer - left) / (width - left - 6) * span;
        const near = points.slice(first).reduce((best, p) => (Math.abs(p[0] - t) < Math.abs(best[0] - t) ? p : best));
        pen.strokeStyle = theme.ink;
        pen.setLineDash([]);
        pen.lineWidth = 1;
        GS.stroke(pen, [[x(near[0]), 0], [x(near[0]), height]]);
        said.textContent = `${GS.fixed(near[0], 2)} s: ${curves.map((c) => `${c.name} ${GS.text(c.value(near), 3)}`).join(", ")}`;
      }
      pen.restore();
    };
    return { draw };
  };
  // The last points, oldest first.
  GS.history = () => {
    const points = [];
    return {
      points,
      add: (values, size) => {
        for (let k = 0; k < values.length; k += size) points.push(values.subarray(k, k + size));
        if (points.length > MOST) points.splice(0, points.length - MOST);
      },
      clear: () => { points.length = 0; },
    };
  };
})();
