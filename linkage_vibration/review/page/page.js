// Copyright 2026 The linkage_vibration authors
// SPDX-License-Identifier: Apache-2.0
"use strict";

(() => {
  const source = document.getElementById("data");
  const data = JSON.parse(source.textContent);
  source.remove();
  const INK = "#222222", GREY = "#5f5f5f", WARN = "#d55e00", BLUE = "#0072b2", GREEN = "#009e73";
  const DEG = 180 / Math.PI;
  const byId = id => document.getElementById(id);
  const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

  // ---- columns -------------------------------------------------------------------------------

  const TYPES = { f8: Float64Array, f4: Float32Array, u1: Uint8Array };

  function array({ type, base64 }) {
    const text = atob(base64), bytes = new Uint8Array(text.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = text.charCodeAt(i);
    return new TYPES[type](bytes.buffer);
  }

  const columns = {};
  for (const [name, packed] of Object.entries(data.columns)) {
    columns[name] = "constant" in packed
      ? new TYPES[packed.type](data.n).fill(packed.constant ?? NaN) : array(packed);
  }
  data.columns = null;
  const time = columns.time, n = data.n;
  const first = time[0], last = Math.max(time[n - 1], time[0] + 1e-3);
  const breaks = data.breaks;  // indices before which predictions are missing, ascending

  /** Index of the first of ascending values that is not less than x. */
  function lowerBound(values, x) {
    let low = 0, high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] < x) low = middle + 1; else high = middle;
    }
    return low;
  }

  function nearest(t) {
    const i = clamp(lowerBound(time, t), 0, n - 1);
    return i > 0 && t - time[i - 1] < time[i] - t ? i - 1 : i;
  }

  // ---- least and greatest values of any stretch -----------------------------------------------

  const BLOCK = 64;

  /** A quantity to draw: its values, and those of blocks, so that a stretch costs little. */
  function drawable(value) {
    const blocks = Math.ceil(n / BLOCK);
    const lows = new Float64Array(blocks), highs = new Float64Array(blocks);
    const plain = (from, to) => {
      let low = Infinity, high = -Infinity;
      for (let i = from; i < to; i++) {
        const v = value(i);
        if (v < low) low = v;
        if (v > high) high = v;
      }
      return [low, high];
    };
    for (let b = 0; b < blocks; b++) {
      [lows[b], highs[b]] = plain(b * BLOCK, Math.min(n, (b + 1) * BLOCK));
    }
    const extremes = (from, to) => {
      const head = Math.ceil(from / BLOCK), tail = Math.floor(to / BLOCK);
      if (head >= tail) return plain(from, to);
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

  /** Cut [from, to) into some stretches, none of which spans a gap. */
  function stretches(from, to, wanted) {
    const step = Math.max(1, (to - from) / wanted), found = [];
    let next = lowerBound(breaks, from + 1);
    for (let a = from; a < to;) {
      let b = Math.min(to, Math.max(a + 1, Math.floor(from + step * (found.length + 1))));
      if (b <= a) b = a + 1;
      const gap = next < breaks.length && breaks[next] <= b && breaks[next] < to;
      if (gap) b = breaks[next++];
      found.push([a, b, gap]);
      a = b;
    }
    return found;
  }

  const finite = v => Number.isFinite(v) ? v : null;

  /** uPlot's data of quantities over a view, decimated to the least and greatest of stretches. */
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
          // As it goes, so that a line that falls has no teeth.
          if (quantity.value(a) > quantity.value(b - 1)) ys[k].push(high, low); else ys[k].push(low, high);
        } else {
          ys[k].push(finite(quantity.value(a)));
        }
        if (gap) ys[k].push(null);
      });
    }
    return [x, ...ys];
  }

  /** How many stretches a chart shows: one in two pixels, as lines are wider than one. */
  const wantedOver = width => Math.max(100, (width - 80) / 2);

  // ---- state ---------------------------------------------------------------------------------

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

  // ---- words ---------------------------------------------------------------------------------

  const digits = (v, count = 6) =>
    !Number.isFinite(v) ? "none"
      : v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e6) ? v.toExponential(count - 1)
        : v.toPrecision(count);

  /** A time in words, with decimals enough for a step. */
  function clock(t, step = 1e-3) {
    const places = step >= 1 ? 0 : Math.min(6, Math.ceil(-Math.log10(step) - 1e-9));
    if (last - first < 120) return t.toFixed(places);
    // Rounded first, so that no 60 s stand behind the minutes.
    const rounded = Number(t.toFixed(places));
    const sign = rounded < 0 ? "-" : "", whole = Math.abs(rounded);
    const hours = Math.floor(whole / 3600), minutes = Math.floor(whole / 60) % 60;
    const seconds = (whole % 60).toFixed(places).padStart(places ? places + 3 : 2, "0");
    return sign + (last - first >= 3600
      ? `${hours}:${String(minutes).padStart(2, "0")}:${seconds}` : `${minutes}:${seconds}`);
  }

  const timeUnit = last - first < 120 ? "s" : last - first < 3600 ? "min:s" : "h:min:s";

  /** The stamp of a sample in UTC, to the millisecond. */
  function stamp(index) {
    const told = new Date(Number(data.start_ms) + time[index] * 1e3);
    return Number.isNaN(told.getTime()) ? "" : told.toISOString().replace("T", " ").replace("Z", "");
  }

  function element(tag, attributes = {}, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (value !== undefined && value !== false) made.setAttribute(name, value === true ? "" : value);
    }
    made.append(...children);
    return made;
  }

  function svg(tag, attributes = {}, ...children) {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    made.append(...children);
    return made;
  }

  // ---- charts --------------------------------------------------------------------------------

  const AXIS = { stroke: INK, font: "12px system-ui, sans-serif", ticks: { stroke: "#9a9a9a", width: 1, size: 5 } };
  const TIMES = [1e-6, 1e-5, 1e-4, 1e-3, .002, .005, .01, .02, .05, .1, .2, .5, 1, 2, 5, 10, 15, 30, 60,
    120, 300, 600, 900, 1800, 3600, 7200, 18000, 36000];

  const timeAxis = (show, grid) => ({
    ...AXIS, size: show ? 28 : 8, incrs: TIMES, space: 70,
    grid: { show: grid, stroke: "#e4e4e4", width: 1 },
    values: (u, splits, axis, space, step) => splits.map(t => show ? clock(t, step) : null),
    label: show ? `time [${timeUnit}]` : undefined, labelSize: show ? 18 : 0,
    labelFont: "12px system-ui, sans-serif", labelGap: 0,
  });

  const valueAxis = (log, grid) => ({
    ...AXIS, size: 64, space: log ? 16 : 28, grid: { show: grid, stroke: "#e4e4e4", width: 1 },
    values: (u, splits) => log ? logLabels(u, splits) : plainLabels(splits),
  });

  function plainLabels(splits) {
    const step = splits.length > 1 ? splits[1] - splits[0] : 1;
    const size = Math.max(...splits.map(Math.abs));
    if (size >= 1e6 || (size > 0 && size < 1e-3)) return splits.map(v => v.toExponential(1));
    const places = clamp(Math.ceil(-Math.log10(step) - 1e-9), 0, 12);
    return splits.map(v => v.toFixed(places));
  }

  function logLabels(u, splits) {
    const height = u.bbox.height / devicePixelRatio;
    const decades = Math.log10(u.scales.y.max / u.scales.y.min);
    const room = height / Math.max(decades, .1);  // px a decade
    return splits.map(v => {
      if (v === null) return null;
      const lead = Math.round(v / 10 ** Math.floor(Math.log10(v) + 1e-9));
      const told = lead === 1 || (room > 60 && (lead === 2 || lead === 5)) || room > 150;
      return told ? (v >= 1e-3 && v < 1e5 ? String(Number(v.toPrecision(3))) : v.toExponential(0)) : null;
    });
  }

  function yRange(log) {
    return (u, low, high) => {
      if (low === null || !Number.isFinite(low)) return log ? [1e-3, 1] : [0, 1];
      if (log) return [low / 1.12, high * 1.12];
      const room = high > low ? (high - low) * .08 : Math.abs(high) * .05 || 1;
      return [low - room, high + room];
    };
  }

  function quantity(series, sign = 0) {
    const values = columns[series.column], factor = series.factor ?? 1;
    if (series.minus) {
      const other = columns[series.minus];
      return drawable(i => (values[i] - other[i]) * factor);
    }
    if (!sign) return drawable(i => values[i] * factor);
    const spread = columns[series.spread], by = sign * data.coverage;
    return drawable(i => (values[i] + by * (spread[i] || 0)) * factor);
  }

  const dashes = { dashed: [6, 4], dotted: [2, 3] };

  function makeChart(spec, holder, isLast) {
    const box = element("div", { class: "chart", id: `chart-${spec.id}` });
    const heading = element("h3", {}, spec.title);
    if (spec.unit) heading.append(element("span", { class: "unit" }, ` [${spec.unit}]`));
    const key = element("span", { class: "key" });
    for (const item of spec.key ?? []) key.append(keyItem(item));
    const head = element("div", { class: "row-head" }, heading, key);
    const row = element("div", { class: "chart-row" }, head, box);
    holder.append(row);
    const quantities = [], series = [{}], bands = [];
    for (const line of spec.series) {
      quantities.push(quantity(line));
      series.push({ stroke: line.colour, width: line.width ?? 1.6, dash: dashes[line.style], points: { show: false }, spanGaps: false });
      if (line.spread) {
        quantities.push(quantity(line, 1), quantity(line, -1));
        const faint = { stroke: `${line.colour}66`, width: .6, points: { show: false } };
        series.push({ ...faint }, { ...faint });
        bands.push({ series: [series.length - 2, series.length - 1], fill: `${line.colour}40` });
      }
    }
    const log = Boolean(spec.log);
    const chart = {
      spec, box, row, head, quantities,
      make(width) {
        this.u?.destroy();
        this.u = new uPlot({
          width, height: (spec.height ?? 130) + (isLast ? 44 : 8), series, bands,
          legend: { show: false }, cursor: { show: false }, padding: [6, 12, 0, 0],
          scales: { x: { time: false, range: () => view }, y: { distr: log ? 3 : 1, range: spec.range ? () => spec.range : yRange(log) } },
          axes: [timeAxis(isLast, !spec.paint), valueAxis(log, !spec.paint)],
          hooks: { drawClear: [u => { spec.paint?.(u); shade(u); }], draw: [u => { guides(u, spec); spec.overlay?.(u); }] },
        }, this.data(width), box);
        this.line = element("div", { class: "cursor" });
        this.u.over.append(this.line);
        interact(this);
      },
      data(width) { return decimated(quantities, view, wantedOver(width)); },
      near: true,
      stale: false,
      update() {
        if (this.box.hidden) return;
        this.stale = false;
        this.u.setData(this.data(this.u.width));
      },
      showCursor() {
        if (this.box.hidden) return;
        const t = time[cursor], inside = t >= view[0] && t <= view[1];
        this.line.hidden = !inside;
        this.line.classList.toggle("kept", cursor === kept);
        if (inside) this.line.style.left = `${this.u.valToPos(t, "x")}px`;
      },
    };
    charts.push(chart);
    return chart;
  }

  function keyItem({ label, colour, style, fill }) {
    const line = svg("svg", { width: 22, height: 10, "aria-hidden": "true" });
    if (fill) line.append(svg("rect", { width: 22, height: 10, fill: colour, stroke: GREY, "stroke-width": .5 }));
    else line.append(svg("line", { x1: 0, x2: 22, y1: 5, y2: 5, stroke: colour, "stroke-width": 2.4, "stroke-dasharray": (dashes[style] ?? []).join(" ") }));
    return element("span", {}, line, label);
  }

  const fills = { gap: "#e4e4e4", range: "#f9e08b", toggle: "#d9e6f2" };

  /** Shade where there is no prediction, or no sound one. */
  function shade(u) {
    const { ctx, bbox } = u;
    ctx.save();
    for (const [start, end, kind] of data.shades) {
      if (end < view[0] || start > view[1]) continue;
      const a = clamp(u.valToPos(start, "x", true), bbox.left, bbox.left + bbox.width);
      const b = clamp(u.valToPos(end, "x", true), bbox.left, bbox.left + bbox.width);
      const width = Math.max(b - a, devicePixelRatio);
      ctx.fillStyle = fills[kind];
      ctx.fillRect(a, bbox.top, width, bbox.height);
      if (kind === "gap") {
        ctx.save();
        ctx.beginPath();
        ctx.rect(a, bbox.top, width, bbox.height);
        ctx.clip();
        ctx.strokeStyle = "#a8a8a8";
        ctx.beginPath();
        for (let x = a - bbox.height; x < a + width; x += 9 * devicePixelRatio) {
          ctx.moveTo(x, bbox.top + bbox.height);
          ctx.lineTo(x + bbox.height, bbox.top);
        }
        ctx.stroke();
        ctx.restore();
      }
    }
    ctx.restore();
  }

  function guides(u, spec) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.strokeStyle = GREY;
    ctx.setLineDash([5 * devicePixelRatio, 4 * devicePixelRatio]);
    for (const value of spec.guides ?? []) {
      const y = u.valToPos(value, "y", true);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  }

  /** Hover, click, drag, wheel and touch on a chart. */
  function interact(chart) {
    const over = chart.u.over;
    const place = event => event.clientX - over.getBoundingClientRect().left;
    const at = x => chart.u.posToVal(clamp(x, 0, over.clientWidth), "x");
    let drag = null;
    over.addEventListener("pointerdown", event => {
      if (event.button !== 0) return;
      over.setPointerCapture(event.pointerId);
      const kind = event.pointerType === "touch" ? "move" : event.shiftKey ? "pan" : "zoom";
      drag = { x: place(event), view, kind, far: false };
      if (kind === "move") setCursor(nearest(at(drag.x)));
    });
    over.addEventListener("pointermove", event => {
      const x = place(event);
      if (!drag || drag.kind === "move") {
        setCursor(nearest(at(x)));
        chart.spec.hover?.(chart.u, event.clientY - over.getBoundingClientRect().top);
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
      else if (kind === "zoom") {
        const ends = [at(x), at(place(event))].sort((a, b) => a - b);
        setView(...ends);
      }
    };
    over.addEventListener("pointerup", finish);
    over.addEventListener("pointercancel", finish);
    over.addEventListener("pointerleave", () => { if (!drag) { setCursor(kept); chart.spec.leave?.(); } });
    over.addEventListener("dblclick", () => setView(first, last));
    over.addEventListener("wheel", event => {
      if (!event.ctrlKey && !event.metaKey) return;  // the page scrolls
      event.preventDefault();
      zoom(Math.exp(clamp(event.deltaY, -200, 200) / 250), at(place(event)));
    }, { passive: false });
  }

  // ---- the receptance ------------------------------------------------------------------------

  const frf = data.frf && {
    ...data.frf, angles: array(data.frf.angles), terms: array(data.frf.terms),
    residual: array(data.frf.residual), frequencies: array(data.frf.frequencies),
  };
  const TERM = 7;  // numbers a term: k, c, residue and rate, complex but for c

  /** log10 |H|, m/N, at an angle (as a place on the grid) and a frequency in Hz. */
  function logReceptance(place, frequency) {
    const i = clamp(Math.floor(place), 0, frf.angles.length - 2), s = place - i, r = 1 - s;
    const w = 2 * Math.PI * frequency, terms = frf.terms, size = frf.n_terms * TERM;
    let re = r * frf.residual[2 * i] + s * frf.residual[2 * i + 2];
    let im = r * frf.residual[2 * i + 1] + s * frf.residual[2 * i + 3];
    for (let a = i * size, b = a + size, end = b; a < end; a += TERM, b += TERM) {
      const kr = r * terms[a] + s * terms[b] - w * w;
      const ki = r * terms[a + 1] + s * terms[b + 1] + w * (r * terms[a + 2] + s * terms[b + 2]);
      const nr = r * terms[a + 3] + s * terms[b + 3] - w * (r * terms[a + 6] + s * terms[b + 6]);
      const ni = r * terms[a + 4] + s * terms[b + 4] + w * (r * terms[a + 5] + s * terms[b + 5]);
      const square = kr * kr + ki * ki;
      re += (nr * kr + ni * ki) / square;
      im += (ni * kr - nr * ki) / square;
    }
    return Math.log10(re * re + im * im) / 2;
  }

  const gridPlace = angle =>
    (angle - frf.angles[0]) / (frf.angles[frf.angles.length - 1] - frf.angles[0]) * (frf.angles.length - 1);
  const inside = place => place >= 0 && place <= frf.angles.length - 1;

  // Cividis (Nunez, Anderton and Renslow 2018), which reads alike to the colour-blind.
  const CIVIDIS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"];
  const LUT = (() => {
    const stops = CIVIDIS.map(c => [1, 3, 5].map(k => parseInt(c.slice(k, k + 2), 16)));
    return Uint32Array.from({ length: 256 }, (_, i) => {
      const x = i / 255 * (stops.length - 1), k = Math.min(Math.floor(x), stops.length - 2);
      const [red, green, blue] = [0, 1, 2].map(c => Math.round(stops[k][c] + (stops[k + 1][c] - stops[k][c]) * (x - k)));
      return (255 << 24 | blue << 16 | green << 8 | red) >>> 0;
    });
  })();

  const waterfall = frf && (() => {
    const lowest = Math.min(...frf.frequencies.filter(Number.isFinite));
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
    /** Paint columns of pixels, each the greatest of some places on the grid of angles. */
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

  function paintOverTime(u) {
    const width = Math.max(1, Math.round(u.bbox.width / devicePixelRatio));
    const angle = columns.crank_angle, status = columns.status;
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

  /** Whether a line jumps so much from point to point that it would cover what is beneath. */
  function busy(u, points) {
    let far = 0;
    for (let i = 1; i < points.length; i++) {
      const a = points[i - 1][1], b = points[i][1];
      const both = a > 0 && b > 0;
      if (both ? Math.abs(u.valToPos(a, "y") - u.valToPos(b, "y")) > 10 : a > 0) far++;
    }
    return far > Math.max(20, points.length / 8);
  }

  /** Draw lines over a waterfall, dark with a light edge, or the other way round. */
  function stroke(u, points, { colour, edge, width, dash = [] }) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    const path = new Path2D();
    let down = false;
    // Far out of sight dashes would cost as much as in sight.
    const top = bbox.top - bbox.height, bottom = bbox.top + 2 * bbox.height;
    for (const [x, y] of points) {
      if (x === null || !(y > 0)) { down = false; continue; }
      const px = u.valToPos(x, "x", true), py = clamp(u.valToPos(y, "y", true), top, bottom);
      if (down) path.lineTo(px, py); else path.moveTo(px, py);
      down = true;
    }
    ctx.lineJoin = "bevel";
    ctx.setLineDash(dash.map(d => d * devicePixelRatio));
    for (const [style, size] of edge ? [[edge, width + 2], [colour, width]] : [[colour, width]]) {
      ctx.strokeStyle = style;
      ctx.lineWidth = size * devicePixelRatio;
      ctx.stroke(path);
    }
    ctx.restore();
  }

  function mark(u, x, y, current, small = false) {
    const { ctx, bbox } = u, px = u.valToPos(x, "x", true), py = u.valToPos(y, "y", true);
    if (px < bbox.left || px > bbox.left + bbox.width || py < bbox.top || py > bbox.top + bbox.height) return;
    ctx.save();
    ctx.beginPath();
    ctx.arc(px, py, (current ? 7 : small ? 2 : 4.5) * devicePixelRatio, 0, 2 * Math.PI);
    ctx.fillStyle = WARN;
    ctx.strokeStyle = "#ffffff";
    ctx.lineWidth = 1.6 * devicePixelRatio;
    ctx.fill();
    if (!small || current) ctx.stroke();
    ctx.restore();
  }

  // ---- excitations and moments ----------------------------------------------------------------

  const excitations = (data.excitations ?? []).map(one => ({ ...one, times: array(one.times), values: array(one.values) }));
  const moments = data.tables.find(table => table.id === "moments")?.rows ?? [];

  /** Points of an excitation in view, least and greatest of stretches where they are many. */
  function excitationPoints({ times, values }, wanted) {
    const from = Math.max(0, lowerBound(times, view[0]) - 1), to = Math.min(times.length, lowerBound(times, view[1]) + 1);
    const step = Math.max(1, Math.floor((to - from) / wanted)), points = [];
    const apart = i => i > from && times[i] - times[i - 1] > data.stale_after;
    for (let i = from; i < to;) {
      let low = Infinity, high = -Infinity, end = i;
      while (end < Math.min(i + step, to) && values[end] > 0 && (end === i || !apart(end))) {
        low = Math.min(low, values[end]);
        high = Math.max(high, values[end++]);
      }
      const [one, other] = values[i] > values[end - 1] ? [high, low] : [low, high];
      if (end > i) points.push([times[i], one], [times[end - 1], other]);
      const lost = end < to && !(values[end] > 0);
      if (lost || (end < to && apart(end))) points.push([null, null]);
      while (end < to && !(values[end] > 0)) end++;
      i = end;
    }
    return points;
  }

  let pointsInView = [], viewOfPoints = null;  // which several charts draw

  function drawExcitations(u, style) {
    if (viewOfPoints !== view) {
      pointsInView = excitations.map(one => [one, excitationPoints(one, 250)]);
      viewOfPoints = view;
    }
    const { ctx, bbox } = u, taken = [], { min, max } = u.scales.y;
    const inSight = points => points.some(([, y]) => y >= min) && points.some(([, y]) => y !== null && y <= max);
    const drawn = pointsInView.filter(([, points]) => inSight(points) && !busy(u, points));
    for (const [one, points] of drawn) stroke(u, points, { ...style, dash: dashes[one.style] ?? [] });
    for (const [one, points] of drawn) {
      // At the right end, where there is room between the labels.
      const end = points.findLast(([x, y]) => x !== null && x <= view[1] && y > 0);
      if (!end) continue;
      const y = u.valToPos(end[1], "y", true), high = 14 * devicePixelRatio;
      if (y < bbox.top + high || y > bbox.top + bbox.height || taken.some(other => Math.abs(other - y) < high)) continue;
      taken.push(y);
      ctx.save();
      ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
      ctx.textAlign = "right";
      const x = Math.min(u.valToPos(end[0], "x", true), bbox.left + bbox.width) - 4 * devicePixelRatio;
      ctx.lineWidth = 3 * devicePixelRatio;
      ctx.strokeStyle = style.edge ?? "#ffffff";
      ctx.strokeText(one.name, x, y - 3 * devicePixelRatio);
      ctx.fillStyle = style.colour;
      ctx.fillText(one.name, x, y - 3 * devicePixelRatio);
      ctx.restore();
    }
  }

  const onMap = { colour: "#ffffff", edge: "#00000099", width: 1.3 };
  const onPaper = { colour: "#555555", width: 1.1 };

  function drawMoments(u, modeOnly) {
    const shown = moments.filter(row => row.time >= view[0] && row.time <= view[1] &&
      (modeOnly === undefined || row.mode === modeOnly));
    for (const row of shown) mark(u, row.time, row.y, row === moments[current], shown.length > 80);
  }

  // ---- the waterfall over the angle -----------------------------------------------------------

  let angleChart = null;
  function makeAngleChart(width, box) {
    const angles = Array.from(frf.angles, a => a * DEG), count = data.modes.length;
    angleChart?.destroy();
    angleChart = new uPlot({
      width, height: 300, legend: { show: false }, cursor: { show: false }, padding: [6, 12, 0, 0],
      series: [{}, { show: false }],
      scales: { x: { time: false, range: () => [angles[0], angles[angles.length - 1]] }, y: { distr: 3, range: () => waterfall.range } },
      axes: [{ ...AXIS, size: 28, label: "crank angle [deg]", labelSize: 18, labelGap: 0, labelFont: AXIS.font, grid: { show: false } }, valueAxis(true, false)],
      hooks: {
        drawClear: [u => {
          const w = Math.max(1, Math.round(u.bbox.width / devicePixelRatio));
          waterfall.paint(u, w, x => [(x + .5) / w * (angles.length - 1)]);
        }],
        draw: [u => {
          for (let k = 0; k < count; k++) {
            stroke(u, angles.map((a, i) => [a, frf.frequencies[i * count + k]]), { colour: "#000000", edge: k === mode ? "#ffffff" : "", width: k === mode ? 1.8 : 1, dash: [4, 3] });
          }
          for (const row of moments) mark(u, columns.crank_angle[row.index] * DEG, row.y, row === moments[current], moments.length > 80);
          const x = u.valToPos(columns.crank_angle[cursor] * DEG, "x", true), { ctx, bbox } = u;
          if (x >= bbox.left && x <= bbox.left + bbox.width) {
            ctx.save();
            ctx.lineWidth = 2 * devicePixelRatio;
            ctx.strokeStyle = WARN;
            ctx.beginPath();
            ctx.moveTo(x, bbox.top);
            ctx.lineTo(x, bbox.top + bbox.height);
            ctx.stroke();
            ctx.restore();
          }
        }],
      },
    }, [angles, angles.map(() => 1)], box);
    angleChart.over.addEventListener("pointermove", event => {
      const at = angleChart.over.getBoundingClientRect();
      showPointer(angleChart.posToVal(event.clientX - at.left, "x") / DEG, angleChart.posToVal(event.clientY - at.top, "y"));
    });
    angleChart.over.addEventListener("pointerleave", () => showPointer());
  }

  function showPointer(angle, frequency) {
    const told = byId("pointer");
    if (!told) return;
    const place = angle === undefined ? NaN : gridPlace(angle);
    told.textContent = inside(place) && frequency > 0
      ? `|H| = ${digits(10 ** logReceptance(place, frequency), 4)} m/N at ${digits(frequency, 4)} Hz, ${(angle * DEG).toFixed(2)}°` : "";
  }

  // ---- the linkage ---------------------------------------------------------------------------

  const SWING = .08, SWINGS_PER_SECOND = .5;

  const linkage = data.linkage && (() => {
    const L = data.linkage, angles = array(L.angles), places = array(L.places), shapes = array(L.shapes);
    const joints = array(L.joints), centres = array(L.centres), ground = array(L.ground);
    const count = L.lengths.reduce((a, b) => a + b, 0), size = L.size;
    let left = Infinity, right = -Infinity, low = Infinity, high = -Infinity;
    for (const points of [places, ground]) {
      for (let i = 0; i < points.length; i += 2) {
        left = Math.min(left, points[i]); right = Math.max(right, points[i]);
        low = Math.min(low, points[i + 1]); high = Math.max(high, points[i + 1]);
      }
    }
    const edge = 1.3 * SWING * size, box = byId("linkage"), width = .009 * size;
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
    const mix = (values, i, s, stride, k) => (1 - s) * values[i * stride + k] + s * values[(i + 1) * stride + k];
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
    function draw(phase) {
      const angle = columns.crank_angle[cursor];
      const place = (angle - angles[0]) / (angles[angles.length - 1] - angles[0]) * (angles.length - 1);
      const there = place >= 0 && place <= angles.length - 1;
      box.classList.toggle("empty", !there);
      for (const group of [still, moved, pins]) group.style.display = there ? "" : "none";
      if (!there) return;
      const i = Math.min(Math.floor(place), angles.length - 2), s = place - i;
      const amplitude = SWING * size * Math.sin(phase);
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
        const f = columns[`f${mode + 1}`][cursor], angle = columns.crank_angle[cursor];
        byId("linkage-caption").textContent = Number.isFinite(f)
          ? `Mode ${mode + 1}, ${digits(f)} Hz, at ${(angle * DEG).toFixed(2)}°; its motion is magnified and slowed down. Grey: at rest.`
          : `No prediction at ${Number.isFinite(angle) ? `${(angle * DEG).toFixed(2)}°` : "an angle that is no number"}.`;
      },
    };
  })();

  // ---- what the cursor reads -------------------------------------------------------------------

  const readout = byId("readout").tBodies[0];
  const cells = {};
  function reading(id, label, colour) {
    const name = element("td", {});
    if (colour) name.append(element("span", { class: "swatch", style: `background:${colour}` }));
    name.append(label);
    readout.append(element("tr", {}, name, cells[id] = element("td", { id: `read-${id}` })));
  }

  reading("time", "Time");
  reading("stamp", "Stamp, UTC");
  for (const item of data.readings) reading(item.id, item.label, item.colour);

  function told(item, i) {
    const value = columns[item.column][i] - (item.minus ? columns[item.minus][i] : 0);
    if (item.words) return item.words[value] ?? String(value);
    let text = Number.isFinite(value) ? `${digits(value * (item.factor ?? 1), item.digits ?? 6)} ${item.unit ?? ""}` : "none";
    if (item.spread && Number.isFinite(value)) {
      const spread = columns[item.spread][i];
      if (Number.isFinite(spread)) text += ` ± ${digits(data.coverage * spread * (item.factor ?? 1), 2)}`;
    }
    return text.trim();
  }

  onCursor.push(() => {
    cells.time.textContent = `${clock(time[cursor], 1e-4)} ${timeUnit}`;
    cells.stamp.textContent = stamp(cursor);
    for (const item of data.readings) cells[item.id].textContent = told(item, cursor);
    byId("brief").textContent = [`${clock(time[cursor], 1e-2)} ${timeUnit}`, ...data.readings
      .filter(item => data.brief.includes(item.id))
      .map(item => told({ ...item, digits: 4, spread: undefined }, cursor))].join(" \u00b7 ");
    for (const chart of charts) chart.showCursor();
    linkage?.show();
    if (angleChart && !angleBox.hidden) angleChart.redraw(false);
  });

  const spoken = i => `${clock(time[i])} ${timeUnit}: ` +
    data.readings.map(item => `${item.label} ${told(item, i)}`).join(", ");

  // ---- tables whose rows are moments -----------------------------------------------------------

  let current = -1;
  const jumps = data.tables.find(table => table.rows.some(row => row.time !== undefined));
  for (const table of data.tables) {
    const body = element("tbody");
    table.rows.forEach((row, i) => {
      const line = element("tr", row.time === undefined ? {} : { "data-time": row.time, tabindex: 0 },
        ...row.cells.map(cell => element("td", {}, String(cell))));
      if (row.time !== undefined) {
        line.addEventListener("click", () => table === jumps ? jump(i) : keep(row.index));
        line.addEventListener("keydown", event => {
          if (event.key === "Enter" || event.key === " ") { event.preventDefault(); event.stopPropagation(); line.click(); }
        });
      }
      body.append(line);
    });
    const head = element("thead", {}, element("tr", {}, ...table.head.map(text => element("th", { scope: "col" }, text))));
    const section = element("section", { class: "table", id: `table-${table.id}` }, element("h2", {}, table.title));
    if (table.note) section.append(element("p", { class: "note" }, table.note));
    if (table.rows.length) section.append(element("div", { class: "scroll", tabindex: 0, "aria-label": table.title }, element("table", {}, head, body)));
    byId("tables").append(section);
  }

  function jump(i) {
    const rows = jumps.rows;
    current = clamp(i, 0, rows.length - 1);
    const row = rows[current], lines = document.querySelectorAll(`#table-${jumps.id} tbody tr`);
    lines.forEach((line, k) => line.classList.toggle("current", k === current));
    const line = lines[current], scroll = line.closest(".scroll");
    scroll.scrollTop += line.getBoundingClientRect().top - scroll.getBoundingClientRect().top - scroll.clientHeight / 2;
    byId("jump-label").textContent = `${current + 1} of ${rows.length}`;
    if (row.mode !== undefined) setMode(row.mode);
    // Near enough that its beginning and its end show, not nearer than the view that is chosen.
    const span = Math.min(view[1] - view[0], Math.max(4 * (row.length ?? 0), (last - first) / 50, 2));
    setView(row.time - span / 2, row.time + span / 2);
    keep(row.index);
    schedule();
  }

  if (jumps) byId("jumps").hidden = false;

  // ---- modes -----------------------------------------------------------------------------------

  const modeButtons = data.modes.map((colour, k) => {
    const button = element("button", { type: "button", role: "radio", "aria-checked": String(k === 0), tabindex: k ? -1 : 0, id: `mode-${k + 1}` }, `Mode ${k + 1}`);
    button.addEventListener("click", () => setMode(k));
    byId("modes").append(button);
    return button;
  });
  byId("modes").hidden = modeButtons.length === 0;

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

  // ---- histograms and provenance ---------------------------------------------------------------

  for (const { title, unit, edges, shares, limit, note } of data.histograms) {
    const W = 460, H = 190, left = 44, bottom = 40, top = 8;
    const most = Math.max(...shares, 1e-9), step = [.01, .02, .05, .1, .2, .25, .5].find(s => most / s <= 5) ?? .5;
    const x = v => left + (v - edges[0]) / (edges[edges.length - 1] - edges[0]) * (W - left - 10);
    const y = v => H - bottom - v / (Math.ceil(most / step) * step) * (H - bottom - top);
    const drawn = svg("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": title, "font-size": 12, fill: INK });
    for (let v = 0; v <= Math.ceil(most / step) * step + 1e-9; v += step) {
      drawn.append(svg("line", { x1: left, x2: W - 10, y1: y(v), y2: y(v), stroke: "#e4e4e4" }),
        svg("text", { x: left - 6, y: y(v) + 4, "text-anchor": "end" }, `${Math.round(100 * v)} %`));
    }
    shares.forEach((share, i) => {
      const near = limit !== null && edges[i + 1] <= limit + 1e-9;
      drawn.append(svg("rect", { x: x(edges[i]) + .5, width: Math.max(.5, x(edges[i + 1]) - x(edges[i]) - 1), y: y(share), height: Math.max(0, y(0) - y(share)), fill: near ? WARN : BLUE },
        svg("title", {}, `${digits(edges[i], 4)} to ${digits(edges[i + 1], 4)} ${unit}: ${(100 * share).toFixed(2)} % of the time`)));
    });
    const span = edges[edges.length - 1] - edges[0];
    const tick = [1e-3, .01, .02, .05, .1, .2, .5, 1, 2, 5, 10, 20, 30, 45, 90].find(s => span / s <= 9) ?? span;
    for (let v = Math.ceil(edges[0] / tick - 1e-9) * tick; v <= edges[edges.length - 1] + 1e-9; v += tick) {
      drawn.append(svg("line", { x1: x(v), x2: x(v), y1: y(0), y2: y(0) + 5, stroke: GREY }),
        svg("text", { x: x(v), y: y(0) + 18, "text-anchor": "middle" }, String(Number(v.toPrecision(6)))));
    }
    drawn.append(svg("line", { x1: left, x2: W - 10, y1: y(0), y2: y(0), stroke: GREY }),
      svg("text", { x: (left + W - 10) / 2, y: H - 6, "text-anchor": "middle" }, unit));
    const section = element("section", { class: "histogram" }, element("h2", {}, title), drawn);
    if (note) section.append(element("p", { class: "note" }, note));
    byId("histograms").append(section);
  }

  byId("subtitle").textContent = data.subtitle;
  for (const { label, value, alert } of data.summary) {
    byId("summary").append(element("div", { class: alert ? "alert" : undefined }, element("dt", {}, label), element("dd", {}, value)));
  }
  const provenance = byId("provenance");
  provenance.append(element("h2", {}, data.provenance.title), element("table", {}, element("tbody", {},
    ...data.provenance.rows.map(cells => element("tr", {}, ...cells.map(text => element("td", {}, text)))))));
  for (const { name, text } of data.provenance.files) {
    provenance.append(element("details", {}, element("summary", {}, name), element("pre", { tabindex: 0 }, text)));
  }

  // ---- putting it together ---------------------------------------------------------------------

  document.querySelector("main").classList.toggle("wide", Boolean(data.wide));
  const holder = byId("charts");
  let angleBox = element("div", { class: "chart", hidden: true, id: "chart-over-angle" });
  const specs = data.charts.slice();
  if (waterfall) {
    specs.splice(1, 0, {
      id: "waterfall", title: `Receptance |H| at ${frf.place}, frequency over time`, unit: "Hz", log: true, height: 256,
      range: waterfall.range, series: [], paint: paintOverTime,
      overlay(u) {
        data.modes.forEach((_, k) => {
          const [x, y] = decimated([charts.lines[k]], view, wantedOver(u.width)), points = x.map((t, i) => [t, y[i]]);
          if (!busy(u, points)) stroke(u, points, { colour: "#000000", edge: k === mode ? "#ffffff" : "", width: k === mode ? 1.8 : 1, dash: [4, 3] });
        });
        drawExcitations(u, onMap);
        drawMoments(u);
      },
      hover(u, y) { showPointer(columns.crank_angle[cursor], u.posToVal(y, "y")); },
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
        ...(excitations.length ? [keyItem({ label: "excitations (white; where they are too dense, zoom in)", colour: "#8a8a8a" })] : []),
        ...(moments.length ? [element("span", {}, element("span", { style: `color:${WARN}` }, "●"), "moments of resonance")] : [])),
      element("span", { class: "note", id: "pointer" }));
    fallChart.head.append(both);
    fallChart.row.append(angleBox, key);
  }

  if (linkage) byId("linkage-section").hidden = false;

  // the strip that shows the whole drive
  const overview = byId("overview"), strip = { u: null };
  const stripSeries = { ...data.overview };
  const stripQuantity = quantity(stripSeries);
  const frameBox = element("div", { class: "window" });
  function makeStrip(width) {
    strip.u?.destroy();
    strip.u = new uPlot({
      width, height: 58, legend: { show: false }, cursor: { show: false }, padding: [4, 12, 4, 0],
      series: [{}, { stroke: GREY, width: 1, points: { show: false } }],
      scales: { x: { time: false, range: () => [first, last] }, y: { range: yRange(false) } },
      axes: [{ show: false }, { ...AXIS, size: 64, values: (u, splits) => splits.map(() => null), grid: { show: false }, ticks: { show: false }, label: data.overview.label, labelSize: 16, labelFont: "11px system-ui, sans-serif" }],
      hooks: { drawClear: [u => shadeAll(u)] },
    }, decimated([stripQuantity], [first, last], wantedOver(width)), overview);
    strip.u.over.append(frameBox);
    strip.u.over.style.cursor = "grab";
    const over = strip.u.over, at = x => first + clamp(x, 0, over.clientWidth) / over.clientWidth * (last - first);
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

  function shadeAll(u) {
    const shown = view;
    view = [first, last];
    shade(u);
    view = shown;
  }

  function showWindow() {
    const a = strip.u.valToPos(view[0], "x"), b = strip.u.valToPos(view[1], "x");
    frameBox.style.left = `${a}px`;
    frameBox.style.width = `${Math.max(b - a, 3)}px`;
  }

  // What is out of sight waits until it comes near.
  const watcher = new IntersectionObserver(entries => entries.forEach(entry => {
    const chart = charts.find(one => one.row === entry.target);
    chart.near = entry.isIntersecting;
    if (chart.near && chart.stale) chart.update();
  }), { rootMargin: "150px" });
  charts.forEach(chart => watcher.observe(chart.row));

  onView.push(() => {
    for (const chart of charts) if (chart.near) chart.update(); else chart.stale = true;
    showWindow();
  });
  onMode.push(() => {
    for (const chart of charts) if (chart.spec.id === "waterfall" && !chart.box.hidden) chart.u.redraw();
    if (angleChart && !angleBox.hidden) angleChart.redraw();
  });

  let shownWidth = 0;
  function layout(width = 0) {
    const wide = width || holder.clientWidth;
    shownWidth = wide;
    for (const chart of charts) if (!chart.box.hidden) chart.make(wide);
    if (!angleBox.hidden) makeAngleChart(wide, angleBox);
    makeStrip(width || overview.clientWidth);
    requestAnimationFrame(() => { showWindow(); showCursor(); });  // when uPlot knows its places
  }

  const actions = {
    all: () => setView(first, last),
    in: () => zoom(.5, (view[0] + view[1]) / 2),
    out: () => zoom(2, (view[0] + view[1]) / 2),
    left: () => pan(-.4),
    right: () => pan(.4),
    previous: () => jump(current < 0 ? 0 : current - 1),
    next: () => jump(current + 1),
    move() {
      moving = !moving;
      showMoving();
      showCursor();
    },
  };

  function showMoving() {
    byId("move").textContent = moving ? "Hold it still" : "Let it move";
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
      0: actions.all, n: () => jumps && actions.next(), p: () => jumps && actions.previous(), m: () => linkage && actions.move(),
    };
    if (scrolls && event.key.startsWith("Arrow")) return;
    if (/^[1-9]$/.test(event.key)) setMode(Number(event.key) - 1);
    else if (Object.hasOwn(keys, event.key)) keys[event.key]();
    else return;
    event.preventDefault();
  });

  new ResizeObserver(() => {
    if (holder.clientWidth && Math.abs(holder.clientWidth - shownWidth) > 1 && !printing) layout();
  }).observe(holder);

  let printing = false;
  addEventListener("beforeprint", () => { printing = true; layout(680); });
  addEventListener("afterprint", () => { printing = false; layout(); });

  showMoving();
  layout();
  if (moments.length) kept = cursor = moments.reduce((a, b) => Math.abs(b.margin) < Math.abs(a.margin) ? b : a).index;
  showCursor();
  // For scripts, and for those who look into the page's own numbers.
  window.review = {
    columns, n,
    get cursor() { return cursor; },
    get view() { return view; },
    get mode() { return mode; },
    drawn: id => charts.find(chart => chart.spec.id === id).u.data[1],
    receptance: (angle, frequency) => 10 ** logReceptance(gridPlace(angle), frequency),
  };
})();
