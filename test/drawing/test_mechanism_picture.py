# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of orders and loads over a stroke show their numbers, and say in words what is worst."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from linkage_vibration.drawing import mechanism_picture, palette
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.worst_levels import WorstLevels
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import PAPER_MECHANISM, PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table


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


@pytest.fixture(scope="module")
def given() -> tuple[Excitation, ...]:
    """Return the excitations of three sources."""
    return tuple(excitations_from_mapping(yaml.safe_load(EXCITATIONS)))


@pytest.fixture(scope="module")
def levels(given: tuple[Excitation, ...]) -> LevelTable:
    """Return levels of the paper's linkage, with a shaking engine, a PTO shaft and tyres' lugs."""
    predictor = Predictor(load_table(config_file(PAPER_TABLE)))
    return LevelTable(predictor, read_mechanism(config_file(PAPER_MECHANISM)), given)


EXCITATIONS = """
engine: {speed: engine, orders: [0.5, 1, 3]}
shake: {speed: engine, orders: [1.5], force: [100.0], at: E1.z, at_speed: 2000.0}
shaft: {speed: pto, orders: [1, 2], force: [60.0, 60.0], at: E1.z, at_speed: 540.0, exponent: 2}
lugs: {speed: ground, rolling_radius: 0.8, orders: [1], force: [70.0], at: E1.z, at_speed: 8.0}
"""


def test_maps_are_of_one_source(levels: LevelTable, given: tuple[Excitation, ...]) -> None:
    """Ratios are those of its loads alone, at even angles and speeds and at each crossing."""
    ends = math.radians(100.0), math.radians(160.0)
    every = WorstLevels([levels])
    crossings = [(Source.GROUND, 2.0, 9.3), (Source.PTO, 2.5, 777.7)]
    for source, at, factor in (
        (Source.PTO, (2.5, 777.7), 1.0),
        (Source.GROUND, (2.0, 3.6 * 9.3), 3.6),
    ):
        drawn = mechanism_picture._load_map(source, every, given, ends, crossings)
        angles, speeds, ratios, known = drawn
        assert known.all()
        assert (angles[0], angles[-1]) == pytest.approx(ends)
        low, high = (200.0, 1100.0) if source is Source.PTO else (2.0, 50.0)
        assert (speeds[0], speeds[-1]) == pytest.approx((low, high))
        i, j = np.abs(angles - at[0]).argmin(), np.abs(speeds - at[1]).argmin()
        assert (angles[i], speeds[j]) == pytest.approx(at)
        assert (len(angles), len(speeds)) == (92, 162)
        alone = np.full((3, 1), math.nan)
        alone[source.index] = speeds[j] / factor
        expected = levels.at(angles[[i]], alone).total_load_ratio[0]
        assert ratios[i, j] == pytest.approx(expected, rel=1e-6)


def test_a_figure_has_two_panels_for_each_source(
    levels: LevelTable, given: tuple[Excitation, ...]
) -> None:
    """Modes come first, then the orders and the loads of each source, all loads on one scale."""
    ends = levels.alpha3_range
    figure, sentences = mechanism_picture.draw_mechanism([levels], given, 0.33, ends, [])
    titles = [ax.get_title(loc="left") for ax in figure.axes if ax.get_title(loc="left")]
    assert titles[0].startswith("Natural frequencies over the stroke")
    assert titles[1::2] == ["Orders, and the range of each mode"] * 3
    assert titles[2:7:2] == [
        "A part of the load ratio by the engine alone",
        "Load ratio by the PTO alone",
        "Load ratio by the ground alone",
    ]
    assert [len(ax.lines) for ax in figure.axes if ax.get_title("left") == titles[1]] == [4, 2, 1]
    assert ["engine" in text for text in sentences] == [True, False, False]
    assert "without engine 0.5, engine 1, engine 3, which have no amplitude" in sentences[0]
    named = [ax for ax in figure.axes if "by the" in ax.get_title("left")]
    meshes = [each for ax in named for each in ax.collections if isinstance(each, QuadMesh)]
    largest = max(float(np.nanmax(np.asarray(mesh.get_array()))) for mesh in meshes)
    scales = [mesh.get_clim()[1] for mesh in meshes]
    assert scales == pytest.approx([max(0.33, largest)] * len(meshes))
