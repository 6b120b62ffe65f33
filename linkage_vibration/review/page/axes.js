// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// The axes of charts: their ranges and labels.

const AXIS = { stroke: INK, font: "12px system-ui, sans-serif", ticks: { stroke: "#9a9a9a", width: 1, size: 5 } };
/** The steps that a time axis may have, s. */
const TIMES = [1e-6, 1e-5, 1e-4, 1e-3, .002, .005, .01, .02, .05, .1, .2, .5, 1, 2, 5, 10, 15, 30, 60,
  120, 300, 600, 900, 1800, 3600, 7200, 18000, 36000];

/** The places of round times; there is none within a gap that is shown short. */
function roundTimes(u, axis, low, high, step) {
  const { shown, real } = data.clock ?? { shown: [first, last], real: [first, last] }, found = [];
  for (let i = 0; i + 1 < shown.length; i++) {
    const from = Math.max(low, shown[i]), to = Math.min(high, shown[i + 1]);
    const slope = (real[i + 1] - real[i]) / (shown[i + 1] - shown[i]);
    if (from >= to || Math.abs(slope - 1) > 1e-6) continue;
    const shift = real[i] - shown[i];
    for (let k = Math.ceil((from + shift) / step - 1e-9); k * step - shift <= to + 1e-9 * step; k++) {
      found.push(k * step - shift);
    }
  }
  return found;
}

/** The time axis of a chart. */
const timeAxis = {
  ...AXIS, size: 28, incrs: TIMES, space: 70, splits: roundTimes, grid: { stroke: "#e4e4e4", width: 1 },
  values: (u, splits, axis, space, step) => splits.map(t => clock(t, step)),
  label: `time [${timeUnit}]`, labelSize: 18, labelFont: AXIS.font, labelGap: 0,
};
/** The room on the right of a chart for names of what is drawn, px. */
const roomForNames = width => Math.min(130, .28 * width);

/** The axis of values of a chart, logarithmic or linear. */
const valueAxis = log => ({
  ...AXIS, size: 56, space: log ? 16 : 28, grid: { stroke: "#e4e4e4", width: 1 },
  values: (u, splits) => log ? logLabels(u, splits) : plainLabels(splits), ...(log ? { splits: logSplits } : {}),
});

/** The round values of a logarithmic axis: with one digit, or with two where only one of these is in sight. */
function logSplits(u, axis, low, high) {
  const found = per => {
    const values = [];
    for (let ten = Math.floor(Math.log10(low)); 10 ** ten <= high; ten++) {
      for (let k = per; k < 10 * per; k++) values.push(Number(`${k / per}e${ten}`));
    }
    return values.filter(v => v >= low && v <= high);
  };
  const round = found(1);
  return round.length > 1 ? round : found(10);
}

/** The labels of a linear axis, all with the same number of decimals. */
function plainLabels(splits) {
  const step = splits.length > 1 ? splits[1] - splits[0] : 1;
  const size = Math.max(...splits.map(Math.abs));
  if (size >= 1e6 || (size > 0 && size < 1e-3)) return splits.map(v => v.toExponential(1));
  let places = 0;
  while (places < 12 && Math.abs(step * 10 ** places - Math.round(step * 10 ** places)) > 1e-6) places++;
  return splits.map(v => v.toFixed(places));
}

/** The labels of a logarithmic axis: those of powers of ten, and of more values where there is room. */
function logLabels(u, splits) {
  const height = u.bbox.height / devicePixelRatio;
  const decades = Math.log10(u.scales.y.max / u.scales.y.min);
  const room = height / Math.max(decades, .1);  // pixels per decade
  return splits.map(v => {
    if (v === null) return null;
    const lead = Math.round(v / 10 ** Math.floor(Math.log10(v) + 1e-9));
    const labelled = lead === 1 || (room > 60 && (lead === 2 || lead === 5)) || room > 150;
    return labelled ? (v >= 1e-3 && v < 1e5 ? String(Number(v.toPrecision(3))) : v.toExponential(0)) : null;
  });
}

/** What uPlot asks for the range of the values: a little more than they span, with the limit of a load. */
function yRange(log, limit) {
  return (u, low, high) => {
    if (limit) return [0, 1.15 * Math.max(limit, high ?? 0)];
    if (low === null || !Number.isFinite(low)) return log ? [1e-3, 1] : [0, 1];
    if (log) return [low / 1.12, high * 1.12];
    const room = high > low ? (high - low) * .08 : Math.abs(high) * .05 || 1;
    return [low - room, high + room];
  };
}
