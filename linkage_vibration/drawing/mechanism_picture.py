# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws a mechanism over its stroke: modes, orders of its excitations, and the loads they cause."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.plots import draw_bands, frequency_axis, name_modes, tidy
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import predict_many
from linkage_vibration.prediction.worst_levels import WorstLevels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPEEDS = {  # what is drawn of each source: its name, the lowest and the highest speed, SI per unit
    Source.ENGINE: ("engine speed [rpm]", 700.0, 2300.0, 1.0),
    Source.PTO: ("PTO speed [rpm]", 200.0, 1100.0, 1.0),
    Source.GROUND: ("ground speed [km/h]", 2.0, 50.0, 1.0 / 3.6),
}

Point = tuple[Source, float, float]
"""A crossing: a source, a crank angle, rad, and a speed, rpm or m/s. The maps contain them all."""

Map = tuple[FloatArray, FloatArray, FloatArray, BoolArray]
"""Crank angles, (n,), rad, speeds as drawn, (k,), and load ratios, (n, k), with what is known."""

_WIDTH, _HEIGHT = 6.0, 3.4  # of a panel with its texts, inches
_ANGLES, _MAP = 181, (91, 161)  # angles of a curve; angles and speeds of a map at least


def drawn_speeds(excitations: Sequence[Excitation]) -> dict[Source, tuple[float, float]]:
    """Return the lowest and the highest speed, rpm or m/s, of each source of excitations."""
    used = {each.source for each in excitations}
    drawn = SPEEDS.items()
    return {of: (low * unit, high * unit) for of, (_, low, high, unit) in drawn if of in used}


def draw_mechanism(
    every: Sequence[LevelTable],
    excitations: Sequence[Excitation],
    limit: float,
    ends: tuple[float, float],
    crossings: Sequence[Point],
) -> tuple["Figure", list[str]]:
    """Draw modes, orders and load ratios; return the figure, and a sentence for each source.

    Of several levels, with other masses of the implement, all modes and the worst loads are drawn.
    ``limit`` is the load ratio of a warning, ``ends`` are the crank angles to draw between, rad.
    """
    from matplotlib.figure import Figure

    sources, levels = [*drawn_speeds(excitations)], WorstLevels(every)
    n_panels = 1 + 2 * len(sources)
    # One panel below the other, so that the texts are legible on a phone.
    figure = Figure(figsize=(_WIDTH, _HEIGHT * n_panels), dpi=110)
    first, *panels = figure.subplots(n_panels, squeeze=False)[:, 0]
    angles, table = np.linspace(*ends, _ANGLES), every[0].predictor.table
    predictions = [predict_many(of.predictor, angles, np.zeros(_ANGLES)) for of in every]
    draw_modes(first, table.mode_names, predictions, table.lateral_modes)
    frequencies = np.concatenate([of.natural_frequencies for of in predictions])
    maps = [_load_map(source, levels, excitations, ends, crossings) for source in sources]
    top = max(limit, *(float(np.nanmax(ratios, initial=0.0)) for _, _, ratios, _ in maps), 0.0)
    sentences = []
    for i, source in enumerate(sources):
        orders = [each for each in excitations if each.source is source and each.is_order]
        _draw_orders(panels[2 * i], source, orders, frequencies, table.lateral_modes)
        silent = [each.name for each in orders if not each.load]
        panel = panels[2 * i + 1]
        sentences.append(_draw_loads(panel, source, maps[i], silent, (limit, top), levels))
    _arrange(figure)
    return figure, sentences


