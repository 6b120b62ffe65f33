# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws where damped poles meet, and how a damper changes them from zero to rigid."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from benchmark.stability.static_limit import picture_of
from linkage_vibration.drawing.palette import COLOURS, GAP_SHADE, INK

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_NEAR = math.radians(3.0)  # of a meeting
_LINES: dict[str, dict[str, Any]] = {
    "exact": {"color": INK, "lw": 3.5},
    "paired": {"color": COLOURS[1], "lw": 1.4},
    "tracked": {"color": COLOURS[4], "lw": 1.4},
    "ours": {"color": COLOURS[2], "lw": 1.6, "ls": "--"},
}
_WORDS = {
    "exact": "exact",
    "paired": "paired by similarity",
    "tracked": "tracked by shape",
    "ours": "ours",
}
_SIZES = {"exact": 6.0, "paired": 4.0, "ours": 1.6}  # of dots, points


@dataclass(frozen=True)
class Near:
    """Poles around a meeting: for each method a function of alpha3 (rad) that returns rad/s."""

    alpha3: float  # rad, of the meeting
    methods: dict[str, Callable[[float], ComplexArray]]


@dataclass(frozen=True)
class Stroke:
    """Damping ratios over a stroke, 1, by method; rows of NaN and 1 where they are unknown."""

    title: str
    degrees: FloatArray  # (n,)
    ratios: dict[str, FloatArray]  # (n, n_modes), the same modes of every method


@dataclass(frozen=True)
class Sweep:
    """All poles (rad/s) of a linkage at one angle, for each constant of a damper."""

    title: str
    unit: str
    band: float  # Hz
    constants: FloatArray
    poles: Sequence[ComplexArray]


def draw_meetings(off_axis: Near, on_axis: Near, stroke: Stroke, picture: Path) -> None:
    """Draw frequencies and ratios where poles meet, and ratios over the stroke of the hitch.

    Parameters
    ----------
    off_axis, on_axis, stroke, picture
        Poles of the crank around two meetings; ratios; file to write.
    """
    title = "Where damped poles meet, or damping is strong, pairing and splines fail"
    figure = picture_of(title, 11.0, 4.6)
    left, middle, right = figure.subplots(1, 3)
    _near(left, off_axis, lambda poles: np.abs(poles) / (2.0 * math.pi))
    left.set(ylabel="natural frequency [Hz]", title="crank, poles meet off the real axis")
    _near(middle, on_axis, _highest_ratio)
    middle.axvspan(math.degrees(on_axis.alpha3), middle.get_xlim()[1], color=GAP_SHADE, lw=0)
    middle.text(
        math.degrees(on_axis.alpha3 + _NEAR / 2.0),
        0.82,
        "overdamped:\nno frequency, NaN",
        fontsize=8,
        ha="center",
    )
    middle.set(ylabel="damping ratio [1]", title="crank, poles meet on the real axis")
    middle.set_ylim(0.75, 1.1)
    for name, values in stroke.ratios.items():
        colour, size = _LINES[name]["color"], _SIZES[name]
        lines = right.semilogy(stroke.degrees, values, "o", color=colour, ms=size)
        lines[0].set_label(_WORDS[name])
    right.set(ylabel="damping ratio [1]", title=stroke.title)
    for ax in (left, middle, right):
        ax.set_xlabel("$\\alpha_3$ [deg]")
        _finish(ax)
        ax.legend(fontsize=8, frameon=False)
    figure.savefig(picture)


def _highest_ratio(poles: ComplexArray) -> FloatArray:
    ratios = -poles.real / np.abs(poles)
    return np.where(np.isfinite(ratios).all(), ratios.max(keepdims=True), math.nan)


def _near(ax: Axes, near: Near, value: Callable[[ComplexArray], FloatArray]) -> None:
    """Draw values of poles around a meeting by every method."""
    angles = near.alpha3 + _NEAR * np.linspace(-1.0, 1.0, 601)
    for name, poles in near.methods.items():
        rows = np.array([value(poles(float(angle))) for angle in angles])
        lines = ax.plot(np.degrees(angles), rows, **_LINES[name])
        lines[0].set_label(_WORDS[name])
    ax.set_xlim(*np.degrees(angles[[0, -1]]))


def draw_sweeps(sweeps: Sequence[Sweep], picture: Path) -> None:
    """Draw poles in the complex plane, and frequencies and ratios over a damper's constant.

    Parameters
    ----------
    sweeps, picture
        One row of the picture for each; file to write.
    """
    title = "A damper from zero to rigid: ratios rise and fall, and a pair may become real"
    figure = picture_of(title, 11.0, 7.0)
    for row, sweep in zip(figure.subplots(len(sweeps), 3), sweeps, strict=True):
        _draw_sweep(row, sweep)
    figure.savefig(picture)


def _draw_sweep(row: Sequence[Axes], sweep: Sweep) -> None:
    """Draw poles, frequencies and damping ratios of one linkage."""
    plane, frequencies, ratios = row
    counts = [len(poles) for poles in sweep.poles]
    c, poles = np.repeat(sweep.constants, counts), np.concatenate(sweep.poles) / (2.0 * math.pi)
    near = np.abs(poles) < 1.3 * sweep.band
    c, poles = c[near], poles[near]
    waves = poles.imag > 0.0
    drawn = plane.scatter(poles.real, poles.imag, c=np.log10(c), s=6, cmap="viridis")
    bar = row[0].figure.colorbar(drawn, ax=plane)
    bar.set_label(f"log10 of damper [{sweep.unit}]")
    plane.set(xlabel="real part / 2$\\pi$ [Hz]", ylabel="imaginary part / 2$\\pi$ [Hz]")
    plane.set_title(f"{sweep.title}: poles")
    plane.set_xlim(-0.45 * sweep.band, 0.03 * sweep.band)
    frequencies.set_ylim(-0.05 * sweep.band, 1.7 * sweep.band)
    ratios.set_ylim(3e-3, 1.5)
    sizes, decay = np.abs(poles), -poles.real / np.abs(poles)
    for chosen, colour, words in (
        (waves, COLOURS[0], "modes that oscillate"),
        (~waves, COLOURS[1], "real poles (overdamped)"),
    ):
        frequencies.semilogx(c[chosen], sizes[chosen], "o", ms=2, color=colour, label=words)
    frequencies.legend(fontsize=8, frameon=False, markerscale=2)
    ratios.loglog(c[waves], decay[waves], "o", ms=2, color=COLOURS[0])
    frequencies.set(ylabel="|pole| / 2$\\pi$ [Hz]", title="frequencies")
    ratios.set(ylabel="damping ratio [1]", title="damping ratios")
    for ax in (frequencies, ratios):
        ax.set_xlabel(f"damper [{sweep.unit}]")
    for ax in row:
        _finish(ax)


def _finish(ax: Axes) -> None:
    ax.title.set_fontsize(9)
    ax.grid(color="#dddddd", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
