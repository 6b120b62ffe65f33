# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a log as a PNG picture: frequencies over time, and below them the load ratio."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.intervals import gap_starts
from linkage_vibration.drawing.mechanism_picture import draw_modes
from linkage_vibration.drawing.plots import (
    draw_bands,
    frequency_axis,
    name_modes,
    require_matplotlib,
    shaded,
    tidy,
    write_png,
)
from linkage_vibration.drawing.pose_picture import lowest_modes, pose_figure, shapes_figure
from linkage_vibration.drawing.result_pictures import draw_frf, draw_sweep, is_sweep
from linkage_vibration.errors import check_type
from linkage_vibration.mechanics.arrays import FloatArray, runs
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.frf import Frf
from linkage_vibration.mechanics.model import LinkageModel, ModeShape, Solution
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.prediction.severity import WarningLimits
from linkage_vibration.prediction.verdict import Drive, above_and_below, ground_and_orders
from linkage_vibration.review.findings import all_counted, log_limits, speeds_at_drive
from linkage_vibration.review.log import Log
from linkage_vibration.table.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_Drawable = Mechanism | Solution | ModeShape | Frf | Table | MessageColumns | Log
_LEAST_LOAD = 0.1  # A smaller share of the limit is drawn as a smaller width.
_FAINT_COLOUR = "#bdbdbd"
_WIDEST = 7.0  # points, the width of the line of the largest load
_LABELLED = 4  # So many orders, those of the largest loads, have their names beside them.
_ANGLES = 181  # of a curve over the stroke
_LEAST_APART = 0.045  # of the height: names of modes are at least so far apart


def plot(source: _Drawable, picture: str | Path | None = None) -> "Figure":
    """Draw whatever has a picture.

    Parameters
    ----------
    source : Mechanism, Solution, ModeShape, Frf, Table, MessageColumns, Log or xarray.Dataset
        A mechanism is drawn in the middle of its stroke, a solution in the shapes of its lowest
        modes, and what `Solution.shape` returns in one shape. Of a table, of predictions at many
        angles and of a dataset of `sweep`, natural frequencies are drawn; a log is drawn over time,
        with its excitations and the load ratio.
    picture : str or Path, optional
        A PNG file to write.

    Returns
    -------
    matplotlib.figure.Figure
        A notebook shows it.

    Raises
    ------
    PlotError
        If Matplotlib is missing, the file cannot be written, or there is too much to draw.

    Examples
    --------
    >>> import linkage_vibration as lv
    >>> solution = lv.LinkageModel(lv.read_mechanism()).solve(2.3)
    >>> figure = lv.plot(solution.shape(2))
    >>> figure.axes[0].get_xlabel()
    'x, forward [m]'
    """
    if not is_sweep(source):
        hint = "give one of these, such as `frf.at(frequencies)`, or a dataset of `sweep`"
        check_type(source, hint, *get_args(_Drawable))
    require_matplotlib()
    figure = _drawn(source)
    if picture is not None:
        write_png(figure, Path(picture))
    return figure


def _drawn(source: Any) -> "Figure":
    """Return the figure of what has one."""
    from matplotlib.figure import Figure

    match source:
        case Mechanism():
            return pose_figure(LinkageModel(source), sum(source.stroke) / 2.0)
        case ModeShape():
            return shapes_figure([source])
        case Solution():
            return shapes_figure([source.shape(mode) for mode in lowest_modes(source)])
        case Log():
            figure = Figure(figsize=(10.0, 7.6), dpi=150, layout="constrained")
            draw_log(figure, source)
            return figure
    figure = Figure(figsize=(9.0, 4.5), dpi=110, layout="constrained")
    match source:
        case Frf():
            draw_frf(figure, source)
        case Table():
            predictions = Predictor(source).predict(np.linspace(*source.alpha3_range, _ANGLES))
            draw_modes(figure.subplots(), source.mode_names, [predictions], source.lateral_modes)
        case MessageColumns():
            names = [""] * source.natural_frequencies.shape[1]  # they are drawn as their numbers
            draw_modes(figure.subplots(), names, [source.rows(np.argsort(source.crank_angle))])
        case _:
            draw_sweep(figure.subplots(), source)
    return figure


