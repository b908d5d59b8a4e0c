"use strict";
// Saves files: a chart with its title, legend and note as PNG, as it is on the screen.
(() => {
  const GS = GoughStewart, { element } = GS;
  const FONT = 'system-ui, "Segoe UI", sans-serif', EDGE = 12, ROW = 20;

  const plain = (text) => text.replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "");
  // Downloads a file, and says so.
  GS.save = (blob, ending, said) => {
    const link = document.createElement("a"), name = `${plain(document.title) || "report"}${ending}`;
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    if (said) said.textContent = `saved ${name}`;
  };

  // Words on as many lines as the width needs.
  const wrapped = (pen, text, width) => {
    const lines = [];
    for (const word of text.split(/\s+/)) {
      const longer = lines.length ? `${lines.at(-1)} ${word}` : word;
      if (lines.length && pen.measureText(longer).width <= width) lines[lines.length - 1] = longer; else lines.push(word);
    }
    return lines;
  };

  // The legend as items with their place, and its height.
  const legendOf = (pen, panel, width) => {
    let x = 0, y = 0;
    const items = [...panel.key.children].filter((item) => !item.hidden).map((item) => {
      // without the values at the cursor, which a picture has not
      const words = item.querySelectorAll("button > span:not(.sample)"), text = (words.length ? [...words].map((each) => each.textContent).join(" ") : item.textContent).trim(), shapes = item.querySelectorAll("line, rect"), swatches = item.querySelectorAll("i");
      const sample = shapes.length ? 34 : swatches.length ? 16 : 0, wide = sample + pen.measureText(text).width;
      if (x > 0 && x + wide > width) { x = 0; y += ROW; }
      const found = { text, x, y, sample, shape: shapes[0], colour: !shapes.length && swatches.length ? getComputedStyle(swatches[0]).backgroundColor : null };
      x += wide + 16;
      return found;
    });
    return { items, height: items.length ? y + ROW : 0 };
  };

  const drawSample = (pen, { shape, colour }, x, y) => {
    const value = (name) => shape.getAttribute(name);
    if (colour) { pen.fillStyle = colour; pen.fillRect(x, y - 5, 10, 10); }
    if (!shape) return;
    if (shape.tagName === "rect") {
      pen.globalAlpha = Number(value("fill-opacity") || 1);
      pen.fillStyle = value("fill");
      pen.fillRect(x + 8, y - 5, 12, 10);
      pen.globalAlpha = 1;
      return;
    }
    pen.strokeStyle = value("stroke");
    pen.lineWidth = Number(value("stroke-width"));
    pen.setLineDash((value("stroke-dasharray") || "").split(" ").filter(Boolean).map(Number));
    pen.lineDashOffset = Number(value("stroke-dashoffset") || 0);
    pen.beginPath();
    pen.moveTo(x, y);
    pen.lineTo(x + 28, y);
    pen.stroke();
    pen.setLineDash([]);
  };

  // The chart on a canvas of its own: title, study, legend, plot, note.
  GS.chartPicture = (panel) => {
    const plot = panel.figure.picture(), { width, height } = panel.plot.getBoundingClientRect(), { ink, paper } = GS.theme();
    const canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), ratio = plot.width / width;
    const small = `12px ${FONT}`, title = `600 15px ${FONT}`, note = panel.host.querySelector(".hint")?.textContent || "";
    pen.font = title;
    const titles = wrapped(pen, panel.chart.title, width);
    pen.font = small;
    const study = wrapped(pen, [document.title, GS.page.changed].filter(Boolean).join("; set: "), width), notes = note ? wrapped(pen, note, width) : [], legend = legendOf(pen, panel, width);
    const head = EDGE + ROW * titles.length + 17 * study.length + 6, top = head + legend.height;
    canvas.width = Math.round(ratio * (width + 2 * EDGE));
    canvas.height = Math.round(ratio * (top + height + 17 * notes.length + EDGE));
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = paper;
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.textBaseline = "middle";
    const write = (lines, font, y, step) => {
      Object.assign(pen, { font, fillStyle: ink });
      lines.forEach((line, k) => pen.fillText(line, EDGE, y + step * k + step / 2));
    };
    write(titles, title, EDGE, ROW);
    write(study, small, EDGE + ROW * titles.length, 17);
    for (const item of legend.items) {
      drawSample(pen, item, EDGE + item.x, head + item.y + ROW / 2);
      Object.assign(pen, { font: small, fillStyle: ink });
      pen.fillText(item.text, EDGE + item.x + item.sample, head + item.y + ROW / 2);
    }
    pen.drawImage(plot, EDGE, top, width, height);
    write(notes, small, top + height, 17);
    return canvas;
  };

  GS.saveChart = (panel) => {
    if (!panel.figure) return;
    GS.chartPicture(panel).toBlob((blob) => GS.save(blob, `-${plain(panel.chart.title)}.png`, panel.saved), "image/png");
  };

  GS.saveButton = (panel) => {
    panel.saved = element("span", { class: "unseen", role: "status" });
    const button = element("button", {
      type: "button", class: "save", title: "save this chart as PNG (s)", "aria-label": `save ${panel.chart.title} as PNG`, onclick: () => GS.saveChart(panel),
    }, "PNG");
    panel.key.before(button, panel.saved);
  };
})();
