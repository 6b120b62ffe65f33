// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws the orders over the speed, with the bands of the modes over the angles of the drive.

/** Round values from low to high, about as many as there is room for. */
function roundValues(low, high, count) {
  const raw = (high - low) / count, ten = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map(k => k * ten).find(s => s >= raw * (1 - 1e-9)), found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(Number((k * step).toPrecision(9)));
  return found;
}

for (const { title, unit, speeds, orders, bands, dots } of data.campbell ?? []) {
  const W = 460, H = 300, left = 50, right = 90, bottom = 40, top = 10;
  const room = Math.max(.08 * (speeds[1] - speeds[0]), .02 * speeds[1]);
  const low = Math.max(0, speeds[0] - room), high = speeds[1] + room;
  const highest = Math.max(...orders.map(([, ratio]) => ratio * high));
  const most = 1.05 * Math.max(highest, ...bands.filter(b => b.ends && b.ends[0] <= 1.2 * highest).map(b => b.ends[1]));
  const x = v => left + (v - low) / (high - low) * (W - left - right);
  const least = Math.min(...bands.filter(b => b.ends).map(b => b.ends[0]), most / 10) / 1.5;
  const y = v => H - bottom - Math.log(Math.min(Math.max(v, least), most) / least) / Math.log(most / least) * (H - bottom - top);
  const curve = (from, to, ratio, style) => {  // an order, from where it is above the lowest frequency
    const start = Math.max(from, least / ratio), at = [...Array(41).keys()].map(i => start + (to - start) * i / 40);
    return svg("polyline", { points: start < to ? at.map(v => `${x(v)},${y(ratio * v)}`).join(" ") : "", fill: "none", ...style });
  };
  const drawn = svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": `${title}, ${orders.length} orders and ${bands.length} modes`, "font-size": 11, fill: INK });
  const labels = [], named = [];  // heights of the names of modes, which move up where bands are close together
  bands.forEach(({ colour, ends }, k) => {
    if (!ends || ends[0] > most) return;
    let at = Math.min((y(ends[0]) + y(ends[1])) / 2 + 4, H - bottom - 3);
    while (named.some(other => Math.abs(other - at) < 12)) at -= 1;
    named.push(at);
    drawn.append(svg("rect", { x: left, width: W - left - right, y: y(ends[1]), height: Math.max(2, y(ends[0]) - y(ends[1])), fill: colour, "fill-opacity": .25 }));
    labels.push(svg("rect", { x: left + 4, width: 7, y: at - 8, height: 7, fill: colour }),
      svg("text", { x: left + 15, y: at, stroke: "#ffffff", "stroke-width": 3, "paint-order": "stroke" }, data.mode_labels[k]));
  });
  const ticks = [-2, -1, 0, 1, 2, 3].flatMap(k => [1, 2, 5].map(d => Number(`${d}e${k}`))).filter(v => v >= least && v <= most);
  for (const v of ticks) drawn.append(svg("line", { x1: left, x2: W - right, y1: y(v), y2: y(v), stroke: "#e4e4e4" }), svg("text", { x: left - 6, y: y(v) + 4, "text-anchor": "end" }, String(v)));
  for (const v of roundValues(low, high, 5)) drawn.append(svg("line", { x1: x(v), x2: x(v), y1: y(0), y2: y(0) + 5, stroke: GREY }), svg("text", { x: x(v), y: y(0) + 17, "text-anchor": "middle" }, String(v)));
  const taken = [];
  for (const [name, ratio] of orders) {
    drawn.append(curve(low, high, ratio, { stroke: "#555555" }), curve(speeds[0], speeds[1], ratio, { stroke: INK, "stroke-width": 2.4 }));
    let at = y(ratio * high) + 4;
    while (taken.some(other => Math.abs(other - at) < 12)) at += 12;
    taken.push(at);
    drawn.append(svg("text", { x: W - right + 5, y: at }, name));
  }
  drawn.append(...labels);
  for (const [speed, frequency] of dots) drawn.append(svg("circle", { cx: x(speed), cy: y(frequency), r: 3, fill: WARN, stroke: "#ffffff", "stroke-width": .7 }));
  drawn.append(svg("text", { x: (left + W - right) / 2, y: H - 6, "text-anchor": "middle" }, unit),
    svg("text", { x: 12, y: (top + H - bottom) / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${(top + H - bottom) / 2})` }, "frequency [Hz]"));
  byId("campbell").append(element("section", { class: "plot" }, element("h2", {}, title), drawn,
    element("p", { class: "note" }, "Bold: the speeds of the drive. Bands: the natural frequencies over its angles. Dots: warnings.")));
}
