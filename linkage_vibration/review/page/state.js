// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// The state of the page: which times are in view, and which sample and mode are chosen.

let view = [first, last];
let kept = 0, cursor = 0;  // samples: where the cursor was put, and where it is
let mode = 0, moving = !matchMedia("(prefers-reduced-motion: reduce)").matches;
const charts = [], onCursor = [], onView = [], onMode = [];

function setView(low, high) {
  const least = Math.max(1e-6, 3 * (last - first) / Math.max(n, 3) / 10);
  const span = clamp(high - low, least, last - first);
  low = clamp(low, first, last - span);
  if (low === view[0] && low + span === view[1]) return;
  view = [low, low + span];
  schedule();
}

let waiting = false;
function schedule() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => { waiting = false; onView.forEach(f => f()); showCursor(); });
}

const zoom = (factor, about) =>
  setView(about - (about - view[0]) * factor, about + (view[1] - about) * factor);
const pan = share => {
  const by = share * (view[1] - view[0]);
  setView(view[0] + by, view[1] + by);
};

let cursorWaiting = false;
function setCursor(index) {
  cursor = index;
  if (cursorWaiting) return;
  cursorWaiting = true;
  requestAnimationFrame(() => { cursorWaiting = false; showCursor(); });
}

const showCursor = () => onCursor.forEach(f => f());

function keep(index, speak = true) {
  kept = index;
  setCursor(index);
  const t = time[index];
  if (t < view[0] || t > view[1]) {
    const half = (view[1] - view[0]) / 2;
    setView(t - half, t + half);
  }
  if (speak) byId("spoken").textContent = spoken(index);
}
