# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Drives in the time domain, of a tractor that differs from the model that listens to it.

The modes at each angle are those of the mechanism with another mass and softer oil, in some drives
with a spring and a damper under the implement. Both axles roll over one profile, one later than the
other; engine, PTO, draft, noise and misplaced sensors are in the signals.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.signal import lfilter

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import number_at, with_numbers
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.support.resources import config_file
from test.support.in_plane import in_plane

FILE = "three_point_linkage_on_tractor"
RATE, SECONDS = 200.0, 120.0  # Hz, s
GRID = np.radians(np.arange(94.0, 177.0, 3.0))  # rad, angles at which modes are known
PLACES = [
    ("E1", "x"),
    ("E1", "z"),
    ("E2", "x"),
    ("E2", "z"),
    ("rear_axle", "x"),
    ("rear_axle", "z"),
    ("front_axle", "z"),
]
WHEELBASE = 2.5  # m
HEAVE = 3  # mode, from 0
HIGHEST = 60.0  # Hz of the modes that are integrated
MISPLACED, TURNED = 0.1, math.radians(5.0)  # m along the mast, rad
MAST = 0.438  # m from E1 to E2
NOISE = 0.02  # m/s2 rms of a sensor
SOIL = 60e3, 1.5e3  # N/m, N s/m under E1
TYRES = (700e3, 4460.0), (600e3, 3820.0)  # N/m, N s/m of rear and front axle


@dataclass(frozen=True)
class Scene:
    """What differs from the model, and what happens."""

    mass: float = 1.2  # over that of the model
    oil: float = 0.7  # bulk modulus over that of the model
    soil: bool = False  # whether the implement is on the soil
    moves: bool = False  # whether the crank creeps between the heights
    road: float = 64e-6  # m3 at 0.1 1/m (class B); 0 without any excitation
    seconds: float = SECONDS
    order: float = 0.0  # relative distance of a strong order of the PTO to the heave; 0: far away


@dataclass(frozen=True)
class Drive:
    """A simulated drive."""

    times: FloatArray  # (n,), s
    signals: FloatArray  # (n, 4), m/s2: x and z of the implement, and of the rear axle
    crank_angle: FloatArray  # (n,), rad
    speeds: dict[str, FloatArray]  # rpm, rpm, m/s, each (n,)
    frequencies: FloatArray  # (n, n_modes), Hz, true


SENSORS = (("E2", "x"), ("E2", "z"), ("rear_axle", "x"), ("rear_axle", "z"))
"""Where the sensors of a drive are said to be."""


@cache
def modes(mass: float, oil: float, soil: bool) -> tuple[ComplexArray, ComplexArray]:
    """Return poles, (n_angles, n_modes), and shapes, (n_angles, n_places, n_modes), on the grid."""
    mapping = in_plane(load_yaml(config_file(f"{FILE}.yaml"))[0])
    paths = {
        "rigid_bodies.implement.mass": mass,
        "springs.lift_cylinders.cylinder.bulk_modulus": oil,
    }
    numbers = [(path, factor * float(number_at(mapping, path))) for path, factor in paths.items()]
    model = LinkageModel(mechanism_from_mapping(with_numbers(mapping, numbers)))
    poles: list[ComplexArray] = []
    shapes: list[ComplexArray] = []
    for alpha3 in GRID.tolist():
        terms = model.solve(alpha3).frf(PLACES, PLACES)
        root = np.sqrt((terms.decay / 2.0) ** 2 - terms.stiffness.astype(complex))
        s = np.where(root.imag > 0.0, root, -root) - terms.decay / 2.0
        residues = (terms.residues + s * terms.rates) / (2.0 * s + terms.decay)
        kept = np.abs(s) < 2.0 * math.pi * HIGHEST
        s, residues = s[kept], residues[:, :, kept]
        best = np.abs(residues[range(len(PLACES)), range(len(PLACES))]).argmax(axis=0)
        each = range(len(s))
        psi = residues[:, best, each] / np.sqrt(residues[best, best, each])
        if soil:
            s, psi = with_soil(s, psi)
        order = np.argsort(np.abs(s))
        s, psi = s[order], psi[:, order]
        if shapes:  # The sign of a shape is free; it must not jump.
            psi = psi * np.where((shapes[-1].conj() * psi).sum(axis=0).real < 0.0, -1.0, 1.0)
        poles.append(s)
        shapes.append(psi)
    return np.array(poles), np.array(shapes)


