# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Changes of modes by uncertain numbers from the ensemble of a table, beside the model itself."""

import numpy as np

from linkage_vibration.listening.model_check import number_effects
from linkage_vibration.mechanics.model import LinkageModel
from test.support.first_order import first_order
from test.support.in_plane import plane_mechanism, plane_table


def test_effects_are_those_of_the_model() -> None:
    """Each number changes each mode as the derivatives of the model say, and all of them together.

    They are differences over standard deviations of up to 25 %, so higher orders remain: up to 4 %,
    and 0.002. These limits were set at other heights.
    """
    table, mechanism = plane_table(), plane_mechanism()
    assert mechanism.uncertainty is not None
    heights = np.random.default_rng(7).uniform(*table.alpha3_range, 3).tolist()
    effects = number_effects(table, mechanism, np.array(heights))
    variances = np.einsum("iak,ij,jak->ak", effects, mechanism.uncertainty.correlation, effects)
    np.testing.assert_allclose(
        np.sqrt(variances),
        table.evaluate_parameter_deviations(np.array(heights))[:, : table.n_modes],
        rtol=0.03,
    )
    exact = first_order(LinkageModel(mechanism), heights, 4).swapaxes(0, 1)
    np.testing.assert_allclose(effects[..., :4], exact, 0.04, 2e-3)
