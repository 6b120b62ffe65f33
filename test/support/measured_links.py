# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Random links whose FRFs are measured: with noise, a suspension, small errors, or a fault."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from linkage_vibration.mechanics.bodies.beam import element_matrices
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.description import Material, Point
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.mass_lines import find_mass_lines
from linkage_vibration.mechanics.sections.rectangle import rectangle
from linkage_vibration.readers.component_files import FileError
from linkage_vibration.readers.frf_faults import check_faults

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_ELEMENTS = 12
_STEEL, _ALUMINIUM = Material(210e9, 7800.0, 0.3), Material(70e9, 2700.0, 0.33)
_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class MeasuredLink:
    """What a laboratory hands over, and what it knows of the link."""

    points: dict[str, Point]
    mass: float  # kg
    frfs: Frfs
    lowest: float  # Hz, first resonance of the free link


Fault = Callable[[MeasuredLink, np.random.Generator], MeasuredLink]


def measured_link(rng: np.random.Generator) -> MeasuredLink:
    """Draw a tapered bar with point masses, two to four points, and a sound measurement of it.

    One in seven is measured above its first resonance only. Suspensions have resonances up to a
    fifth of the first one of the bar; loss factors reach from 0.0005 to 0.1, relative noise from 0
    to 5 %, errors of gain to 4 %, and errors of phase to 1 deg.
    """
    length = 10.0 ** rng.uniform(-0.5, 0.2)
    mass, stiffness = _bar(rng, length)
    weight = float(mass[::3, ::3].sum())
    first = float(np.sqrt(eigh(stiffness, mass, eigvals_only=True)[3]) / _TURN)
    points, dofs, rows = _points(rng, length)
    spring, dashpot = _suspension(rng, weight, first, len(mass))
    frequencies = _grid(rng, first)
    loss, drag = 10.0 ** rng.uniform(-3.3, -1.0), rng.choice([0.0, 1e-3, 1e-2]) * _TURN * first
    structural = rng.random() < 0.5
    frf = np.empty((len(frequencies), len(rows), len(rows)), dtype=complex)
    for k, frequency in enumerate(frequencies):
        omega = _TURN * frequency
        eta = loss if structural else loss * frequency / first
        dynamic = stiffness * (1.0 + 1j * eta) + spring - omega**2 * mass
        dynamic = dynamic + 1j * omega * (drag * mass + dashpot)
        frf[k] = rows @ np.linalg.solve(dynamic, rows.T)
    body = Frfs(dofs, frequencies, _with_errors(rng, frequencies, frf))
    return MeasuredLink(points, weight, body, first)


def _bar(rng: np.random.Generator, length: float) -> tuple[FloatArray, FloatArray]:
    """Return the mass and the stiffness of a tapered bar with up to two point masses."""
    material = _STEEL if rng.random() < 0.6 else _ALUMINIUM
    n = 3 * (_ELEMENTS + 1)
    mass, stiffness = np.zeros((n, n)), np.zeros((n, n))
    height, taper, slim = length * rng.uniform(0.03, 0.15), rng.uniform(-0.5, 0.5), rng.uniform()
    for e in range(_ELEMENTS):
        at, high = slice(3 * e, 3 * e + 6), height * (1.0 + taper * e / _ELEMENTS)
        section = rectangle(high * (0.3 + 0.7 * slim), high, material.poisson_ratio)
        m, k = element_matrices(length / _ELEMENTS, section, material)
        mass[at, at] += m
        stiffness[at, at] += k
    weight = mass[::3, ::3].sum()
    for _ in range(rng.integers(0, 3)):
        added, node = weight * rng.uniform(), 3 * int(rng.integers(_ELEMENTS + 1))
        own = added * np.array([1.0, 1.0, (0.1 * length * rng.uniform()) ** 2])
        mass[range(node, node + 3), range(node, node + 3)] += own
    return mass, stiffness


def _points(
    rng: np.random.Generator, length: float
) -> tuple[dict[str, Point], tuple[InterfaceDof, ...], FloatArray]:
    """Return places of the points, DoFs, and how the nodes move them, (n_dofs, n)."""
    nodes = sorted(rng.choice(_ELEMENTS + 1, rng.choice([2, 2, 3, 4]), replace=False))
    if rng.random() < 0.6 or nodes[-1] - nodes[0] < 4:
        nodes[0], nodes[-1] = 0, _ELEMENTS
    points: dict[str, Point] = {}
    dofs: list[InterfaceDof] = []
    rows: list[FloatArray] = []
    beside = 0.0
    for k, node in enumerate(nodes):
        z = float(length * rng.uniform(-0.15, 0.15)) if rng.random() < 0.25 else 0.0
        beside = z if k == 0 else beside
        name = f"P{k + 1}"
        points[name] = (float(length * (node - nodes[0]) / _ELEMENTS), z - beside)
        moved = np.zeros((3, 3 * (_ELEMENTS + 1)))
        moved[range(3), range(3 * node, 3 * node + 3)] = 1.0
        moved[0, 3 * node + 2] = -z
        directions = ("x", "z", "theta") if rng.random() < 0.12 else ("x", "z")
        dofs += [InterfaceDof(name, direction) for direction in directions]
        rows.append(moved[: len(directions)])
    return points, tuple(dofs), np.vstack(rows)


