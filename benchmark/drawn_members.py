# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How much deviations of damping depend on the draws: ``python -m benchmark.drawn_members``.

A starter is solved in the middle of its stroke: 1000 models that are drawn independently, as in
`benchmark.uncertainty`, and the members of ensembles with other draws than those of the table.
"""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.report import machine, publish, table
from benchmark.uncertainty import ANGLES, SAMPLES, coarse, described, modes_of, sampled
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.uncertainty import rotation
from linkage_vibration.readers.mechanism import mechanism_of

FloatArray = NDArray[np.float64]

NAME = "starters/category_2.yaml"
OWN = 7  # the seed of the draws of tables
OTHERS = range(100, 124)


def members(seed: int) -> FloatArray:
    """Return frequencies (logarithms) and damping ratios of an ensemble, (n, 2, n_modes)."""
    mechanism = mechanism_of(described(NAME), Path("description"))
    assert mechanism.uncertainty is not None
    rows = rotation(len(mechanism.uncertainty.numbers), seed)
    values = mechanism.uncertainty.draw(np.concatenate([rows, -rows])).tolist()
    angle, n = float(np.mean(mechanism.stroke)), mechanism.response.modes
    models = (LinkageModel(coarse(mechanism.uncertainty.described(each))) for each in values)
    return np.array([modes_of(model.solve(angle), n) for model in models])


def lognormal(ratios: FloatArray) -> FloatArray:
    """Return standard deviations of damping ratios, (n, n_modes), from those of logarithms."""
    mean, spread = np.log(ratios).mean(axis=0), np.log(ratios).std(axis=0)
    return np.asarray(np.exp(mean + spread**2 / 2.0) * np.sqrt(np.expm1(spread**2)))


def main() -> None:
    """Compare the deviations by all draws, and publish them."""
    mechanism = mechanism_of(described(NAME), Path("description"))
    angles, middle = np.linspace(*mechanism.stroke, ANGLES), ANGLES // 2
    parts = [sampled(described(NAME), angles, SAMPLES // 4, i) for i in range(4)]
    whole = np.concatenate(parts)[:, middle, 1]
    whole = whole[np.isfinite(whole).all(axis=1)]
    ensembles = [members(seed)[:, 1] for seed in OTHERS]
    pool, own = np.concatenate(ensembles), members(OWN)[:, 1]
    true = pool.std(axis=0)
    fourth = ((whole - whole.mean(axis=0)) ** 4).mean(axis=0) / whole.std(axis=0) ** 4
    errors = np.sqrt((fourth - 1.0) / (4.0 * len(whole)))
    scatter = (np.array([lognormal(each) for each in ensembles]) / true).std(axis=0)
    rows = [
        [str(mode + 1), *(f"{100.0 * value:.1f} %" for value in values)]
        for mode, values in enumerate(
            zip(
                lognormal(own) / whole.std(axis=0) - 1.0,
                errors,
                lognormal(own) / true - 1.0,
                scatter,
                whole.std(axis=0) / true - 1.0,
                strict=True,
            )
        )
    ]
    n = len(own)
    publish(
        "drawn_members",
        "How much deviations of damping depend on the draws",
        [
            "This page compares standard deviations of the damping ratios of "
            f"`{NAME}` in the middle of its stroke: by the {n} members whose numbers are drawn "
            f"first for a table, by {len(whole)} models that are drawn independently and close "
            f"over the stroke, and by the {len(pool)} members of {len(ensembles)} ensembles of "
            "other draws. All have the stated standard deviations and correlations, each ensemble "
            "exactly, and the models in the mean. The table also leaves out two opposite members "
            "that do not close over the stroke, which this page does not. A deviation of "
            f"{n} independent normal numbers would have a standard error of "
            f"{100.0 / math.sqrt(2.0 * (n - 1)):.1f} %.",
            table(
                [
                    "mode",
                    "members over models",
                    "standard error of the models",
                    "members over all ensembles",
                    "scatter of ensembles",
                    "models over all ensembles",
                ],
                rows,
            ),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
