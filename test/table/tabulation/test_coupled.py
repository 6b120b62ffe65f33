# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of linkages whose damping couples the modes: poles that meet, vanish and come back."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.reduced import ReducedModels
from linkage_vibration.table.table import Table, TableError, load_table, save_table
from linkage_vibration.table.tabulation import build_table
from test.support.crossing import (
    AT,
    GAP,
    RATIO,
    STROKE,
    crossing_crank,
    exact_poles,
    meeting_off_axis,
)

FloatArray = NDArray[np.float64]


def angles(meeting: float = AT) -> FloatArray:
    """Return angles all over the stroke, and ever denser towards a meeting."""
    near = meeting + np.outer([-1.0, 1.0], np.logspace(-7, -2, 30)).ravel()
    return np.sort(np.concatenate([np.linspace(*STROKE, 150), near, [meeting]]))


def damped(name: str, spring: dict[str, Any]) -> LinkageModel:
    """Return a shipped linkage with a spring that is almost only a damper."""
    mapping = yaml.safe_load(config_file(f"{name}.yaml").read_text())
    mapping.setdefault("springs", {})["damper"] = {"stiffness": 1e-6, **spring}
    return LinkageModel(mechanism_from_mapping(mapping))


def worst_pole_error(table: Table, at: FloatArray, row: FloatArray, poles: Any) -> float:
    """Check one row of values against exact poles, and return the error over that reported."""
    n = table.n_modes
    frequencies, ratios = row[:n], row[n : 2 * n]
    assert (np.isnan(frequencies) == np.isnan(ratios)).all()
    known = ~np.isnan(frequencies)
    exact = poles[poles.imag > 0.0]
    lambdas = 2.0 * math.pi * frequencies[known] * np.exp(1j * np.arccos(-ratios[known]))
    pairs = np.abs(lambdas[:, np.newaxis] - exact).argmin(axis=1)
    assert len(set(pairs.tolist())) == known.sum()
    size = np.abs(exact[pairs])
    off = np.abs(2.0 * math.pi * frequencies[known] / size - 1.0)
    off = np.maximum(off, np.abs(ratios[known] / (-exact[pairs].real / size) - 1.0))
    piece = np.searchsorted(table.alpha3[table.pieces[1:-1]], at)
    return float(off.max(initial=0.0) / table.interpolation_error[piece])


@pytest.mark.parametrize("meeting", [0.5, 0.99])
def test_two_poles_that_meet_off_the_real_axis(meeting: float) -> None:
    """Near the dashpot with which two poles meet, every angle has both of them."""
    exact_dashpot, at = meeting_off_axis()
    dashpot = meeting * exact_dashpot
    table = build_table(LinkageModel(crossing_crank(GAP, AT, RATIO, dashpot)), 1e-5)
    assert len(table.reduced) == 1
    values = table.evaluate(angles(at))
    assert np.isfinite(values).all()
    shares = [
        worst_pole_error(table, angle, row, exact_poles(GAP, AT, RATIO, dashpot, float(angle)))
        for angle, row in zip(angles(at), values, strict=True)
    ]
    assert max(shares) <= 2.0
    assert np.mean(np.array(shares) > 1.0) <= 0.01
    assert table.interpolation_error.max() <= 1e-5 + 1e-8


def test_poles_that_become_real() -> None:
    """Where the crank's mode is overdamped its values are NaN, and all else is still right."""
    dashpot = 3e3
    model = LinkageModel(crossing_crank(GAP, AT, RATIO, dashpot))
    table = build_table(model, 1e-5)
    vanished = 0
    for angle, row in zip(angles(), table.evaluate(angles()), strict=True):
        poles = exact_poles(GAP, AT, RATIO, dashpot, float(angle))
        low = poles[(poles.imag > 0.0) & (np.abs(poles) < 2.0 * math.pi * 1000.0)]
        assert np.isfinite(row[:2]).sum() == len(low)
        assert worst_pole_error(table, angle, row, poles) <= 2.0
        vanished += len(low) < 2
        slopes = np.array(table.slopes(float(angle))[:2])
        np.testing.assert_array_equal(np.isnan(slopes), np.isnan(row[:2]))
    assert 0 < vanished < len(angles())
    for angle in (0.4, AT, 1.1):
        peak = model.solve(angle).peak(table.band)
        assert table.interpolate(angle)[1:3] == pytest.approx(
            (peak.frequency, peak.magnitude), rel=2.0 * table.peak_error
        )


def test_damper_from_zero_to_rigid() -> None:
    """The table follows the model from no damper to one that holds the crank like a rod."""
    for dashpot in (0.0, 1e3, 1e6):
        table = build_table(LinkageModel(crossing_crank(GAP, AT, RATIO, dashpot)), 1e-4)
        for angle in np.linspace(*STROKE, 7)[1:-1]:
            poles = exact_poles(GAP, AT, RATIO, dashpot, float(angle))
            row = table.evaluate(np.array([angle]))[0]
            assert worst_pole_error(table, angle, row, poles) <= 2.0


