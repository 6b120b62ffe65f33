# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Noise, drift and wrong sensors in the FRFs of a link, and what the assembly makes of them."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.fbs import component_frf, couple_frfs
from linkage_vibration.mechanics.identification import identify
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.regularisation import (
    MeasuredFrfs,
    RegularisationError,
    noise_gain,
    noise_level,
    regularise,
    rigid_motions,
)

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LINES = np.linspace(0.1, 200.0, 2000)
PLACES = [("E1", "z"), ("E1", "x"), ("E2", "x"), ("V1", "z")]


@dataclass(frozen=True)
class Bench:
    """The paper's linkage at 140 deg, one of whose links is measured."""

    model: LinkageModel
    lines: FloatArray
    link: Component
    blocks: list[ComplexArray]
    compatibility: FloatArray
    rows: FloatArray
    exact: ComplexArray

    @property
    def at(self) -> int:
        """Which component the link is."""
        return [c.name for c in self.model.components].index(self.link.name)

    @property
    def measured(self) -> ComplexArray:
        """What a measurement of the link without fault would give."""
        return self.blocks[self.at]

    @property
    def motions(self) -> FloatArray:
        """How the link moves when it does not deform."""
        points = self.model.mechanism.local_points(self.link.name)
        return rigid_motions(self.link.dofs, list(points.items()))

    def regularise(self, frf: ComplexArray) -> MeasuredFrfs:
        """Regularise FRFs of the link."""
        return regularise(self.link.dofs, self.lines, frf, self.motions)

    def put(self, part: ComplexArray | MeasuredFrfs) -> list[ComplexArray | MeasuredFrfs]:
        """Return the components with another one in the place of the link."""
        return [part if k == self.at else block for k, block in enumerate(self.blocks)]

    def couple(self, frf: ComplexArray) -> ComplexArray:
        """Return the assembly's receptances of PLACES to a force at the first, from any FRFs."""
        blocks = [frf if k == self.at else block for k, block in enumerate(self.blocks)]
        return couple_frfs(blocks, self.compatibility, self.rows, self.rows[:1])

    def error(self, coupled: ComplexArray) -> float:
        """Relative error of the drive-point receptance over all lines."""
        difference = np.linalg.norm((coupled - self.exact)[:, 0])
        return float(difference / np.linalg.norm(self.exact[:, 0]))


def as_measured(frf: ComplexArray) -> MeasuredFrfs:
    """Return receptances, (n_freq, n, n), that nothing has smoothed."""
    return MeasuredFrfs((frf + frf.swapaxes(1, 2)) / 2.0, np.eye(frf.shape[1]), np.zeros(len(frf)))


def bench(model: LinkageModel, name: str, lines: FloatArray = LINES) -> Bench:
    """Make the components' FRFs at some lines."""
    solution = model.solve(math.radians(140.0))
    assert not solution.joining.stiffness.size
    blocks = []
    for c in model.components:
        assert isinstance(c, Component)
        blocks.append(component_frf(c.mass, c.stiffness, c.damping, len(c.dofs), lines))
    link = next(c for c in model.components if c.name == name)
    assert isinstance(link, Component)
    return Bench(
        model,
        lines,
        link,
        blocks,
        solution.joining.compatibility,
        model.rows(PLACES, solution.configuration),
        solution.frf(PLACES, PLACES[:1]).frf(lines),
    )


def noisy(frf: ComplexArray, share: float, seed: int = 0) -> ComplexArray:
    """Return FRFs with complex normal noise, its standard deviation a share of each value."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(frf.shape) + 1j * rng.standard_normal(frf.shape)
    return frf * (1.0 + share * noise / math.sqrt(2.0))


def test_forces_without_a_resultant_feel_no_mass(model: LinkageModel) -> None:
    """At right angles to the rigid motions receptance stays finite towards 0 Hz, elsewhere not."""
    for name in ("lower_link", "upper_link", "input_crank", "lift_rod"):
        case = bench(model, name, np.array([0.5, 5.0]))
        left, values, _ = np.linalg.svd(case.motions)
        apart = left[:, int((values > 1e-9).sum()) :]
        low, high = np.linalg.norm(case.measured @ apart, axis=(1, 2))
        assert low == pytest.approx(high, rel=1e-2)
        whole = np.linalg.norm(case.measured, axis=(1, 2))
        assert whole[0] > 90.0 * whole[1]


@pytest.mark.parametrize("share", [1e-3, 1e-2, 0.1])
def test_noise_level(model: LinkageModel, share: float) -> None:
    """The noise of a link's FRFs is estimated within 15 %; computed ones have none."""
    exact = bench(model, "lower_link").measured
    assert noise_level(LINES, noisy(exact, share)) == pytest.approx(share, rel=0.15)
    assert noise_level(LINES, exact) < 1e-8


