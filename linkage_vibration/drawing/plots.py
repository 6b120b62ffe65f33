# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws what a log holds."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.reading import read_messages, topic_names
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.support.atomic_files import write_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

PREDICTION_TOPIC = "/linkage_vibration/prediction"
RESONANCE_TOPIC = "/linkage_vibration/resonance"
# Okabe and Ito's palette, which the colour-blind tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#56B4E9", "#E69F00")
INK, GREY = "#222222", "#6b6b6b"
_PEAK, _SHADE, _NEAR = "#AA4499", "#F9E08B", "#CC3311"


class PlotError(LinkageVibrationError):
    """A picture cannot be drawn."""


def plot_predictions(log: Path, picture: Path) -> None:
    """Draw the predictions of a log over time: crank angle, natural frequencies and FRF peak.

    Excitations are drawn where they are near to a natural frequency. The time axis is that of the
    joint states' stamps. Lines break, and the background is shaded,
    where predictions have a status other than OK or are missing.

    Parameters
    ----------
    log : Path
        An MCAP, as the node writes it.
    picture : Path
        The PNG to write; replaced when it exists.

    Raises
    ------
    PlotError
        If matplotlib is missing, if the log holds no prediction, or if the picture cannot be
        written.
    BagError
        If the log cannot be read.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise PlotError(
            "Drawing needs matplotlib; `pip install linkage_vibration[plots]`."
        ) from None
    messages = [message for _, message in read_messages(log, PREDICTION_TOPIC)]
    told = topic_names(log)
    if not messages:
        raise PlotError(f"{log} holds no prediction to draw; was the joint ever published?")
    figure = Figure(figsize=(10, 8.6), dpi=150, layout="constrained")
    near = [
        message
        for _, message in (read_messages(log, RESONANCE_TOPIC) if RESONANCE_TOPIC in told else [])
        if message.state == ResonanceState.WARNING
    ]
    _draw(figure, messages, near)
    figure.suptitle(
        "Natural frequencies and FRF peak of the linkage as its crank turns",
        x=0.01,
        horizontalalignment="left",
        fontweight="bold",
    )
    figure.axes[0].set_title(
        f"{len(messages)} predictions of table {messages[0].table_id}, from {log.name}",
        loc="right",
        fontsize=9,
        color=GREY,
    )
    png = io.BytesIO()
    figure.savefig(png, format="png")
    write_bytes(picture, png.getvalue(), PlotError)


def _draw(figure: "Figure", messages: Sequence[Any], near: Sequence[Any] = ()) -> None:
    """Draw one row each for the angle, every mode (the highest on top) and the peak."""
    from matplotlib.ticker import LogLocator, NullLocator

    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages])
    times = (stamps - stamps[0]) / 1e9
    alpha3 = np.rad2deg([m.crank_angle if np.isfinite(m.crank_angle) else np.nan for m in messages])
    frequencies = np.array([m.natural_frequencies for m in messages])
    peak_frequency = np.array([m.frf_peak_frequency for m in messages])
    peak_magnitude = np.array([m.frf_peak_magnitude for m in messages])
    invalid = np.array([m.status in (1, 2) for m in messages])
    steps = np.diff(times)
    missing = steps > max(0.1, 10 * float(np.median(steps))) if steps.size else steps > 0
    breaks = np.flatnonzero(missing) + 1

    def line(ax: "Axes", values: NDArray[np.float64], **style: Any) -> "Line2D":
        [drawn] = ax.plot(
            np.insert(times, breaks, np.nan), np.insert(values, breaks, np.nan), **style
        )
        return drawn

    n_modes = frequencies.shape[1]
    axes = figure.subplots(n_modes + 2, sharex=True, height_ratios=[1.4, *[1] * n_modes, 1.4])
    line(axes[0], alpha3, color=INK, linewidth=1.6)
    axes[0].set_ylabel("crank angle\n$α_3$ [deg]")
    for mode, ax in zip(reversed(range(n_modes)), axes[1:-1], strict=True):
        colour = COLOURS[mode % len(COLOURS)]
        line(ax, frequencies[:, mode], color=colour, linewidth=3)
        # The peak shows in the row of the mode that it belongs to; it must not stretch the others.
        limits = ax.get_ylim()
        peak = line(ax, peak_frequency, color=INK, linewidth=1.2, linestyle=(0, (3, 3)))
        own = [message for message in near if message.mode == mode]
        if own:
            at = [
                (m.header.stamp.sec * 10**9 + m.header.stamp.nanosec - stamps[0]) / 1e9 for m in own
            ]
            [excited] = ax.plot(
                at, [m.excitation_frequency for m in own], ".", color=_NEAR, markersize=3
            )
        ax.set_ylim(limits)
        ax.set_ylabel(f"mode {mode + 1}\n$f_{mode + 1}$ [Hz]", color=colour)
    line(axes[-1], peak_magnitude, color=_PEAK, linewidth=2)
    axes[-1].set_yscale("log")
    axes[-1].yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
    axes[-1].yaxis.set_major_formatter("{x:.2g}")
    axes[-1].yaxis.set_minor_locator(NullLocator())
    axes[-1].set_ylabel("FRF peak\n[m/N]", color=_PEAK)
    axes[-1].set_xlabel("time [s]")
    axes[-1].set_xlim(times[0], max(times[-1], times[0] + 1e-3))

    keys: dict[str, Any] = {"frequency of the FRF peak": peak}
    if near:
        keys["excitation near a natural frequency"] = excited
    for ax in axes:
        for last in np.flatnonzero(missing):
            keys["no prediction"] = ax.axvspan(
                times[last],
                times[last + 1],
                facecolor="#e4e4e4",
                edgecolor=GREY,
                hatch="//",
                lw=0,
            )
        for start, end in _runs(invalid):
            # The edge keeps a single prediction visible.
            keys[f"angle out of range or invalid ({invalid.sum()} predictions)"] = ax.axvspan(
                times[start], times[min(end, times.size - 1)], color=_SHADE, lw=1, zorder=0
            )
        ax.grid(color="#dddddd", linewidth=0.6)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
        ax.yaxis.label.set(rotation=0, horizontalalignment="right", verticalalignment="center")
        ax.yaxis.labelpad = 12
    figure.align_ylabels(axes)
    figure.legend(
        keys.values(),
        keys.keys(),
        loc="outside lower right",
        ncols=len(keys),
        frameon=False,
        markerscale=3.0,
    )


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return where each run of true values starts, and where it has ended."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(int)))
    return [(int(start), int(end)) for start, end in edges.reshape(-1, 2)]
