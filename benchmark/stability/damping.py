# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Damped poles that meet, a damper from zero to rigid, and modes paired by similarity."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment

from benchmark.report import table
from benchmark.stability.damping_pictures import Near, Stroke, Sweep, draw_meetings, draw_sweeps
from linkage_vibration.mechanics.description import Spring
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.modes import damp_modes
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from test.support.crossing import (
    AT,
    GAP,
    RATIO,
    STROKE,
    crossing_crank,
    meeting_off_axis,
    meeting_on_axis,
    poles_at,
)

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

TITLE = "Damping that couples modes"

_POINTS = 46  # as many as the paper has configurations
_DISTANCES = (10.0, 1.0, 0.1, 1e-3, 1e-5, 1e-7, 1e-9)  # deg, from a meeting of poles
_ANGLES = 150  # random ones, at which tables are compared with the model
_STEPS = 150  # of a sweep that is drawn
_ALONE = 1e-6  # N/m or N m/rad, of a spring that is only a damper
_RIGID = 1e12  # N/m or N m/rad


@dataclass(frozen=True)
class Damper:
    """Where a shipped linkage has a damper, and the constants of the sweep."""

    name: str
    words: str
    unit: str
    bodies: tuple[str, str]
    points: tuple[str, ...]
    alpha3_deg: float
    sweep: tuple[float, ...]
    drawn: tuple[float, float]  # powers of ten
    tables: tuple[float, ...]

    def model(self, damping: float, stiffness: float = _ALONE) -> LinkageModel:
        """Return the linkage with a damper of a constant, and with a spring beside it."""
        mechanism = read_mechanism(config_file(f"{self.name}.yaml"))
        spring = Spring("damper", self.bodies, self.points, stiffness, damping)
        return LinkageModel(replace(mechanism, springs=(spring,)))


HITCH = Damper(
    "three_point_linkage",
    "hitch, joint P1",
    "N m s/rad",
    ("lower_link", "ground"),
    ("P1",),
    140.0,
    (0.0, 20.0, 100.0, 500.0, 5e3, 1e5, 1e7),
    (0.0, 6.0),
    (20.0, 500.0, 5e3),
)
FOUR_BAR = Damper(
    "four_bar",
    "four-bar, A to C",
    "N s/m",
    ("ground", "coupler"),
    ("A", "C"),
    0.0,
    (0.0, 100.0, 1e3, 5e3, 1e4, 1e5, 1e8),
    (1.0, 7.0),
    (1e4, 1e6),
)


@dataclass(frozen=True)
class Meeting:
    """A crank two of whose poles meet at an angle."""

    dashpot: float  # N s/m
    alpha3: float  # rad
    ours: Table
    solutions: int
    plain: dict[str, CubicSpline]  # of the poles of two modes, rad/s

    def exact(self, alpha3: float) -> ComplexArray:
        """Return the poles of both modes, (2,), rad/s; NaN where one does not oscillate."""
        return np.array([*poles_at(self.dashpot, alpha3), math.nan])[:2]

    def tabulated(self, alpha3: float) -> ComplexArray:
        """Return the two poles of the table, rad/s; NaN where a mode is overdamped."""
        values = self.ours.evaluate(np.array([alpha3]))[0]
        return _poles(values[:2], values[2:4])

    @property
    def near(self) -> Near:
        """What is drawn around the meeting."""
        return Near(self.alpha3, {"exact": self.exact, **self.plain, "ours": self.tabulated})

    def error(self, method: str, alpha3: float) -> float:
        """Return the largest error of a pole, relative to its magnitude."""
        exact = self.exact(alpha3)
        result = self.tabulated(alpha3) if method == "ours" else self.plain[method](alpha3)
        apart = np.abs(result[np.isfinite(result)][:, np.newaxis] - exact) / np.abs(exact)
        return float(apart[linear_sum_assignment(apart)].max())

    def worst(self, method: str, distance: float) -> float:
        """Return the same at a distance (rad) from the meeting, where both modes oscillate."""
        near = (self.alpha3 - distance, self.alpha3 + distance)
        return max(self.error(method, at) for at in near if np.isfinite(self.exact(at)).all())


