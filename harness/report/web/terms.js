"use strict";
// Explains a word where the reader points at it, or reaches it by keyboard; Escape hides the explanation.
(() => {
  const tip = GoughStewart.element("div", { id: "tip", role: "tooltip", hidden: "" });
  document.body.append(tip);
  const show = (term) => {
    tip.textContent = term.dataset.means;
    tip.hidden = false;
    const at = term.getBoundingClientRect(), { width, height } = tip.getBoundingClientRect();
    const left = Math.max(8, Math.min(at.left, document.documentElement.clientWidth - width - 8));
    const top = at.bottom + 6 + height < innerHeight ? at.bottom + 6 : at.top - height - 6;
    tip.style.transform = `translate(${left + scrollX}px, ${top + scrollY}px)`;
    term.setAttribute("aria-describedby", "tip");
  };
  const hide = (term) => {
    tip.hidden = true;
    term.removeAttribute("aria-describedby");
  };
  for (const [start, end] of [["pointerover", "pointerout"], ["focusin", "focusout"]]) {
    document.addEventListener(start, (event) => { const term = event.target.closest?.(".term"); if (term) show(term); });
    document.addEventListener(end, (event) => { const term = event.target.closest?.(".term"); if (term) hide(term); });
  }
  document.addEventListener("keydown", (event) => { if (event.key === "Escape") tip.hidden = true; });
})();
