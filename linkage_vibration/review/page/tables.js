// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Shows tables whose rows lead to a moment of the drive.

let current = -1;
const jumps = data.tables.find(table => table.rows.some(row => row.time !== undefined));
for (const table of data.tables) {
  const body = element("tbody");
  table.rows.forEach((row, i) => {
    const line = element("tr", row.time === undefined ? {} : { "data-time": row.time, tabindex: 0 },
      ...row.cells.map(cell => element("td", {}, String(cell))));
    if (row.time !== undefined) {
      line.addEventListener("click", () => table === jumps ? jump(i) : keep(row.index));
      line.addEventListener("keydown", event => {
        if (event.key === "Enter" || event.key === " ") { event.preventDefault(); event.stopPropagation(); line.click(); }
      });
    }
    body.append(line);
  });
  const head = element("thead", {}, element("tr", {}, ...table.head.map(text => element("th", { scope: "col" }, text))));
  const section = element("section", { class: "table", id: `table-${table.id}` }, element("h2", {}, table.title));
  if (table.note) section.append(element("p", { class: "note" }, table.note));
  if (table.rows.length) section.append(element("div", { class: "scroll", tabindex: 0, "aria-label": table.title }, element("table", {}, head, body)));
  byId("tables").append(section);
}

function jump(i) {
  const rows = jumps.rows;
  current = clamp(i, 0, rows.length - 1);
  const row = rows[current], lines = document.querySelectorAll(`#table-${jumps.id} tbody tr`);
  lines.forEach((line, k) => line.classList.toggle("current", k === current));
  const line = lines[current], scroll = line.closest(".scroll");
  scroll.scrollTop += line.getBoundingClientRect().top - scroll.getBoundingClientRect().top - scroll.clientHeight / 2;
  byId("jump-label").textContent = `${current + 1} of ${rows.length}`;
  if (row.mode !== undefined) setMode(row.mode);
  // Near enough that its beginning and its end show, not nearer than the view that is chosen.
  const span = Math.min(view[1] - view[0], Math.max(4 * (row.length ?? 0), (last - first) / 50, 2));
  setView(row.time - span / 2, row.time + span / 2);
  keep(row.index);
  schedule();
}

if (jumps) byId("jumps").hidden = false;
