# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Linkages that ship against Exudyn, a flexible multibody code that shares nothing with ours."""

import math

import numpy as np
import pytest

pytest.importorskip("exudyn", reason="exudyn comes with the test extra, on x86_64")

from benchmark.validation.exudyn_beams import CONFIG, MODES, ExudynModel
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from test.mechanics.test_base import on_base
from test.support.in_plane import plane_mechanism

ELEMENTS = 24  # a link; the error is below 1e-5


@pytest.mark.parametrize("alpha3_deg", [100.0, 175.0])
def test_three_point_linkage_has_the_natural_frequencies_of_exudyn(alpha3_deg: float) -> None:
    """The first six differ by less than 1e-4 with the mesh and the reduction that ship."""
    mechanism = read_mechanism(CONFIG / "three_point_linkage.yaml")
    solution = LinkageModel(mechanism).solve(math.radians(alpha3_deg))
    theirs = ExudynModel(mechanism, solution.configuration, ELEMENTS).natural_frequencies()
    np.testing.assert_allclose(
        solution.natural_frequencies[:MODES], theirs[:MODES], rtol=1e-4, atol=0.0
    )


def test_pins_beside_the_axis_steps_masses_and_springs_are_those_of_exudyn() -> None:
    """The first four of the six-bar that has them all differ by less than 1e-4."""
    mechanism = read_mechanism(CONFIG / "stephenson_six_bar.yaml")
    solution = LinkageModel(mechanism).solve(math.radians(70.0))
    theirs = ExudynModel(mechanism, solution.configuration, ELEMENTS).natural_frequencies()
    np.testing.assert_allclose(solution.natural_frequencies[:4], theirs[:4], rtol=1e-4, atol=0.0)


@pytest.mark.parametrize("clamped", [True, False])
@pytest.mark.parametrize("alpha3_deg", [90.0, 135.0, 180.0])
def test_linkage_on_a_tractor_has_the_natural_frequencies_of_exudyn(
    alpha3_deg: float, clamped: bool
) -> None:
    """The first six differ by less than 1e-4, with the crank clamped or held by oil."""
    mechanism = on_base() if clamped else plane_mechanism()
    solution = LinkageModel(mechanism).solve(math.radians(alpha3_deg))
    theirs = ExudynModel(mechanism, solution.configuration, ELEMENTS).natural_frequencies()
    ours = solution.modes.omega / (2.0 * math.pi)  # undamped, as theirs
    np.testing.assert_allclose(ours[:MODES], theirs[:MODES], rtol=1e-4, atol=0.0)
