// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Shows tables whose rows lead to a moment of the drive, and sorts them.

const PRINTED = 20;  // rows of a folded table that are printed
const stops = [];  // the moments in the order of time, with their lines in the page
let current = -1;  // the stop that was chosen last

/** Sort the lines of a table by the numbers or the words of a column, in turn up and down. */
function sortBy(body, column, head) {
  const down = head.getAttribute("aria-sort") === "ascending";
  const key = line => line.cells[column].textContent;
  const number = text => Number(text.split(":").reduce((sum, part) => 60 * sum + parseFloat(part), 0));
  const order = (a, b) => Number.isFinite(number(key(a)) - number(key(b)))
    ? Math.abs(number(key(a))) - Math.abs(number(key(b))) : key(a).localeCompare(key(b));
  body.append(...[...body.rows].sort((a, b) => down ? order(b, a) : order(a, b)));
  for (const cell of head.parentElement.cells) cell.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
}

/** Align the columns that hold only numbers and times at their decimal points. */
function alignNumbers(heads, body) {
  heads.forEach((head, column) => {
    const own = [...body.rows].map(row => row.cells[column]);
    if (!own.some(cell => /^\d/.test(cell.textContent)) || !own.every(cell => /^[\d.:+-]*$|^not known$|^doubted$/.test(cell.textContent))) return;
    const decimals = own.map(cell => cell.textContent.split(".")[1]?.length ?? 0), most = Math.max(...decimals);
    for (const cell of [head, ...own]) cell.classList.add("number");
    // Spaces as wide as the digits, and as the point, that a number lacks.
    own.forEach((cell, i) => { if (/^\d/.test(cell.textContent)) cell.dataset.pad = "\u2007".repeat(most - decimals[i]) + "\u2008".repeat(most > 0 && decimals[i] === 0); });
  });
}

for (const table of data.tables) {
  const body = element("tbody");
  const worst = table.rows.map(row => row.severity ?? 0).sort((a, b) => b - a)[PRINTED] ?? -1;
  table.rows.forEach(row => {
    const line = element("tr", row.time === undefined ? {} : { "data-time": row.time, tabindex: 0 },
      ...row.cells.map(cell => element("td", {}, String(cell))));
    line.classList.toggle("unprinted", row.severity <= worst);
    if (row.time !== undefined) {
      if (table.id === "moments") stops.push({ row, line });
      line.addEventListener("click", () => show(row, line));
      line.addEventListener("keydown", event => {
        if (event.key === "Enter" || event.key === " ") { event.preventDefault(); event.stopPropagation(); line.click(); }
      });
    }
    body.append(line);
  });
  const heads = table.head.map((text, column) => {
    const head = element("th", { scope: "col" });
    const button = element("button", { type: "button", title: `Sort by ${text}` }, text);
    button.addEventListener("click", () => sortBy(body, column, head));
    head.append(button);
    return head;
  });
  const section = element(table.first ? "section" : "details", { class: "table", id: `table-${table.id}` },
    element(table.first ? "h2" : "summary", {}, table.title));
  if (table.id === "moments" && table.rows.length > PRINTED) section.append(element("p", { class: "note printed" }, `The ${PRINTED} strongest of them:`));
  alignNumbers(heads, body);
  if (table.rows.length) section.append(element("div", { class: "scroll", tabindex: 0, "aria-label": table.title }, element("table", {}, element("thead", {}, element("tr", {}, ...heads)), body)));
  else if (table.first) section.append(element("p", { class: "note" }, "No load above zero is known without a doubt."));
  byId(table.first ? "first" : "tables").append(section);
}
stops.sort((a, b) => a.row.time - b.row.time);

/** Go to the stop after or before the cursor; the last and the first one are kept. */
const jumpFrom = by => jump(by > 0 ? stops.findIndex(stop => stop.row.index > kept) : stops.findLastIndex(stop => stop.row.index < kept));

/** Go to a stop, if there is one. */
function jump(i) {
  if (i >= 0 && i < stops.length) show(stops[i].row, stops[i].line);
}

/** Show the moment and the mode of a row, and put the cursor there. */
function show(row, line) {
  current = stops.findIndex(stop => stop.row === row);
  document.querySelectorAll("tr.current").forEach(other => other.classList.remove("current"));
  line.classList.add("current");
  const scroll = line.closest(".scroll");
  scroll.scrollTop += line.getBoundingClientRect().top - scroll.getBoundingClientRect().top - scroll.clientHeight / 2;
  byId("jump-label").textContent = current < 0 ? "" : `${current + 1} of ${stops.length}`;
  if (row.mode !== undefined) setMode(row.mode);
  // The view shows the whole stretch about the moment, and never grows.
  const span = Math.min(view[1] - view[0], Math.max(4 * (row.length ?? 0), (last - first) / 50, 2));
  setView(row.time - span / 2, row.time + span / 2);
  keep(row.index);
  showViewSoon();
}

byId("jumps").hidden = stops.length === 0;
addEventListener("beforeprint", () => document.querySelectorAll("details.table").forEach(one => { one.open = true; }));
