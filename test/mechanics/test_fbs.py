# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""LM-FBS against closed forms and against the assembled matrices of real linkages."""

import contextlib
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh

from linkage_vibration.mechanics import fbs
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.coupling import assembled_frf
from linkage_vibration.mechanics.description import (
    Damping,
    LossFactor,
    Mechanism,
    ModalRatio,
    Rayleigh,
)
from linkage_vibration.mechanics.fbs import (
    FbsError,
    component_frf,
    couple_frfs,
    couple_frfs_with_error,
)
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.parsing import mechanism_from_mapping

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ANGLES_DEG = (90.0, 115.0, 140.0, 168.0, 180.0)
PLACES = [("E1", "z"), ("E1", "x"), ("E2", "x"), ("V1", "z")]
FREQUENCIES = np.linspace(0.5, 200.0, 400)


def scalar(value: float) -> FloatArray:
    """Return a matrix of one DoF."""
    return np.array([[value]])


def coupled(model: LinkageModel, solution: Solution, frequencies: FloatArray) -> ComplexArray:
    """FRFs between all PLACES by LM-FBS, springs by their compliance."""
    blocks = []
    for c in model.components:
        assert isinstance(c, Component)
        frf = component_frf(c.mass, c.stiffness, c.damping, len(c.dofs), frequencies, c.loss_factor)
        blocks.append(frf)
    joining = solution.joining
    omega = 2.0 * math.pi * frequencies[:, np.newaxis]
    both = np.vstack([joining.compatibility, joining.elongation])
    compliance = np.zeros((len(omega), len(both)), dtype=np.complex128)
    compliance[:, len(joining.compatibility) :] = 1.0 / (
        joining.stiffness + 1j * omega * joining.damping
    )
    rows = model.rows(PLACES, solution.configuration)
    return couple_frfs(blocks, both, rows, rows, compliance)


def assembled(model: LinkageModel, solution: Solution, frequencies: FloatArray) -> ComplexArray:
    """FRFs between all PLACES by solving the primal assembly, frequency by frequency."""
    system = solution.coupled
    rows = system.restrict(model.rows(PLACES, solution.configuration))
    omega = 2.0 * math.pi * frequencies[:, np.newaxis, np.newaxis]
    dynamic = system.stiffness + 1j * (system.loss + omega * system.damping)
    dynamic = dynamic - omega**2 * system.mass
    return np.asarray(rows @ np.linalg.solve(dynamic, rows.T[np.newaxis]))


def test_two_oscillators_in_closed_form() -> None:
    """A held oscillator and a free mass, joined rigidly and by a damped spring."""
    m, k, c, free = 2.0, 800.0, 3.0, 5.0
    frequencies = np.linspace(0.1, 20.0, 50)
    w = 2.0 * math.pi * frequencies
    blocks = [
        component_frf(scalar(m), scalar(k), scalar(c), 1, frequencies),
        component_frf(scalar(free), scalar(0.0), scalar(0.0), 1, frequencies),
    ]
    joint, pick = np.array([[1.0, -1.0]]), np.array([[1.0, 0.0]])
    rigid = couple_frfs(blocks, joint, pick, pick)
    np.testing.assert_allclose(rigid[:, 0, 0], 1 / (k + 1j * w * c - w**2 * (m + free)), 1e-12)
    spring = 300.0 + 1j * w * 4.0
    compliance = (1 / spring[:, np.newaxis]).astype(np.complex128)
    sprung = couple_frfs(blocks, joint, pick, pick, compliance)
    seen = k + 1j * w * c - w**2 * m - spring * w**2 * free / (spring - w**2 * free)
    np.testing.assert_allclose(sprung[:, 0, 0], 1 / seen, 1e-12)


def test_compliance_spans_rigid_to_apart() -> None:
    """A compliance of zero joins; a very large one leaves the components as they were."""
    frequencies = np.array([1.0, 3.0])
    first = component_frf(scalar(2.0), scalar(800.0), scalar(3.0), 1, frequencies)
    joint, pick = np.array([[1.0, -1.0]]), np.array([[1.0, 0.0]])
    apart = couple_frfs([first, first], joint, pick, pick, np.array([1e12]))
    np.testing.assert_allclose(apart, first, rtol=1e-12)
    np.testing.assert_allclose(
        couple_frfs([first, first], joint, pick, pick), first / 2, rtol=1e-12
    )


