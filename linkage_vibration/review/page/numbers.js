// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Gives each chart a name and a table of its numbers.

/** Give the canvas of a chart a name for screen readers. */
function nameCanvas(u, name) {
  u.ctx.canvas.setAttribute("role", "img");
  u.ctx.canvas.setAttribute("aria-label", name);
}

const TABLED = 25;  // times in a table of numbers

/** Add the numbers of a chart in view as a table, which is made when it is opened. */
function addNumbers(chart) {
  const box = element("details", { class: "numbers" }, element("summary", {}, "Numbers"));
  const lines = chart.spec.series.map(line => ({ ...line, name: `${line.name ?? chart.spec.title} [${chart.spec.unit}]` }));
  const fill = () => {
    if (!box.open) return;
    const from = lowerBound(time, view[0]), to = Math.max(from + 1, lowerBound(time, view[1]));
    const step = Math.max(1, Math.floor((to - from) / TABLED)), rows = [];
    for (let i = from; i < Math.min(to, n); i += step) {
      rows.push(element("tr", {}, element("th", { scope: "row" }, clock(time[i], 1e-2)), ...lines.map(line => {
        const value = columns[line.column][i];
        return element("td", {}, digits(value * (line.factor ?? 1), 4));
      })));
    }
    const head = element("tr", {}, ...[`time [${timeUnit}]`, ...lines.map(line => line.name)].map(text => element("th", { scope: "col" }, text)));
    box.querySelector("table")?.remove();
    box.append(element("table", {}, element("thead", {}, head), element("tbody", {}, ...rows)));
  };
  box.addEventListener("toggle", fill);
  onView.push(fill);
  chart.row.append(box);
}
