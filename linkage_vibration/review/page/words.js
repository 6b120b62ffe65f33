// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Writes numbers and times as text.

/** A number with a count of significant digits. */
const digits = (v, count = 6) =>
  !Number.isFinite(v) ? "no value"
    : v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e6) ? v.toExponential(count - 1)
      : v.toPrecision(count);

/** A place of the time axis as text of its time, with enough decimals to show a step, both in s. */
function clock(place, step = 1e-3) {
  const t = realTime(place);
  const places = step >= 1 ? 0 : Math.min(6, Math.ceil(-Math.log10(step) - 1e-9));
  if (longest - first < 120) return t.toFixed(places);
  // The time is rounded first, so that the seconds never read 60.
  const rounded = Number(t.toFixed(places));
  const sign = rounded < 0 ? "-" : "", whole = Math.abs(rounded);
  const hours = Math.floor(whole / 3600), minutes = Math.floor(whole / 60) % 60;
  const seconds = (whole % 60).toFixed(places).padStart(places ? places + 3 : 2, "0");
  return sign + (longest - first >= 3600
    ? `${hours}:${String(minutes).padStart(2, "0")}:${seconds}` : `${minutes}:${seconds}`);
}

const timeUnit = longest - first < 120 ? "s" : longest - first < 3600 ? "min:s" : "h:min:s";

/** The stamp of a sample in UTC, to the millisecond. */
function stamp(index) {
  const date = new Date(Number(data.start_ms) + realTime(time[index]) * 1e3);
  return Number.isNaN(date.getTime()) ? "" : date.toISOString().replace("T", " ").replace("Z", "");
}
