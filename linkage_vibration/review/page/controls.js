// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Connects buttons and keys with what they do.

/** What the buttons of the toolbar do. */
const actions = {
  all: () => setView(first, last),
  in: () => zoom(.5, (view[0] + view[1]) / 2),
  out: () => zoom(2, (view[0] + view[1]) / 2),
  left: () => pan(-.4),
  right: () => pan(.4),
  previous: () => jumpFrom(-1),
  next: () => jumpFrom(1),
  move() {
    moving = !moving;
    showMoving();
    showCursor();
  },
};

/** Show on the button what it does next. */
function showMoving() {
  byId("move").textContent = moving ? "Stop the motion" : "Start the motion";
  byId("move").setAttribute("aria-pressed", String(moving));
}

document.querySelectorAll("button[data-do]").forEach(button =>
  button.addEventListener("click", () => actions[button.dataset.do]()));

document.addEventListener("keydown", event => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const inModes = modeButtons.includes(document.activeElement);
  const step = event.shiftKey ? 0 : (view[1] - view[0]) / 200;
  const move = by => {
    const to = step ? nearest(time[cursor] + by * step) : cursor + by;
    keep(clamp(to === cursor ? cursor + by : to, 0, n - 1));
  };
  const about = clamp(time[cursor], view[0], view[1]);
  const scrolls = event.target.closest?.(".scroll, pre");
  const keys = {
    ArrowLeft: () => inModes ? setMode((mode + data.modes.length - 1) % data.modes.length) : move(-1),
    ArrowRight: () => inModes ? setMode((mode + 1) % data.modes.length) : move(1),
    "+": () => zoom(.5, about), "=": () => zoom(.5, about), "-": () => zoom(2, about),
    0: actions.all, n: () => stops.length && actions.next(), p: () => stops.length && actions.previous(), m: () => linkage && actions.move(),
  };
  if (scrolls && event.key.startsWith("Arrow")) return;
  if (/^[1-9]$/.test(event.key)) setMode(Number(event.key) - 1);
  else if (Object.hasOwn(keys, event.key)) keys[event.key]();
  else return;
  event.preventDefault();
});
