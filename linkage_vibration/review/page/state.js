// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// The state of the page: which times are in view, and which sample and mode are chosen.

let view = [first, last];
let kept = 0, cursor = 0;  // samples: where the user put the cursor, and where it is now
let mode = 0, moving = !matchMedia("(prefers-reduced-motion: reduce)").matches;
const charts = [], onCursor = [], onView = [], onMode = [];

/** Show the times from low to high, s, within the drive and not closer than a few samples. */
function setView(low, high) {
  const least = Math.max(1e-6, 3 * (last - first) / Math.max(n, 3) / 10);
  const span = clamp(high - low, least, last - first);
  low = clamp(low, first, last - span);
  if (low === view[0] && low + span === view[1]) return;
  view = [low, low + span];
  showViewSoon();
}

/** A function that calls another one in the next frame, once however often it is called itself. */
function inNextFrame(act) {
  let waiting = false;
  return () => {
    if (!waiting) requestAnimationFrame(() => { waiting = false; act(); });
    waiting = true;
  };
}

const showCursor = () => onCursor.forEach(f => f());
const showCursorSoon = inNextFrame(showCursor);
const showViewSoon = inNextFrame(() => { onView.forEach(f => f()); showCursor(); });

/** Multiply the length of the view by a factor about a time. */
const zoom = (factor, about) =>
  setView(about - (about - view[0]) * factor, about + (view[1] - about) * factor);
/** Move the view by a share of its length. */
const pan = share => {
  const by = share * (view[1] - view[0]);
  setView(view[0] + by, view[1] + by);
};

/** Move the cursor to a sample until the pointer leaves. */
function setCursor(index) {
  cursor = index;
  showCursorSoon();
}

/** Put the cursor on a sample, bring it into view, and announce its numbers to screen readers.
 *  The address of the page then leads to this moment. */
function keep(index) {
  kept = index;
  history.replaceState(null, "", `#t=${time[index].toFixed(3)}`);
  setCursor(index);
  const t = time[index];
  if (t < view[0] || t > view[1]) {
    const half = (view[1] - view[0]) / 2;
    setView(t - half, t + half);
  }
  byId("spoken").textContent = spoken(index);
}
