# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Helps to draw pictures with matplotlib."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.version import check_versions

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
    check_versions("matplotlib")
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


def shaded(ax: "Axes", spans: Sequence[tuple[float, float]], **style: Any) -> "Artist":
    """Shade spans of time over the whole height; thousands are one artist, which is fast."""
    from matplotlib.collections import PolyCollection

    corners = [[(a, 0.0), (a, 1.0), (b, 1.0), (b, 0.0)] for a, b in spans]
    # The edge keeps a single prediction visible.
    style = {"lw": 1.0, "zorder": 0, "transform": ax.get_xaxis_transform(), **style}
    return ax.add_collection(PolyCollection(corners, **style), autolim=False)
