# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of orders and loads over a stroke show their numbers, and say in words what is worst."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from linkage_vibration.drawing import mechanism_picture, palette
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.support.resources import config_file


def test_orders_cross_the_ranges_of_modes() -> None:
    """Engine order 1.5 is at 17.5 to 57.5 Hz from 700 to 2300 rpm; what is lateral is hatched."""
    every = read_excitations(config_file("excitations.yaml"))
    [shake] = (each for each in every if each.name == "engine 1.5")
    far = replace(shake, name="far", ratio=1000.0)
    modes = np.array([[20.0, 5.0, math.nan], [30.0, 6.0, math.nan]])
    ax = Figure().subplots()
    lateral = np.array([False, True, True])
    mechanism_picture._draw_orders(ax, Source.ENGINE, [shake, far], modes, lateral)
    ranges = [patch.get_extents().transformed(ax.transData.inverted()) for patch in ax.patches]
    np.testing.assert_allclose([(each.y0, each.y1) for each in ranges], [(20, 30), (5, 6)])
    assert [patch.get_fill() for patch in ax.patches] == [True, False]
    assert [bool(patch.get_hatch()) for patch in ax.patches] == [False, True]
    colours = [to_hex(patch.get_edgecolor()).upper() for patch in ax.patches]
    assert colours == palette.mode_colours(2)
    ends = np.asarray(ax.lines[0].get_xydata())[[0, -1]]
    np.testing.assert_allclose(ends, [(700, 17.5), (2300, 57.5)])
    assert [text.get_text() for text in ax.texts] == [shake.name]  # the other one is not shown
    assert (ax.get_xlabel(), ax.get_xlim()) == ("engine speed [rpm]", (700.0, 2300.0))


class OneMass:
    """Levels with one mass of the implement, or that of a worst one."""

    def __init__(self, mass: str) -> None:
        self.mass = mass

    def masses(self, angles: Any, speeds: Any) -> list[str]:
        """Return the mass at a place, which is the maximum of the map."""
        assert angles == pytest.approx(math.radians(110.0))
        assert speeds[:, 0] == pytest.approx([math.nan, math.nan, 20.0 / 3.6], nan_ok=True)
        return [self.mass]


RATIOS = np.array([[0.1, 0.2, 0.1], [0.1, 0.9, 0.5], [0.3, 0.1, 0.4]])
WORST = "up to 0.9 of its force at rest, at 110 deg and 20 km/h"


@pytest.mark.parametrize(
    ("limit", "mass", "silent", "words"),
    [
        (0.33, "", [], ". Above the limit of 0.33 are speeds from 20 to 30 km/h between 110 and"),
        (0.9, "", [], ", which is not above the limit of 0.9."),
        (0.89, "900", [], ", with an implement of 900 kg. Above the limit of 0.89 are speeds from"),
        (0.9, "", ["a", "b"], " (without a, b, which have no amplitude), which is not above the"),
    ],
)
@pytest.mark.parametrize("unknown", [None, (1, 1), (0, 0)])
def test_worst_of_a_map(
    limit: float, mass: str, silent: list[str], words: str, unknown: tuple[int, int] | None
) -> None:
    """The sentence names the maximum, and what is above the limit; grey is what is not known."""
    known = np.ones((3, 3), np.bool_)
    if unknown is not None:
        known[unknown] = False
    given: Any = np.radians([100.0, 110.0, 120.0]), np.array([10.0, 20.0, 30.0]), RATIOS, known
    ax = Figure().subplots()
    levels: Any = OneMass(mass)
    scale = limit, 1.2
    text = mechanism_picture._draw_loads(ax, Source.GROUND, given, silent, scale, levels)
    if unknown == (1, 1):
        words = words.replace(", which is not", " (without what is not known there), which is not")
        words = words.replace(". Above", " (without what is not known there). Above")
    assert f"{WORST}{words}" in text
    assert text.endswith("the load ratio is not fully known.") == (unknown is not None)
    [mesh] = (each for each in ax.collections if isinstance(each, QuadMesh))
    np.testing.assert_array_equal(np.ma.filled(mesh.get_array(), -1.0), np.where(known, RATIOS, -1))
    assert mesh.get_clim() == (0.0, 1.2)
    title = ax.get_title(loc="left")
    assert title.startswith("A part of the load ratio" if silent else "Load ratio by the ground")
    assert ("(grey: not known)" in title) == (unknown is not None)
    assert (len(ax.collections) > 1) == (limit < 0.9)  # a contour of the limit


def test_a_map_that_is_not_known() -> None:
    """Without any number the sentence says so, and nothing is drawn."""
    given: Any = np.radians([100.0, 110.0]), np.array([10.0, 20.0]), np.full((2, 2), math.nan)
    ax, levels = Figure().subplots(), OneMass("")
    known = np.zeros((2, 2), np.bool_)
    text = mechanism_picture._draw_loads(
        ax,
        Source.PTO,
        (*given, known),
        [],
        (0.33, 0.33),
        levels,  # type: ignore[arg-type]
    )
    assert text.startswith("The load ratio by the PTO is not known")
    assert not ax.collections