@pytest.mark.parametrize(
    "name", ["lift_rod", pytest.param("lower_link", marks=pytest.mark.nightly)]
)
def test_computed_frfs_stay_as_they_are(model: LinkageModel, name: str) -> None:
    """Without noise, regularisation changes the coupled FRF by 2e-8 at most."""
    case = bench(model, name)
    assert case.error(case.couple(case.regularise(case.measured).frf)) < 2e-8


@pytest.mark.parametrize(
    ("name", "share", "error", "frequency"),
    [
        pytest.param("lift_rod", 1e-3, 2e-3, 1e-4, marks=pytest.mark.nightly),
        pytest.param("lift_rod", 1e-2, 2e-2, 1e-3, marks=pytest.mark.nightly),
        ("lift_rod", 0.1, 0.2, 1e-2),
        pytest.param("upper_link", 1e-2, 2e-2, 1e-3, marks=pytest.mark.nightly),
        pytest.param("lower_link", 1e-3, 0.05, 1e-3, marks=pytest.mark.nightly),
        ("lower_link", 1e-2, 0.1, 2e-3),
    ],
)
def test_noise_in_a_link(
    model: LinkageModel, name: str, share: float, error: float, frequency: float
) -> None:
    """Raw FRFs couple to nonsense; regularised ones show mode 1, at 4 Hz, and no mode that is not.

    Whatever is truncated in B H B^T instead leaves no less than the assembly's whole response.
    """
    case = bench(model, name)
    frf = noisy(case.measured, share)
    assert case.error(case.couple(frf)) > 1.0
    coupled = case.couple(case.regularise(frf).frf)
    assert case.error(coupled) < error
    actual = identify(LINES, coupled, (0.0, 200.0)).omega / (2.0 * math.pi)
    exact = model.solve(math.radians(140.0)).natural_frequencies[:3]
    assert len(actual) == 3
    assert exact[0] < 10.0
    assert actual[0] == pytest.approx(exact[0], rel=frequency)
    np.testing.assert_allclose(actual, exact, rtol=0.03)


def test_truncating_the_interface_flexibility_is_no_cure(model: LinkageModel) -> None:
    """Every truncated SVD of B H B^T leaves an error above the response: its joints come apart."""
    case = bench(model, "lift_rod", np.linspace(0.5, 200.0, 400))
    blocks = case.put(noisy(case.measured, 1e-2))
    n = case.rows.shape[1]
    frf, start = np.zeros((len(case.lines), n, n), dtype=complex), 0
    for block in blocks:
        assert isinstance(block, np.ndarray)
        own = slice(start, start + block.shape[1])
        frf[:, own, own], start = block, own.stop
    b, rows = case.compatibility, case.rows
    for cut in (0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2):
        joints = np.linalg.pinv(b @ frf @ b.T, rcond=cut)
        coupled = rows @ (frf - frf @ b.T @ joints @ b @ frf) @ rows[:1].T
        assert case.error(np.asarray(coupled)) > 1.0
    assert case.error(case.couple(case.regularise(noisy(case.measured, 1e-2)).frf)) < 0.1


def test_gain_of_raw_frfs(model: LinkageModel) -> None:
    """The gain, 4e4 at mode 1, is the spread of 400 noisy couplings within 15 % at every line."""
    case = bench(model, "lift_rod", np.array([1.0, 4.1, 20.0, 98.9, 166.0]))
    gain = noise_gain(
        case.put(as_measured(case.measured)), case.compatibility, case.rows, case.rows[:1]
    )
    noise = 1e-8
    drawn = [case.couple(as_measured(noisy(case.measured, noise, seed)).frf) for seed in range(400)]
    spread = np.sqrt(np.mean(np.abs(np.array(drawn) - case.exact) ** 2, axis=0))
    np.testing.assert_allclose(gain, spread / np.abs(case.exact) / noise, rtol=0.15)
    assert gain[1].max() > 1e4


