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
