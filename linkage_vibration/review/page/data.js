// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Unpacks the numbers of the page, and finds samples by their times.

const byId = id => document.getElementById(id);
const data = JSON.parse(byId("data").textContent);
byId("data").remove();

const DEG = 180 / Math.PI;
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const TYPES = { f8: Float64Array, f4: Float32Array, u1: Uint8Array };

if (!window.DecompressionStream) {
  byId("subtitle").textContent = "This browser cannot unpack the numbers of this page; open it in "
    + "Chrome or Edge from version 80, Firefox from 113, or Safari from 16.4.";
  return;
}

/** A typed array from the form in which the page holds it: the differences of all first bytes, then of all second ones. */
async function unpacked({ type, deflate }) {
  const text = atob(deflate), packed = new Uint8Array(text.length);
  for (let i = 0; i < packed.length; i++) packed[i] = text.charCodeAt(i);
  const { readable, writable } = new DecompressionStream("deflate"), writer = writable.getWriter();
  writer.write(packed);
  writer.close();
  const differences = new Uint8Array(await new Response(readable).arrayBuffer());
  const bytes = new Uint8Array(differences.length), size = TYPES[type].BYTES_PER_ELEMENT;
  for (let first = 0, k = 0; first < size; first++) {
    for (let i = first, sum = 0; i < bytes.length; i += size) bytes[i] = sum = sum + differences[k++] & 255;
  }
  return new TYPES[type](bytes.buffer);
}

/** Put typed arrays in the place of all that are packed. */
async function unpack(holder) {
  await Promise.all(Object.entries(holder).map(async ([key, value]) => {
    if (value?.deflate) holder[key] = await unpacked(value);
    else if (value && typeof value === "object") await unpack(value);
  }));
}
await unpack(data);

const columns = {};
for (const [name, values] of Object.entries(data.columns)) {
  columns[name] = "constant" in values
    ? new TYPES[values.type](data.n).fill(values.constant ?? NaN) : values;
}
data.columns = null;
const time = columns.time, n = data.n;
const first = time[0], last = Math.max(time[n - 1], time[0] + 1e-3);
const breaks = data.breaks;  // ascending indices of samples; predictions are missing before each of them

/** The crank angle without whole turns, where a table of a whole turn holds for each of them. */
const tableAngle = columns.table_angle ?? columns.crank_angle;

/** The index of the first value that is not less than x; the values ascend. */
function lowerBound(values, x) {
  let low = 0, high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < x) low = middle + 1; else high = middle;
  }
  return low;
}

/** The number that corresponds to x, by lists of corresponding ascending and other numbers. */
function corresponding(x, from, to) {
  const i = clamp(lowerBound(from, x) - 1, 0, from.length - 2);
  if (x <= from[0]) return to[0] + x - from[0];
  if (x >= from[from.length - 1]) return to[to.length - 1] + x - from[from.length - 1];
  return to[i] + (x - from[i]) / (from[i + 1] - from[i]) * (to[i + 1] - to[i]);
}
/** The time since the first stamp at a place of the time axis, on which long gaps are short, s. */
const realTime = t => data.clock ? corresponding(t, data.clock.shown, data.clock.real) : t;
const longest = data.clock ? Math.max(...data.clock.real) : last;

/** The index of the sample nearest to a time in s. */
function nearest(t) {
  const i = clamp(lowerBound(time, t), 0, n - 1);
  return i > 0 && t - time[i - 1] < time[i] - t ? i - 1 : i;
}
