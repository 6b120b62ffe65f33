// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws one chart for each row over time.

/** What a series of the page's data draws; with a sign, an edge of its band of uncertainty. */
function quantity(series, sign = 0) {
  const values = columns[series.column], factor = series.factor ?? 1;
  if (!sign) return drawable(i => values[i] * factor);
  const spread = columns[series.spread], by = sign * data.coverage;
  return drawable(i => (values[i] + by * (spread[i] || 0)) * factor);
}

/** The samples between missing ones, which no line shows. */
const lonely = (u, k) => [...u.data[k].keys()].filter(i => u.data[k][i] != null && u.data[k][i - 1] == null && u.data[k][i + 1] == null);

/** The dashes of each line style, px. */
const dashes = { dashed: [6, 4], dotted: [2, 3] };

/** Add a row with a chart. */
function makeChart(spec, holder) {
  const height = (spec.height ?? 130) + 44;
  const box = element("div", { class: "chart", id: `chart-${spec.id}`, style: `min-height: ${height}px` });
  const heading = element("h3", {}, spec.title);
  if (spec.unit) heading.append(element("span", { class: "unit" }, ` [${spec.unit}]`));
  const key = element("span", { class: "key" }, ...(spec.key ?? []).map(keyItem));
  const head = element("div", { class: "row-head" }, heading, key);
  const row = element("div", { class: "chart-row" }, head, box);
  holder.append(row);
  const quantities = [], series = [{}], bands = [];
  for (const line of spec.series) {
    quantities.push(quantity(line));
    const points = { show: true, filter: lonely, size: 5, width: 0, fill: line.colour };
    series.push({ stroke: line.colour, width: line.width ?? 1.6, dash: dashes[line.style], points, spanGaps: false });
    if (line.spread) {
      quantities.push(quantity(line, 1), quantity(line, -1));
      const faint = { stroke: `${line.colour}66`, width: .6, points: { show: false } };
      series.push({ ...faint }, { ...faint });
      bands.push({ series: [series.length - 2, series.length - 1], fill: `${line.colour}40` });
    }
  }
  const log = Boolean(spec.log);
  const chart = {
    spec, box, row, head, quantities,
    make(width) {
      this.u?.destroy();
      this.u = new uPlot({
        width, height, series, bands,
        legend: { show: false }, cursor: { show: false }, padding: [6, roomForNames(width), 0, 0],
        scales: { x: { time: false, range: () => view }, y: { distr: log ? 3 : 1, range: yRange(log, spec.limit) } },
        axes: [timeAxis, valueAxis(log)],
        hooks: { drawClear: [u => shade(u, spec.shades)], draw: [u => { if (spec.limit) drawLimit(u, spec.limit); if (spec.orders) drawOrders(u, spec.series); }] },
      }, this.data(width), box);
      nameCanvas(this.u, `${spec.title}${spec.unit ? ` [${spec.unit}]` : ""} over time`);
      this.line = element("div", { class: "cursor" });
      this.u.over.append(this.line);
      interact(this);
    },
    data(width) { return decimated(quantities, view, wantedOver(width)); },
    near: true,  // whether it is in sight or close to it
    stale: false,  // whether it has to be redrawn once it is near
    update() {
      if (!this.u) return;
      this.stale = false;
      this.u.setData(this.data(this.u.width));
    },
    showCursor() {
      if (!this.u) return;
      const t = time[cursor], inside = t >= view[0] && t <= view[1];
      this.line.hidden = !inside;
      this.line.classList.toggle("kept", cursor === kept);
      if (inside) this.line.style.left = `${this.u.valToPos(t, "x")}px`;
    },
  };
  addNumbers(chart);
  charts.push(chart);
  return chart;
}

/** An entry of a legend: a line or a filled box, and its label. */
function keyItem({ label, colour, style, fill, hatched }) {
  const line = svg("svg", { width: 22, height: 10, "aria-hidden": "true" });
  if (fill) line.append(svg("rect", { width: 22, height: 10, fill: colour, stroke: GREY, "stroke-width": .5 }));
  if (hatched) line.append(svg("path", { d: "M0 8l8-8M5 10l10-10M12 10l10-10", stroke: HATCH }));
  if (!fill) line.append(svg("line", { x1: 0, x2: 22, y1: 5, y2: 5, stroke: colour, "stroke-width": 2.4, "stroke-dasharray": (dashes[style] ?? []).join(" ") }));
  return element("span", {}, line, label);
}
