// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Shows the page for the first time.

showMoving();
layout(0, charts.filter(chart => chart.row.getBoundingClientRect().top < innerHeight));
const worst = data.tables.find(table => table.first)?.rows.find(row => row.time !== undefined);
if (worst) {
  kept = cursor = worst.index;
  if (worst.mode !== undefined) setMode(worst.mode);
}
showCursor();
/** Put the cursor on the moment in the address, s since the first stamp, if it names one. */
function goToAddress() {
  const moment = location.hash.match(/^#t=(\d+(?:\.\d+)?)$/);
  if (moment) keep(nearest(clamp(Number(moment[1]), first, last)));
}
addEventListener("hashchange", goToAddress);
goToAddress();
// The page's numbers and state, for scripts and for the console of the browser.
window.review = {
  columns, n,
  get cursor() { return cursor; },
  get view() { return view; },
  get mode() { return mode; },
  ticks: id => {
    const { axes } = charts.find(chart => chart.spec.id === id).u, [axis] = axes;
    return axis._splits.map(t => clock(t, axis._splits.length > 1 ? Math.abs(realTime(axis._splits[1]) - realTime(axis._splits[0])) : 1));
  },
  drawn: (id, line = 1) => charts.find(chart => chart.spec.id === id).u.data[line],
  labels: id => (axis => [axis._values, axis._splits])(charts.find(chart => chart.spec.id === id).u.axes[1]),
  scale: id => (y => [y.min, y.max])(charts.find(chart => chart.spec.id === id).u.scales.y),
};
// The charts out of sight follow one by one, so that the page answers in between.
for (const chart of charts) {
  await new Promise(done => { setTimeout(done); });
  if (!chart.u) chart.make(shownWidth);
}
showCursorSoon();
