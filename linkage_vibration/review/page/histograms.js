// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws histograms of time shares.

for (const { title, unit, edges, shares, limit, note } of data.histograms) {
  const W = 460, H = 190, left = 44, bottom = 40, top = 8;
  const most = Math.max(...shares, 1e-9), step = [.01, .02, .05, .1, .2, .25, .5].find(s => most / s <= 5) ?? .5;
  const x = v => left + (v - edges[0]) / (edges[edges.length - 1] - edges[0]) * (W - left - 10);
  const y = v => H - bottom - v / (Math.ceil(most / step) * step) * (H - bottom - top);
  const drawn = svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": title, "font-size": 12, fill: INK });
  for (let v = 0; v <= Math.ceil(most / step) * step + 1e-9; v += step) {
    drawn.append(svg("line", { x1: left, x2: W - 10, y1: y(v), y2: y(v), stroke: "#e4e4e4" }),
      svg("text", { x: left - 6, y: y(v) + 4, "text-anchor": "end" }, `${Math.round(100 * v)} %`));
  }
  shares.forEach((share, i) => {
    const near = limit !== null && edges[i] >= limit - 1e-9;
    drawn.append(svg("rect", { x: x(edges[i]) + .5, width: Math.max(.5, x(edges[i + 1]) - x(edges[i]) - 1), y: y(share), height: Math.max(0, y(0) - y(share)), fill: near ? WARN : BLUE },
      svg("title", {}, `${digits(edges[i], 4)} to ${digits(edges[i + 1], 4)} ${unit}: ${(100 * share).toFixed(2)} % of the time`)));
  });
  const span = edges[edges.length - 1] - edges[0];
  const tick = [1e-3, .01, .02, .05, .1, .2, .5, 1, 2, 5, 10, 20, 30, 45, 90, 180, 360].find(s => span / s <= 9) ?? span;
  for (let v = Math.ceil(edges[0] / tick - 1e-9) * tick; v <= edges[edges.length - 1] + 1e-9; v += tick) {
    drawn.append(svg("line", { x1: x(v), x2: x(v), y1: y(0), y2: y(0) + 5, stroke: GREY }),
      svg("text", { x: x(v), y: y(0) + 18, "text-anchor": "middle" }, String(Number(v.toPrecision(6)))));
  }
  drawn.append(svg("line", { x1: left, x2: W - 10, y1: y(0), y2: y(0), stroke: GREY }),
    svg("text", { x: (left + W - 10) / 2, y: H - 6, "text-anchor": "middle" }, unit));
  const section = element("section", { class: "histogram" }, element("h2", {}, title), drawn);
  if (note) section.append(element("p", { class: "note" }, note));
  byId("histograms").append(section);
}