@dataclass(frozen=True)
class Compared:
    """Damped modes at random angles: those of the model, paired by similarity, and of a table."""

    damper: Damper
    damping: float
    degrees: FloatArray  # (n,), ascending
    exact: list[FloatArray]  # n arrays (2, n_modes): Hz and 1, of the modes that oscillate
    paired: FloatArray  # (n, 2, 3)
    ours: FloatArray  # (n, 2, 3)
    table: Table
    solutions: int

    @property
    def over_the_stroke(self) -> Stroke:
        """What is drawn: the lowest modes, as many as the table has."""
        n = self.ours.shape[2]
        exact = np.array([ratios[:n] for _, ratios in self.exact])
        ratios = {"exact": exact, "paired": self.paired[:, 1], "ours": self.ours[:, 1]}
        words = f"{self.damper.words}, {self.damping:g} {self.damper.unit}: modes 1 to {n}"
        return Stroke(words, self.degrees, ratios)


def section(pictures: Path) -> str:
    """Measure poles that meet, dampers from zero to rigid, and paired modes, and report."""
    off, on = _meeting(*meeting_off_axis()), _meeting(*meeting_on_axis())
    compared = [_compare(damper, c) for damper in (HITCH, FOUR_BAR) for c in damper.tables]
    draw_meetings(off.near, on.near, compared[2].over_the_stroke, pictures / "damping.png")
    draw_sweeps([_drawn_sweep(damper) for damper in (HITCH, FOUR_BAR)], pictures / "damper.png")
    return f"""\
A common method pairs each undamped mode with the damped mode whose shape is most like it (*paired*;
the former method of this package): the mode keeps its undamped frequency, and receives the damping
ratio of its partner. Another one follows damped poles by their complex shapes from angle to angle,
and interpolates them (*tracked*). Ours interpolates a small matrix whose eigenvalues are all the
poles in reach of the band. Therefore it does not matter how these veer, meet or become real.

**Two poles that meet.** The crank of section 5 has a damper in its spring. With
{off.dashpot:.4f} N s/m, the poles of its two modes meet at {math.degrees(off.alpha3):.4f} deg off
the real axis, at {_text(off.alpha3, off.exact)} rad/s. With {on.dashpot:g} N s/m, one pole meets
its conjugate on the real axis at {math.degrees(on.alpha3):.4f} deg, and the mode is overdamped
beyond it. At such an exceptional point the poles change with the square root of the distance, and
their shapes coincide, while their sum and their product are smooth. The table shows the largest
error of a pole, relative to its magnitude, compared with the three equations of motion of this
crank. Paired and tracked poles are interpolated by cubic splines between {_POINTS} equispaced
angles:

{_meeting_table(off, on)}

Any error of the model, even rounding, changes a pole in inverse proportion to the square root of
the distance. Ours reaches {_largest(off, on):.0e}. On the axis, frequency
and damping ratio do not suffer, because they follow from the product and the sum. The two tables
have {off.solutions} and {on.solutions} solutions. They report errors of frequencies and damping
ratios of {off.ours.interpolation_error.max():.0e} and {on.ours.interpolation_error.max():.0e}.

![Poles that meet, and damping ratios of the hitch over its stroke](stability/damping.png)

**From zero to rigid.** The next tables are for the shipped hitch at {HITCH.alpha3_deg:g} deg with a
damper in joint P1 of the lower link, and for the shipped four-bar at {FOUR_BAR.alpha3_deg:g} deg
with one between A and C. They show natural frequency and damping ratio of the first three modes
that oscillate, and the real poles below 1.3 times the band, as |lambda| / 2 pi. In the last row
there is a spring of {_RIGID:.0e} N m/rad or N/m instead. Damping ratios rise with the damper, then
fall. A pair that becomes real has one pole that leaves the band and one that goes to 0 Hz. The
modes that remain are those of the linkage with a rigid damper:

{_sweep_table(HITCH)}

{_sweep_table(FOUR_BAR)}

![Poles, frequencies and damping ratios from no damper to a rigid one](stability/damper.png)

**How far pairing is off.** The next table compares the first three modes with the model at
{_ANGLES} random angles. For pairing, it shows by which factor a damping ratio differs from that of
the damped mode nearest in frequency, at how many angles by more than 10 %, and by how much the
frequency differs from that mode's. For ours, it shows the largest relative error of a frequency or
damping ratio, and the reported one. Where a mode of the table is overdamped, its frequency and
damping ratio are NaN; the table shows at how many angles one is:

{_pairing_table(compared)}

A weak damper leaves pairs that are right. A strong one makes shapes that are like none of the
undamped ones. Then pairing gives a mode of the band two real poles, one slow and one fast, which
have nothing to do with each other. It reports no error.

Tests: `test/table/tabulation/test_meeting_poles.py`, `test/table/tabulation/test_coupled.py`,
`test/test_benchmarks.py::test_pairs_by_similarity_are_wrong`,
`::test_damper_from_zero_to_rigid`.
"""