def draw_log(figure: "Figure", log: Log) -> None:
    """Draw modes and excitations over time, and below them the total load ratio, if it is known."""
    drive, limits = log.drive, log_limits(log)
    loaded = drive is not None and bool(np.isfinite(_total(drive)).any())
    panels = figure.subplots(
        2 if loaded else 1, sharex=True, squeeze=False, height_ratios=[2.2, 1.0][: 1 + loaded]
    )[:, 0]
    upper, lower = panels[0], panels[-1]
    above = list[tuple[float, float]]()
    ends, orders = _draw_modes(upper, log), list[tuple[str, float]]()
    if drive is not None and loaded:
        orders = _draw_excitations(upper, log, drive, limits)
        _draw_total(lower, log, drive, limits)
        times = [*drive.times.tolist(), float(drive.times[-1] + drive.held[-1])]
        above = [(times[i], times[j]) for i, j in runs(above_and_below(drive, limits.warning)[0])]
    names = [log.mode_name(mode) for mode in range(log.n_modes)]
    name_modes(upper, ends, names, orders, least=_LEAST_APART)
    for ax in panels:
        if above:
            shaded(ax, above, color=palette.ABOVE_SHADE)
        _shade_what_is_missing(ax, log)
        tidy(ax)
        ax.tick_params(labelsize=12)
    lower.set_xlim(log.times[0], max(log.times[-1], log.times[0] + 1e-3))
    lower.set_xlabel("time [s]", fontsize=13)


def _total(drive: Drive) -> FloatArray:
    """Return the total load ratio of each resonance, (n,)."""
    return np.asarray(drive.resonances.total_load_ratio, dtype=float)


def _broken(log: Log, values: FloatArray) -> FloatArray:
    """Return values of predictions, (n,), with NaN where a line breaks: before gaps and jumps."""
    last = np.union1d(gap_starts(log.times), log.passes - 1)
    values = values.astype(float)
    values[last] = np.nan
    return values


def _draw_modes(ax: "Axes", log: Log) -> FloatArray:
    """Draw each mode as a band of its standard deviation; return where they end, Hz, (n_modes,)."""
    frequencies = np.column_stack([_broken(log, values) for values in log.natural_frequencies.T])
    lateral = log.table.lateral_modes if log.table else None
    words = draw_bands(ax, log.times, frequencies, log.frequency_stddevs, lateral)
    ends = np.array([[np.nan, *each[np.isfinite(each)]][-1] for each in frequencies.T])
    frequency_axis(ax, ends)
    ax.yaxis.label.set_fontsize(13)
    ax.set_title(f"Where the linkage resonates (coloured, {words})", loc="left", fontsize=13)
    return ends


def _draw_excitations(
    ax: "Axes", log: Log, drive: Drive, limits: WarningLimits
) -> list[tuple[str, float]]:
    """Draw orders as wide as their load, red above the limit; return names, and their ends, Hz."""
    from matplotlib.collections import LineCollection

    times, speeds = drive.times, speeds_at_drive(log)
    ratios = np.asarray(drive.resonances.load_ratios, dtype=float)
    loads = np.nan_to_num(ratios)
    largest = max(float(loads.max(initial=0.0)), _LEAST_LOAD * limits.warning)
    loudest = np.argsort(-loads.max(axis=0, initial=0.0))[:_LABELLED].tolist()
    shown = [i for i in loudest if loads[:, i].max(initial=0.0) >= palette.FAINT * limits.warning]
    low, high = ax.get_ylim()
    ends = list[tuple[str, float]]()
    words = ["as wide as its load", "red above the limit", "dotted: load not known"]
    drawn = [True, bool((loads > limits.warning).any()), bool(np.isnan(ratios).any())]
    text = "; ".join(word for word, there in zip(words, drawn, strict=True) if there)
    ax.set_title(f"{ax.get_title('left')},\nand what excites it ({text})", loc="left", fontsize=13)
    for i, (order, load) in enumerate(zip(log.excitations, loads.T, strict=True)):
        if not (order.is_order and order.source in speeds):
            continue
        frequencies = order.ratio * speeds[order.source]
        frequencies = np.where(frequencies > 0.0, frequencies, np.nan)
        places = np.column_stack([times, frequencies])
        segments = np.stack([places[:-1], places[1:]], axis=1)
        segments[drive.broken[1:]] = np.nan
        faint = load[1:] < palette.FAINT * limits.warning
        colours = np.where(faint, _FAINT_COLOUR, palette.INK)
        colours = np.where(load[1:] > limits.warning, palette.ABOVE, colours)
        widths = 0.7 + _WIDEST * load[1:] / largest
        dashes = np.where(np.isnan(ratios[1:, i]), ":", "-").tolist()
        style: dict[str, Any] = {"capstyle": "round", "zorder": 1.5 if faint.all() else 3.0}
        style |= {"linewidths": widths, "colors": colours.tolist(), "linestyles": dashes}
        lines = LineCollection(list(segments), **style)
        ax.add_collection(lines, autolim=False)
        visible = (frequencies > low) & (frequencies < high)
        if i in shown and visible.any():
            ends.append((order.name, float(frequencies[visible][-1])))
    return ends


