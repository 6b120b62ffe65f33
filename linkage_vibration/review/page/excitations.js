// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws excitations and moments of resonance over charts.

const excitations = (data.excitations ?? []).map(one => ({ ...one, ...data.speeds[one.source] }));
/** The moments of resonance, as rows of their table; the ground has no frequency. */
const moments = (data.tables.find(table => table.id === "moments")?.rows ?? []).filter(row => row.y !== undefined);

/** The points of an excitation in view, s and Hz; of long stretches only the lowest and the highest value. */
function excitationPoints({ times, values, ratio }, wanted) {
  const from = Math.max(0, lowerBound(times, view[0]) - 1), to = Math.min(times.length, lowerBound(times, view[1]) + 1);
  const step = Math.max(1, Math.floor((to - from) / wanted)), points = [];
  const apart = i => i > from && times[i] - times[i - 1] > data.stale_after;
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

let pointsInView = [], viewOfPoints = null;  // shared by all charts that draw excitations

/** Draw the excitations that are in sight, each with its name. */
function drawExcitations(u, style) {
  if (viewOfPoints !== view) {
    pointsInView = excitations.map(one => [one, excitationPoints(one, 250)]);
    viewOfPoints = view;
  }
  const { ctx, bbox } = u, taken = [], { min, max } = u.scales.y;
  const inSight = points => points.some(([, y]) => y >= min) && points.some(([, y]) => y !== null && y <= max);
  const drawn = pointsInView.filter(([, points]) => inSight(points) && !busy(u, points));
  for (const [one, points] of drawn) stroke(u, points, { ...style, dash: dashes[one.style] ?? [] });
  for (const [one, points] of drawn) {
    // The name is at the right end, unless it would cover another name.
    const end = points.findLast(([x, y]) => x !== null && x <= view[1] && y > 0);
    if (!end) continue;
    const y = u.valToPos(end[1], "y", true), high = 14 * devicePixelRatio;
    if (y < bbox.top + high || y > bbox.top + bbox.height || taken.some(other => Math.abs(other - y) < high)) continue;
    taken.push(y);
    ctx.save();
    ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.textAlign = "right";
    const x = Math.min(u.valToPos(end[0], "x", true), bbox.left + bbox.width) - 4 * devicePixelRatio;
    ctx.lineWidth = 3 * devicePixelRatio;
    ctx.strokeStyle = style.edge ?? "#ffffff";
    ctx.strokeText(one.name, x, y - 3 * devicePixelRatio);
    ctx.fillStyle = style.colour;
    ctx.fillText(one.name, x, y - 3 * devicePixelRatio);
    ctx.restore();
  }
}

const onMap = { colour: "#ffffff", edge: "#00000099", width: 1.3 };
const onPaper = { colour: "#555555", width: 1.1 };

/** Draw the moments of resonance in view, of one mode or of all modes. */
function drawMoments(u, modeOnly) {
  const shown = moments.filter(row => row.time >= view[0] && row.time <= view[1] &&
    (modeOnly === undefined || row.mode === modeOnly));
  for (const row of shown) mark(u, row.time, row.y, row, shown.length > 80);
}
