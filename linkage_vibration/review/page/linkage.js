// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Draws the linkage at the cursor, at rest and moving in the chosen mode.

const SWING = .08, SWINGS_PER_SECOND = .5;  // amplitude as a share of the linkage's size, and rate

/** The picture of the linkage, if the log holds its model; show() updates it. */
const linkage = data.linkage && (() => {
  const L = data.linkage, { angles, places, shapes, joints, centres, ground } = L;
  const count = L.lengths.reduce((a, b) => a + b, 0), reach = L.size;
  let left = Infinity, right = -Infinity, low = Infinity, high = -Infinity;
  for (const points of [places, ground]) {
    for (let i = 0; i < points.length; i += 2) {
      left = Math.min(left, points[i]); right = Math.max(right, points[i]);
      low = Math.min(low, points[i + 1]); high = Math.max(high, points[i + 1]);
    }
  }
  // On the screen, a name is about 11 px high, also if the linkage reaches high.
  const size = Math.max(reach, 220 * Math.max((right - left) / 280, (high - low) / 135));
  const edge = .12 * size, box = byId("linkage"), width = .009 * size;
  box.setAttribute("viewBox", [left - edge, -high - edge, right - left + 2 * edge, high - low + 2 * edge].join(" "));
  const layer = (attributes) => { const g = svg("g", { fill: "none", "stroke-linecap": "round", "stroke-linejoin": "round", ...attributes }); box.append(g); return g; };
  const still = layer({ stroke: "#b5b5b5", "stroke-width": width });
  const moved = layer({ "stroke-width": 1.5 * width });
  const pins = layer({});
  for (let i = 0; i < ground.length; i += 2) {
    const [x, y, s] = [ground[i], -ground[i + 1], .022 * size];
    pins.append(svg("path", { d: `M${x} ${y}l${-s} ${1.7 * s}h${2 * s}z`, fill: GREY }));
  }
  const stillLines = L.bodies.map(() => still.appendChild(svg("polyline")));
  const movedLines = L.bodies.map((name, k) => moved.appendChild(svg("polyline", { stroke: L.rigid[k] ? GREEN : BLUE })));
  const circles = (n, fill) => Array.from({ length: n }, () => pins.appendChild(svg("circle", { r: .012 * size, fill })));
  const nJoints = joints.length / 2 / angles.length, nCentres = centres.length / 2 / angles.length;
  const jointMarks = circles(nJoints, "#e69f00"), centreMarks = circles(nCentres, GREEN);
  const names = L.names.map(name => pins.appendChild(svg("text", { class: "pin", "font-size": .05 * size, "text-anchor": "middle", "dominant-baseline": "middle" }, name)));
  const mix = (values, i, s, stride, k) => (1 - s) * values[i * stride + k] + s * values[(i + 1) * stride + k];
  /** Points from..to of all curves between angles i and i + 1, moved by the mode, as SVG has them. */
  function points(i, s, from, to, amplitude) {
    let text = "";
    const stride = 2 * count, base = mode * angles.length * stride;
    for (let p = from; p < to; p++) {
      let x = mix(places, i, s, stride, 2 * p), y = mix(places, i, s, stride, 2 * p + 1);
      if (amplitude) {
        const a = base + i * stride + 2 * p, b = a + stride;
        x += amplitude * ((1 - s) * shapes[a] + s * shapes[b]);
        y += amplitude * ((1 - s) * shapes[a + 1] + s * shapes[b + 1]);
      }
      text += `${x.toFixed(4)},${(-y).toFixed(4)} `;
    }
    return text;
  }
  /** Draw the linkage at the cursor and at a phase of its motion, rad. */
  function draw(phase) {
    const angle = tableAngle[cursor];
    const place = (angle - angles[0]) / (angles[angles.length - 1] - angles[0]) * (angles.length - 1);
    const there = place >= 0 && place <= angles.length - 1;
    for (const group of [still, moved, pins]) group.style.display = there ? "" : "none";
    if (!there) return;
    const i = Math.min(Math.floor(place), angles.length - 2), s = place - i;
    const amplitude = SWING * reach * Math.sin(phase);
    let from = 0;
    L.lengths.forEach((length, k) => {
      stillLines[k].setAttribute("points", points(i, s, from, from + length, 0));
      movedLines[k].setAttribute("points", points(i, s, from, from + length, amplitude));
      from += length;
    });
    const put = (marks, values, count) => marks.forEach((mark, k) => {
      mark.setAttribute("cx", mix(values, i, s, 2 * count, 2 * k));
      mark.setAttribute("cy", -mix(values, i, s, 2 * count, 2 * k + 1));
    });
    put(jointMarks, joints, nJoints);
    const at = names.map((_, k) => k < nJoints
      ? [0, 1].map(c => mix(joints, i, s, 2 * nJoints, 2 * k + c)) : [0, 1].map(c => ground[2 * (k - nJoints) + c]));
    const middle = [0, 1].map(c => at.reduce((sum, place) => sum + place[c], 0) / at.length);
    const near = (a, b) => Math.abs(a[0] - b[0]) < .09 * size && Math.abs(a[1] - b[1]) < .05 * size;
    const written = [];
    names.forEach((text, k) => {
      // A name is outside the middle of all pins, or turned about its pin until it is beside all others.
      const away = Math.atan2(at[k][1] - middle[1], at[k][0] - middle[0]);
      const places = [0, .8, -.8, 1.6, -1.6, 2.4, -2.4, Math.PI].map(turn =>
        [at[k][0] + .06 * size * Math.cos(away + turn), at[k][1] + .06 * size * Math.sin(away + turn)]);
      const place = places.find(each => !written.some(other => near(each, other))) || places[0];
      written.push(place);
      text.setAttribute("x", place[0]);
      text.setAttribute("y", -place[1]);
    });
    put(centreMarks, centres, nCentres);
  }
  let visible = true;
  new IntersectionObserver(entries => { visible = entries[0].isIntersecting; }).observe(box);
  function frame(now) {
    if (moving && visible) draw(2 * Math.PI * SWINGS_PER_SECOND * now / 1e3);
    requestAnimationFrame(frame);
  }
  requestAnimationFrame(frame);
  return {
    show() {
      if (!moving) draw(Math.PI / 2);
      const f = columns[`f${mode + 1}`][cursor], angle = tableAngle[cursor];
      byId("linkage-caption").textContent = Number.isFinite(f)
        ? `${data.mode_labels[mode]}, ${briefText(data.readings.find(item => item.id === `f${mode + 1}`), cursor)}, at ${(angle * DEG).toFixed(1)}°. The motion is magnified and slowed down; grey shows the linkage at rest${data.linkage.lateral[mode] ? ", and the left side is drawn" : ""}.`
        : Number.isFinite(columns.peak_magnitude[cursor])
          ? `${data.mode_labels[mode]} is overdamped at ${(angle * DEG).toFixed(2)}°: it does not oscillate.`
          : `No prediction at ${Number.isFinite(angle) ? `${(angle * DEG).toFixed(2)}°` : "an invalid angle"}.`;
    },
  };
})();