@pytest.mark.parametrize("alpha3_deg", ANGLES_DEG)
def test_equals_modal_superposition(model: LinkageModel, alpha3_deg: float) -> None:
    """Drive points and cross FRFs agree with the primal pole-residue sum within 1e-8."""
    solution = model.solve(math.radians(alpha3_deg))
    actual = coupled(model, solution, FREQUENCIES)
    exact = solution.frf(PLACES, PLACES).frf(FREQUENCIES)
    np.testing.assert_allclose(actual, exact, rtol=1e-8)


@pytest.mark.parametrize("kind", ["rayleigh", "loss", "mixed"])
@pytest.mark.parametrize("alpha3_deg", [90.0, 140.0, 180.0])
def test_any_damping(mechanism: Mechanism, kind: str, alpha3_deg: float) -> None:
    """Links with different kinds of damping respond as the assembled complex matrices do."""
    kinds: dict[str, list[Damping]] = {
        "rayleigh": [Rayleigh(3.0, 1e-6), Rayleigh(0.1, 4e-5), Rayleigh(0.0, 2e-4)],
        "loss": [LossFactor(0.01), LossFactor(0.08), LossFactor(0.03)],
        "mixed": [LossFactor(0.05), Rayleigh(2.0, 1e-5), ModalRatio(0.03)],
    }
    rules = kinds[kind]
    links = tuple(
        replace(link, damping=rule)
        for link, rule in zip(mechanism.links, [*rules, rules[0]], strict=True)
    )
    model = LinkageModel(replace(mechanism, links=links))
    solution = model.solve(math.radians(alpha3_deg))
    actual = coupled(model, solution, FREQUENCIES)
    np.testing.assert_allclose(actual, assembled(model, solution, FREQUENCIES), rtol=1e-8)


def test_springs_by_compliance(mapping: Any) -> None:
    """A damped spring between two links gives what its matrices give in the primal assembly."""
    mapping["springs"] = {"stay": {"between": ["P2", "V1"], "stiffness": 3e5, "damping": 2e3}}
    model = LinkageModel(mechanism_from_mapping(mapping))
    for angle in np.radians([90.0, 180.0]):
        solution = model.solve(angle)
        actual = coupled(model, solution, FREQUENCIES)
        np.testing.assert_allclose(actual, assembled(model, solution, FREQUENCIES), rtol=1e-8)


def test_floating_links_at_low_frequencies(model: LinkageModel) -> None:
    """At 0.1 Hz, where free links move far more than the linkage, errors stay below 1e-8."""
    frequencies = np.array([0.1, 0.2, 0.4])
    for angle in np.radians(ANGLES_DEG):
        solution = model.solve(angle)
        exact = assembled(model, solution, frequencies)
        rest = np.abs(coupled(model, solution, frequencies) - exact).max(axis=(1, 2))
        assert (rest < 1e-8 * np.abs(exact).max(axis=(1, 2))).all()


def test_reciprocity(model: LinkageModel) -> None:
    """Response and force may change places."""
    actual = coupled(model, model.solve(math.radians(120.0)), FREQUENCIES)
    np.testing.assert_allclose(actual.swapaxes(1, 2), actual, rtol=1e-8)


