# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the predictions of a log as a PNG picture."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.message_columns import (
    PLACE,
    Columns,
    first_topic,
    header_stamps,
    read_columns,
    topic_types,
)
from linkage_vibration.drawing import palette
from linkage_vibration.drawing.intervals import (
    gap_starts,
    in_passes,
    one_after_the_other,
    runs,
)
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.messages.topics import PREDICTION, RESONANCE
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.prediction.resonance import ResonanceState
from linkage_vibration.support.atomic_files import write_bytes
from linkage_vibration.support.version import check_versions

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D


_NEAR = "#CC3311"  # an excitation near a natural frequency


class PlotError(LinkageVibrationError):
    """A picture cannot be drawn."""


def require_matplotlib() -> None:
    """Import matplotlib before anything long begins.

    Raises
    ------
    PlotError
        If it is missing.
    OldLibraryError
        If it is too old.
    """
    check_versions("matplotlib", "pillow")
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError:
        raise PlotError(
            "Drawing needs matplotlib; `pip install linkage_vibration[plots]`."
        ) from None


def legend_below(
    figure: "Figure",
    handles: "Sequence[Artist]",
    labels: Sequence[str],
    loc: Literal["lower center", "lower right"],
    **style: Any,
) -> None:
    """Draw a legend at the bottom of a figure, and leave its height free of axes.

    Matplotlib does so by itself since 3.7, with "outside" in `loc`.
    """
    legend = figure.legend(handles, labels, loc=loc, frameon=False, **style)
    top = legend.get_window_extent().y1 / figure.bbox.height
    layout: Any = figure.get_layout_engine()
    left, bottom, width, height = layout.get()["rect"]
    layout.set(rect=(left, top, width, bottom + height - top))