@pytest.mark.nightly(short="test_gain_of_raw_frfs")
def test_gain_of_regularised_frfs(model: LinkageModel) -> None:
    """Below 1 where the raw gain is thousands, and the spread of 60 couplings within 35 %."""
    case = bench(model, "lift_rod", np.linspace(0.5, 60.0, 120))
    noise = 1e-3
    parts = [case.regularise(noisy(case.measured, noise, seed)) for seed in range(60)]
    coupled = np.array([case.couple(part.frf) for part in parts])
    spread = np.sqrt((np.abs(coupled - coupled.mean(axis=0)) ** 2).mean(axis=0))
    exact = MeasuredFrfs(case.measured, parts[0].kept, parts[0].leverage)
    gain = noise_gain(case.put(exact), case.compatibility, case.rows, case.rows[:1])
    actual = spread / np.abs(coupled.mean(axis=0)) / noise
    lines = [1, 7, 20, 60]
    np.testing.assert_allclose(gain[lines, 0], actual[lines, 0], rtol=0.35)


def test_lines_that_show_no_flexibility(model: LinkageModel) -> None:
    """Up to 20 Hz noise of 1 % hides how the rod deforms: the gain predicts the error above 1."""
    case = bench(model, "lift_rod", np.linspace(0.5, 20.0, 40))
    part = case.regularise(noisy(case.measured, 1e-2))
    coupled = case.couple(part.frf)
    gain = noise_gain(case.put(part), case.compatibility, case.rows[:1], case.rows[:1])
    noise = 1e-2 * np.linalg.norm(gain[:, 0] * coupled[:, 0]) / np.linalg.norm(coupled[:, 0])
    assert case.error(coupled) > 1.0
    assert noise > 1.0
    with pytest.raises(RegularisationError, match="29 lines above 0 Hz are too few"):
        bench(model, "lift_rod", np.linspace(0.5, 20.0, 29)).regularise(case.measured[:29])


def drifted(case: Bench, share: float) -> ComplexArray:
    """Return FRFs whose last two columns were measured when the link was softer."""
    c = case.link
    soft = component_frf(
        c.mass, (1.0 - share) ** 2 * c.stiffness, c.damping, len(c.dofs), case.lines
    )
    return np.concatenate([case.measured[:, :, :-2], soft[:, :, -2:]], axis=2)


def scaled(case: Bench, rows: slice, columns: slice, factor: float) -> ComplexArray:
    """Return FRFs, some of them multiplied."""
    frf = case.measured.copy()
    frf[:, rows, columns] *= factor
    return frf


ALL = slice(None)
FAULTS: dict[str, Callable[[Bench], ComplexArray]] = {
    "a pole 1 % lower in some columns": lambda case: drifted(case, 0.01),
    "a sensor that shows 10 % too much": lambda case: scaled(case, slice(5, 6), ALL, 1.1),
    "one FRF 30 % too large": lambda case: scaled(case, slice(1, 2), slice(5, 6), 1.3),
    "a sensor the wrong way round": lambda case: scaled(case, slice(3, 4), ALL, -1.0),
}

NIGHTLY = list(FAULTS)[1::2]


@pytest.mark.parametrize("share", [pytest.param(0.0, marks=pytest.mark.nightly), 1e-2])
@pytest.mark.parametrize(
    "fault", [*list(FAULTS)[::2], *(pytest.param(f, marks=pytest.mark.nightly) for f in NIGHTLY)]
)
def test_faults_are_refused(model: LinkageModel, fault: str, share: float) -> None:
    """Drift, wrong gains and signs are reported with size and place, also in noise of 1 %."""
    case = bench(model, "lower_link", np.linspace(0.1, 500.0, 2500))
    with pytest.raises(RegularisationError, match=r"response \w+ \w to a force at .* differs by"):
        case.regularise(noisy(FAULTS[fault](case), share))


def test_points_elsewhere_are_refused(model: LinkageModel) -> None:
    """A sensor 5 cm from where the description has it contradicts the rigid motions."""
    case = bench(model, "lower_link")
    points = [("P1", (0.0, 0.0)), ("V1", (0.416, 0.0)), ("E1", (0.810, 0.0))]
    with pytest.raises(RegularisationError, match="wrong gain, sign or place"):
        regularise(case.link.dofs, LINES, case.measured, rigid_motions(case.link.dofs, points))
