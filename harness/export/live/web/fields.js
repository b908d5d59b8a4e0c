"use strict";
// A slider with its number.
(() => {
  const GS = GoughStewart;
  // `to` and `from` are the slider's place, 0 to 1, of a value, and back; a special value has a text of its own.
  GS.field = (host, { id, label, unit, step, to, from, text, set, valid = () => true, expected, special, said }) => {
    const slider = GS.element("input", { type: "range", id, min: 0, max: 1, step, "aria-label": `${label} ${unit}`.trim(), autocomplete: "off" });
    const number = GS.element("input", { type: "text", inputmode: "decimal", "aria-label": `${label}, as a number`, autocomplete: "off" });
    host.append(GS.element("div", { class: "axis" }, GS.element("label", { for: id }, label), slider, number, GS.element("span", { class: "unit" }, unit)));
    const shown = (value) => (special && value === special.value ? special.text : text(value));
    slider.addEventListener("input", () => {
      said.textContent = "";
      set(from(Number(slider.value)));
    });
    number.addEventListener("change", () => {
      const typed = number.value.trim(), value = typed === "" ? NaN : Number(typed.replace("−", "-").replace(",", "."));
      const isSpecial = special && (typed === "" || typed === special.text);
      if (!isSpecial && !(Number.isFinite(value) && valid(value))) {
        said.textContent = `${label} is '${number.value}'; expected ${expected}${special ? `, or ${special.text}` : ""}`;
        number.setAttribute("aria-invalid", "true");
        return;
      }
      said.textContent = "";
      number.removeAttribute("aria-invalid");
      set(isSpecial ? special.value : value);
    });
    return {
      show: (value) => {
        const share = special && value === special.value ? special.share : to(value);
        slider.value = Math.min(Math.max(share, 0), 1);
        slider.setAttribute("aria-valuetext", `${shown(value)} ${unit}`.trim());
        if (document.activeElement === number && number.getAttribute("aria-invalid")) return;
        number.removeAttribute("aria-invalid");
        number.value = shown(value);
      },
    };
  };
})();