def _text(alpha3: float, exact: Callable[[float], ComplexArray]) -> str:
    """Return the pole at a meeting."""
    pole = exact(alpha3).mean()
    return f"{pole.real:.3f} + {pole.imag:.3f}i"


def _poles(frequencies: FloatArray, ratios: FloatArray) -> ComplexArray:
    """Return poles (rad/s) from natural frequencies (Hz) and damping ratios."""
    return np.asarray(2 * math.pi * frequencies * (-ratios + 1j * np.sqrt(1 - ratios**2 + 0j)))


def _meeting(dashpot: float, alpha3: float) -> Meeting:
    model = LinkageModel(crossing_crank(GAP, AT, RATIO, dashpot))
    solutions: list[float] = []
    ours = build_table(model, progress=solutions.append)
    grid = np.linspace(*STROKE, _POINTS)
    solved = [model.solve(float(angle)) for angle in grid]
    paired = np.array([_poles(*(x[:2] for x in plain_pairs(solution))) for solution in solved])
    plain = {"paired": CubicSpline(grid, paired), "tracked": CubicSpline(grid, _tracked(solved))}
    return Meeting(dashpot, alpha3, ours, len(solutions), plain)


def plain_pairs(solution: Solution) -> tuple[FloatArray, FloatArray]:
    """Return undamped frequencies (Hz), and the ratios of the damped modes most like them.

    This was the former method of this package. It made pairs of the real poles first, the slowest
    with the fastest.
    """
    result = solution.damped
    assert result.poles is not None
    assert result.shapes is not None
    poles, shapes = result.poles.ravel(), np.hstack(list(result.shapes))
    upper, real = np.flatnonzero(poles.imag > 0.0), np.flatnonzero(poles.imag == 0.0)
    real = real[np.argsort(poles[real].real)]
    half = len(real) // 2
    first = np.concatenate([upper, real[half:]])
    second = np.concatenate([poles[upper].conj(), poles[real[:half][::-1]]])
    alike = np.abs(shapes[:, first]) / np.linalg.norm(shapes[:, first], axis=0)
    order = linear_sum_assignment(alike, maximize=True)[1]
    single, other = poles[first][order], second[order]
    ratios = -(single + other).real / (2.0 * np.sqrt((single * other).real))
    return solution.modes.omega / (2.0 * math.pi), ratios


def _tracked(solutions: list[Solution]) -> ComplexArray:
    """Return two poles at each angle, (n, 2), rad/s, followed by their complex shapes."""
    before, poles = None, []
    for solution in solutions:
        result = solution.damped
        assert result.poles is not None
        assert result.shapes is not None
        shapes = solution.modes.shapes @ result.shapes[0]
        shapes = shapes / np.linalg.norm(shapes, axis=0)
        order = np.arange(2)
        if before is not None:
            order = linear_sum_assignment(np.abs(before.conj().T @ shapes), maximize=True)[1]
        before = shapes[:, order]
        poles.append(result.poles[0][order])
    return np.array(poles)


def _largest(*meetings: Meeting) -> float:
    """Return our largest error in the table of meetings."""
    return max(m.worst("ours", math.radians(d)) for m in meetings for d in _DISTANCES)


def _meeting_table(*meetings: Meeting) -> str:
    rows = []
    for distance in _DISTANCES:
        errors = [
            f"{meeting.worst(method, math.radians(distance)):.0e}"
            for meeting in meetings
            for method in ("paired", "tracked", "ours")
        ]
        rows.append([f"{distance:g}", *errors])
    columns = ["off the axis: paired", "tracked", "ours", "on the axis: paired", "tracked", "ours"]
    return table(["distance, deg", *columns], rows)


def sweep(damper: Damper, constants: FloatArray) -> list[ComplexArray]:
    """Return all poles at one angle for each constant of a damper, of pairs the upper, rad/s."""
    alpha3 = math.radians(damper.alpha3_deg)
    base, unit = (damper.model(c).solve(alpha3) for c in (0.0, 1.0))
    per_unit = unit.coupled.damping - base.coupled.damping
    result = []
    for constant in constants.tolist():
        system = replace(base.coupled, damping=base.coupled.damping + constant * per_unit)
        modes = damp_modes(system, base.modes.omega, base.vectors)
        if modes.poles is None:
            omega, ratios = base.modes.omega, modes.damping_ratios
            result.append(_poles(omega / (2.0 * math.pi), ratios))
        else:
            poles = modes.poles.ravel()
            result.append(poles[poles.imag >= 0.0])
    return result