def test_set_that_exceeds_the_poles_of_an_angle() -> None:
    """A piece is halved where the set of its poles grew to more poles than another angle has."""
    mapping = yaml.safe_load(config_file("four_bar.yaml").read_text())
    for link in mapping["links"].values():
        link.update(elements=3, modes=1)
    mapping["input"]["range_deg"] = [20.0, 120.0]
    mapping["springs"] = {"damper": {"joint": "B", "damping": 5.0}}
    model = LinkageModel(mechanism_from_mapping(mapping))
    table = build_table(model, 1e-4)
    for angle in np.linspace(*table.alpha3_range, 9).tolist():
        row = table.evaluate(np.array([angle]))[0]
        poles = model.solve(angle).damped.oscillating
        assert worst_pole_error(table, angle, row, poles) <= 2.0


def test_a_mass_that_moves_freely() -> None:
    """H = -1 / (m w^2), although residues of both poles, which are at zero, cancel."""
    mass, omega = 3.0, np.array([0.01, 1.0, 100.0])
    inertia, stiffness = np.array([[[0.0, mass], [mass, 0.0]], [[0.0, 0.0], [0.0, -mass]]])
    shapes, far = np.array([[[1.0, 0.0]]]), (np.zeros((1, 1, 1)), np.empty(0, complex), np.empty(0))
    models = ReducedModels(inertia[np.newaxis], stiffness[np.newaxis], shapes, *far, 1, free=True)
    value, slope = models.modal._near(np.zeros(3, int), omega)
    np.testing.assert_allclose(value, -1.0 / (mass * omega**2), rtol=1e-12)
    np.testing.assert_allclose(slope, 2.0 / (mass * omega**3), rtol=1e-12)


@pytest.fixture(scope="module")
def hitch() -> tuple[LinkageModel, Table]:
    """Return the shipped hitch with a strong damper in a joint, and its table."""
    model = damped("three_point_linkage", {"joint": "P1", "damping": 500.0})
    return model, build_table(model, 1e-5)


def test_hitch_with_a_damper(hitch: tuple[LinkageModel, Table]) -> None:
    """At random angles poles, peak and FRFs are within the errors that the table reports."""
    model, table = hitch
    rng = np.random.default_rng(11)
    lines = np.linspace(*table.band, 1001)
    for angle in rng.uniform(*table.alpha3_range, 20).tolist():
        solution = model.solve(angle)
        row = table.evaluate(np.array([angle]))[0]
        assert worst_pole_error(table, angle, row, solution.damped.oscillating) <= 2.0
        exact = solution.peak(table.peak_band)
        peak = exact.frequency, exact.magnitude
        assert row[-2:] == pytest.approx(peak, rel=2.0 * table.peak_error)
    exact_frf = solution.frf(table.places, table.places).frf(lines)
    receptances = table.frf(angle, table.places, table.places).frf(lines)
    np.testing.assert_allclose(receptances, receptances.swapaxes(1, 2), rtol=1e-11)  # reciprocity
    apart = np.linalg.norm(receptances - exact_frf, axis=0) / np.linalg.norm(exact_frf, axis=0)
    assert apart.max() <= 2.0 * table.frf_error


