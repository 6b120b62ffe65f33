# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares deviations of damping with several sets of models: ``-m benchmark.drawn_members``.

They are those of the starters that differ most from the one set of `benchmark.uncertainty`.
"""

from concurrent.futures import ProcessPoolExecutor

import numpy as np

from benchmark.report import machine, publish, table
from benchmark.uncertainty import LIMIT, SAMPLES, described, sampled, scatter
from test.support.in_plane import IN_PLANE

NAMES = "starters/category_1.yaml", "starters/category_2.yaml"
SEEDS = range(10, 14)  # other draws than those of that page
ANGLES = "first angle", "middle angle", "last angle"


def compared(name: str) -> tuple[list[list[str]], float]:
    """Return a row for each mode, and the largest difference from all sets together."""
    stated = scatter(described(name), 0, len(ANGLES))
    with ProcessPoolExecutor() as pool:
        every = [described(name)] * len(SEEDS), [stated.alpha3] * len(SEEDS)
        sets = np.array([*pool.map(sampled, *every, [SAMPLES] * len(SEEDS), SEEDS)])[..., 1, :]
    whole = sets.reshape(-1, *sets.shape[2:])
    whole = whole[np.isfinite(whole).all(axis=(1, 2))]
    true, predicted = whole.std(axis=0), stated.predicted[:, 1]
    kurtosis = ((whole - whole.mean(axis=0)) ** 4).mean(axis=0) / true**4
    errors = np.sqrt((kurtosis - 1.0) / (4.0 * len(whole)))
    differences, single = predicted / true - 1.0, predicted / np.nanstd(sets, axis=1) - 1.0
    rows = []
    for mode in range(true.shape[1]):
        numbers = zip(differences[:, mode], errors[:, mode], strict=True)
        cells = [f"{100.0 * d:+.1f} ± {100.0 * e:.1f} %" for d, e in numbers]
        ends = (100.0 * f(single[..., mode]) for f in (np.min, np.max))
        rows.append([name, str(mode + 1), *cells, "{:+.1f} to {:+.1f} %".format(*ends)])
    return rows, float(np.abs(differences).max())


def main() -> None:
    """Compare the deviations with all sets, and publish them."""
    found = [compared(name) for name in NAMES]
    largest, count = max(most for _, most in found), len(SEEDS) * SAMPLES
    within = "within" if largest <= LIMIT else "beyond"
    publish(
        "drawn_members",
        "Deviations of damping against several sets of models",
        [
            "This page compares the standard deviations of damping ratios that tables state with "
            f"those of {len(SEEDS)} sets of {SAMPLES} whole models that are drawn independently, "
            f"as [one set](uncertainty.md) is for all descriptions, of the two that differ from it "
            f"by more than {100.0 * LIMIT:.0f} %. Models that do not close at each angle are left "
            f"out. Behind ± is the standard error of the deviation of all {count} models.",
            IN_PLANE,
            f"The largest difference from all models is {100.0 * largest:.1f} %, {within} "
            f"{100.0 * LIMIT:.0f} %.",
            table(
                ["description", "mode", *ANGLES, f"from single sets of {SAMPLES}"],
                [row for rows, _ in found for row in rows],
            ),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
