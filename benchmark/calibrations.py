# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Fits the nine published frequencies with different free dimensions.

`python -m benchmark.calibrations` takes a few minutes.
"""

import copy
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmark.report import machine, publish, table
from linkage_vibration.studies.calibration import (
    CalibrationTask,
    Parameter,
    calibrate,
    read_calibration,
)
from linkage_vibration.support.resources import config_file

STARTS = 4
LOWER = "links.lower_link"
V1_BESIDE = 0.034  # m


def offset(points: dict[str, float]) -> dict[str, list[float]]:
    """Return a link's points 20 mm off its axis."""
    return {name: [place, 0.02] for name, place in points.items()}


def loosened(mapping: Any) -> Any:
    """Return a description in which a spring at P3 holds the crank instead of a clamp."""
    changed = copy.deepcopy(mapping)
    del changed["links"]["input_crank"]["clamped"]
    changed["springs"] = {"rockshaft": {"joint": "P3", "stiffness": 1e6}}
    return changed


def together(link: str, *points: str) -> str:
    """Return the path of the offset that all pins of a link share."""
    return ", ".join(f"links.{link}.points.{point}.1" for point in points)


def variants(paper: CalibrationTask) -> dict[str, CalibrationTask]:
    """Return the calibrations to compare; the keys say what each may change."""

    def variant(mapping: Any, drop: str, *more: Parameter) -> CalibrationTask:
        kept = tuple(p for p in paper.parameters if not drop or not p.path.startswith(drop))
        return CalibrationTask(mapping, paper.text, kept + more, paper.targets)

    own = paper.mapping
    stepped = copy.deepcopy(own)
    section = stepped["links"]["lower_link"].pop("section")
    stepped["links"]["lower_link"]["sections"] = [dict(section, until=0.4), dict(section)]
    steps = [
        Parameter(f"{LOWER}.sections.{i}.{name}", *bounds)
        for i in (0, 1)
        for name, bounds in (("width", (0.02, 0.06)), ("height", (0.025, 0.12)))
    ]
    steps.append(Parameter(f"{LOWER}.sections.0.until", 0.1, 0.7))

    sprung = loosened(own)
    spring = Parameter("springs.rockshaft.stiffness", 1e4, 1e8)

    arched = copy.deepcopy(own)
    lower = arched["links"]["lower_link"]
    lower["points"] = offset(lower["points"])
    arch = Parameter(together("lower_link", "P1", "V1", "E1"), 0.001, 0.05)

    both = copy.deepcopy(stepped)
    both["links"]["lower_link"]["points"] = lower["points"]

    bent = copy.deepcopy(own)
    rod = bent["links"]["lift_rod"]
    rod["points"] = offset(rod["points"])
    bend = Parameter(together("lift_rod", "V2", "V1"), 0.001, 0.06)

    # P1 to V1 stays 0.366 m as in Table 1, but V1 is no longer on the line from P1 to E1.
    raised = copy.deepcopy(bent)
    place = [(0.366**2 - V1_BESIDE**2) ** 0.5, V1_BESIDE]
    raised["links"]["lower_link"]["points"]["V1"] = place

    return {
        "straight links of one section, as shipped": paper,
        "lower link in two sections": variant(stepped, f"{LOWER}.section.", *steps),
        "a spring at P3 instead of the clamp": variant(sprung, "", spring),
        "lower link beside the line of its pins": variant(arched, "", arch),
        "lift rod beside the line of its pins": variant(bent, "", bend),
        "lower link beside the line, in two sections": variant(
            both, f"{LOWER}.section.", *steps, arch
        ),
        "V1 34 mm beside P1 to E1, lift rod beside its pins": variant(raised, "", bend),
        "the same, with the spring at P3": variant(loosened(raised), "", bend, spring),
    }


def main() -> None:
    """Fit every variant and publish the table."""
    paper = read_calibration(config_file("calibrations/paper.yaml"))
    wanted = np.array([target.frequency for target in paper.targets])
    rows = []
    compared = variants(paper)
    with tqdm(total=STARTS * len(compared), unit="start") as bar:
        for name, calibration in compared.items():
            result = calibrate(calibration, STARTS, lambda cost: bar.update(1))
            share = result.frequencies / wanted - 1.0
            worst = int(np.abs(share).argmax())
            rows.append(
                [
                    name,
                    str(len(calibration.parameters)),
                    f"{0.5 * (np.log(1.0 + share) ** 2).sum():.4f}",
                    str(int((np.abs(share) <= 0.036).sum())),
                    f"{share[worst]:+.1%} ({paper.targets[worst]})",
                    ", ".join(f"{s:+.1%}" for s in share),
                ]
            )
    columns = [
        "linkage",
        "parameters",
        "half the sum of squared logarithms",
        "frequencies of 9 within 3.6 %",
        "largest error",
        "errors of all nine, in the file's order",
    ]
    text = (
        "This page shows how closely the package can match the nine natural frequencies that the "
        "paper publishes, when more and more dimensions are free. Each row is the best fit from "
        f"{STARTS} starts."
    )
    publish(
        "calibrations",
        "Fits of the published natural frequencies",
        [text, table(columns, rows)],
        machine(),
    )


if __name__ == "__main__":
    main()