def test_file_has_the_cells(
    hitch: tuple[LinkageModel, Table], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A table that is read gives the same bits, and its lookups between meetings find no poles."""
    table = hitch[1]
    save_table(table, tmp_path / "hitch.npz")
    loaded = load_table(tmp_path / "hitch.npz")
    with monkeypatch.context() as without:
        without.delattr(ReducedModels, "modal")  # what finds poles
        first = loaded.interpolate(2.0)
    assert first == table.interpolate(2.0)
    np.testing.assert_array_equal(loaded.cell_cubics, table.cell_cubics)


@pytest.mark.parametrize("damping", [20.0, 100.0, 5000.0])
def test_cost_of_a_hitch_with_a_damper(damping: float) -> None:
    """At 1e-6 its table needs hardly more solutions than that of the hitch without a damper."""
    joint = {"joint": "P1", "stiffness": 1.0e-6, "damping": damping}
    solved: list[float] = []
    build_table(damped("three_point_linkage", joint), progress=solved.append)
    assert len(solved) <= 30
    assert solved == sorted(solved)


def test_slopes_and_lookups(hitch: tuple[LinkageModel, Table]) -> None:
    """One lookup and many give the same bits; slopes are those of the frequencies."""
    table = hitch[1]
    at = np.random.default_rng(2).uniform(*table.alpha3_range, 50)
    values, slopes = table.evaluate(at), table.evaluate_slopes(at)
    ahead, behind = table.evaluate(at + 1e-6), table.evaluate(at - 1e-6)
    for i, angle in enumerate(at.tolist()):
        first, frequency, magnitude, _ = table.interpolate(angle)
        assert [*first, frequency, magnitude] == values[i].tolist()
        assert table.slopes(angle) == slopes[i].tolist()
    n = table.n_modes
    np.testing.assert_allclose((ahead - behind)[:, :n] / 2e-6, slopes[:, :n], rtol=1e-4, atol=1e-4)


def test_round_trip(hitch: tuple[LinkageModel, Table], tmp_path: Path) -> None:
    """A saved table gives the same bits."""
    model, table = hitch
    save_table(table, tmp_path / "hitch.npz")
    loaded = load_table(tmp_path / "hitch.npz", model.mechanism)
    assert loaded.table_id == table.table_id
    np.testing.assert_array_equal(loaded.evaluate(table.alpha3), table.evaluate(table.alpha3))
    place = [table.places[1]]
    lines = np.array([1.0, 50.0])
    actual = (each.frf(2.0, place, place).frf(lines) for each in (table, loaded))
    np.testing.assert_array_equal(*actual)


@pytest.mark.parametrize("other", [0.3, 0.1])
def test_structural_damping(mapping: Any, other: float) -> None:
    """Unequal loss factors of the links couple the modes; tables have the poles of equal ones, too.

    Those are i w sqrt(1 + i eta) by the undamped angular frequencies w.
    """
    eta = 0.1
    mapping["damping"] = {"rule": "loss_factor", "factor": eta}
    first = next(iter(mapping["links"]))
    mapping["links"][first]["damping"] = {"rule": "loss_factor", "factor": other}
    model = LinkageModel(mechanism_from_mapping(mapping))
    table = build_table(model, 1e-4)
    assert np.iscomplexobj(table.reduced[0].stiffness)
    for angle in (1.7, 2.4, 3.0):
        solution = model.solve(angle)
        equal = other == eta
        poles = 1j * solution.modes.omega * np.sqrt(1.0 + 1j * eta)
        poles = poles if equal else solution.damped.oscillating
        row = table.evaluate(np.array([angle]))[0]
        assert worst_pole_error(table, angle, row, poles) <= 2.0
        solved = solution.natural_frequencies[: table.n_modes]
        np.testing.assert_allclose(np.sort(row[: table.n_modes]), solved, rtol=2e-4)
        assert row[-1] == pytest.approx(solution.peak(table.peak_band).magnitude, rel=1e-3)


def test_crank_that_only_a_damper_holds(mapping: Any) -> None:
    """The linkage can creep away at 0 Hz; its elastic modes and their peak are in the table."""
    del mapping["links"]["input_crank"]["clamped"]
    mapping["springs"] = {"oil": {"joint": "P3", "stiffness": 1e-6, "damping": 2e3}}
    mapping["input"]["range_deg"] = [130.0, 140.0]
    model = LinkageModel(mechanism_from_mapping(mapping))
    table = build_table(model, 1e-4)
    assert table.places == ()
    solution = model.solve(2.3)
    row = table.evaluate(np.array([2.3]))[0]
    assert worst_pole_error(table, 2.3, row, solution.damped.oscillating) <= 2.0
    # The peak of the responses from half of the lowest elastic mode on, by LM-FBS.
    place, lines = (
        [(model.mechanism.response.point, model.mechanism.response.direction)],
        np.linspace(row[0] / 2.0, table.band[1], 2000),
    )
    sizes = np.abs(model.coupled_frf(2.3, lines, place, place).values[:, 0, 0])
    peak = solution.peak(table.peak_band)
    for at, height in (row[-2:], (peak.frequency, peak.magnitude)):
        assert at == pytest.approx(lines[sizes.argmax()], abs=lines[1] - lines[0])
        assert height == pytest.approx(sizes.max(), rel=1e-3)


def test_viscous_beside_structural_damping(mapping: Any) -> None:
    """Both together have no such table, which the error says with the remedy."""
    mapping["springs"] = {"s": {"joint": "P1", "stiffness": 1.0, "damping": 20.0}}
    mapping["damping"] = {"rule": "loss_factor", "factor": 0.02}
    with pytest.raises(TableError, match=r"alpha3 = .* deg: .*rule of the same kind"):
        build_table(LinkageModel(mechanism_from_mapping(mapping)), 1e-2)


def test_more_modes_than_the_model_has(mapping: Any) -> None:
    """The error names the key that asks for too much."""
    mapping["springs"] = {"s": {"joint": "P1", "stiffness": 1.0, "damping": 20.0}}
    mapping["response"]["modes"] = 300
    with pytest.raises(TableError, match=r"response\.modes is 300"):
        build_table(LinkageModel(mechanism_from_mapping(mapping)), 1e-2)


def test_rounding_of_small_damping_ratios() -> None:
    """Rounding of a small ratio is part of the reported error, and a tolerance below it refused."""
    ratio, dashpot = 1e-8, 1e-3
    model = LinkageModel(crossing_crank(GAP, AT, ratio, dashpot))
    table = build_table(model, 1e-2)
    for angle in np.linspace(*STROKE, 20)[1:-1].tolist():
        row = table.evaluate(np.array([angle]))[0]
        poles = exact_poles(GAP, AT, ratio, dashpot, angle)
        assert worst_pole_error(table, angle, row, poles) <= 1.0
    assert table.interpolation_error.max() > 1e-12 / row[2:4].min()
    with pytest.raises(TableError, match=r"Rounding .* at alpha3 = .* deg, .* of at least"):
        build_table(model, 1e-6)
