# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A train of four-bars, a linkage of any size, for the growth of cost with the links."""

import math

from linkage_vibration.mechanics.bodies.beam import Beam, Segment
from linkage_vibration.mechanics.description import (
    Link,
    Material,
    Mechanism,
    Response,
    rayleigh_damping,
)
from linkage_vibration.mechanics.sections.rectangle import rectangle

_CRANK, _COUPLER, _ROCKER, _PITCH = 0.10, 0.50, 0.25, 0.50  # m
_STEEL = Material(210e9, 7800.0, 0.3)


def train(n_cells: int, modes: int) -> Mechanism:
    """Return a crank that moves n rockers in a row, each by a coupler from the previous one.

    The first cell is a crank-rocker. All others are parallelograms, whose rockers stay far from
    the line of their couplers, so the linkage has one input, 2 n + 1 bars and no toggle.

    Parameters
    ----------
    n_cells : int
        Number of couplers.
    modes : int
        Fixed-interface modes per link.

    Examples
    --------
    >>> len(train(4, 3).links)
    9
    """
    links = [_bar("crank", "A0", "B0", _CRANK, modes, clamped="A0")]
    angles = []
    for i in range(1, n_cells + 1):
        links.append(_bar(f"coupler_{i}", f"B{i - 1}", f"B{i}", _COUPLER, modes))
        links.append(_bar(f"rocker_{i}", f"A{i}", f"B{i}", _ROCKER, modes))
        angles += [(f"coupler_{i}", 0.3 if i == 1 else 0.0), (f"rocker_{i}", math.radians(90.0))]
    return Mechanism(
        name=f"train_of_{n_cells}",
        ground=tuple((f"A{i}", (_PITCH * i, 0.0)) for i in range(n_cells + 1)),
        links=tuple(links),
        rigid_bodies=(),
        springs=(),
        input_body="crank",
        stroke=(math.radians(60.0), math.radians(120.0)),
        assembly_alpha3=math.radians(90.0),
        assembly_angles=tuple(angles),
        damping=rayleigh_damping(0.02, 4.0, 180.0),
        response=Response("B1", "x", (0.0, 200.0), 3),
    )


def _bar(
    name: str, first: str, second: str, length: float, modes: int, clamped: str | None = None
) -> Link:
    section = rectangle(0.010, 0.020, _STEEL.poisson_ratio)
    return Link(
        name=name,
        points=((first, (0.0, 0.0)), (second, (length, 0.0))),
        body=Beam(_STEEL, (Segment(length, section),), elements=24),
        count=1,
        modes=modes,
        clamped=clamped,
        masses=(),
        damping=None,
    )
