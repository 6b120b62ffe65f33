// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Shows tables whose rows lead to a moment of the drive.

const stops = [];  // the rows that lead to a moment, with their lines in the page
let current = -1;  // the stop that was chosen last
for (const table of data.tables) {
  const body = element("tbody");
  table.rows.forEach(row => {
    const line = element("tr", row.time === undefined ? {} : { "data-time": row.time, tabindex: 0 },
      ...row.cells.map(cell => element("td", {}, String(cell))));
    if (row.time !== undefined) {
      const i = stops.push({ row, line }) - 1;
      line.addEventListener("click", () => jump(i));
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

/** Go to a stop: show its moment and its mode, and put the cursor there. */
function jump(i) {
  current = clamp(i, 0, stops.length - 1);
  const { row, line } = stops[current], scroll = line.closest(".scroll");
  stops.forEach((stop, k) => stop.line.classList.toggle("current", k === current));
  scroll.scrollTop += line.getBoundingClientRect().top - scroll.getBoundingClientRect().top - scroll.clientHeight / 2;
  byId("jump-label").textContent = `${current + 1} of ${stops.length}`;
  if (row.mode !== undefined) setMode(row.mode);
  // The view shows the whole stretch about the moment, and never grows.
  const span = Math.min(view[1] - view[0], Math.max(4 * (row.length ?? 0), (last - first) / 50, 2));
  setView(row.time - span / 2, row.time + span / 2);
  keep(row.index);
  showViewSoon();
}

byId("jumps").hidden = stops.length === 0;
