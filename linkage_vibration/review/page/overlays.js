// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws lines and marks over a chart.

/** Whether a line jumps so often that it would cover what is below it. */
function busy(u, points) {
  let far = 0;
  for (let i = 1; i < points.length; i++) {
    const a = points[i - 1][1], b = points[i][1];
    const both = a > 0 && b > 0;
    if (both ? Math.abs(u.valToPos(a, "y") - u.valToPos(b, "y")) > 10 : a > 0) far++;
  }
  return far > Math.max(20, points.length / 8);
}

/** Draw a line through points, which a pair of nulls interrupts; an edge makes it visible on any ground. */
function stroke(u, points, { colour, edge, width, dash = [] }) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  const path = new Path2D();
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
  for (const [style, size] of edge ? [[edge, width + 2], [colour, width]] : [[colour, width]]) {
    ctx.strokeStyle = style;
    ctx.lineWidth = size * devicePixelRatio;
    ctx.stroke(path);
  }
  ctx.restore();
}

/** The style of a mode's natural frequency; that of the chosen mode is prominent. */
const modeLine = k => ({ colour: "#000000", edge: k === mode ? "#ffffff" : "", width: k === mode ? 1.8 : 1, dash: [4, 3] });

/** The radius of the dot of a moment, px: its area grows with the logarithm of its severity. */
function radius({ severity }, small) {
  const all = radius.all ??= moments.map(row => row.severity).filter(v => v > 0);
  const low = Math.log(radius.low ??= Math.min(...all)), high = Math.log(radius.high ??= Math.max(...all));
  const share = severity > 0 && high > low ? (Math.log(severity) - low) / (high - low) : 1;
  return (small ? .5 : 1) * Math.sqrt(6 + 43 * share);
}

/** Draw a dot at a moment of resonance; the current one has a dark edge. */
function mark(u, x, y, row, small = false) {
  const { ctx, bbox } = u, px = u.valToPos(x, "x", true), py = u.valToPos(y, "y", true);
  if (px < bbox.left || px > bbox.left + bbox.width || py < bbox.top || py > bbox.top + bbox.height) return;
  const chosen = current >= 0 && row === stops[current].row;
  ctx.save();
  ctx.beginPath();
  ctx.arc(px, py, radius(row, small && !chosen) * devicePixelRatio, 0, 2 * Math.PI);
  ctx.fillStyle = WARN;
  ctx.strokeStyle = chosen ? "#000000" : "#ffffff";
  ctx.lineWidth = 1.6 * devicePixelRatio;
  ctx.fill();
  if (!small || chosen) ctx.stroke();
  ctx.restore();
}