def _suspension(
    rng: np.random.Generator, weight: float, first: float, n: int
) -> tuple[FloatArray, FloatArray]:
    """Return the stiffness and the damping of cords at two nodes: none, soft or stiff."""
    spring, dashpot = np.zeros((n, n)), np.zeros((n, n))
    kind = rng.choice(3, p=[0.4, 0.35, 0.25])
    if kind:
        ratio = rng.uniform(-2.3, -1.3) if kind == 1 else rng.uniform(-1.2, -0.7)
        for node in rng.choice(_ELEMENTS + 1, 2, replace=False):
            for at, share in ((3 * node, rng.uniform(0.05, 1.0)), (3 * node + 1, 1.0)):
                k = weight / 2.0 * (_TURN * first * 10.0**ratio) ** 2 * share
                spring[at, at] += k
                dashpot[at, at] += 2.0 * rng.uniform(0.005, 0.1) * np.sqrt(k * weight / 2.0)
    return spring, dashpot


def _grid(rng: np.random.Generator, first: float) -> FloatArray:
    """Return 30 to 1000 lines, evenly spaced or not."""
    highest, count = first * 10.0 ** rng.uniform(-0.4, 1.0), int(10.0 ** rng.uniform(1.5, 3.0))
    if rng.random() < 0.15:
        lowest = first * rng.uniform(1.05, 2.5)
        return np.linspace(lowest, max(highest, 3.0 * lowest), count)
    kind = rng.choice(4)
    if kind == 0:
        return np.geomspace(highest * 10.0 ** rng.uniform(-3.0, -1.3), highest, count)
    if kind == 1:
        return np.linspace(highest * 10.0 ** rng.uniform(-3.0, -1.3), highest, count)
    step = highest / count
    if kind == 2:
        step = 10.0 ** np.floor(np.log10(step)) * rng.choice([1.0, 1.25, 2.0, 2.5, 5.0, 6.25])
    return np.asarray(step * np.arange(1.0, count + 1.0))


def _with_errors(
    rng: np.random.Generator, frequencies: FloatArray, frf: ComplexArray
) -> ComplexArray:
    """Add noise, and sometimes errors of gain and of phase; measure all FRFs, or one triangle."""
    if rng.random() < 0.1:
        return frf
    share, n = 10.0 ** rng.uniform(-3.0, -1.3), frf.shape[1]
    noise = share * (rng.standard_normal(frf.shape) + 1j * rng.standard_normal(frf.shape)) / 2**0.5
    if rng.random() < 0.5:
        frf = frf * (1.0 + noise)
    else:
        square = frequencies[:, np.newaxis, np.newaxis] ** 2
        unit = np.sqrt(np.median(np.abs(np.einsum("kii->ki", square * frf)), axis=0))
        frf = frf + noise * np.outer(unit, unit) / square
    if rng.random() < 0.5:
        gains = 1.0 + 0.02 * np.clip(rng.standard_normal(n), -2.0, 2.0)
        frf = frf * np.outer(gains, gains)
    if rng.random() < 0.4:
        delay = rng.choice([0.0, 1.0])
        phase = np.radians(rng.uniform(-1.0, 1.0)) * (frequencies / frequencies[-1]) ** delay
        frf = frf * np.exp(1j * phase)[:, np.newaxis, np.newaxis]
    if rng.random() < 0.5:
        upper = np.triu(np.ones((n, n), dtype=bool))
        frf = np.where(upper, frf, frf.swapaxes(1, 2))
    return np.asarray(frf)


def _changed(change: Callable[[ComplexArray], ComplexArray]) -> Fault:
    return lambda link, _: replace(link, frfs=replace(link.frfs, frf=change(link.frfs.frf)))


def _reversed(link: MeasuredLink, rng: np.random.Generator) -> MeasuredLink:
    """Reverse one response."""
    frf, at = link.frfs.frf.copy(), rng.integers(len(link.frfs.dofs))
    frf[:, at] *= -1.0
    return replace(link, frfs=replace(link.frfs, frf=frf))


def _in_radians(link: MeasuredLink, _: np.random.Generator) -> MeasuredLink:
    """Take rad/s for Hz."""
    wrong = replace(link.frfs, frequencies=_TURN * link.frfs.frequencies)
    return replace(link, frfs=wrong)


FAULTS: dict[str, Fault] = {
    "all signs reversed": _changed(lambda frf: -frf),
    "one sensor reversed": _reversed,
    "accelerations in g": _changed(lambda frf: frf / 9.80665),
    "responses per lbf": _changed(lambda frf: frf * 4.4482216),
    "receptances over rad/s": _in_radians,
    "exp(-i omega t)": _changed(np.conj),
}
"""Faults of a measurement by their names."""


@dataclass(frozen=True)
class Outcome:
    """How many links were tried and refused, with and without lines that show the rigid body."""

    tried: dict[bool, int] = field(default_factory=lambda: {True: 0, False: 0})
    refused: dict[bool, int] = field(default_factory=lambda: {True: 0, False: 0})


def outcomes(seeds: Iterable[int]) -> dict[str, Outcome]:
    """Check a sound measurement ("none") and every fault of random links."""
    actual = {name: Outcome() for name in ("none", *FAULTS)}
    for seed in seeds:
        link = measured_link(np.random.default_rng(seed))
        known = find_mass_lines(link.frfs.frequencies, link.frfs.frf) is not None
        for name, outcome in actual.items():
            fault = FAULTS.get(name)
            tried = fault(link, np.random.default_rng(seed)) if fault else link
            outcome.tried[known] += 1
            outcome.refused[known] += bool(refusal(tried))
    return actual


def refusal(link: MeasuredLink) -> str:
    """Return the error of a measured link, or an empty text."""
    try:
        check_faults(link.frfs, link.points, link.mass)
    except FileError as error:
        return str(error)
    return ""
