# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Peaks between lines, of equal height, at the edge of a band, and a band without a peak."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from benchmark.report import table
from benchmark.stability.static_limit import linkage, picture_of
from linkage_vibration.drawing.palette import COLOURS, GREY, INK
from linkage_vibration.mechanics.description import rayleigh_damping
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import Peak, oscillators
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from test.support.crossing import BAND, STROKE, crossing_crank

FloatArray = NDArray[np.float64]

TITLE = "Peaks between frequency lines, of one height, at a band's edge"

_RATIO = 2e-4  # damping ratio, 1
_LINE = 0.1  # Hz, from line to line
_GAP, _AT = 1.0, 0.8  # Hz and rad, of the crank


def section(pictures: Path) -> str:
    """Measure the errors of lines and splines at peaks and at edges of bands, and report."""
    crank = LinkageModel(crossing_crank(_GAP, _AT))
    built = build_table(crank)
    jump = _jump(crank)
    _draw(crank, built, jump, pictures / "peaks.png")
    first, second = 2.0 * math.pi * np.array([10.0, 15.0])
    two = oscillators([first, second], [0.01, 0.01], [first**2, _equal(first, second)])
    both, none = two.local_peaks(np.arange(2)), two.peak((20.0, 40.0))
    seen = [["0.1 Hz lines", *_missed(_LINE)], ["0.01 Hz lines", *_missed(_LINE / 10.0)]]
    columns = ["", "3 Hz", "30 Hz", "150 Hz"]
    return f"""\
**Between lines.** One oscillator with a damping ratio of 0.02 % resonates halfway between two
lines. The table shows the share of the peak's magnitude that the higher line misses:

{table(columns, [*seen, ["ours", *_exact()]])}

In the paper's linkage with this damping at 4 and 180 Hz, 0.1 Hz lines miss {_over_the_stroke()} of
the highest peak at 46 angles. The error goes up and down from one angle to the next, as the peak
approaches a line or leaves it. Ours finds the zeros of the derivative of abs(H)^2, bracketed
between lines around each resonance. It refines every maximum that may be the highest before it
compares them, because of two nearly equal maxima the one nearer to a line would seem the higher.

**Two peaks of equal height** in an FRF: both are found, at {both[0][0]:.4f} and {both[0][1]:.4f}
Hz, with magnitudes within {abs(both[1][0] / both[1][1] - 1.0):.0e}. The lower frequency is
reported.

**Along the stroke**, the highest peak of a crank with two modes (1 Hz apart where they veer) jumps
from {_at(crank, jump - 1e-9):.4f} to {_at(crank, jump + 1e-9):.4f} Hz at {math.degrees(jump):.6f}
deg. The largest relative error of its frequency, at 400 angles within 2 deg of the jump, is
{_spline_error(crank, jump):.0e} for a spline through 46 equispaced angles, and
{_table_error(crank, built, jump):.0e} for ours. The table contains every maximum that may be the
highest, and compares them at the requested angle. If a maximum does not exist over a whole piece,
the piece is halved.

**The band.** {_edges()} Between 20 and 40 Hz, where neither of the two oscillators resonates, the
highest value is reported at {none.frequency:g} Hz, {_kind(none)}.

Tests: `test/table/tabulation/test_peaks.py`,
`test/mechanics/test_response.py::test_peak_of_one_oscillator`,
`::test_peak_at_the_edges_of_a_band`, `::test_local_peaks_are_maxima_of_a_dense_grid`.

![A sharp peak between lines, and the highest peak over the stroke](stability/peaks.png)
"""


def _sharp(frequency: float) -> tuple[float, float]:
    """Return frequency (Hz) and magnitude of the peak of one oscillator in closed form."""
    omega, z = 2.0 * math.pi * frequency, _RATIO
    return frequency * math.sqrt(1 - 2 * z**2), 1 / (2 * omega**2 * z * math.sqrt(1 - z**2))


def _missed(step: float) -> list[str]:
    texts = []
    for around in (3.0, 30.0, 150.0):
        frequency = around + step / 2.0
        first = oscillators([2.0 * math.pi * frequency], [_RATIO], [1.0])
        lines = np.array([around, around + step])
        seen = np.abs(first.frf(lines)).max() / _sharp(frequency)[1]
        texts.append(f"{100.0 * (1.0 - seen):.1f} %")
    return texts


def _exact() -> list[str]:
    texts = []
    for around in (3.0, 30.0, 150.0):
        first = oscillators([2.0 * math.pi * (around + _LINE / 2.0)], [_RATIO], [1.0])
        error = first.peak((0.0, 200.0)).magnitude / _sharp(around + _LINE / 2.0)[1] - 1.0
        texts.append(f"{100.0 * abs(error):.0e} %")
    return texts


def _over_the_stroke() -> str:
    mechanism = replace(linkage().mechanism, damping=rayleigh_damping(_RATIO, 4.0, 180.0))
    model = LinkageModel(mechanism)
    lines = np.arange(0.0, 200.0 + _LINE / 2.0, _LINE)
    missed = []
    for angle in np.linspace(*mechanism.stroke, 46):
        solution = model.solve(float(angle))
        seen = np.abs(solution.drive_point.frf(lines)).max()
        missed.append(1.0 - seen / solution.peak(mechanism.response.band).magnitude)
    return f"{100.0 * min(missed):.0f} to {100.0 * max(missed):.0f} %"


