# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Counts which faults in the FRFs of a thousand random links are refused."""

from benchmark.report import machine, publish, table
from test.support.measured_links import outcomes

LINKS = 1000


def main() -> None:
    """Check every fault of every link, and publish the rates."""
    rows = []
    for fault, each in outcomes(range(LINKS)).items():
        cells = [f"{each.refused[known]} of {each.tried[known]}" for known in (True, False)]
        rows.append([fault, *cells])
    columns = ["fault", "refused, rigid-body lines known", "refused, not known"]
    publish(
        "measured_faults",
        "Faults in measured FRFs",
        [
            f"This page shows how many faulty measurements of {LINKS} random links are refused "
            "when they are read, and that no sound one is. The links are bars of 0.3 to 1.6 m with "
            "two to four points. Their masses are known. Noise is up to 5 %, loss factors are up "
            "to 0.1, suspensions have resonances up to a fifth of the first one of the link, and "
            "there are errors of gain (up to 4 %) and of phase (up to 1 deg). One link in seven is "
            "measured above its first resonance only. The lines of the rigid body are not known "
            "there, nor if the suspension is too stiff or the lines are too few.",
            table(columns, rows),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
