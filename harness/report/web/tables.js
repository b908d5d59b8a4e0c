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
  // a table wider than the page scrolls sideways, also by keyboard
  const boxes = document.querySelectorAll(".table .sideways");
  const check = () => { for (const box of boxes) if (box.scrollWidth > box.clientWidth) box.tabIndex = 0; else box.removeAttribute("tabindex"); };
  addEventListener("resize", check);
  document.addEventListener("toggle", check, true);
  check();
})();
