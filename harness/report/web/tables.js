"use strict";
// Tables: rows sorted by a column, and rows that wait until they are asked for.
(() => {
  const key = (row, column) => {
    const cell = row.cells[column], value = cell.dataset.value;
    return value === undefined ? cell.textContent : Number(value);
  };
  const compared = (a, b) => {
    if (typeof a === "number" && typeof b === "number") return a - b;
    if (typeof a === "number") return -1;
    if (typeof b === "number") return 1;
    return a.localeCompare(b, "en", { numeric: true });
  };
  for (const button of document.querySelectorAll("button.sort")) {
    button.addEventListener("click", () => {
      const head = button.closest("th"), table = head.closest("table"), column = head.cellIndex;
      const falls = head.getAttribute("aria-sort") === "ascending", [body] = table.tBodies;
      for (const other of table.tHead.querySelectorAll("[aria-sort]")) other.setAttribute("aria-sort", "none");
      head.setAttribute("aria-sort", falls ? "descending" : "ascending");
      const rows = [...body.rows].map((row, k) => [key(row, column), k, row]);
      rows.sort((a, b) => (falls ? -1 : 1) * compared(a[0], b[0]) || a[1] - b[1]);
      body.append(...rows.map(([, , row]) => row));
      table.classList.remove("folded");
      table.closest(".table").querySelector("button.all")?.remove();
    });
  }
  for (const button of document.querySelectorAll("button.all")) {
    button.addEventListener("click", () => {
      const table = button.closest(".table").querySelector("table");
      table.classList.remove("folded");
      table.closest(".sideways").focus();
      button.remove();
    });
  }
  // A table that is wider than a phone shows each row as a card, its values under each other with the heads beside them;
  // one that is wider than a larger page scrolls sideways, also by keyboard.
  const phone = matchMedia("screen and (max-width: 640px)");
  const label = (table) => {
    const heads = [...table.tHead?.rows[0].cells ?? []].map((cell) => cell.textContent);
    // short names leave room for two values in a line
    table.classList.toggle("short", heads.every((text) => text.length <= 16));
    for (const row of table.tBodies[0].rows) {
      for (const cell of row.cells) cell.dataset.head = heads[cell.cellIndex] || "";
      // a card is named by its first cell: "leg 1" rather than 1
      if (!heads[0] || !/^\d+$/.test(row.cells[0].textContent)) delete row.cells[0].dataset.head;
    }
  };
  const fit = (box) => {
    const table = box.querySelector("table");
    table.classList.remove("stacked");
    const isWide = box.scrollWidth > box.clientWidth;
    if (isWide && phone.matches) {
      label(table);
      table.classList.add("stacked");
    }
    if (isWide && box.scrollWidth > box.clientWidth) box.tabIndex = 0; else box.removeAttribute("tabindex");
  };
  // A table of texts: heads of columns, a head for each row, numbers at the right.
  GoughStewart.table = (heads, rows, caption) => {
    const { element } = GoughStewart, head = (text, scope, kind) => (text ? element("th", { scope, class: kind }, text) : element("td", {}));
    return element("table", {}, ...(caption ? [element("caption", {}, caption)] : []),
      element("thead", {}, element("tr", {}, ...heads.map((text) => head(text, "col", "n")))),
      element("tbody", {}, ...rows.map(([name, ...cells]) => element("tr", {}, head(name, "row", null), ...cells.map((cell) => element("td", { class: "n" }, cell))))));
  };
  GoughStewart.fitTables = () => document.querySelectorAll(":is(.table, #marked) .sideways").forEach(fit);
  addEventListener("resize", GoughStewart.fitTables);
  document.addEventListener("toggle", GoughStewart.fitTables, true);
  phone.addEventListener("change", GoughStewart.fitTables);
  GoughStewart.fitTables();
})();

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
