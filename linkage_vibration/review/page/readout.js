// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Shows the numbers at the cursor.

const readout = byId("readout").tBodies[0], cells = {};
/** Add a line to the list of numbers. */
function addReading(id, label, colour) {
  const name = element("td", {});
  if (colour) name.append(element("span", { class: "swatch", style: `background:${colour}` }));
  name.append(label);
  readout.append(element("tr", {}, name, cells[id] = element("td", { id: `read-${id}` })));
}

addReading("time", "Time");
addReading("stamp", "Stamp, UTC");
for (const item of data.readings) addReading(item.id, item.label, item.colour);

/** The text of a reading at a sample: a word, or a number with its unit and its uncertainty.
 *  A mode without a frequency is overdamped where the column that the reading names has a number. */
function readingText(item, i) {
  const value = columns[item.column][i];
  if (item.words) return item.words[value] ?? String(value);
  const missing = item.predicted && Number.isFinite(columns[item.predicted][i]) ? "overdamped" : "no value";
  if (!Number.isFinite(value)) return missing;
  const by = item.spread ? data.coverage * columns[item.spread][i] * (item.factor ?? 1) : NaN;
  let text = digits(value * (item.factor ?? 1), item.digits);
  if (by > 0) {  // A number has no more digits than its deviation, which has two.
    const places = clamp(1 - Math.floor(Math.log10(by)), 0, 12);
    text = `${(value * (item.factor ?? 1)).toFixed(places)} ± ${by.toFixed(places)}`;
  }
  return `${text} ${item.unit ?? ""}`.trim();
}

/** The same without the uncertainty. */
function briefText(item, i) {
  return readingText({ ...item, digits: 4 }, i).replace(/ ± \S+/, "");
}

onCursor.push(() => {
  cells.time.textContent = `${clock(time[cursor], 1e-4)} ${timeUnit}`;
  cells.stamp.textContent = stamp(cursor);
  for (const item of data.readings) cells[item.id].textContent = readingText(item, cursor);
  byId("brief").textContent = [`${clock(time[cursor], 1e-2)} ${timeUnit}`, ...data.readings
    .filter(item => data.brief.includes(item.id))
    .map(item => briefText(item, cursor))].join(" \u00b7 ");
  for (const chart of charts) chart.showCursor();
  linkage?.show();
});

/** What a screen reader says of a sample. */
const spoken = i => `${clock(time[i])} ${timeUnit}: ` +
  data.readings.map(item => `${item.label} ${readingText(item, i)}`).join(", ");