def _drawn_sweep(damper: Damper) -> Sweep:
    constants = np.logspace(*damper.drawn, _STEPS)
    band = damper.model(0.0).mechanism.response.band[1]
    title = f"{damper.words}, {damper.alpha3_deg:g} deg"
    return Sweep(title, damper.unit, band, constants, sweep(damper, constants))


def _sweep_table(damper: Damper) -> str:
    """Return how the modes change from no damper to a rigid one."""
    band = damper.model(0.0).mechanism.response.band[1]
    rigid = damper.model(0.0, _RIGID).solve(math.radians(damper.alpha3_deg))
    last = _poles(rigid.natural_frequencies, rigid.damping_ratios)
    rows = []
    for constant, poles in zip(
        [f"{c:g}" for c in damper.sweep] + ["rigid"],
        [*sweep(damper, np.array(damper.sweep)), last],
        strict=True,
    ):
        waves = np.array(sorted(poles[poles.imag > 0.0], key=abs)[:3])
        texts = [f"{abs(p) / (2 * math.pi):.2f} Hz, {-p.real / abs(p):.4f}" for p in waves]
        real = np.sort(np.abs(poles[poles.imag == 0.0])) / (2.0 * math.pi)
        texts.append(", ".join(f"{r:.3g} Hz" for r in real[real < 1.3 * band]) or "none")
        rows.append([constant, *texts])
    columns = ["mode 1", "mode 2", "mode 3", "real poles"]
    return table([f"{damper.words}, {damper.unit}", *columns], rows)


def _compare(damper: Damper, damping: float) -> Compared:
    """Solve a linkage at random angles, pair its modes, and build its table."""
    model = damper.model(damping)
    solutions: list[float] = []
    built = build_table(model, progress=solutions.append)
    angles = np.sort(np.random.default_rng(13).uniform(*model.mechanism.stroke, _ANGLES))
    solved = [model.solve(float(angle)) for angle in angles]
    exact = [np.array([s.natural_frequencies, s.damping_ratios]) for s in solved]
    paired = np.array([[values[:3] for values in plain_pairs(s)] for s in solved])
    ours = built.evaluate(angles)[:, :6].reshape(-1, 2, 3)
    return Compared(damper, damping, np.degrees(angles), exact, paired, ours, built, len(solutions))


def _pairing_table(compared: list[Compared]) -> str:
    rows = []
    for case in compared:
        factors, frequencies, errors = [], [], []
        for exact, paired, ours in zip(case.exact, case.paired, case.ours, strict=True):
            near = np.abs(exact[0] - paired[0][:, np.newaxis]).argmin(axis=1)
            frequencies.append(np.abs(paired[0] / exact[0, near] - 1.0).max())
            factors.append(np.exp(np.abs(np.log(paired[1] / exact[1, near])).max()))
            errors.append(_own_error(exact, ours))
        own = max(errors)
        rows.append(
            [
                f"{case.damper.words}, {case.damping:g} {case.damper.unit}",
                f"{max(factors):.2f}" if max(factors) < 100.0 else f"{max(factors):.0e}",
                f"{100 * np.mean(np.array(factors) > 1.1):.0f} %",
                f"{100 * max(frequencies):.1f} %",
                f"{own:.0e}",
                f"{case.table.interpolation_error.max():.0e}",
                f"{100 * np.isnan(case.ours[:, 0]).any(axis=1).mean():.0f} %",
                f"{case.solutions}",
            ]
        )
    columns = ["linkage, damper", "paired: ratio by", "over 10 %", "frequency", "ours"]
    return table([*columns, "its estimate", "overdamped", "solutions"], rows)


def _own_error(exact: FloatArray, ours: FloatArray) -> float:
    """Return the largest relative error of the table's frequencies and ratios at an angle."""
    waves = ours[:, np.isfinite(ours[0])]
    apart = np.abs(_poles(*waves)[:, np.newaxis] - _poles(*exact))
    rows, columns = linear_sum_assignment(apart)
    return float(np.abs(waves[:, rows] / exact[:, columns] - 1.0).max(initial=0.0))
