// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Shows the page for the first time.

showMoving();
layout();
if (moments.length) kept = cursor = moments.reduce((a, b) => Math.abs(b.margin) < Math.abs(a.margin) ? b : a).index;
showCursor();
// The page's numbers and state, for scripts and for the console of the browser.
window.review = {
  columns, n,
  get cursor() { return cursor; },
  get view() { return view; },
  get mode() { return mode; },
  drawn: id => charts.find(chart => chart.spec.id === id).u.data[1],
  receptance: (angle, frequency) => 10 ** logReceptance(gridPlace(angle), frequency),
};
