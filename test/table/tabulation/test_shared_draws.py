# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws of members in both halves, and deviations and effects of numbers that follow from them."""

import numpy as np
import pytest

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.listening.model_check import number_effects
from linkage_vibration.mechanics.description import UncertainNumber, Uncertainty, coarser
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.uncertainty import paired_draws
from linkage_vibration.prediction.ensemble import load_factors
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from test.prediction.test_level_deviations import within_samples
from test.support.first_order import first_order

ANGLES = np.array([1.7, 2.3, 3.0])  # rad
CONTACT = "lateral.axles.front_axle.contact"


@pytest.fixture(scope="module")
def table() -> Table:
    """Return the table of the shipped hitch, between few points."""
    model = LinkageModel(read_mechanism())
    return build_table(model, 1e-4, ["E1"])


@pytest.mark.parametrize(
    ("n", "n_alike", "m"), [(5, 0, 32), (32, 0, 32), (33, 1, 32), (48, 16, 32), (49, 16, 33)]
)
def test_draws_of_pairs(n: int, n_alike: int, m: int) -> None:
    """The best known numbers beyond 32, up to 16, are alike in a pair; others are opposite.

    All are uncorrelated and have the variance 1, and draws of loads are not correlated with them.
    """
    shares = np.linspace(0.5, 0.01, n).tolist()
    numbers = tuple(UncertainNumber("a", -2.0, 2.0 * each, 1e-3, True) for each in shares)
    rows = tuple(map(tuple, np.eye(n).tolist()))
    first, second = paired_draws(Uncertainty(numbers, rows, lambda values: None), 7)  # type: ignore
    assert first.shape == (m, n)
    opposite = n - n_alike
    assert (first[:, :opposite] == -second[:, :opposite]).all()
    assert (first[:, opposite:] == second[:, opposite:]).all()
    draws = np.concatenate([first, second])
    assert draws.mean(axis=0) == pytest.approx(0.0, abs=1e-12)
    assert draws.T @ draws / len(draws) == pytest.approx(np.eye(n), abs=1e-12)
    orders = [Excitation(f"{i}", Source.PTO, 1.0, relative_stddev=0.01) for i in range(9)]
    frequencies = (load_factors(orders, draws)[1] - 1.0) / 0.01
    assert frequencies.std(axis=1) == pytest.approx(1.0)
    assert frequencies @ draws / len(draws) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.nightly(short="test_members_of_the_lateral_half_are_known")
def test_deviations_are_those_of_models(table: Table) -> None:
    """Those of both halves are within 15 %, and three standard errors, of 200 drawn models."""
    mechanism = read_mechanism()
    assert mechanism.uncertainty is not None
    normal = np.random.default_rng(5).standard_normal((200, len(mechanism.uncertainty.numbers)))
    nearby, samples = LinkageModel(mechanism).kinematics.nearby, []
    for values in mechanism.uncertainty.draw(normal).tolist():
        try:
            drawn = coarser(mechanism.uncertainty.described(values), 8, 4)
            halves = LinkageModel(drawn, kinematics=nearby(drawn)).halves
            rows = [row for half in halves for row in half.stack(ANGLES).rows]
        except LinkageVibrationError:  # its cylinder is a little too short
            continue
        poles = [row.damped.oscillating[:6] for row in rows]
        samples.append([np.log([np.abs(p), -p.real / np.abs(p)]) for p in poles])
    assert len(samples) > 190
    stated = []
    for half in table.halves:
        order = np.argsort(half.evaluate(ANGLES)[:, :6], axis=1)[:, np.newaxis]
        both = half.evaluate_parameter_deviations(ANGLES).reshape(len(ANGLES), 2, 6)
        stated.extend(np.take_along_axis(both, order, axis=2))
    logs, deviations = np.array(samples), np.array(stated)
    # A damping ratio is stated by its own deviation, that of its logarithm if it is lognormal.
    assert within_samples(deviations[:, 0], logs[:, :, 0])
    assert within_samples(deviations[:, 1], np.exp(logs[:, :, 1]))


def test_members_of_the_lateral_half_are_known(table: Table) -> None:
    """Modes that veer between two heights are followed from the other side, or by the mechanism.

    Factors of levels need 95 % of the members.
    """
    for half in table.halves:
        unknown = np.isnan(half.ensemble_poles.real).any(axis=(1, 2))
        assert unknown.mean() < 0.05


@pytest.mark.nightly(short="test_members_of_the_lateral_half_are_known")
def test_effects_belong_to_one_of_both(table: Table) -> None:
    """The number that changes a mode most is that of whole models, to a tenth of all changes.

    With the chain, the tractor's roll and the implement's sway veer, so that they change with the
    draws, too: by up to 0.17 with those of five other seeds.
    The contact of an axle changes lateral modes alone.
    """
    mechanism = read_mechanism()
    assert mechanism.uncertainty is not None
    heights, limits = [1.8, 2.6], np.array([[0.1] * 5, [0.1, 0.1, 0.1, 0.2, 0.2]])
    effects = number_effects(table, mechanism, np.array(heights)).swapaxes(0, 1)
    contact = [number.path for number in mechanism.uncertainty.numbers].index(CONTACT)
    for half, model in enumerate(LinkageModel(mechanism).halves):
        modes = np.flatnonzero(table.lateral_modes == half)[:5]
        for found, own in zip(effects[..., modes], first_order(model, heights, 5), strict=True):
            largest = np.abs(own).argmax(axis=0), range(len(modes))
            assert np.abs(found).argmax(axis=0).tolist() == largest[0].tolist()
            off = np.abs(found[largest] - own[largest])
            assert (off < limits[half] * np.sqrt((own**2).sum(axis=0))).all()
            assert found[contact].any() == (half == 1)
