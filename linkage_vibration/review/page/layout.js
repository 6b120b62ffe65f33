// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Fits the charts to the width of the page, and redraws those that have changed.

// A chart that is out of sight is redrawn only when it comes near.
const watcher = new IntersectionObserver(entries => entries.forEach(entry => {
  const chart = charts.find(one => one.row === entry.target);
  chart.near = entry.isIntersecting;
  if (chart.near && chart.stale) {
    chart.update();
    showCursorSoon();  // its place follows the scale, which is new in the next frame
  }
}), { rootMargin: "150px" });
charts.forEach(chart => watcher.observe(chart.row));

onView.push(() => {
  for (const chart of charts) if (chart.near) chart.update(); else chart.stale = true;
  showWindow();
});
let shownWidth = 0;
/** Draw charts in a width, px, or in that of the page. */
function layout(width = 0, shown = charts) {
  const wide = width || holder.clientWidth;
  shownWidth = wide;
  for (const chart of shown) chart.make(width || chart.row.parentElement.clientWidth);
  makeStrip(width || overview.clientWidth);
  requestAnimationFrame(() => { showWindow(); showCursor(); });  // in the next frame, when uPlot knows its scales
}

new ResizeObserver(() => {
  if (holder.clientWidth && Math.abs(holder.clientWidth - shownWidth) > 1 && !printing) layout();
}).observe(holder);

let printing = false;
addEventListener("beforeprint", () => { printing = true; layout(680); });
addEventListener("afterprint", () => { printing = false; layout(); });
