# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the picture of docs/excitation.md: ``python -m benchmark.campbell``.

It shows the natural frequencies over the stroke, the engine orders over engine speed, and both over
the shipped drive.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from linkage_vibration.drawing.palette import GREY, INK, mode_colours
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor, ResonanceState
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.support.resources import DEFAULT_TABLE, config_file
from linkage_vibration.table.table import Table, load_table
from test.support.drive import engine_and_pto_speed, hitch_duty_cycle

FloatArray = NDArray[np.float64]

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "campbell.png"
EXCITATIONS = "excitations.yaml"
ENGINE_SPEEDS = np.array([700.0, 2200.0])  # rpm
TOP = 215.0  # Hz
SHADE = "#F9E08B"


def draw(picture: Path) -> None:
    """Draw the picture."""
    table = load_table(config_file(DEFAULT_TABLE))
    figure = Figure(figsize=(9.0, 7.6), dpi=110, layout="constrained")
    panels = figure.subplot_mosaic([["stroke", "engine"], ["drive", "drive"]])
    over_the_stroke(panels["stroke"], table)
    excitations = read_excitations(config_file(EXCITATIONS))
    over_engine_speed(panels["engine"], table, excitations)
    over_the_drive(panels["drive"], Predictor(table), excitations)
    figure.savefig(picture)


def over_the_stroke(ax: Axes, table: Table) -> None:
    """Draw the natural frequencies over the crank angle."""
    alpha3, frequencies = _swept(table)
    for mode, colour in enumerate(mode_colours(table.n_modes)):
        ax.plot(np.degrees(alpha3), frequencies[:, mode], color=colour, lw=2.0)
        place = (130.0, frequencies[len(frequencies) // 2, mode] + 4.0)
        if not table.mode_names[mode].startswith("tractor"):  # these are too near to one another
            ax.annotate(table.mode_names[mode], place, color=colour, fontsize=9)
    first, last = np.degrees(table.alpha3_range)
    ax.set(
        title="Natural frequencies over the stroke",
        xlabel="crank angle [deg]",
        ylabel="frequency [Hz]",
        xlim=(first, last),
        ylim=(0.0, TOP),
        xticks=np.arange(first, last + 1.0, 15.0),
    )


def over_engine_speed(ax: Axes, table: Table, excitations: Sequence[Excitation]) -> None:
    """Draw the engine's orders over its speed, and the range of each mode over the stroke."""
    _, frequencies = _swept(table)
    for mode, colour in enumerate(mode_colours(table.n_modes)):
        low, high = frequencies[:, mode].min(), frequencies[:, mode].max()
        ax.axhspan(low, high, color=colour, alpha=0.25, lw=0.0)
    for one in excitations:
        if one.source is Source.ENGINE:
            ax.plot(ENGINE_SPEEDS, one.ratio * ENGINE_SPEEDS, color=INK, lw=1.0)
            at = min(1500.0, 0.93 * TOP / one.ratio)
            ax.annotate(
                one.name.split()[-1],
                (at, one.ratio * at),
                ha="center",
                va="center",
                fontsize=8,
                bbox={"boxstyle": "round,pad=0.15", "color": "white"},
            )
    ax.set(
        title="Engine orders, and the range of each mode",
        xlabel="engine speed [rpm]",
        xlim=ENGINE_SPEEDS,
        ylim=(0.0, TOP),
    )


def over_the_drive(ax: Axes, predictor: Predictor, excitations: Sequence[Excitation]) -> None:
    """Draw modes, excitations and warnings over the shipped drive."""
    times, resonances = assess_drive(predictor, excitations)
    alpha3 = hitch_duty_cycle()[1]
    frequencies = predictor.table.evaluate(alpha3)[:, : predictor.table.n_modes]
    warned = [resonance.state is ResonanceState.WARNING for resonance in resonances]
    across = ax.get_xaxis_transform()
    ax.fill_between(times, 0, 1, where=warned, transform=across, color=SHADE, lw=0, label="warning")
    names = predictor.table.mode_names
    for name, values, colour in zip(names, frequencies.T, mode_colours(len(names)), strict=True):
        ax.plot(times, values, color=colour, lw=2.0, label=name)
    speed_times, engine, pto = engine_and_pto_speed()
    speeds = {Source.ENGINE: engine, Source.PTO: pto}
    nearest = {resonance.excitation for resonance in resonances}
    for one in excitations:
        if one.name in nearest:
            turning = np.where(speeds[one.source] > 0.0, one.ratio * speeds[one.source], np.nan)
            colour = INK if one.source is Source.ENGINE else GREY
            ax.plot(speed_times, turning, color=colour, lw=1.0)
    for name, height in (("engine 3", 103.0), ("engine 6", 183.0)):
        ax.annotate(name, (0.2, height), fontsize=8)
    ax.annotate("PTO shaft and rotor", (0.2, 21.0), fontsize=8, color=GREY)
    ax.set(
        title="The shipped drive by the margin: a warning begins below 10 % and ends above 12 %",
        xlabel="time [s]",
        ylabel="frequency [Hz]",
        xlim=(0.0, times[-1]),
        ylim=(0.0, TOP),
    )
    ax.legend(loc="lower right", bbox_to_anchor=(0.99, 0.13), ncols=3, fontsize=8)


def assess_drive(
    predictor: Predictor, excitations: Sequence[Excitation]
) -> tuple[FloatArray, list[MessageColumns]]:
    """Assess every joint state of the shipped drive, as the node would.

    Returns
    -------
    times : ndarray, (n,), s
        Times of the joint states.
    resonances : list of MessageColumns, n
        The resonance at each time.
    """
    times, alpha3 = hitch_duty_cycle()
    readings = zip(times.tolist(), alpha3.tolist(), np.gradient(alpha3, times), strict=True)
    speeds = list(zip(*(column.tolist() for column in engine_and_pto_speed()), strict=True))
    monitor, resonances = ResonanceMonitor(excitations), []
    for time, angle, velocity in readings:
        now = round(1e9 * time)
        while speeds and speeds[0][0] <= time:
            _, engine, pto = speeds.pop(0)
            monitor.set_speed(Source.ENGINE, engine, now)
            monitor.set_speed(Source.PTO, pto, now)
        resonances.append(monitor.assess(predictor.predict(angle), float(velocity), now))
    return times, resonances


def _swept(table: Table) -> tuple[FloatArray, FloatArray]:
    """Return angles over the stroke (rad), and the natural frequencies there (Hz)."""
    alpha3 = np.linspace(*table.alpha3_range, 361)
    return alpha3, table.evaluate(alpha3)[:, : table.n_modes]


if __name__ == "__main__":
    draw(PICTURE)
