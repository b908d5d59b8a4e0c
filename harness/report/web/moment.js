"use strict";
// The values at the present time: a table per run with its pose, and force and length of each leg.
(() => {
  const GS = GoughStewart, { fixed } = GS;

  const tableOf = (record, host) => {
    const table = document.createElement("table");
    const heads = ["", ...[1, 2, 3, 4, 5, 6].map((k) => `leg ${k}`)];
    const rows = [...(record.force ? ["force [N]"] : []), "length [m]", ...(record.nearness ? ["of limit [%]"] : [])];
    table.innerHTML = `<caption></caption><thead><tr>${heads.map((h) => (h ? `<th scope="col">${h}</th>` : "<td></td>")).join("")}</tr></thead><tbody>${
      rows.map((r, k) => `<tr><th scope="row">${r}</th>${`<td>${k ? "" : "<i></i>"}<span></span></td>`.repeat(6)}</tr>`).join("")}</tbody>`;
    host.append(table);
    table.classList.add("now");
    return {
      record, caption: table.caption, dots: [...table.querySelectorAll("i")], cells: [...table.querySelectorAll("td span")],
      title: GS.records.length > 1 ? `${record.name}: ` : "",
    };
  };

  // Creates the tables in an element; returns a function that fills in the values of a time.
  GS.moment = (host) => {
    const tables = GS.records.map((record) => tableOf(record, host));
    return (time, colour) => {
      for (const { record, caption, dots, cells, title } of tables) {
        const at = GS.frameAt(record, time), length = GS.between(record.length, 6, at);
        const [x, y, z] = GS.between(record.pose, 7, at).slice(0, 3).map((v) => fixed(v, record.digits));
        const turned = record.orientation ? GS.between(record.orientation, 3, at).map((v) => `${fixed(180 / Math.PI * v, record.digits - 2)}°`) : null;
        caption.textContent = `${title}x ${x}  y ${y}  z ${z} m${turned ? `   roll ${turned[0]}  pitch ${turned[1]}  yaw ${turned[2]}` : ""}`;
        for (let k = 0; k < 6; k++) {
          dots[k].style.background = GS.css(GS.legColour(colour, record, at, k));
          const texts = [
            ...(record.force ? [GS.text(record.force[6 * at.frame + k])] : []), length[k].toFixed(record.digits),
            ...(record.nearness ? [(100 * record.nearness.values[6 * at.frame + k]).toFixed(0)] : []),
          ];
          texts.forEach((text, row) => { cells[6 * row + k].textContent = text; });
        }
      }
    };
  };
})();