def test_inner_coordinates_and_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A free chain seen at both ends: as a 2x2 closed form, however small the chunks."""
    m, k = 3.0, 2000.0  # end masses m, a middle mass 2 m, springs k; the ends come first
    mass = np.diag([m, m, 2 * m])
    stiffness = k * np.array([[1.0, 0.0, -1.0], [0.0, 1.0, -1.0], [-1.0, -1.0, 2.0]])
    frequencies = np.linspace(0.5, 30.0, 60)
    squared = (2.0 * math.pi * frequencies) ** 2
    together = -1 / (4 * m * squared) - 1 / (4 * m) / (squared - 2 * k / m)
    against = 1 / (2 * m) / (k / m - squared)
    monkeypatch.setattr(fbs, "_CHUNK", 7 * mass.size)
    actual = component_frf(mass, stiffness, 0.0 * mass, 2, frequencies)
    np.testing.assert_allclose(actual[:, 0, 0], together + against, rtol=1e-9)
    np.testing.assert_allclose(actual[:, 0, 1], together - against, rtol=1e-9)


def test_zero_frequency() -> None:
    """At 0 Hz a held component gives its compliance, and a free one is refused with the fix."""
    pair = 500.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    none, mass = np.zeros((2, 2)), np.eye(2)
    held = component_frf(mass, pair + np.diag([100.0, 0.0]), none, 2, np.array([0.0]))
    np.testing.assert_allclose(held[0].real, [[0.01, 0.01], [0.01, 0.012]], rtol=1e-12)
    with pytest.raises(FbsError, match="0 Hz; begin above 0"):
        component_frf(mass, pair, none, 2, np.array([0.0, 1.0]))


def test_undamped_resonance_is_refused() -> None:
    """A line on an undamped resonance is named, not divided by."""
    stiffness = scalar((2.0 * math.pi * 4.0) ** 2)
    with pytest.raises(FbsError, match="singular at 4 Hz"):
        component_frf(scalar(1.0), stiffness, scalar(0.0), 1, np.array([3.0, 4.0]))


def test_joints_without_frfs_are_refused() -> None:
    """Two components that respond to nothing have no flexibility at their joint."""
    still, pick = np.zeros((5, 1, 1), dtype=complex), np.array([[1.0, 0.0]])
    with pytest.raises(FbsError, match="singular at line 0 and 4 other frequencies"):
        couple_frfs([still, still], np.array([[1.0, -1.0]]), pick, pick)


def test_rows_that_say_nothing_join_nothing() -> None:
    """A row of zeros leaves the components as they are, where B H B^T is singular."""
    block = np.full((3, 1, 1), 2.0 + 0.0j)
    pick = np.array([[1.0, 0.0]])
    np.testing.assert_array_equal(couple_frfs([block, block], np.zeros((1, 2)), pick, pick), block)


def plain(blocks: Sequence[ComplexArray], b: FloatArray, rows: FloatArray) -> ComplexArray:
    """Return eq. 19 unchanged, solved at each frequency; NaN where that fails."""
    values = np.full((len(blocks[0]), len(rows), len(rows)), np.nan + 0.0j)
    for frf, line in zip(values, zip(*blocks, strict=True), strict=True):
        h = block_diag(*line)
        with contextlib.suppress(np.linalg.LinAlgError):
            frf[:] = rows @ (h - h @ b.T @ np.linalg.solve(b @ h @ b.T, b @ h)) @ rows.T
    return values


def share(actual: ComplexArray, exact: ComplexArray) -> FloatArray:
    """Return the largest difference at each frequency, of the largest FRF there."""
    return np.asarray(np.abs(actual - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2)))


def frfs_of(model: LinkageModel, frequencies: FloatArray) -> list[ComplexArray]:
    """Return the components' FRFs."""
    known = [c for c in model.components if isinstance(c, Component)]
    return [
        component_frf(c.mass, c.stiffness, c.damping, len(c.dofs), frequencies, c.loss_factor)
        for c in known
    ]


@pytest.mark.parametrize("alpha3_deg", [90.0, 140.0, 180.0])
def test_joints_closed_twice(model: LinkageModel, alpha3_deg: float) -> None:
    """With two pins closed twice the plain equation stops or is all wrong; ours stays to 1e-8."""
    solution = model.solve(math.radians(alpha3_deg))
    rows = model.rows(PLACES, solution.configuration)
    blocks, b = frfs_of(model, FREQUENCIES), solution.joining.compatibility
    once = couple_frfs(blocks, b, rows, rows)
    b = np.vstack([b, b[3:7], 0.6 * b[:1] + 0.8 * b[1:2]])
    assert share(couple_frfs(blocks, b, rows, rows), once).max() < 1e-8
    assert np.nanmedian(share(plain(blocks, b, rows), once)) > 1.0


def test_springs_side_by_side_repeat_nothing(model: LinkageModel) -> None:
    """Two springs with the same row add up, and a rigid row beside them rules."""
    solution = model.solve(2.0)
    rows = model.rows(PLACES, solution.configuration)
    blocks, b = frfs_of(model, FREQUENCIES), solution.joining.compatibility
    spring = rows[:1]
    pair = np.vstack([b, spring, spring])
    soft = np.zeros(len(pair))
    soft[-2:] = 1e-5
    receptances = couple_frfs(blocks, pair[:-1], rows, rows, np.append(soft[:-2], 0.5e-5))
    assert share(couple_frfs(blocks, pair, rows, rows, soft), receptances).max() < 1e-8
    held = couple_frfs(blocks, pair[:-1], rows[1:], rows[1:])
    soft[-1] = 0.0
    assert share(couple_frfs(blocks, pair, rows[1:], rows[1:], soft), held).max() < 1e-8


