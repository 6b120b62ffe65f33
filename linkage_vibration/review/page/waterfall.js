// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Paints the receptance as a picture: frequency upwards, time or angle to the right.

// Cividis (Nunez, Anderton and Renslow 2018) looks alike with and without colour blindness.
const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
const LUT = (() => {
  const stops = CIVIDIS.map(c => [1, 3, 5].map(k => parseInt(c.slice(k, k + 2), 16)));
  return Uint32Array.from({ length: 256 }, (_, i) => {
    const x = i / 255 * (stops.length - 1), k = Math.min(Math.floor(x), stops.length - 2);
    const [red, green, blue] = [0, 1, 2].map(c => Math.round(stops[k][c] + (stops[k + 1][c] - stops[k][c]) * (x - k)));
    return (255 << 24 | blue << 16 | green << 8 | red) >>> 0;
  });
})();

/** The receptance as a picture, computed once; paint draws it into a chart. */
const waterfall = frf && (() => {
  const lowest = Math.min(frf.band[1], ...frf.frequencies.filter(Number.isFinite));
  const range = [Math.max(frf.band[0], lowest / 2.5), frf.band[1]];
  const ROWS = 240, shade = new Uint8Array(frf.angles.length * ROWS);
  const values = new Float32Array(shade.length);
  const ratio = Math.log(range[1] / range[0]);
  let top = -Infinity;
  for (let i = 0; i < frf.angles.length; i++) {
    for (let r = 0; r < ROWS; r++) {
      const f = range[1] * Math.exp(-ratio * (r + .5) / ROWS);
      const v = values[i * ROWS + r] = logReceptance(i, f);
      if (v > top && Number.isFinite(v)) top = v;
    }
  }
  const low = Math.max(top - 5, values.reduce((a, b) => Math.min(a, b), top));
  values.forEach((v, i) => { shade[i] = clamp(Math.round(255 * (v - low) / (top - low)), 0, 255); });
  const canvas = document.createElement("canvas");
  /** Paint columns of pixels; places(x) lists the places on the grid whose maximum column x shows. */
  function paint(u, width, places) {
    const { ctx, bbox } = u;
    canvas.width = width;
    canvas.height = ROWS;
    const own = canvas.getContext("2d"), image = own.createImageData(width, ROWS);
    const pixels = new Uint32Array(image.data.buffer);
    const best = new Uint8Array(ROWS);
    for (let x = 0; x < width; x++) {
      const here = places(x);
      if (!here.length) continue;
      best.fill(0);
      let from = -1;
      for (const place of here) {
        if (from === Math.round(place) * ROWS) continue;
        from = Math.round(place) * ROWS;
        for (let r = 0; r < ROWS; r++) if (shade[from + r] > best[r]) best[r] = shade[from + r];
      }
      for (let r = 0; r < ROWS; r++) pixels[r * width + x] = LUT[best[r]];
    }
    own.putImageData(image, 0, 0);
    ctx.save();
    ctx.imageSmoothingEnabled = false;
    ctx.drawImage(canvas, bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.restore();
  }
  return { range, low, top, paint };
})();

/** Paint the waterfall over time: each column of pixels shows the angles of its interval of time. */
function paintOverTime(u) {
  const width = Math.max(1, Math.round(u.bbox.width / devicePixelRatio));
  const angle = tableAngle, status = columns.status;
  const gapFrom = breaks.map(i => time[i - 1]), gapTo = breaks.map(i => time[i]);
  const step = (view[1] - view[0]) / width;
  waterfall.paint(u, width, x => {
    const t = view[0] + x * step, places = [];
    const a = lowerBound(time, t), b = lowerBound(time, t + step);
    const take = i => {
      const place = gridPlace(angle[i]);
      if ((status[i] === 0 || status[i] === 3) && inside(place)) places.push(place);
    };
    if (b > a) for (let i = a; i < b; i += Math.max(1, (b - a) >> 2)) take(i);
    else {
      const gap = lowerBound(gapTo, t);
      if (a > 0 && a < n && !(gap < gapTo.length && gapFrom[gap] < t)) take(nearest(t));
    }
    return places;
  });
}
