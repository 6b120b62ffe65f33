// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Chooses the mode that the page shows.

const modeButtons = data.modes.map((colour, k) => {
  const button = element("button", { type: "button", role: "radio", "aria-checked": String(k === 0), tabindex: k ? -1 : 0, id: `mode-${k + 1}` }, data.mode_labels[k]);
  button.addEventListener("click", () => setMode(k));
  byId("modes").append(button);
  return button;
});
byId("modes").hidden = modeButtons.length === 0;

/** Show a mode; modes are counted from 0 here and from 1 on the page. */
function setMode(k) {
  if (k >= data.modes.length) return;
  const focused = modeButtons.includes(document.activeElement);
  mode = k;
  modeButtons.forEach((button, i) => {
    button.setAttribute("aria-checked", String(i === k));
    button.tabIndex = i === k ? 0 : -1;
  });
  if (focused) modeButtons[k].focus();
  onMode.forEach(f => f());
  showCursor();
}