@pytest.mark.parametrize("damping", [Rayleigh(0.0, 0.0), ModalRatio(0.01), LossFactor(0.02)])
def test_rounding_at_low_frequencies(mechanism: Mechanism, damping: Damping) -> None:
    """The error stays below its estimate; lines on which that passes 1e-6 are refused by name."""
    model = LinkageModel(replace(mechanism, damping=damping))
    frequencies = np.array([1e-4, 1e-3, 0.1, 1.0, 10.0, 100.0])
    blocks = frfs_of(model, frequencies)
    for angle in np.radians(ANGLES_DEG):
        solution = model.solve(angle)
        rows, b = model.rows(PLACES, solution.configuration), solution.joining.compatibility
        exact = assembled_frf(solution.coupled, frequencies, rows, rows)
        actual, error = couple_frfs_with_error(blocks, b, rows, rows)
        largest = np.abs(exact).max(axis=(1, 2))
        assert (share(actual, exact) < error / largest).all()
        assert share(actual, exact)[0] > 1e-6
        assert (error / largest < 1e-6).tolist() == [False, False, True, True, True, True]
        with pytest.raises(FbsError, match=r"At 0\.0001 Hz and 1 other .*free near 0 Hz"):
            couple_frfs(blocks, b, rows, rows, frequencies=frequencies)
        some = [block[2:] for block in blocks]
        np.testing.assert_array_equal(couple_frfs(some, b, rows, rows), actual[2:])


@pytest.mark.parametrize("body", ["lower_link", "upper_link", "lift_rod"])
def test_on_a_components_own_resonance(mechanism: Mechanism, body: str) -> None:
    """Near an undamped resonance of a free link digits are lost: estimated, then refused."""
    model = LinkageModel(replace(mechanism, damping=Rayleigh(0.0, 0.0)))
    solution = model.solve(2.0)
    rows, b = model.rows(PLACES, solution.configuration), solution.joining.compatibility
    component = next(c for c in model.components if c.name == body)
    assert isinstance(component, Component)
    values = eigh(component.stiffness, component.mass, eigvals_only=True)
    resonance = math.sqrt(values[3]) / (2.0 * math.pi)
    frequencies = resonance * (1.0 + np.array([1e-3, 1e-6, 1e-14]))
    blocks = frfs_of(model, frequencies)
    exact = assembled_frf(solution.coupled, frequencies, rows, rows)
    actual, error = couple_frfs_with_error(blocks, b, rows, rows)
    largest = np.abs(exact).max(axis=(1, 2))
    assert (share(actual, exact) < error / largest).all()
    assert share(plain(blocks, b, rows), exact)[2] > 1e-6
    with pytest.raises(FbsError, match=r"line 2 the components .* undamped resonance of their own"):
        couple_frfs(blocks, b, rows, rows)
    some = [block[:2] for block in blocks]
    assert (share(couple_frfs(some, b, rows, rows), exact[:2]) < 1e-8).all()


def test_two_identical_links(mechanism: Mechanism) -> None:
    """Two undamped rods with the same poles, coupled by FRFs, are one rod twice as strong.

    Beside a resonance of theirs both have receptances without bound.
    """
    model = LinkageModel(replace(mechanism, damping=Rayleigh(0.0, 0.0)))
    solution = model.solve(2.0)
    rows, b = model.rows(PLACES, solution.configuration), solution.joining.compatibility
    components = [c for c in model.components if isinstance(c, Component)]
    rod = components.index(next(c for c in components if c.name == "lift_rod"))
    mass, stiffness = components[rod].mass / 2.0, components[rod].stiffness / 2.0
    resonance = math.sqrt(eigh(stiffness, mass, eigvals_only=True)[3]) / (2.0 * math.pi)
    frequencies = np.append(FREQUENCIES[1::40], resonance * (1.0 + 1e-6))
    blocks = frfs_of(model, frequencies)
    n, m = b.shape[1], len(components[rod].dofs)
    start = sum(len(c.dofs) for c in components[:rod])
    blocks[rod] = component_frf(mass, stiffness, 0.0 * mass, m, frequencies)
    # The other rod's DoFs are behind all others and follow those of the first.
    follows = np.zeros((m, n + m))
    follows[:, start : start + m], follows[:, n:] = np.eye(m), -np.eye(m)
    both = np.vstack([np.pad(b, ((0, 0), (0, m))), follows])
    wide = np.pad(rows, ((0, 0), (0, m)))
    receptances = couple_frfs([*blocks, blocks[rod]], both, wide, wide)
    exact = assembled_frf(solution.coupled, frequencies, rows, rows)
    assert (share(receptances, exact) < 1e-8).all()


def test_response_that_vanishes_is_no_loss(model: LinkageModel) -> None:
    """A point on the ground does not move; its response of zero is no loss of digits."""
    solution = model.solve(2.0)
    rows = model.rows([("P1", "x")], solution.configuration)
    held = couple_frfs(frfs_of(model, FREQUENCIES), solution.joining.compatibility, rows, rows)
    assert np.abs(held).max() < 1e-15
