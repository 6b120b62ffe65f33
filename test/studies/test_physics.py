# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A plan names the physics that a scene needs, and what each part of it changes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.studies.plan.physics import (
    CRANK,
    TRACTOR,
    Effect,
    effects,
    physics_table,
)
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file

BAND = (0.0, 200.0)
ANGLES = [math.radians(angle) for angle in (90.0, 135.0, 180.0)]


@pytest.fixture(scope="module")
def on_tractor() -> Mechanism:
    """Return the shipped linkage on its tractor."""
    return read_mechanism(config_file(DEFAULT_MECHANISM))


def found(mechanism: Mechanism) -> dict[str, Effect]:
    """Return the effects by their names."""
    return {one.name: one for one in effects(mechanism, BAND, ANGLES)}


def test_effects_on_the_tractor(on_tractor: Mechanism) -> None:
    """Tractor and oil are needed; the change of f1 by gravity is that of two separate models."""
    effect = found(on_tractor)
    assert effect[TRACTOR].verdict(0.01) == effect[CRANK].verdict(0.01) == "needed, and described"
    assert effect["gravity"].verdict(0.01) == "missing; add `gravity: 9.81`"
    assert effect["gravity"].verdict(0.05) == "not needed"
    models = [LinkageModel(replace(on_tractor, gravity=g)) for g in (0.0, 9.81)]
    first = np.array([[m.solve(at).natural_frequencies[3] for m in models] for at in ANGLES])
    changes = np.abs(first[:, 1] / first[:, 0] - 1.0)
    assert effect["gravity"].change == pytest.approx(changes.max(), rel=0.05)


def test_a_heavy_tractor_and_stiff_oil_may_be_left_out(on_tractor: Mechanism) -> None:
    """A tractor of infinite mass is a ground; a spring of infinite stiffness is a clamp."""
    assert on_tractor.base is not None
    body = replace(on_tractor.base.body, mass=1e12, inertia=1e12)
    spring = replace(on_tractor.springs[0], stiffness=1e12)
    rigid = replace(on_tractor, base=replace(on_tractor.base, body=body), springs=(spring,))
    effect = found(rigid)
    assert "does not stay" in effect["gravity"].verdict(1e-4)  # the tyres carry 1e12 kg
    for name in (TRACTOR, CRANK):
        assert effect[name].change < 1e-4
        assert effect[name].verdict(1e-4) == "not needed, and may be left out"


def test_what_is_not_described_is_not_known(mechanism: Mechanism) -> None:
    """The clamped linkage of the paper says nothing of a tractor, and the table says so."""
    effect = found(mechanism)
    assert math.isnan(effect[TRACTOR].change)
    assert effect[TRACTOR].verdict(0.01) == "not known; describe the tractor under `base:`"
    assert "not known" in effect[CRANK].verdict(0.01)
    lines = physics_table(effects(mechanism, BAND, ANGLES), 0.1).splitlines()
    assert lines[1].split() == ["gravity", "1.7", "%", "not", "needed"]


def test_gravity_that_is_described(mechanism: Mechanism) -> None:
    """Without gravity, a linkage described with it changes by as much, measured from its side."""
    without = found(mechanism)["gravity"]
    described = found(replace(mechanism, gravity=9.81))["gravity"]
    assert described.described
    assert not without.described
    assert described.change == pytest.approx(without.change, rel=0.05)


def test_a_band_without_modes(mechanism: Mechanism) -> None:
    """Nothing is known in a band below the first mode, and the table gives the reason."""
    [gravity] = [one for one in effects(mechanism, (0.0, 0.1), ANGLES) if one.name == "gravity"]
    assert gravity.verdict(0.1) == "not known; the linkage has no mode in the band"