def _arrange(figure: "Figure") -> None:
    """Give all panels the same edges, with space for the longest name on the right.

    A layout engine of matplotlib would lay out all texts twice for it.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)
    renderer = canvas.get_renderer()
    texts = [text for ax in figure.axes for text in ax.texts if text.get_position()[0] > 1.0]
    longest = max((text.get_window_extent(renderer).width for text in texts), default=0.0)
    right, n_panels = longest / figure.dpi + 0.15, figure.get_size_inches()[1] / _HEIGHT
    figure.subplots_adjust(
        left=0.65 / _WIDTH,
        right=1.0 - max(right, 0.9) / _WIDTH,
        bottom=0.5 / _HEIGHT / n_panels,
        top=1.0 - 0.5 / _HEIGHT / n_panels,
        hspace=0.85 / (_HEIGHT - 0.85),
    )


def draw_modes(
    ax: "Axes",
    names: Sequence[str],
    every: Sequence[MessageColumns],
    lateral: BoolArray | None = None,
) -> None:
    """Draw modes over the angle, for each mass; those that are lateral, (n_modes,), are dashed."""
    angles, words = np.degrees(every[0].crank_angle), list[str]()
    for of in every:
        bands = of.natural_frequencies, of.frequency_stddevs
        words.append(draw_bands(ax, np.degrees(of.crank_angle), *bands, lateral))
    frequency_axis(ax, np.concatenate([of.natural_frequencies for of in every]))
    name_modes(ax, every[0].natural_frequencies[-1], names, fontsize=10)
    ax.set(xlabel="crank angle α₃ [deg]", xlim=(angles[0], angles[-1]))
    longest = max(words, key=len)  # says so if a deviation is not known with one of the masses
    ax.set_title(f"Natural frequencies over the stroke,\n{longest}", loc="left")
    tidy(ax)


def _draw_orders(
    ax: "Axes",
    source: Source,
    orders: Sequence[Excitation],
    frequencies: FloatArray,
    lateral: BoolArray,
) -> None:
    """Draw orders over speed, and ranges of modes, (n, n_modes), Hz, hatched if lateral."""
    label, low, high, unit = SPEEDS[source]
    colours = palette.mode_colours(frequencies.shape[1])
    for values, colour, aside in zip(frequencies.T, colours, lateral.tolist(), strict=True):
        if np.isfinite(values).any():
            ends = float(np.nanmin(values)), float(np.nanmax(values))
            hatch = "////" if aside else None
            ax.axhspan(*ends, color=colour, alpha=0.3, linewidth=1.0, fill=not aside, hatch=hatch)
    frequency_axis(ax, frequencies)
    speeds, (bottom, top) = np.linspace(low, high, 181), ax.get_ylim()
    named = list[tuple[str, float]]()
    for order in orders:
        lines = order.ratio * unit * speeds
        ax.plot(speeds, lines, color=palette.INK, linewidth=1.0)
        if (shown := lines[(lines > bottom) & (lines < top)]).size:
            named.append((order.name, float(shown[-1])))
    name_modes(ax, np.empty(0), (), named, fontsize=10)
    ax.set(xlabel=label, xlim=(low, high))
    ax.set_title("Orders, and the range of each mode", loc="left")
    tidy(ax)


def _draw_loads(
    ax: "Axes",
    source: Source,
    drawn: Map,
    silent: Sequence[str],
    scale: tuple[float, float],
    levels: WorstLevels,
) -> str:
    """Draw the load ratio by a source on a scale, limit and maximum; return the worst in words."""
    (label, low, high, unit), (limit, top) = SPEEDS[source], scale
    angles, speeds, ratios, known = drawn
    degrees, name = np.degrees(angles), label.split(" speed")[0]
    ax.set(xlabel=label, ylabel="crank angle α₃ [deg]", facecolor=palette.GAP_SHADE)
    ax.set(xlim=(low, high), ylim=(degrees[0], degrees[-1]))
    part = "A part of the load ratio" if silent else "Load ratio"
    unknown = "" if known.all() else " (grey: not known)"
    ax.set_title(f"{part} by the {name} alone{unknown}", loc="left")
    if not np.isfinite(ratios).any():
        why = "no amplitude, no force at rest, or a tyre in the air"
        return f"The load ratio by the {name} is not known: {why}."
    style: dict[str, Any] = {"cmap": "cividis", "vmin": 0.0, "vmax": top, "shading": "nearest"}
    mesh = ax.pcolormesh(speeds, degrees, np.where(known, ratios, math.nan), **style)
    assert ax.figure is not None
    beside = ax.inset_axes((1.03, 0.0, 0.04, 1.0))
    bar = ax.figure.colorbar(mesh, cax=beside, label=f"load ratio (red: limit {limit:g})")
    bar.ax.axhline(limit, color=palette.ABOVE, linewidth=2.5)
    i, j = np.unravel_index(np.nanargmax(ratios), ratios.shape)
    unit_name = label.partition("[")[2][:-1]
    text = (
        f"In the map, the {name} alone loads a pin or cylinder by up to {ratios[i, j]:.2g} of its "
        f"force at rest, at {degrees[i]:.0f} deg and {speeds[j]:.0f} {unit_name}"
    )
    at = np.full((len(Source), 1), math.nan)
    at[source.index] = unit * speeds[j]
    [mass] = levels.masses(angles[[i]], at)
    text += f", with an implement of {mass} kg" if mass else ""
    if silent:
        text += f" (without {', '.join(silent)}, which have no amplitude)"
    text += "" if known[i, j] else " (without what is not known there)"
    rest = "" if known.all() else " Where the map is grey, the load ratio is not fully known."
    above = np.isfinite(ratios) & (ratios > limit)
    if not above.any():
        return f"{text}, which is not above the limit of {limit:g}.{rest}"
    ax.contour(speeds, degrees, ratios, [limit], colors=palette.ABOVE, linewidths=2.0)
    avoided = degrees[above.any(axis=1)], speeds[above.any(axis=0)]
    (first, last), (slow, fast) = ((values[0], values[-1]) for values in avoided)
    return (
        f"{text}. Above the limit of {limit:g} are speeds from {slow:.0f} to {fast:.0f} "
        f"{unit_name} between {first:.0f} and {last:.0f} deg; the map shows where.{rest}"
    )


def _load_map(
    source: Source,
    levels: WorstLevels,
    excitations: Sequence[Excitation],
    ends: tuple[float, float],
    crossings: Sequence[Point],
) -> Map:
    """Return the load ratios by one source, of what is known, and where they are."""
    _, low, high, unit = SPEEDS[source]
    crossed = [(alpha3, speed / unit) for of, alpha3, speed in crossings if of is source]
    at = np.array(crossed).reshape(-1, 2).T
    angles = np.union1d(np.linspace(*ends, _MAP[0]), at[0])
    shown = np.union1d(np.linspace(low, high, _MAP[1]), at[1])
    speeds = unit * shown
    loaded = np.array([each.source is source and bool(each.load) for each in excitations])
    every = np.full((len(Source), len(speeds)), math.nan)
    every[source.index] = speeds
    results = levels.at_all_pairs(angles, every)
    unknown = (results.ground_unknown != "") & (source is Source.GROUND)
    unknown |= np.isnan(results.velocities[:, loaded]).any(axis=1)
    ratios, shape = results.total_load_ratio.astype(float), (len(angles), len(speeds))
    known = ~unknown & np.isfinite(ratios)
    return angles, shown, ratios.reshape(shape), known.reshape(shape)
