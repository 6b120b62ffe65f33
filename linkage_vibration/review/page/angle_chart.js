// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws the waterfall over the crank angle.

let angleChart = null;
function makeAngleChart(width, box) {
  const angles = Array.from(frf.angles, a => a * DEG), count = data.modes.length;
  angleChart?.destroy();
  angleChart = new uPlot({
    width, height: 300, legend: { show: false }, cursor: { show: false }, padding: [6, 12, 0, 0],
    series: [{}, { show: false }],
    scales: { x: { time: false, range: () => [angles[0], angles[angles.length - 1]] }, y: { distr: 3, range: () => waterfall.range } },
    axes: [{ ...AXIS, size: 28, label: "crank angle [deg]", labelSize: 18, labelGap: 0, labelFont: AXIS.font, grid: { show: false } }, valueAxis(true, false)],
    hooks: {
      drawClear: [u => {
        const w = Math.max(1, Math.round(u.bbox.width / devicePixelRatio));
        waterfall.paint(u, w, x => [(x + .5) / w * (angles.length - 1)]);
      }],
      draw: [u => {
        for (let k = 0; k < count; k++) {
          stroke(u, angles.map((a, i) => [a, frf.frequencies[i * count + k]]), { colour: "#000000", edge: k === mode ? "#ffffff" : "", width: k === mode ? 1.8 : 1, dash: [4, 3] });
        }
        for (const row of moments) mark(u, columns.crank_angle[row.index] * DEG, row.y, row === moments[current], moments.length > 80);
        const x = u.valToPos(columns.crank_angle[cursor] * DEG, "x", true), { ctx, bbox } = u;
        if (x >= bbox.left && x <= bbox.left + bbox.width) {
          ctx.save();
          ctx.lineWidth = 2 * devicePixelRatio;
          ctx.strokeStyle = WARN;
          ctx.beginPath();
          ctx.moveTo(x, bbox.top);
          ctx.lineTo(x, bbox.top + bbox.height);
          ctx.stroke();
          ctx.restore();
        }
      }],
    },
  }, [angles, angles.map(() => 1)], box);
  angleChart.over.addEventListener("pointermove", event => {
    const at = angleChart.over.getBoundingClientRect();
    showPointer(angleChart.posToVal(event.clientX - at.left, "x") / DEG, angleChart.posToVal(event.clientY - at.top, "y"));
  });
  angleChart.over.addEventListener("pointerleave", () => showPointer());
}

function showPointer(angle, frequency) {
  const told = byId("pointer");
  if (!told) return;
  const place = angle === undefined ? NaN : gridPlace(angle);
  told.textContent = inside(place) && frequency > 0
    ? `|H| = ${digits(10 ** logReceptance(place, frequency), 4)} m/N at ${digits(frequency, 4)} Hz, ${(angle * DEG).toFixed(2)}°` : "";
}
