# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of mechanisms, shapes, FRFs and sweeps show their numbers."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes

import linkage_vibration as lv
from linkage_vibration.mechanics.frf import Frf

MASS = "rigid_bodies.implement.mass"


@pytest.fixture(scope="module")
def model() -> lv.LinkageModel:
    """Return the shipped hitch."""
    return lv.LinkageModel(lv.read_mechanism())


def drawn(ax: Axes, style: str, label: str = "") -> list[np.ndarray[Any, Any]]:
    """Return the points, (n, 2), of lines of a style and a label."""
    lines = [line for line in ax.lines if line.get_linestyle() == style]
    return [line.get_xydata() for line in lines if label in ("", line.get_label())]


def scale(ax: Axes) -> float:
    """Return the scale that a title states, m per 1/sqrt(kg)."""
    stated = re.search(r"is (\S+) / √kg", ax.get_title(loc="left"))
    assert stated
    return 0.1 / float(stated[1])


def names(ax: Axes) -> list[str]:
    """Return the texts in axes."""
    return [text.get_text() for text in ax.texts]


def test_a_mechanism_in_the_middle_of_its_stroke(model: lv.LinkageModel, tmp_path: Path) -> None:
    """Links are between their pins at this angle, and have their names; nothing is dashed."""
    figure = lv.plot(model.mechanism, tmp_path / "pose.png")
    assert (tmp_path / "pose.png").read_bytes()[:4] == b"\x89PNG"
    [ax, _], middle = figure.axes, sum(model.mechanism.stroke) / 2.0
    assert f"{math.degrees(middle):.2f}" in ax.get_title(loc="left")
    [crank] = drawn(ax, "-", "input crank")
    local = dict(model.mechanism.local_points("input_crank"))
    ends = [model.kinematics.at(middle).place("input_crank", local[p]) for p in ("P3", "V2")]
    np.testing.assert_allclose(crank[[0, -1]], ends)
    assert not drawn(ax, "--")
    assert {"P1", "P2", "P3", "V1", "V2", "E1", "E2"} == {*names(ax)}
    [legend] = figure.subfigs[-1].legends
    assert legend.get_texts()[0].get_text() == "lower link"


@pytest.mark.parametrize("mode", [2, 5])
def test_a_shape_is_the_participation(model: lv.LinkageModel, mode: int) -> None:
    """Pins move by the mass-normalised shape times the scale that is stated; at rest is dashed."""
    solution = model.solve(2.3)
    ax, _ = lv.plot(solution.shape(mode)).axes
    title = ax.get_title(loc="left")
    frequency = solution.modes.omega[mode] / (2.0 * math.pi)
    assert title.startswith(f"mode {mode + 1} at α₃ = 131.78°: {frequency:.2f} Hz, ")
    rest, moved = drawn(ax, "--")[0], drawn(ax, "-", "lower link")[0]
    pin = model.mechanism.local_points("implement")["E1"]
    np.testing.assert_allclose(rest[-1], model.kinematics.at(2.3).place("implement", pin))
    for row, point in ((0, "P1"), (-1, "E1")):
        by = solution.participation([f"{point}.x", f"{point}.z"])[:, mode]
        np.testing.assert_allclose(moved[row] - rest[row], scale(ax) * by, rtol=0.05, atol=1e-3)


def test_the_shapes_of_a_solution(model: lv.LinkageModel) -> None:
    """There are as many as a table has modes, each with its number, the frequency and a name."""
    figure = lv.plot(model.solve(2.3))
    titles = [ax.get_title(loc="left") for ax in figure.axes[::2]]  # others are from behind
    assert len(titles) == model.mechanism.response.modes
    assert [title.split()[1] for title in titles] == ["1", "2", "3", "4", "5", "6"]
    assert "implement heave" in titles[3]
    with pytest.raises(lv.LinkageVibrationError, match=r"take one of its `rows`"):
        lv.plot(model.stack(np.array([2.0, 2.1])))


@pytest.mark.parametrize(("half", "mode", "factors"), [(0, 3, (-1, 1)), (1, 2, (1, -1))])
def test_a_shape_from_behind(
    model: lv.LinkageModel, half: int, mode: int, factors: tuple[int, int]
) -> None:
    """Left and right mirror one another in the vertical half, and are odd in the lateral one."""
    solution = model.halves[half].solve(2.3)
    left, behind = lv.plot(solution.shape(mode)).axes
    assert ("left side" in left.get_title(loc="left")) == bool(half)
    assert behind.get_title(loc="left") == "from behind"
    rest = [line for line in drawn(behind, "--") if len(line) == 3][:2]  # of the lower link
    moved = [line for line in drawn(behind, "-") if len(line) == 3][:2]
    np.testing.assert_allclose(rest[0] * (-1, 1), rest[1])
    by = moved[0] - rest[0]
    np.testing.assert_allclose(moved[1] - rest[1], by * factors, atol=1e-12)
    places = ["E1.y", "E1.z"] if half else ["E1.z", "E1.z"]
    expected = scale(left) * solution.participation(places)[:, mode] * (half, 1)
    np.testing.assert_allclose(by[-1], expected, rtol=0.05, atol=1e-12)
    first, other = drawn(lv.plot(solution.model.mechanism).axes[1], ":")
    # Pins P1 and E1 of the lower link, of 0.81 m in the plane, are at y = 0.2 and 0.4 m.
    np.testing.assert_allclose(first[:, 0], [0.2 + 0.2 * 0.45 / 0.81, 0.45])
    np.testing.assert_allclose(other, first * (-1, 1))
    assert not drawn(behind, ":")