def with_soil(poles: ComplexArray, shapes: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the poles and shapes with a spring and a damper between E1 and the soil along z."""
    s = np.concatenate([poles, poles.conj()])
    psi = np.hstack([shapes, shapes.conj()])
    place = psi[PLACES.index(("E1", "z"))]
    force = SOIL[0] * place + SOIL[1] * place * s
    values, right = np.linalg.eig(np.diag(s) - np.outer(place, force))
    # Columns are scaled so that the residues stay products of the outputs with themselves.
    out, into = psi @ right, np.linalg.solve(right, psi.T)
    best = np.abs(out).argmax(axis=0)
    each = range(len(values))
    scale = np.sqrt(into[each, best] / out[best, each])
    kept = values.imag > 0.0
    return values[kept], (out * scale)[:, kept]


def slow_noise(random: np.random.Generator, n: int, seconds: float) -> FloatArray:
    """Return noise of variance 1 that changes within so many seconds, (n,)."""
    a = math.exp(-1.0 / (RATE * seconds))
    noise = random.standard_normal(n + 2000)
    return np.asarray(lfilter([math.sqrt(1.0 - a * a)], [1.0, -a], noise)[2000:])


def simulate(seed: int, scene: Scene) -> Drive:
    """Return a drive with heights, speeds and noise that the seed determines."""
    random = np.random.default_rng(seed)
    n = round(scene.seconds * RATE)
    times = np.arange(n) / RATE
    angle = height_over_time(random, times, scene.moves)
    driving = scene.road > 0.0
    ground = random.uniform(1.5, 3.5) * np.exp(0.08 * slow_noise(random, n, 8.0)) * driving
    engine = random.uniform(1400.0, 2000.0) * (1.0 + 0.01 * slow_noise(random, n, 3.0)) * driving
    speeds = {"engine": engine, "pto": engine * 0.27, "ground": ground}
    poles, shapes = modes(scene.mass, scene.oil, scene.soil)
    at = (angle - GRID[0]) / (GRID[1] - GRID[0])
    cell = np.clip(at.astype(int), 0, len(GRID) - 2)
    share = (at - cell)[:, np.newaxis]
    s = poles[cell] * (1.0 - share) + poles[cell + 1] * share
    psi = shapes[cell] * (1.0 - share[:, np.newaxis]) + shapes[cell + 1] * share[:, np.newaxis]
    if scene.order:
        heave = np.abs(s[:, HEAVE]) / (2.0 * math.pi)
        wander = 1.0 + 0.01 * slow_noise(np.random.default_rng([seed, 1]), n, 3.0)
        speeds["pto"] = 60.0 / 0.45 * (1.0 + scene.order) * heave * wander
    forces = loads(random, times, speeds, scene) if driving else np.zeros((n, len(PLACES)))
    drive = np.einsum("np,npk->nk", forces, psi)
    # Exact for a force that is constant over a sample.
    decay = np.exp(s / RATE)
    step = (decay - 1.0) / s * drive
    state, states = np.zeros(s.shape[1], dtype=complex), np.empty_like(s)
    for i in range(n):
        states[i] = state
        state = decay[i] * state + step[i]
    motion = 2.0 * np.einsum("npk,nk->np", psi, s * (s * states + drive)).real
    e1x, e1z, e2x, e2z, rx, rz, _ = motion.T
    beyond = MISPLACED / MAST
    x, z = e2x + beyond * (e2x - e1x), e2z + beyond * (e2z - e1z)
    c, d = math.cos(TURNED), math.sin(TURNED)
    signals = np.stack([c * x + d * z, c * z - d * x, rx, rz], axis=1)
    signals[:, [1, 3]] += 9.81
    signals += random.normal(0.0, NOISE, signals.shape)
    frequencies = np.abs(s) / (2.0 * math.pi)
    return Drive(times, signals, angle, speeds, frequencies)


def height_over_time(random: np.random.Generator, times: FloatArray, moves: bool) -> FloatArray:
    """Return the crank angle, rad: two heights with a quick move between, or a slow creep."""
    low, high = np.radians(sorted(random.uniform(100.0, 172.0, 2)))
    middle = times[-1] / 2.0
    angle = np.interp(times, [middle - 1.5, middle + 1.5], [high, low])
    if moves:
        slope = math.radians(0.25)
        angle = low + slope * np.abs(times - middle) * (high - low > 0.1)
        angle = np.minimum(angle, math.radians(172.0))
    return np.asarray(angle + math.radians(0.1) * np.sin(0.3 * times))


def loads(
    random: np.random.Generator, times: FloatArray, speeds: dict[str, FloatArray], scene: Scene
) -> FloatArray:
    """Return the forces at the places over time, (n, n_places), N."""
    n, forces = len(times), np.zeros((len(times), len(PLACES)))
    travelled = np.cumsum(speeds["ground"]) / RATE
    # The slope of a profile of ISO 8608 is white over the distance: (2 pi n)^2 G = constant.
    spacing = 0.01
    length = int((travelled[-1] + 2.0 * WHEELBASE) / spacing) + 10
    density = scene.road * 0.1**2 * (2.0 * math.pi) ** 2
    slope = random.normal(0.0, math.sqrt(density / 2.0 / spacing), length)
    profile = lfilter([spacing], [1.0, -math.exp(-spacing / 30.0)], slope)
    at = np.arange(length) * spacing
    for place, behind, (stiffness, damping) in (
        (("front_axle", "z"), 0.0, TYRES[1]),
        (("rear_axle", "z"), WHEELBASE, TYRES[0]),
    ):
        height = np.interp(travelled + WHEELBASE - behind, at, profile)
        forces[:, PLACES.index(place)] += stiffness * height
        forces[:, PLACES.index(place)] += damping * np.gradient(height, times)
    for name, order, amplitude, place in (
        ("engine", 0.5, 40.0, ("front_axle", "z")),
        ("engine", 1.0, 300.0, ("front_axle", "z")),
        ("pto", 1.0, 60.0, ("E1", "z")),
        ("pto", 0.45, *((300.0, ("E1", "z")) if scene.order else (80.0, ("E1", "x")))),
    ):
        phase = 2.0 * math.pi * np.cumsum(speeds[name] / 60.0 * order) / RATE
        forces[:, PLACES.index(place)] += amplitude * np.sin(phase + random.uniform(0.0, 6.28))
    draft = 1500.0 if scene.soil else 60.0
    for place in (("E1", "x"), ("E1", "z")):
        forces[:, PLACES.index(place)] += draft * slow_noise(random, n, 0.02)
    return forces
