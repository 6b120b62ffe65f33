// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws the waterfall over the crank angle.

let angleChart = null;
/** Draw the chart in a box, with the natural frequencies, the moments and the cursor. */
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
          stroke(u, angles.map((a, i) => [a, frf.frequencies[i * count + k]]), modeLine(k));
        }
        for (const row of moments) mark(u, tableAngle[row.index] * DEG, row.y, row, moments.length > 80);
        stroke(u, waterfall.range.map(f => [tableAngle[cursor] * DEG, f]), { colour: WARN, width: 2 });
      }],
    },
  }, [angles, angles.map(() => 1)], box);
  nameCanvas(angleChart, `Receptance |H| at ${frf.place}, frequency over the crank angle`);
  angleChart.over.addEventListener("pointermove", event => {
    const at = angleChart.over.getBoundingClientRect();
    showPointer(angleChart.posToVal(event.clientX - at.left, "x") / DEG, angleChart.posToVal(event.clientY - at.top, "y"));
  });
  angleChart.over.addEventListener("pointerleave", () => showPointer());
}

/** Show |H| at an angle, rad, and a frequency, Hz; without them, show nothing. */
function showPointer(angle, frequency) {
  const place = angle === undefined ? NaN : gridPlace(angle);
  byId("pointer").textContent = inside(place) && frequency > 0
    ? `|H| = ${digits(10 ** logReceptance(place, frequency), 4)} m/N at ${digits(frequency, 4)} Hz, ${(angle * DEG).toFixed(2)}°` : "";
}