def frf_of(count: int) -> Frf:
    """Return so many FRFs, each one larger than the one before, at 0 to 3 Hz."""
    values = np.multiply.outer([0.0, 1j, 1j, 0.0], np.arange(1.0, 1 + count))[:, np.newaxis]
    values[3] = np.inf
    place = (("E1", "z"),)
    return Frf(np.arange(4.0), place, count * place, values, np.array([0.1]))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_phase_is_not_joined_over_half_a_turn(way: float) -> None:
    """From 170 to 190 deg, which is drawn at -170 deg, there is no line, and so the other way."""
    turns = np.radians([0.0, 90.0, 170.0, 190.0, 200.0])
    values = np.exp(1j * way * turns)[:, np.newaxis, np.newaxis]
    frf = Frf(np.arange(5.0), (("E1", "z"),), (("E1", "z"),), values, np.array([0.0]))
    drawn = lv.plot(frf).axes[1].lines[0].get_ydata()
    np.testing.assert_allclose(drawn, way * np.array([0.0, 90.0, math.nan, -170.0, -160.0]))


def test_frfs_are_drawn_with_their_error() -> None:
    """A band has the width of the error; zero and infinity are no points; nine are too many."""
    upper, lower = frf_of(8).plot().axes
    assert len(upper.lines) == 8
    np.testing.assert_array_equal(upper.lines[7].get_ydata(), [np.nan, 8.0, 8.0, np.nan])
    assert lower.lines[7].get_ydata()[1] == 90.0
    assert upper.get_ylabel() == "magnitude [m/N]"
    band = upper.collections[7].get_paths()
    assert {y for path in band for y in path.vertices[:, 1].round(9)} == {7.2, 8.8}
    [legend] = [ax.get_legend() for ax in (upper, lower) if ax.get_legend()]
    assert legend.get_texts()[0].get_text() == "E1.z per E1.z"
    with pytest.raises(lv.LinkageVibrationError, match=r"^9 FRFs cannot be distinguished; choose"):
        frf_of(9).plot()


def test_sweeps_are_drawn_over_their_longest_axis(model: lv.LinkageModel) -> None:
    """The angle or a number is the axis; the values of another number have four styles at most."""
    pytest.importorskip("xarray", reason="xarray is not installed")
    masses = [500.0, 700.0, 900.0, 1100.0, 1300.0]
    sweep = lv.sweep(model.mechanism, {MASS: masses}, [1.8, 2.0, 2.2, 2.4, 2.6, 2.8])
    four = sweep.isel({MASS: slice(4)})
    [ax] = lv.plot(four).axes
    assert ax.get_xlabel() == "crank angle α₃ [deg]"
    legend = ax.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == [
        f"{MASS} = {m:g}" for m in masses[:4]
    ]
    both, alone = (lv.plot(sweep.isel({MASS: slice(n)})).axes[0].get_legend() for n in (2, 1))
    assert both is not None
    assert (len(both.get_texts()), alone) == (2, None)
    curve = drawn(ax, ":")[3]  # the fourth mode with the third mass
    expected = four.natural_frequencies.sel({MASS: 900.0, "mode": 4})
    np.testing.assert_allclose(curve.T, [np.degrees(expected.alpha3), expected])
    with pytest.raises(lv.LinkageVibrationError, match=r"^5 combinations of .*mass cannot be dist"):
        lv.plot(sweep)
    [ax] = lv.plot(sweep.isel(alpha3=2)).axes
    assert (ax.get_xlabel(), ax.get_legend()) == (MASS, None)
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), masses)
    with pytest.raises(lv.LinkageVibrationError, match=r"has one solution, so there is no axis"):
        lv.plot(sweep.isel({MASS: 0, "alpha3": 0}))
    stack = model.stack([2.0, 2.2]).to_xarray()
    assert len(lv.plot(stack.isel(mode=slice(8))).axes[0].texts) == 8
    with pytest.raises(
        lv.LinkageVibrationError, match=r"^9 modes cannot be distinguished; `sel` at m"
    ):
        lv.plot(stack.isel(mode=slice(9)))
