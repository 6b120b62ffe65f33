// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Arranges the charts in rows, that of the load on the first screen.

const holder = byId("charts");
for (const spec of data.charts) makeChart(spec, spec.first ? byId("first-chart") : holder);
byId("linkage-section").hidden = !linkage;
