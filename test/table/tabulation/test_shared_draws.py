# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers across the plane share draws with others, and deviations and effects stay as they are."""

import numpy as np
import pytest

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.listening.number_effects import NumberEffects
from linkage_vibration.mechanics.description import UncertainNumber, Uncertainty, coarser
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.uncertainty import draw_of
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table
from test.prediction.test_level_deviations import within_samples
from test.support.first_order import first_order

ANGLES = np.array([1.7, 2.3, 3.0])  # rad
CHAIN, WEAK = "lateral.chains.a.stiffness", "ground.P2.0"


@pytest.fixture(scope="module")
def table() -> Table:
    """Return the table of the shipped hitch, between few points."""
    model = LinkageModel(read_mechanism())
    return build_table(model, 1e-4, ["E1"])


def n_draws(deviations: dict[str, float], n_others: int, correlated: float = 0.0) -> int:
    """Return how many draws numbers of 1 have; the first two may be correlated."""
    paths = deviations | {f"links.a{i}.section.width": 0.2 for i in range(n_others)}
    numbers = [UncertainNumber(path, 1.0, each, 1e-3, True) for path, each in paths.items()]
    correlation = np.eye(len(paths))
    correlation[0, 1] = correlation[1, 0] = correlated
    rows = tuple(map(tuple, correlation.tolist()))
    return int(draw_of(Uncertainty(tuple(numbers), rows, lambda values: None)).max()) + 1  # type: ignore


@pytest.mark.parametrize(
    ("path", "weak", "n_others", "correlated", "shared"),
    [
        (CHAIN, 0.01, 31, 0.0, 1),
        (CHAIN, 0.01, 30, 0.0, 0),  # 32 members are needed anyway
        (CHAIN, 0.0101, 31, 0.0, 0),
        (CHAIN, 0.01, 31, 0.5, 0),
        ("base.mounts.rear_axle.track", 0.01, 31, 0.0, 1),
        ("base.mounts.rear_axle.track, lateral.axles.rear_axle.track", 0.01, 31, 0.0, 1),
        ("lateral.y.E1", 0.01, 31, 0.0, 0),  # changes the length of a link, too
        ("lateral.y.E1, lateral.inertia.base.yaw", 0.01, 31, 0.0, 0),
    ],
)
def test_which_numbers_share_a_draw(
    path: str, weak: float, n_others: int, correlated: float, shared: int
) -> None:
    """A number across the plane follows one of the vertical half with up to 1 % of deviation."""
    n = 2 + n_others
    assert n_draws({path: 0.5, WEAK: weak}, n_others, correlated) == n - shared


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


def test_effects_belong_to_one_of_both(table: Table) -> None:
    """The number that changes a mode most is that of whole models, to a tenth of all changes.

    One of 36 pairs is missing in the lateral half. P2 follows the contact of an axle, and changes
    vertical modes alone.
    """
    mechanism = read_mechanism()
    assert mechanism.uncertainty is not None
    effects, heights = NumberEffects(table), [1.8, 2.6]
    changes = effects.at(np.array(heights))
    paths = [number.path for number in mechanism.uncertainty.numbers]
    for half, model in enumerate(LinkageModel(mechanism).halves):
        modes = np.flatnonzero(table.lateral_modes == half)[:5]
        exact = first_order(model, heights, 5)
        for here, own in zip(changes[:, modes], exact, strict=True):
            found = np.array([*effects.of_numbers(mechanism, here, modes).values()])
            most = np.abs(own).argmax(axis=0)
            assert np.abs(found).argmax(axis=0).tolist() == most.tolist()
            largest = most, range(len(modes))
            off = np.abs(found[largest] - own[largest])
            assert (off < 0.1 * np.sqrt((own**2).sum(axis=0))).all()
            assert found[paths.index("ground.P2.0")].any() == (half == 0)
            assert found[paths.index("lateral.axles.front_axle.contact")].any() == (half == 1)
