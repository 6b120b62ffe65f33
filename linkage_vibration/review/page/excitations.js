// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws the orders over the modes, and the names of both.

const excitations = (data.excitations ?? []).map(one => ({ ...one, ...data.speeds[one.source] }))
  .map(one => one.fixed === undefined ? one : { ...one, times: time, values: new Float32Array(n).fill(one.fixed) });
/** How a load is drawn: unknown, weak, four widths below the limit, and three above it. */
const LOADS = [{ colour: WEAK, width: 1, dash: dashes.dotted }, { colour: WEAK, width: 1 },
  ...[1.2, 2, 2.8, 3.6].map(width => ({ colour: INK, width })), ...[4, 5, 6].map(width => ({ colour: ABOVE, width }))];
/** Which of these a step of the load is, as the page holds it (0 unknown, 1 weak, 128 the limit). */
const loadStyle = step => step < 2 ? step : step <= 128 ? 2 + Math.min(3, (step - 2) >> 5) : 6 + Math.min(2, Math.floor((step - 129) / 42.5));

/** The points of an excitation in view, s and Hz; of long stretches only the lowest and the highest value. */
function excitationPoints({ times, values, ratio, fixed }, wanted) {
  const from = Math.max(0, lowerBound(times, view[0]) - 1), to = Math.min(times.length, lowerBound(times, view[1]) + 1);
  const step = Math.max(1, Math.floor((to - from) / wanted)), points = [];
  const apart = i => fixed === undefined && i > from && times[i] - times[i - 1] > data.stale_after;
  for (let i = from; i < to;) {
    let low = Infinity, high = -Infinity, end = i;
    while (end < Math.min(i + step, to) && values[end] > 0 && (end === i || !apart(end))) {
      low = Math.min(low, values[end]);
      high = Math.max(high, values[end++]);
    }
    const [one, other] = values[i] > values[end - 1] ? [high, low] : [low, high];
    if (end > i) points.push([times[i], ratio * one], [times[end - 1], ratio * other]);
    const lost = end < to && !(values[end] > 0);
    if (lost || (end < to && apart(end))) points.push([null, null]);
    while (end < to && !(values[end] > 0)) end++;
    i = end;
  }
  return points;
}

/** Draw a line through points, which a pair of nulls interrupts. */
function stroke(u, points, { colour, width, dash = [] }) {
  const { ctx, bbox } = u, path = new Path2D();
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  let down = false;
  // Points far out of sight are clamped, as the browser computes dashes there too.
  const top = bbox.top - bbox.height, bottom = bbox.top + 2 * bbox.height;
  for (const [x, y] of points) {
    if (x === null || !(y > 0)) { down = false; continue; }
    const px = u.valToPos(x, "x", true), py = clamp(u.valToPos(y, "y", true), top, bottom);
    if (down) path.lineTo(px, py); else path.moveTo(px, py);
    down = true;
  }
  ctx.lineJoin = "bevel";
  ctx.setLineDash(dash.map(d => d * devicePixelRatio));
  ctx.strokeStyle = colour;
  ctx.lineWidth = width * devicePixelRatio;
  ctx.stroke(path);
  ctx.restore();
}

/** Draw each order, as wide as its load, and write the names of modes and orders on the right. */
function drawOrders(u, modes) {
  const { min, max } = u.scales.y, lines = LOADS.map(() => []), names = [];
  const from = lowerBound(time, view[0]), to = Math.min(n, lowerBound(time, view[1]) + 1);
  for (const { column, colour, name } of modes) {
    let i = to - 1;
    while (i > from && !(columns[column][i] > 0)) i--;
    if (columns[column][i] > 0) names.push({ name, colour, bold: true, y: columns[column][i], load: LOADS.length });
  }
  for (const one of excitations) {
    const points = excitationPoints(one, 250);
    const seen = points.findLast(([x, y]) => x !== null && x <= view[1] && y >= min && y <= max);
    if (!seen) continue;
    let load = -1;
    for (let k = 1; k < points.length; k++) {
      const [before, here] = [points[k - 1], points[k]];
      if (before[0] === null || here[0] === null) continue;
      const style = loadStyle(columns[one.load]?.[nearest(here[0])] ?? 0), line = lines[style];
      if (line[line.length - 1] !== before) line.push([null, null], before);
      line.push(here);
      load = Math.max(load, style);
    }
    if (load >= 0) names.push({ name: one.name, colour: LOADS[Math.max(load, 2)].colour, y: seen[1], load });
  }
  lines.forEach((points, style) => stroke(u, points, LOADS[style]));
  writeNames(u, names);
}

/** Write names on the right of a chart at their heights, or below one another; if there is no room, those of the weakest loads are left out. */
function writeNames(u, names) {
  const { ctx, bbox } = u, high = 13 * devicePixelRatio, bottom = bbox.top + bbox.height;
  const shown = names.sort((a, b) => b.load - a.load).slice(0, Math.floor(bbox.height / high))
    .map(one => ({ ...one, at: u.valToPos(one.y, "y", true) })).sort((a, b) => a.at - b.at);
  shown.forEach((one, i) => { one.at = Math.max(one.at, i ? shown[i - 1].at + high : bbox.top + high / 2); });
  for (let i = shown.length - 1, low = bottom; i >= 0; i--, low -= high) shown[i].at = Math.min(shown[i].at, low);
  ctx.save();
  ctx.textAlign = "left";
  ctx.textBaseline = "middle";
  for (const { name, colour, bold, at } of shown) {
    ctx.font = `${bold ? 700 : 400} ${11 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.fillStyle = colour;
    ctx.fillText(name, bbox.left + bbox.width + 6 * devicePixelRatio, at, (roomForNames(u.width) - 8) * devicePixelRatio);
  }
  ctx.restore();
}
