"use strict";
// Paper: light colours, charts as drawings that fit the page, the 3-D view as a picture of the present moment.
(() => {
  const GS = GoughStewart;
  addEventListener("beforeprint", () => {
    GS.setPrinting(true);
    for (const panel of GS.panels || []) {
      if (!panel.host.checkVisibility()) continue;
      if (!panel.figure) {
        panel.paper = GS.element("p", { class: "paper" }, "This chart was not yet drawn: print once more.");
        panel.plot.after(panel.paper);
        continue;
      }
      GS.dressChart(panel);
      panel.paper = GS.element("div", { class: "paper", "aria-hidden": "true" }, panel.figure.drawing());
      panel.plot.after(panel.paper);
    }
    GS.printStage?.();
    GS.drawRest?.();
  });
  addEventListener("afterprint", () => {
    GS.setPrinting(false);
    for (const panel of GS.panels || []) {
      panel.paper?.remove();
      GS.dressChart(panel);
    }
  });
})();
