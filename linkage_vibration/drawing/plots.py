# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Helps to draw pictures with matplotlib."""

import io
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from linkage_vibration.drawing import palette
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, FloatArray
from linkage_vibration.support.atomic_files import write_bytes
from linkage_vibration.support.missing_library import needed
from linkage_vibration.support.version import check_versions

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LONGEST = 28  # letters of a name beside a curve


class PlotError(LinkageVibrationError):
    """A picture cannot be drawn."""


def require_matplotlib() -> None:
    """Import matplotlib before anything long begins; raise a PlotError or an OldLibraryError."""
    check_versions("matplotlib")
    with needed("plots", "Drawing needs matplotlib", PlotError):
        import matplotlib.figure  # noqa: F401


def write_png(figure: "Figure", picture: Path) -> None:
    """Write a figure to a PNG file, which is replaced if it exists."""
    write_bytes(picture, png_bytes(figure), PlotError)


def png_bytes(figure: "Figure") -> bytes:
    """Return a figure as the content of a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)
    with warnings.catch_warnings(record=True) as caught:
        warnings.filterwarnings("always", "Glyph")
        canvas.print_png(png := io.BytesIO())  # savefig draws a figure with a layout twice
    if caught:  # The usual font lacks some characters.
        _find_fonts(figure)
        canvas.print_png(png := io.BytesIO())
    return png.getvalue()


def _find_fonts(figure: "Figure") -> None:
    """Add an installed font to the texts of a figure if the usual one lacks some characters."""
    from matplotlib.font_manager import FontProperties, findfont, fontManager
    from matplotlib.ft2font import FT2Font
    from matplotlib.text import Text

    texts = [text for text in figure.findobj(Text) if isinstance(text, Text)]
    needed = {ord(letter) for text in texts for letter in text.get_text() if letter.isprintable()}
    usual = FontProperties()
    missing = needed.difference(FT2Font(findfont(usual)).get_charmap())
    if not missing:
        return
    for font in fontManager.ttflist:
        if font.name.startswith("Last Resort"):
            continue  # It has a box for every character.
        with suppress(OSError, RuntimeError):  # a font that was removed or is damaged
            if missing.issubset(FT2Font(font.fname).get_charmap()):
                for text in texts:
                    text.set_fontfamily([*usual.get_family(), font.name])
                return
    letters = "".join(map(chr, sorted(missing)))
    print(f"No installed font has {letters}; the picture shows boxes instead.", file=sys.stderr)


def tidy(ax: "Axes") -> None:
    """Draw a grid behind the curves, and no frame at the top and on the right."""
    ax.grid(color="#dddddd", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def draw_bands(
    ax: "Axes",
    x: FloatArray,
    frequencies: FloatArray,
    stddevs: FloatArray,
    lateral: BoolArray | None = None,
) -> str:
    """Draw modes, (n, n_modes), Hz, over x with one deviation; return words for the title."""
    for mode, colour in enumerate(palette.mode_colours(frequencies.shape[1])):
        values, deviation = frequencies[:, mode], np.nan_to_num(stddevs[:, mode])
        low = np.maximum(values - deviation, 0.5 * values)
        ax.fill_between(x, low, values + deviation, color=colour, alpha=0.3, linewidth=0)
        style = "--" if lateral is not None and lateral[mode] else "-"
        ax.plot(x, values, style, color=colour, linewidth=1.7)
    unknown = " (no band: not known)" if np.isnan(stddevs).any() else ""
    dashed = "; dashed: sway, roll and yaw" if lateral is not None and lateral.any() else ""
    # The error of a table, which is a deviation, too, is less than the width of a line.
    certain = not unknown and not (stddevs > 1e-4 * frequencies).any()
    return f"{'without' if certain else 'with one'} standard deviation{unknown}{dashed}"


def frequency_axis(ax: "Axes", frequencies: FloatArray) -> None:
    """Scale an axis logarithmically, from below to above all known frequencies, Hz."""
    from matplotlib.ticker import LogLocator, NullLocator

    ax.set_yscale("log")
    ax.set_ylabel("frequency [Hz]")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_locator(NullLocator())
    positive = frequencies[np.isfinite(frequencies) & (frequencies > 0.0)]
    if len(positive):
        ax.set_ylim(0.6 * float(positive.min()), 2.0 * float(positive.max()))
    else:  # A logarithmic axis has no ticks without a range.
        ax.set_ylim(1.0, 100.0)
        text = "No natural frequency is known."
        ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center")


def name_modes(
    ax: "Axes",
    ends: FloatArray,
    names: Sequence[str],
    orders: Sequence[tuple[str, float]] = (),
    *,
    least: float = 0.06,
    fontsize: int = 12,
) -> None:
    """Write names where curves end, Hz, (n_modes,), the least share of the height apart."""
    low, high = np.log(ax.get_ylim())
    n_modes, ends = len(names), np.append(ends, [end for _, end in orders])
    names = [*(name or f"mode {i + 1}" for i, name in enumerate(names)), *(n for n, _ in orders)]
    finite = np.flatnonzero(np.isfinite(ends))
    heights = spread((np.log(ends[finite]) - low) / (high - low), least)
    colours = [*palette.mode_colours(n_modes), *[palette.INK] * len(orders)]
    for i, height in zip(finite.tolist(), heights.tolist(), strict=True):
        style: dict[str, Any] = {"color": colours[i], "fontsize": fontsize, "va": "center"}
        style["fontweight"] = "bold" if i < n_modes else "normal"
        ax.text(1.01, height, plain(shortened(names[i])), transform=ax.transAxes, **style)


def spread(heights: FloatArray, least: float) -> FloatArray:
    """Return heights, (n,), moved up so that no two are closer than the least distance."""
    moved, lowest = np.array(heights, dtype=float), -np.inf
    for i in np.argsort(heights):
        moved[i] = lowest = max(float(heights[i]), lowest + least)
    return moved


def shortened(name: str) -> str:
    """Return a name that leaves room for the curves: a long one by its beginning and its end."""
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST // 2]}…{name[-_LONGEST // 2 :]}"


def plain(text: str) -> str:
    """Return a text that matplotlib does not read as a formula."""
    return text.replace("$", r"\$")


def shaded(ax: "Axes", spans: Sequence[tuple[float, float]], **style: Any) -> "Artist":
    """Shade spans of time over the whole height; thousands are one artist, which is fast."""
    from matplotlib.collections import PolyCollection

    corners = [[(a, 0.0), (a, 1.0), (b, 1.0), (b, 0.0)] for a, b in spans]
    # The edge keeps a single prediction visible.
    style = {"lw": 1.0, "zorder": 0, "transform": ax.get_xaxis_transform(), **style}
    return ax.add_collection(PolyCollection(corners, **style), autolim=False)
