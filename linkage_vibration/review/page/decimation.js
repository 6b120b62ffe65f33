// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Reduces a quantity to what a chart can show, without losing a lowest or a highest value.

const BLOCK = 64;

/** A quantity to draw: value(i), and extremes(from, to), which is fast as it uses the extremes of blocks. */
function drawable(value) {
  let lows = null, highs = null;
  const plain = (from, to) => {
    let low = Infinity, high = -Infinity;
    for (let i = from; i < to; i++) {
      const v = value(i);
      if (v < low) low = v;
      if (v > high) high = v;
    }
    return [low, high];
  };
  const fillBlocks = () => {
    const blocks = Math.ceil(n / BLOCK);
    lows = new Float64Array(blocks);
    highs = new Float64Array(blocks);
    for (let b = 0; b < blocks; b++) {
      [lows[b], highs[b]] = plain(b * BLOCK, Math.min(n, (b + 1) * BLOCK));
    }
  };
  const extremes = (from, to) => {
    const head = Math.ceil(from / BLOCK), tail = Math.floor(to / BLOCK);
    if (head >= tail) return plain(from, to);
    if (!lows) fillBlocks();
    let [low, high] = plain(from, head * BLOCK);
    for (let b = head; b < tail; b++) {
      if (lows[b] < low) low = lows[b];
      if (highs[b] > high) high = highs[b];
    }
    const rest = plain(tail * BLOCK, to);
    return [Math.min(low, rest[0]), Math.max(high, rest[1])];
  };
  return { value, extremes };
}

/** Cut the samples [from, to) into about the wanted number of stretches, none of which spans a gap. */
function stretches(from, to, wanted) {
  const step = Math.max(1, (to - from) / wanted), found = [];
  let next = lowerBound(breaks, from + 1);
  for (let a = from; a < to;) {
    let b = Math.min(to, Math.max(a + 1, Math.floor(from + step * (found.length + 1))));
    const gap = next < breaks.length && breaks[next] <= b && breaks[next] < to;
    if (gap) b = breaks[next++];
    found.push([a, b, gap]);
    a = b;
  }
  return found;
}

/** What uPlot draws of a value: it takes null for a missing one. */
const finite = v => Number.isFinite(v) ? v : null;

/** What uPlot draws of quantities in a view: the lowest and the highest value of each stretch. */
function decimated(quantities, view, wanted) {
  const from = Math.max(0, lowerBound(time, view[0]) - 1);
  const to = Math.min(n, lowerBound(time, view[1]) + 1);
  const x = [], ys = quantities.map(() => []);
  for (const [a, b, gap] of stretches(from, to, wanted)) {
    x.push(time[a]);
    if (b > a + 1) x.push(time[b - 1]);
    if (gap) x.push(time[b - 1]);
    quantities.forEach((quantity, k) => {
      if (b > a + 1) {
        const [low, high] = quantity.extremes(a, b).map(finite);
        // The order follows the line, so that a falling line shows no zigzag.
        if (quantity.value(a) > quantity.value(b - 1)) ys[k].push(high, low); else ys[k].push(low, high);
      } else {
        ys[k].push(finite(quantity.value(a)));
      }
      if (gap) ys[k].push(null);
    });
  }
  return [x, ...ys];
}

/** How many stretches a chart shows: one for every two pixels, as lines are wider than one pixel. */
const wantedOver = width => Math.max(100, (width - 80) / 2);
