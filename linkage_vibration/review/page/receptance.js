// Copyright 2026 The linkage_vibration authors. SPDX-License-Identifier: Apache-2.0
// Computes the receptance at the drive point from the poles and residues of the table.

/** The terms of the receptance on a grid of angles, if the log holds them. */
const frf = data.frf;
const TERM = 7;  // numbers of a term: k, c, residue and rate; all but c are complex

/** log10 |H|, m/N, at a place on the grid of angles (see gridPlace) and a frequency in Hz. */
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

/** The place of an angle on the grid, as an index with a fraction. */
const gridPlace = angle =>
  (angle - frf.angles[0]) / (frf.angles[frf.angles.length - 1] - frf.angles[0]) * (frf.angles.length - 1);
/** Whether such a place is on the grid. */
const inside = place => place >= 0 && place <= frf.angles.length - 1;
