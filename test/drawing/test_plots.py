# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures show characters that the usual font lacks."""

import math
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager

from linkage_vibration.drawing import palette
from linkage_vibration.drawing.plots import draw_bands, frequency_axis, name_modes, png_bytes

OTHER = chr(0x2ADD)  # STIXGeneral, which matplotlib brings, has this sign, and DejaVu Sans has not
JAPANESE = "耕うん"


def title_font(text: str) -> list[str]:
    """Return the fonts of a title after its picture was made."""
    figure = Figure()
    title = figure.subplots().set_title(text)
    assert png_bytes(figure).startswith(b"\x89PNG")
    return list(title.get_fontfamily())


@pytest.mark.parametrize(("frequency", "texts"), [(math.nan, 1), (0.0, 1), (5.0, 0)])
def test_axis_without_a_frequency(frequency: float, texts: int) -> None:
    """A picture without any natural frequency is drawn, and says so."""
    figure = Figure()
    ax = figure.subplots()
    frequency_axis(ax, np.array([frequency]))
    assert png_bytes(figure).startswith(b"\x89PNG")
    assert [text.get_text() for text in ax.texts] == ["No natural frequency is known."] * texts


def test_names_where_curves_end() -> None:
    """A mode without a name has its number, one without a frequency has no text."""
    figure = Figure()
    ax = figure.subplots()
    ax.set_ylim(1.0, 100.0)
    name_modes(ax, np.array([5.0, 10.0, math.nan]), ["", "heave", ""], [("pto", 30.0)])
    assert [text.get_text() for text in ax.texts] == ["mode 1", "heave", "pto"]
    colours = [*palette.mode_colours(3)[:2], palette.INK]
    assert [text.get_color() for text in ax.texts] == colours
    assert [text.get_fontweight() for text in ax.texts] == ["bold", "bold", "normal"]
    ends = np.log10([5.0, 10.0, 30.0]) / 2.0  # shares of two decades
    assert [text.get_position()[1] for text in ax.texts] == pytest.approx(ends)


def test_long_names_are_shortened() -> None:
    """A name of 28 letters is whole; of a longer one there are 14 from either end."""
    ax = Figure().subplots()
    ax.set_ylim(1.0, 100.0)
    name_modes(ax, np.array([5.0, 50.0]), ["a" * 28, "b" * 15 + "c" * 60])
    assert [text.get_text() for text in ax.texts] == ["a" * 28, "b" * 14 + "…" + "c" * 14]


def test_names_do_not_overlap() -> None:
    """Names of curves that end close together are moved up, to the least distance, in order."""
    ax = Figure().subplots()
    ax.set_ylim(1.0, 100.0)
    name_modes(ax, np.array([10.1, 10.0, 10.2, 90.0]), ["b", "a", "c", "d"], least=0.1)
    heights = [text.get_position()[1] for text in ax.texts]
    assert heights == pytest.approx([0.6, 0.5, 0.7, 0.9771], 1e-4)


def test_axis_contains_all_frequencies() -> None:
    """It reaches from 0.6 of the lowest to twice the highest, and leaves out what is not known."""
    ax = Figure().subplots()
    frequency_axis(ax, np.array([[5.0, math.nan], [0.0, 80.0]]))
    assert ax.get_ylim() == pytest.approx((3.0, 160.0))
    assert (ax.get_yscale(), len(ax.texts)) == ("log", 0)


def test_bands_are_one_deviation() -> None:
    """A band is one deviation on each side, and above half of the curve; each mode has a colour."""
    ax, x = Figure().subplots(), np.arange(3.0)
    draw_bands(ax, x, np.full((3, 2), [2.0, 10.0]), np.full((3, 2), [0.5, 7.0]))
    bands = [
        np.concatenate([p.vertices for p in each.get_paths()])[:, 1] for each in ax.collections
    ]
    ends = [(band.min(), band.max()) for band in bands]
    assert ends == [(1.5, 2.5), (5.0, 17.0)]
    np.testing.assert_array_equal([line.get_ydata() for line in ax.lines], [[2.0] * 3, [10.0] * 3])
    assert [line.get_color() for line in ax.lines] == palette.mode_colours(2)


def test_usual_font() -> None:
    """Latin and Greek letters need no other font."""
    assert title_font("Load ratio, α₃ in °") == list(matplotlib.rcParams["font.family"])


def test_font_that_has_a_character(capsys: pytest.CaptureFixture[str]) -> None:
    """An installed font that has the character is added, and nothing is said."""
    assert title_font(f"a {OTHER}")[-1].startswith("STIX")
    assert capsys.readouterr().err == ""


@pytest.mark.filterwarnings("ignore:Glyph")
def test_character_without_a_font(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without such a font, one sentence names the characters; matplotlib's boxes do not count."""
    brought = [each for each in fontManager.ttflist if "mpl-data" in Path(each.fname).parts]
    monkeypatch.setattr(fontManager, "ttflist", brought)
    title_font(f"Load {JAPANESE}")
    start = f"No installed font has {''.join(sorted(JAPANESE))};"
    assert capsys.readouterr().err.startswith(start)


@pytest.mark.parametrize("deviation", [math.nan, 1.1e-4, 0.9e-4])
@pytest.mark.parametrize("lateral", [None, [False], [True]])
def test_titles_say_what_is_drawn(deviation: float, lateral: list[bool] | None) -> None:
    """A band, one that is not known, and dashed modes are named where there are any."""
    ax, x = Figure().subplots(), np.arange(2.0)
    stddevs = np.full((2, 1), deviation)
    which = None if lateral is None else np.array(lateral)
    words = draw_bands(ax, x, np.ones((2, 1)), stddevs, which)
    assert ("no band: not known" in words) == math.isnan(deviation)
    assert words.startswith("without") == (deviation == 0.9e-4)
    assert ("dashed" in words) == (lateral == [True]) == (ax.lines[0].get_linestyle() == "--")
