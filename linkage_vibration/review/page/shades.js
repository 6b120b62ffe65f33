// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Shades gaps, invalid angles and toggles behind a chart, and draws its guide lines.

const fills = { gap: "#e4e4e4", jump: "#222222", range: "#f9e08b", toggle: "#d9e6f2", unknown: "#f3f3f3", above: "#f8ddd6" };
const HATCH = "#a8a8a8";

/** Shade where predictions are missing, have no numbers, or are near a toggle, and what the chart adds. */
function shade(u, more = []) {
  const { ctx, bbox } = u, { min, max } = u.scales.x, labels = [];
  ctx.save();
  for (const [start, end, kind, text] of [...more, ...data.shades]) {
    if (end < min || start > max) continue;
    const a = clamp(u.valToPos(start, "x", true), bbox.left, bbox.left + bbox.width);
    const b = clamp(u.valToPos(end, "x", true), bbox.left, bbox.left + bbox.width);
    const width = Math.max(b - a, devicePixelRatio);
    ctx.fillStyle = fills[kind];
    ctx.fillRect(a, bbox.top, width, bbox.height);
    if (text && bbox.height > 100 * devicePixelRatio) {
      // A gap that is shown short, or a jump of the clock, is marked with its length.
      ctx.save();
      ctx.translate((a + b) / 2 + (kind === "jump" ? -4 : 4) * devicePixelRatio, bbox.top + bbox.height / 2);
      ctx.rotate(-Math.PI / 2);
      ctx.font = `600 ${11 * devicePixelRatio}px system-ui, sans-serif`;
      ctx.textAlign = "center";
      labels.push([ctx.getTransform(), text]);
      ctx.restore();
    }
    if (kind === "gap" || kind === "unknown") {
      ctx.save();
      ctx.beginPath();
      ctx.rect(a, bbox.top, width, bbox.height);
      ctx.clip();
      ctx.strokeStyle = HATCH;
      ctx.beginPath();
      for (let x = a - bbox.height; x < a + width; x += 9 * devicePixelRatio) {
        ctx.moveTo(x, bbox.top + bbox.height);
        ctx.lineTo(x + bbox.height, bbox.top);
      }
      ctx.stroke();
      ctx.restore();
    }
  }
  ctx.font = `600 ${11 * devicePixelRatio}px system-ui, sans-serif`;
  ctx.textAlign = "center";
  ctx.fillStyle = INK;
  ctx.strokeStyle = "#ffffff";
  ctx.lineWidth = 3 * devicePixelRatio;
  for (const [at, text] of labels) {
    ctx.setTransform(at);
    ctx.strokeText(text, 0, 0);
    ctx.fillText(text, 0, 0);
  }
  ctx.restore();
}

/** Draw the limit of a load as a dashed line, with its value on the right. */
function drawLimit(u, limit) {
  const { ctx, bbox } = u, y = u.valToPos(limit, "y", true), right = bbox.left + bbox.width;
  stroke(u, [[view[0], limit], [view[1], limit]], { colour: ABOVE, width: 1.4, dash: dashes.dashed });
  ctx.save();
  ctx.font = `600 ${12 * devicePixelRatio}px system-ui, sans-serif`;
  ctx.textAlign = "left";
  ctx.textBaseline = "middle";
  ctx.fillStyle = ABOVE;
  ctx.fillText(`limit ${limit}`, right + 6 * devicePixelRatio, y);
  ctx.restore();
}
