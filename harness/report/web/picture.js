"use strict";
// A picture of the stage on one canvas, to save, record or print.
(() => {
  const GS = GoughStewart;
  const $ = (id) => document.getElementById(id);
  const FONT = 'system-ui, "Segoe UI", sans-serif';

  // Lines of text, with a swatch before those with a colour; x is from the left, y from the top.
  const write = (pen, lines, x, y, ink) => lines.forEach(([text, colour], k) => {
    if (colour) {
      pen.fillStyle = colour;
      pen.fillRect(x, y + 18 * k - 9, 10, 10);
    }
    pen.fillStyle = ink;
    pen.fillText(text, x + (colour ? 16 : 0), y + 18 * k);
  });

  // The present frame at a width in pixels; at full resolution, or as in the animation.
  GS.compose = (view, canvas, wide, sharp = true) => {
    const { canvas: source } = view, theme = GS.theme(), across = source.clientWidth || 600, down = source.clientHeight || 400;
    // video encoders need even sizes
    const [width, height] = [wide, wide * down / across].map((size) => 2 * Math.round(size / 2));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const pen = canvas.getContext("2d"), pixel = width / across;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.fillStyle = theme.paper;
    pen.fillRect(0, 0, width, height);
    // a WebGL canvas keeps its picture only until the end of the task
    view.draw(sharp);
    pen.drawImage(source, 0, 0, width, height);
    pen.setTransform(pixel, 0, 0, pixel, 0, 0);
    pen.font = `13px ${FONT}`;
    const runs = GS.records.length > 1 ? GS.records.filter((r) => !GS.runsHidden(r.run)) : [];
    const note = $("enlarged").hidden ? [] : [[$("enlarged").textContent]];
    write(pen, [...note, ...runs.map((r) => [r.name, theme.six[r.run % 6]])], 12, 22, theme.ink);
    pen.textAlign = "right";
    write(pen, [[$("clock").textContent]], across - 12, 22, theme.ink);
    pen.textAlign = "left";
    const scale = GS.scale($("colour").value);
    if (!scale) return;
    const bar = pen.createLinearGradient(12, 0, 232, 0);
    scale.colours.forEach((colour, k) => bar.addColorStop(k / (scale.colours.length - 1), GS.css(colour)));
    pen.fillStyle = bar;
    pen.fillRect(12, down - 34, 220, 8);
    write(pen, [[scale.title], [""], [scale.low]], 12, down - 42, theme.ink);
    pen.textAlign = "right";
    write(pen, [[scale.high]], 232, down - 6, theme.ink);
    pen.textAlign = "left";
  };

  GS.savePicture = (view) => {
    const canvas = document.createElement("canvas");
    GS.compose(view, canvas, 2 * view.canvas.clientWidth);
    canvas.toBlob((blob) => GS.save(blob, `-${GS.state.time.toFixed(3)}s.png`, $("saved")), "image/png");
  };
})();