def _draw_total(ax: "Axes", log: Log, drive: Drive, limits: WarningLimits) -> None:
    """Draw the total load ratio with its limit, red where it exceeds that."""
    total = _total(drive)
    total[np.flatnonzero(drive.broken[1:])] = np.nan
    factor = np.asarray(drive.resonances.total_load_ratio_factor, dtype=float)
    known = all_counted(drive)
    finite = np.isfinite(factor) & np.isfinite(total) & known
    if finite.any():
        low, high = total / factor, total * factor
        ax.fill_between(drive.times, low, high, where=finite, color=palette.GREY, alpha=0.3, lw=0)
    above = total > limits.warning
    parts = ground_and_orders(drive, log.excitations) or ()
    labels = "the ground", "all orders, at most"
    for values, label, colour in zip(parts, labels, palette.COLOURS[2:4], strict=False):
        broken = np.where(np.isnan(total), np.nan, values)
        if np.isfinite(broken).any():
            ax.plot(drive.times, broken, color=colour, linewidth=1.2, label=label)
    whole = np.where(known, total, np.nan)
    (line,) = ax.plot(drive.times, whole, color=palette.INK, linewidth=1.6)
    if np.isfinite(whole).any():
        line.set_label("total")
    times = [*drive.times.tolist(), float(drive.times[-1] + drive.held[-1])]
    if spans := [(times[i], times[j]) for i, j in runs(~known)]:
        part = np.where(known, np.nan, total)
        ax.plot(drive.times, part, ":", color=palette.INK, lw=1.0, label="a part of the total")
        style = {"facecolor": "#f3f3f3", "edgecolor": "#b8b8b8", "lw": 0, "hatch": "//"}
        shaded(ax, spans, label="a source is not known", **style)
    ax.legend(loc="upper right", fontsize=10, ncols=3)
    ax.plot(drive.times, np.where(above, total, np.nan), color=palette.ABOVE, linewidth=3.0)
    ax.axhline(limits.warning, color=palette.ABOVE, linestyle="--", linewidth=1.2)
    beside: dict[str, Any] = {"fontsize": 12, "transform": ax.get_yaxis_transform()}
    ax.text(1.01, limits.warning, "limit", color=palette.ABOVE, va="center", **beside)
    ax.set_ylim(0.0, 1.75 * max(float(np.nanmax(total)), limits.warning))
    ax.set_ylabel("load ratio", fontsize=13)
    title = "Load ratio: vibration over static force, in the pin or cylinder where it is largest"
    ax.set_title(title, loc="left", fontsize=13)


def _shade_what_is_missing(ax: "Axes", log: Log) -> None:
    """Shade the times without predictions, and those whose predictions have no numbers."""
    times, starts = log.times, gap_starts(log.times)
    if len(starts):
        style: dict[str, Any] = {"facecolor": palette.GAP_SHADE, "edgecolor": palette.GREY}
        spans = np.column_stack([times[starts], times[starts + 1]]).tolist()
        shaded(ax, spans, lw=0, hatch="//", **style)
    for i in log.passes:
        ax.axvline(times[i], color=palette.INK, lw=1.2, linestyle=(0, (1, 2)))
    invalid = runs(np.isin(log.status, (Status.OUT_OF_RANGE, Status.INVALID_ANGLE)))
    if invalid:
        last = len(times) - 1
        spans = [(float(times[start]), float(times[min(end, last)])) for start, end in invalid]
        shaded(ax, spans, color=palette.INVALID_SHADE)
