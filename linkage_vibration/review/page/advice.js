// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Paints the load ratio over height and ground speed, with the drive, its worst moment and the quietest height.

// Cividis (Nunez, Anderton and Renslow 2018) looks alike with and without colour blindness.
const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const LUT = (() => {
  const stops = CIVIDIS.map(c => [1, 3, 5].map(k => parseInt(c.slice(k, k + 2), 16)));
  return Uint32Array.from({ length: 256 }, (_, i) => {
    const x = i / 255 * (stops.length - 1), k = Math.min(Math.floor(x), stops.length - 2);
    const [red, green, blue] = [0, 1, 2].map(c => Math.round(stops[k][c] + (stops[k + 1][c] - stops[k][c]) * (x - k)));
    return (255 << 24 | blue << 16 | green << 8 | red) >>> 0;
  });
})();

/** Round values from low to high, about as many as there is room for. */
function roundValues(low, high, count) {
  const raw = (high - low) / count, ten = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map(k => k * ten).find(s => s >= raw * (1 - 1e-9)), found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(Number((k * step).toPrecision(9)));
  return found;
}

if (data.advice) {
  const { angles, speeds, limit, drive, now, best, texts } = data.advice;
  const { loads, reasons } = data.advice, nV = speeds.length, nA = angles.length;
  const W = 460, H = 300, left = 50, right = 96, bottom = 40, top = 10;
  const step = { x: speeds[1] - speeds[0], y: angles[1] - angles[0] };
  const x = v => left + (v - speeds[0] + step.x / 2) / (nV * step.x) * (W - left - right);
  const y = v => H - bottom - (v - angles[0] + step.y / 2) / (nA * step.y) * (H - bottom - top);
  const most = Math.max(1.25 * limit, loads.reduce((a, b) => b > a ? b : a, 0));
  const shade = v => LUT[clamp(Math.round(255 * v / most), 0, 255)];
  const picture = (width, height, colour) => {
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    const own = canvas.getContext("2d"), image = own.createImageData(width, height);
    const pixels = new Uint32Array(image.data.buffer);
    for (let k = 0; k < pixels.length; k++) pixels[k] = colour(k % width, height - 1 - Math.floor(k / width));
    own.putImageData(image, 0, 0);
    return canvas.toDataURL();
  };
  const at = (j, i) => loads[i * nV + j];
  const edges = [];  // between a cell above the limit and one that is not
  for (let i = 0; i < nA; i++) for (let j = 0; j < nV; j++) {
    const x0 = x(speeds[j] + step.x / 2), y0 = y(angles[i] + step.y / 2), above = at(j, i) > limit;
    if (j + 1 < nV && above !== at(j + 1, i) > limit) edges.push(`M${x0},${y(angles[i] - step.y / 2)}V${y0}`);
    if (i + 1 < nA && above !== at(j, i + 1) > limit) edges.push(`M${x(speeds[j] - step.x / 2)},${y0}H${x0}`);
  }
  const title = "Load ratio over height and ground speed";
  const drawn = svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": `${title}, with the drive`, "font-size": 11, fill: INK });
  const inside = { x: left, y: top, width: W - left - right, height: H - bottom - top, preserveAspectRatio: "none", style: "image-rendering: pixelated" };
  drawn.append(svg("rect", { ...inside, fill: "#e4e4e4" }), svg("image", { ...inside, href: picture(nV, nA, (j, i) => Number.isFinite(at(j, i)) ? shade(at(j, i)) : 0) }),
    svg("path", { d: edges.join(""), stroke: "#ffffff", "stroke-width": 1.5, fill: "none" }));
  const path = drive.map((p, k) => p ? `${k && drive[k - 1] ? "L" : "M"}${x(p[0]).toFixed(1)},${y(p[1]).toFixed(1)}` : "").join("");
  for (const [stroke, width] of [["#ffffff", 2.6], [WARN, 1.2]]) drawn.append(svg("path", { d: path, stroke, "stroke-width": width, "stroke-linecap": "round", "stroke-linejoin": "round", fill: "none" }));
  if (now) drawn.append(svg("circle", { cx: x(now[0]), cy: y(now[1]), r: 5, fill: WARN, stroke: "#ffffff", "stroke-width": 1.5 }));
  if (best) drawn.append(svg("circle", { cx: x(best[0]), cy: y(best[1]), r: 5, fill: "#ffffff", stroke: INK, "stroke-width": 1.5 }));
  for (const v of roundValues(speeds[0], speeds[nV - 1], 6)) drawn.append(svg("text", { x: x(v), y: H - bottom + 15, "text-anchor": "middle" }, String(v)));
  for (const v of roundValues(angles[0], angles[nA - 1], 6)) drawn.append(svg("text", { x: left - 6, y: y(v) + 4, "text-anchor": "end" }, String(v)));
  const bar = { ...inside, x: W - right + 12, width: 10 }, height = v => H - bottom - v / most * (H - bottom - top);
  drawn.append(svg("image", { ...bar, href: picture(1, 256, (_, i) => LUT[i]) }));
  for (const v of roundValues(0, most, 5)) if (Math.abs(height(v) - height(limit)) > 11) drawn.append(svg("text", { x: W - right + 26, y: height(v) + 4 }, String(v)));
  drawn.append(svg("text", { x: W - right + 26, y: height(limit) + 4, "font-weight": "bold" }, `${limit} limit`),
    svg("line", { x1: W - right + 10, x2: W - right + 24, y1: height(limit), y2: height(limit), stroke: INK }),
    svg("text", { x: (left + W - right) / 2, y: H - 6, "text-anchor": "middle" }, "ground speed [km/h]"),
    svg("text", { x: 12, y: (top + H - bottom) / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${(top + H - bottom) / 2})` }, "crank angle α3 [deg]"));
  const note = element("p", { class: "note" }, data.advice.note);
  drawn.addEventListener("pointermove", event => {
    const box = drawn.getBoundingClientRect(), px = (event.clientX - box.left) / box.width * W, py = (event.clientY - box.top) / box.height * H;
    const j = Math.floor((px - left) / (W - left - right) * nV), i = Math.floor((H - bottom - py) / (H - bottom - top) * nA);
    const here = j >= 0 && j < nV && i >= 0 && i < nA, reason = here && texts[reasons[i * nV + j]];
    note.textContent = here ? `${digits(angles[i], 3)} deg, ${digits(speeds[j], 3)} km/h: ${reason || `load ratio ${digits(at(j, i), 2)}`}` : data.advice.note;
  });
  byId("advice").append(element("details", { class: "plot" }, element("summary", {}, title), drawn, note));
}
