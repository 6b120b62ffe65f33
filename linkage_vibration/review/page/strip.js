// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws the strip that shows the whole drive and a window of what is in view.

const overview = byId("overview");
let strip = null;
const stripQuantity = quantity(data.overview);
const frameBox = element("div", { class: "window" });
/** Draw the strip, and listen to drags of its window, its edges, or a new window. */
function makeStrip(width) {
  strip?.destroy();
  strip = new uPlot({
    width, height: 58, legend: { show: false }, cursor: { show: false }, padding: [4, roomForNames(width), 4, 0],
    series: [{}, { stroke: GREY, width: 1, points: { show: false } }],
    scales: { x: { time: false, range: () => [first, last] }, y: { range: yRange(false) } },
    axes: [{ show: false }, { ...AXIS, size: 56, values: (u, splits) => splits.map(() => null), grid: { show: false }, ticks: { show: false }, label: data.overview.label, labelSize: 16, labelFont: "11px system-ui, sans-serif" }],
    hooks: { drawClear: [shade] },
  }, decimated([stripQuantity], [first, last], wantedOver(width)), overview);
  nameCanvas(strip, "The crank angle over the whole drive");
  const over = strip.over, at = x => first + clamp(x, 0, over.clientWidth) / over.clientWidth * (last - first);
  over.append(frameBox);
  over.style.cursor = "grab";
  let drag = null;
  over.addEventListener("pointerdown", event => {
    over.setPointerCapture(event.pointerId);
    const x = event.clientX - over.getBoundingClientRect().left, t = at(x);
    const room = (last - first) * 8 / over.clientWidth;
    const whole = view[1] - view[0] > .999 * (last - first);
    const kind = whole || t < view[0] - room || t > view[1] + room ? "draw"
      : Math.abs(t - view[0]) < room ? "low" : Math.abs(t - view[1]) < room ? "high" : "pan";
    drag = { t, view, kind };
  });
  over.addEventListener("pointermove", event => {
    if (!drag) return;
    const t = at(event.clientX - over.getBoundingClientRect().left), [a, b] = drag.view;
    if (drag.kind === "pan") setView(a + t - drag.t, b + t - drag.t);
    else if (drag.kind === "draw") setView(Math.min(t, drag.t), Math.max(t, drag.t));
    else setView(...(drag.kind === "low" ? [Math.min(t, b), b] : [a, Math.max(t, a)]));
  });
  const end = () => { drag = null; };
  over.addEventListener("pointerup", end);
  over.addEventListener("pointercancel", end);
  over.addEventListener("dblclick", () => setView(first, last));
}

/** Put the window where the view is. */
function showWindow() {
  const a = strip.valToPos(view[0], "x"), b = strip.valToPos(view[1], "x");
  frameBox.style.left = `${a}px`;
  frameBox.style.width = `${Math.max(b - a, 3)}px`;
}
