// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Arranges the charts in rows, and the waterfall among them.

const holder = byId("charts");
const angleBox = element("div", { class: "chart", hidden: true, id: "chart-over-angle" });
const specs = data.charts.slice();
if (waterfall) {
  specs.splice(1, 0, {
    id: "waterfall", title: `Receptance |H| at ${frf.place}, frequency over time`, unit: "Hz", log: true, height: 256,
    range: waterfall.range, series: [], paint: paintOverTime,
    overlay(u) {
      data.modes.forEach((_, k) => {
        const [x, y] = decimated([charts.lines[k]], view, wantedOver(u.width)), points = x.map((t, i) => [t, y[i]]);
        if (!busy(u, points)) stroke(u, points, modeLine(k));
      });
      drawExcitations(u, onMap);
      drawMoments(u);
    },
    hover(u, y) { showPointer(tableAngle[cursor], u.posToVal(y, "y")); },
    leave() { showPointer(); },
  });
  charts.lines = data.modes.map((_, k) => quantity({ column: `f${k + 1}` }));
}
for (const spec of specs) {
  if (spec.mode === undefined) continue;
  spec.overlay = u => { drawExcitations(u, onPaper); drawMoments(u, spec.mode); };
}
specs.forEach((spec, k) => makeChart(spec, holder, k === specs.length - 1 || spec.id === "waterfall"));

const fallChart = charts.find(chart => chart.spec.id === "waterfall");
if (fallChart) {
  const both = element("span", { class: "group", role: "radiogroup", "aria-label": "Waterfall over" });
  const choices = ["time", "angle"].map(name => {
    const button = element("button", { type: "button", role: "radio", "aria-checked": String(name === "time"), id: `over-${name}` }, name === "time" ? "Over time" : "Over angle");
    button.addEventListener("click", () => {
      choices.forEach(other => other.setAttribute("aria-checked", String(other === button)));
      fallChart.box.hidden = name === "angle";
      angleBox.hidden = name !== "angle";
      fallChart.head.querySelector("h3").firstChild.textContent = `Receptance |H| at ${frf.place}, frequency over ${name}`;
      layout();
    });
    both.append(button);
    return button;
  });
  const bar = element("canvas", { width: 256, height: 1, "aria-hidden": "true" });
  const context = bar.getContext("2d"), image = context.createImageData(256, 1);
  new Uint32Array(image.data.buffer).set(LUT);
  context.putImageData(image, 0, 0);
  const key = element("div", { class: "row-head" },
    element("span", { class: "scale-bar" }, `${digits(10 ** waterfall.low, 2)}`, bar, `${digits(10 ** waterfall.top, 2)} m/N`),
    element("span", { class: "key" }, keyItem({ label: "natural frequencies", colour: "#000000", style: "dashed" }),
      ...(excitations.length ? [keyItem({ label: "excitations (white; zoom in where too dense)", colour: "#8a8a8a" })] : []),
      ...(moments.length ? [element("span", {}, element("span", { style: `color:${WARN}` }, "●"), "warnings")] : [])),
    element("span", { class: "note", id: "pointer" }));
  fallChart.head.append(both);
  fallChart.row.append(angleBox, key);
}

if (linkage) byId("linkage-section").hidden = false;