def _equal(first: float, second: float) -> float:
    """Return the residue of a mode (rad/s) that gives it a peak as high as another's, of 1 m/N."""

    def higher(residue: float) -> float:
        pair = oscillators([first, second], [0.01, 0.01], [first**2, residue])
        sizes = pair.local_peaks(np.arange(2))[1]
        return float(sizes[1] - sizes[0])

    return float(brentq(higher, 0.5 * second**2, 2.0 * second**2, xtol=1e-12))


def _at(model: LinkageModel, angle: float) -> float:
    return model.solve(angle).peak(BAND).frequency


def _jump(model: LinkageModel) -> float:
    """Return the angle (rad) at which the highest peak changes from one mode to the other."""

    def higher(angle: float) -> float:
        sizes = model.solve(angle).drive_point.local_peaks(np.arange(2))[1]
        return float(sizes[1] - sizes[0])

    return float(brentq(higher, _AT - 0.05, _AT + 0.3, xtol=1e-14))


def _near(jump: float) -> FloatArray:
    return jump + math.radians(2.0) * np.linspace(-1.0, 1.0, 400)


def _spline_error(model: LinkageModel, jump: float) -> float:
    grid = np.linspace(*STROKE, 46)
    peaks = CubicSpline(grid, [_at(model, float(angle)) for angle in grid])
    exact = np.array([_at(model, float(angle)) for angle in _near(jump)])
    return float(np.abs(peaks(_near(jump)) / exact - 1.0).max())


def _table_error(model: LinkageModel, built: Table, jump: float) -> float:
    exact = np.array([_at(model, float(angle)) for angle in _near(jump)])
    return float(np.abs(built.evaluate(_near(jump))[:, -2] / exact - 1.0).max())


def _edges() -> str:
    """Return how a resonance just outside and just inside a band is reported."""
    first = oscillators([2.0 * math.pi * 50.0], [0.01], [1.0])
    texts = []
    for band in ((0.0, 49.99), (0.0, 50.0), (50.0, 80.0)):
        peak = first.peak(band)
        texts.append(f"{band[0]:g} to {band[1]:g} Hz, {peak.frequency:.4f} Hz, {_kind(peak)}")
    return (
        "The highest value of an oscillator whose resonance peaks at 49.995 Hz, by band: "
        f"{'; '.join(texts)}."
    )


def _kind(peak: Peak) -> str:
    return "a peak" if peak.inside else "the band's edge, not a peak (`inside` is False)"


def _draw(model: LinkageModel, built: Table, jump: float, picture: Path) -> None:
    """Draw a sharp peak with its lines, and the highest peak over the stroke."""
    figure = picture_of("A peak between lines, and the highest peak where it jumps", 9.6, 4.4)
    left, right = figure.subplots(1, 2)
    frequency = 30.0 + _LINE / 2.0
    first = oscillators([2.0 * math.pi * frequency], [_RATIO], [1.0])
    fine, lines = np.linspace(29.7, 30.4, 4001), 29.7 + _LINE * np.arange(8.0)
    left.semilogy(fine, np.abs(first.frf(fine)[:, 0, 0]), color=INK, lw=1.6, label="exact")
    seen = np.abs(first.frf(lines)[:, 0, 0])
    left.semilogy(lines, seen, "o--", color=COLOURS[1], ms=5, lw=1.2, label="0.1 Hz lines")
    peak = first.peak((0.0, 200.0))
    left.plot(peak.frequency, peak.magnitude, "D", color=COLOURS[2], ms=7, label="ours")
    left.set(xlabel="frequency [Hz]", ylabel="|H| [m/N]", title="30.05 Hz, 0.02 %")
    angles = jump + math.radians(6.0) * np.linspace(-1.0, 1.0, 601)
    grid = np.linspace(*STROKE, 46)
    spline = CubicSpline(grid, [_at(model, float(angle)) for angle in grid])
    modes = np.array([model.solve(float(a)).drive_point.local_peaks(np.arange(2)) for a in angles])
    degrees = np.degrees(angles)
    for mode, label in ((0, "both maxima"), (1, None)):
        right.plot(degrees, modes[:, 0, mode], color=GREY, lw=1.0, ls=":", label=label)
    right.plot(degrees, spline(angles), color=COLOURS[1], lw=1.4, label="spline, 46 angles")
    right.plot(degrees, built.evaluate(angles)[:, -2], color=COLOURS[2], lw=1.8, label="ours")
    right.set(
        xlabel="$\\alpha_3$ [deg]", ylabel="frequency of the highest peak [Hz]", title="crank"
    )
    for ax in (left, right):
        ax.title.set_fontsize(9)
        ax.grid(color="#dddddd", linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        ax.legend(fontsize=8, frameon=False)
    figure.savefig(picture)