def tidy(ax: "Axes") -> None:
    """Draw a grid behind the curves, and no frame at the top and on the right."""
    ax.grid(color="#dddddd", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def plain(text: str) -> str:
    """Return a text that matplotlib does not read as a formula."""
    return text.replace("$", r"\$")


def plot_predictions(log: Path, picture: Path, names: Sequence[str] = ()) -> None:
    """Draw crank angle, natural frequencies and FRF peak of a log over the time of its stamps.

    Excitations are drawn where they are near a natural frequency. Where predictions are missing or
    have no numbers, the lines break and the background is shaded. A `PlotError` is raised if
    matplotlib is missing, if the log holds no prediction, or if the picture cannot be written, and
    a `BagError` if the log cannot be read.
    """
    require_matplotlib()
    from matplotlib.figure import Figure

    predictions, resonances = _read(log)
    figure = Figure(figsize=(10, 8.6), dpi=150, layout="constrained")
    _draw(figure, predictions, resonances, names)
    title = "Natural frequencies and FRF peak of the linkage as its crank turns"
    figure.suptitle(title, x=0.01, horizontalalignment="left", fontweight="bold")
    table_ids = predictions["table_id"]
    about = f"{len(table_ids)} predictions of table {table_ids[0]}, from {log.name}"
    figure.axes[0].set_title(plain(about), loc="right", fontsize=9, color=palette.GREY)
    png = io.BytesIO()
    figure.savefig(png, format="png")
    write_bytes(picture, png.getvalue(), PlotError)


def _read(log: Path) -> tuple[Columns, Columns]:
    """Return the predictions and the resonances of a log; no columns where it has no resonance."""
    types = topic_types(log)
    topics = [first_topic(types, kind) for kind in (PREDICTION, RESONANCE)]
    wanted = {topic: types[topic] for topic in topics if topic}
    columns = read_columns(log, wanted, as_written=True)
    predictions, resonances = (columns.get(topic, {}) for topic in topics)
    if not len(predictions.get("status", ())):
        raise PlotError(f"{log} holds no prediction to draw; was the joint ever published?")
    order, _ = in_passes(header_stamps(predictions))
    return {name: column[order] for name, column in predictions.items()}, resonances


def _draw(
    figure: "Figure", predictions: Columns, resonances: Columns, names: Sequence[str] = ()
) -> None:
    """Draw one row for the angle, one for each mode (the highest on top) and one for the peak."""
    n_modes = predictions["natural_frequencies"].shape[1]
    stamps = header_stamps(predictions)
    jumps = in_passes(stamps)[1]
    times = one_after_the_other(stamps, jumps)
    gaps = gap_starts(times)
    axes = figure.subplots(n_modes + 2, sharex=True, height_ratios=[1.4, *[1] * n_modes, 1.4])
    rows = axes[-2:0:-1]  # of the modes, from the lowest
    breaks = np.union1d(gaps + 1, jumps)
    keys: dict[str, Artist] = _draw_lines(axes, times, breaks, predictions)
    for mode, (name, ax) in enumerate(zip(names, rows, strict=False)):
        ax.set_ylabel(f"{plain(name)}\n$f_{mode + 1}$ [Hz]")
    near = resonances["state"] == ResonanceState.WARNING if resonances else np.zeros(0, bool)
    if near.any():
        places = np.maximum.accumulate(predictions[PLACE])
        at = np.interp(resonances[PLACE], places, times)
        for mode, ax in enumerate(rows):
            of_mode = near & (resonances["mode"] == mode)
            values = resonances["excitation_frequency"][of_mode]
            [dots] = ax.plot(at[of_mode], values, ".", color=_NEAR, markersize=3)
            keys["excitation near a natural frequency"] = dots
    invalid = np.isin(predictions["status"], (Status.OUT_OF_RANGE, Status.INVALID_ANGLE))
    for frequencies, ax in zip(predictions["natural_frequencies"].T, rows, strict=True):
        if spans := _spans(times, np.isnan(frequencies) & ~invalid):
            shaded = _shaded(ax, spans, color=palette.OVERDAMPED_SHADE)
            keys["overdamped, without a frequency"] = shaded
    for ax in axes:
        if len(gaps):
            shade = {"facecolor": palette.GAP_SHADE, "edgecolor": palette.GREY, "hatch": "//"}
            missing = np.column_stack([times[gaps], times[gaps + 1]]).tolist()
            keys["no prediction"] = _shaded(ax, missing, lw=0, **shade)
        for i in jumps:
            style = {"color": palette.INK, "lw": 1.2, "linestyle": (0, (1, 2))}
            keys["the clock jumped back"] = ax.axvline(times[i], **style)
        if spans := _spans(times, invalid):
            shaded = _shaded(ax, spans, color=palette.INVALID_SHADE)
            keys[f"angle out of range or invalid ({invalid.sum()} predictions)"] = shaded
        tidy(ax)
        ax.yaxis.label.set(rotation=0, horizontalalignment="right", verticalalignment="center")
        ax.yaxis.labelpad = 12
    figure.align_ylabels(axes)
    style = {"ncols": len(keys), "markerscale": 3.0}
    legend_below(figure, list(keys.values()), list(keys), "lower right", **style)


def _spans(times: FloatArray, flags: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return the start and the end of each run of flagged predictions, s."""
    last = len(times) - 1
    return [(float(times[start]), float(times[min(end, last)])) for start, end in runs(flags)]


def _shaded(ax: "Axes", spans: Sequence[tuple[float, float]], **style: Any) -> "Artist":
    """Shade spans of time over the whole height; thousands are one artist, which is fast."""
    from matplotlib.collections import PolyCollection

    corners = [[(a, 0.0), (a, 1.0), (b, 1.0), (b, 0.0)] for a, b in spans]
    # The edge keeps a single prediction visible.
    style = {"lw": 1.0, "zorder": 0, "transform": ax.get_xaxis_transform(), **style}
    return ax.add_collection(PolyCollection(corners, **style), autolim=False)


def _draw_lines(
    axes: "Sequence[Axes]", times: FloatArray, breaks: NDArray[np.int64], columns: Columns
) -> "dict[str, Artist]":
    """Draw the quantities over time, interrupted before ``breaks``; return the legend's entry."""
    from matplotlib.ticker import LogLocator, NullLocator

    def line(ax: "Axes", values: FloatArray, **style: Any) -> "Line2D":
        with_breaks = (np.insert(column, breaks, np.nan) for column in (times, values))
        [drawn] = ax.plot(*with_breaks, **style)
        return drawn

    angles = np.where(np.isfinite(columns["crank_angle"]), columns["crank_angle"], np.nan)
    line(axes[0], np.rad2deg(angles), color=palette.INK, lw=1.6)
    axes[0].set_ylabel("crank angle\n$α_3$ [deg]")
    frequencies = columns["natural_frequencies"].T
    colours = palette.mode_colours(len(frequencies))
    for mode, ax in reversed(list(enumerate(axes[-2:0:-1]))):
        line(ax, frequencies[mode], color=colours[mode], lw=3)
        # The row of the peak's own mode shows the peak; it must not stretch the other rows.
        limits = ax.get_ylim()
        dashed: dict[str, Any] = {"color": palette.INK, "lw": 1.2, "linestyle": (0, (3, 3))}
        peak = line(ax, columns["frf_peak_frequency"], **dashed)
        ax.set_ylim(limits)
        ax.set_ylabel(f"mode {mode + 1}\n$f_{mode + 1}$ [Hz]", color=colours[mode])
    last = axes[-1]
    line(last, columns["frf_peak_magnitude"], color=palette.PEAK, lw=2)
    last.set_yscale("log")
    last.yaxis.set_major_locator(LogLocator(subs=(1, 1.5, 2, 3, 5, 7)))
    last.yaxis.set_major_formatter("{x:.3g}")
    last.yaxis.set_minor_locator(NullLocator())
    last.set_ylabel("FRF peak\n[m/N]", color=palette.PEAK)
    last.set_xlabel("time [s]")
    last.set_xlim(times[0], max(times[-1], times[0] + 1e-3))
    return {"frequency of the FRF peak": peak}
