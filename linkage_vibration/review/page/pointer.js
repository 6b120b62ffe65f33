// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Moves the cursor and the view of a chart with a mouse, a wheel or a finger.

/** Listen to a chart: to hovering, clicks, drags, the wheel and touches. */
function interact(chart) {
  const over = chart.u.over;
  const place = event => event.clientX - over.getBoundingClientRect().left;
  const at = x => chart.u.posToVal(clamp(x, 0, over.clientWidth), "x");
  let drag = null;
  over.addEventListener("pointerdown", event => {
    if (event.button !== 0) return;
    over.setPointerCapture(event.pointerId);
    // A finger moves the cursor; a mouse draws a selection, or moves the view with Shift.
    const kind = event.pointerType === "touch" ? "move" : event.shiftKey ? "pan" : "zoom";
    drag = { x: place(event), view, kind, far: false };
    if (kind === "move") setCursor(nearest(at(drag.x)));
  });
  over.addEventListener("pointermove", event => {
    const x = place(event);
    if (!drag || drag.kind === "move") {
      setCursor(nearest(at(x)));
      return;
    }
    if (Math.abs(x - drag.x) > 4) drag.far = true;
    if (!drag.far) return;
    if (drag.kind === "pan") {
      const by = (drag.x - x) / over.clientWidth * (drag.view[1] - drag.view[0]);
      setView(drag.view[0] + by, drag.view[1] + by);
      return;
    }
    if (!drag.box) over.append(drag.box = element("div", { class: "selection" }));
    const end = clamp(x, 0, over.clientWidth);
    drag.box.style.left = `${Math.min(drag.x, end)}px`;
    drag.box.style.width = `${Math.abs(end - drag.x)}px`;
  });
  const finish = event => {
    if (!drag) return;
    const { x, kind, far, box } = drag;
    drag = null;
    box?.remove();
    if (event.type === "pointercancel") return;
    if (kind === "move" || !far) keep(nearest(at(place(event))));
    else if (kind === "zoom") setView(...[at(x), at(place(event))].sort((a, b) => a - b));
  };
  over.addEventListener("pointerup", finish);
  over.addEventListener("pointercancel", finish);
  over.addEventListener("pointerleave", () => { if (!drag) setCursor(kept); });
  over.addEventListener("dblclick", () => setView(first, last));
  over.addEventListener("wheel", event => {
    if (!event.ctrlKey && !event.metaKey) return;  // the wheel alone scrolls the page
    event.preventDefault();
    zoom(Math.exp(clamp(event.deltaY, -200, 200) / 250), at(place(event)));
  }, { passive: false });
}
