# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares levels by the ground with sums over many lines, and with simulations in time.

``python -m benchmark ground``. The simulations integrate all modal coordinates, or the beams of
Exudyn, under a random profile that passes under both axles, one after the other.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import exudyn
import numpy as np
from exudyn import itemInterface as items  # noqa: N813
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from benchmark.report import machine, publish, table
from benchmark.validation.exudyn_beams import ExudynModel
from linkage_vibration.mechanics.description import GROUND, Mechanism, Mount, Rayleigh
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.prediction.ground import (
    GroundTable,
    Terrain,
    ground_lines,
    ground_squares,
    ground_transfer,
    mean_squares,
    vertical_mounts,
)
from linkage_vibration.table.table import Table
from test.support.in_plane import IN_PLANE, plane_mechanism, plane_table

FloatArray = NDArray[np.float64]

CLASS_C = Terrain(256e-6, track=0.0)  # as the profiles here, which pass under both wheels
KMH = 1.0 / 3.6  # m/s
STEP, WARM_UP = 2e-3, 20.0  # s
MINUTES = 10.0  # of each simulation
CASES = ((100.0, 12.0), (130.0, 30.0), (160.0, 20.0), (175.0, 40.0))  # deg, km/h
EXUDYN_STEP, EXUDYN_TIME, EXUDYN_ELEMENTS = 2e-3, 40.0, 4  # s, s, elements of a link
REFERENCE_LINES = 60_001


def densities(
    frf: PoleResidue, mounts: tuple[Mount, ...], terrain: Terrain, speed: float, f: FloatArray
) -> FloatArray:
    """Return power spectral densities of responses over frequencies in Hz, (n_out, n_f).

    The receptances, (n_out, n_mounts), are those to forces along z at the mounts.
    """
    w = 2.0 * math.pi * f
    total = np.zeros((len(f), len(frf.residual)), dtype=complex)
    receptance, last = frf.frf(f), max(mount.at[0] for mount in mounts)
    for i, mount in enumerate(mounts):
        force = mount.stiffness[1] + 1j * w * mount.damping[1]
        late = np.exp(-1j * w * (last - mount.at[0]) / speed)
        total += receptance[:, :, i] * (force * late)[:, np.newaxis]
    height = terrain.roughness * (f / speed / terrain.reference) ** -terrain.exponent / speed
    return np.asarray((np.abs(total) ** 2 * height[:, np.newaxis]).T)


def random_heights(
    terrain: Terrain, speed: float, count: int, step: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return heights and their rates under the front axle at count times, of the terrain's band."""
    f = np.fft.rfftfreq(count, step)
    inside = (f >= terrain.band[0]) & (f <= terrain.band[1])
    density = np.zeros(len(f))
    n = f[inside] / speed / terrain.reference
    density[inside] = terrain.roughness * n**-terrain.exponent / speed
    parts = rng.normal(size=len(f)) + 1j * rng.normal(size=len(f))
    # The mean square of each wave is its density times the step between frequencies.
    waves = np.sqrt(density / (count * step) / 4.0) * parts * count
    return np.fft.irfft(waves, count), np.fft.irfft(2j * math.pi * f * waves, count)


@dataclass(frozen=True, eq=False)
class Simulated:
    """A simulation: velocities, accelerations and forces over time, and what drove it."""

    velocity: FloatArray  # (n,), of E1 along z, m/s
    acceleration: FloatArray  # (n,), m/s2
    cylinders: FloatArray  # (n,), N
    tyres: FloatArray  # (n, n_mounts), N, upwards


def delayed(
    mounts: tuple[Mount, ...], speed: float, duration: float, terrain: Terrain, seed: int
) -> tuple[float, FloatArray, FloatArray]:
    """Return the time step, s, and heights and rates under each mount, (n, n_mounts).

    The step divides the delay of the two axles.
    """
    behind = [max(m.at[0] for m in mounts) - mount.at[0] for mount in mounts]
    steps = math.ceil(max(behind) / speed / STEP)
    step = max(behind) / speed / steps
    count = round(duration / step)
    height, rate = random_heights(terrain, speed, count, step, np.random.default_rng(seed))
    late = [round(each / speed / step) for each in behind]
    u, v = (np.stack([np.roll(x, k) for k in late], axis=1) for x in (height, rate))
    return step, u, v


def simulate(
    solution: Solution, mounts: tuple[Mount, ...], step: float, u: FloatArray, rate: FloatArray
) -> Simulated:
    """Integrate all modal coordinates by Newmark's rule of the mean acceleration."""
    at_mounts = solution.participation([(mount.name, "z") for mount in mounts])
    constant, rates, _ = solution.powers([("E1", "z"), ("lift_cylinders", "force")])
    c = solution.vectors.T @ solution.coupled.damping @ solution.vectors
    k = np.diag(solution.modes.omega**2)
    inverse = np.linalg.inv(np.eye(len(k)) + 0.5 * step * c + 0.25 * step**2 * k)
    stiffness, damping = np.array([(m.stiffness[1], m.damping[1]) for m in mounts]).T
    loads = (u * stiffness + rate * damping) @ at_mounts
    into, from_q, from_v = loads @ inverse.T, inverse @ k, inverse @ c
    out = np.vstack([constant, at_mounts])
    n, q = len(out), np.zeros((3, len(k)))
    records, records_of_rates = np.empty((len(u), 3, n)), np.empty(len(u))
    for i in range(len(u)):
        q[0] += step * q[1] + 0.25 * step**2 * q[2]
        q[1] += 0.5 * step * q[2]
        q[2] = into[i] - from_q @ q[0] - from_v @ q[1]
        q[0] += 0.25 * step**2 * q[2]
        q[1] += 0.5 * step * q[2]
        records[i], records_of_rates[i] = q @ out.T, q[1] @ rates[1]
    kept = records[round(WARM_UP / step) :]
    moved, speeds = (part[-len(kept) :] for part in (u, rate))
    tyres = (moved - kept[:, 0, 2:]) * stiffness + (speeds - kept[:, 1, 2:]) * damping
    viscous = records_of_rates[-len(kept) :]
    return Simulated(kept[:, 1, 0], kept[:, 2, 0], kept[:, 0, 1] + viscous, tyres)


def standard_error(density: FloatArray, f: FloatArray, duration: float) -> float:
    """Return that of the root mean square of a Gaussian process over a time, relative, 1."""
    square = float(trapezoid(density**2, f))
    return 0.5 * math.sqrt(square / duration) / float(trapezoid(density, f))


def rms(values: FloatArray) -> float:
    """Return the root mean square."""
    return math.sqrt(float(np.mean(values**2)))


def in_modes(
    minutes: float, cases: tuple[tuple[float, float], ...] = CASES
) -> list[tuple[float, float, list[tuple[float, float]], float, float]]:
    """Simulate cases for some minutes, and compare them with the lookup.

    It returns, for each, deg and km/h, the ratio of the simulation to the lookup with its standard
    error for velocity, acceleration and the force of the cylinders, and the largest share of the
    time that a tyre is off the ground, simulated and looked up.
    """
    mechanism, shipped = _shipped()
    mounts, model = vertical_mounts(mechanism), LinkageModel(mechanism)
    lookup = GroundTable(shipped, mechanism, CLASS_C, [("lift_cylinders", "force")])
    rows = []
    for seed, (degrees, kmh) in enumerate(cases):
        alpha3, speed = math.radians(degrees), kmh * KMH
        solution, duration = model.solve(alpha3), 60.0 * minutes
        simulated = simulate(
            solution, mounts, *delayed(mounts, speed, duration + WARM_UP, CLASS_C, seed)
        )
        level = lookup.at(np.array([alpha3]), np.array([speed]))
        f = np.linspace(*CLASS_C.band, REFERENCE_LINES)
        places: list[Place] = [("E1", "z"), ("lift_cylinders", "force")]
        frf = solution.frf(places, [(mount.name, "z") for mount in mounts])
        density = densities(frf, mounts, CLASS_C, speed, f)
        w2 = (2.0 * math.pi * f) ** 2
        compared = (
            (simulated.velocity, level.velocity[0], density[0] * w2),
            (simulated.acceleration, level.acceleration[0], density[0] * w2**2),
            (simulated.cylinders, math.sqrt(level.forces2[0, 0]), density[1]),
        )
        ratios = [(rms(x) / y, standard_error(z, f, duration)) for x, y, z in compared]
        off = (simulated.tyres < -model.mount_loads(alpha3)).mean(axis=0).max()
        rows.append((degrees, kmh, ratios, float(off), float(level.off_ground_share[0])))
    return rows


def _shipped() -> tuple[Mechanism, Table]:
    return plane_mechanism(), plane_table()


class TyresInExudyn(ExudynModel):
    """Exudyn's beams on tyres with dampers, whose soil moves."""

    def __init__(self, mechanism: Mechanism, configuration: Configuration, elements: int) -> None:
        self._loads: list[int] = []
        super().__init__(mechanism, configuration, elements)

    def _add_ground(self, mechanism: Mechanism) -> None:
        super()._add_ground(mechanism)
        soil = self._system.AddObject(items.ObjectGround())
        for mount in vertical_mounts(mechanism):
            fixed = items.MarkerBodyPosition(bodyNumber=soil, localPosition=[*mount.at, 0.0])
            body = self._places[GROUND, mount.name]
            self._system.AddObject(
                items.CartesianSpringDamper(
                    markerNumbers=[self._system.AddMarker(fixed), body],
                    stiffness=[0.0, 0.0, 0.0],
                    damping=[*mount.damping, 0.0],
                )
            )
            load = items.Force(markerNumber=body, loadVector=[0.0, 0.0, 0.0])
            self._loads.append(self._system.AddLoad(load))

    def velocity(self, place: tuple[str, str], forces: FloatArray, step: float) -> FloatArray:
        """Return the velocity along z of a point of a body, (n,), under forces of the tyres."""
        sensor = self._system.AddSensor(
            items.SensorMarker(
                markerNumber=self._places[place],
                outputVariableType=exudyn.OutputVariableType.Velocity,
                storeInternal=True,
                writeToFile=False,
            )
        )
        self._system.Assemble()

        def pushed(system: object, t: float) -> bool:
            i = min(round(t / step), len(forces) - 1)
            for number, force in zip(self._loads, forces[i].tolist(), strict=True):
                self._system.SetLoadParameter(number, "loadVector", [0.0, force, 0.0])
            return True

        self._system.SetPreStepUserFunction(pushed)
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.numberOfSteps = len(forces) - 1
        settings.timeIntegration.endTime = step * (len(forces) - 1)
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.timeIntegration.newton.absoluteTolerance = 1e-4
        settings.timeIntegration.newton.relativeTolerance = 1e-5
        settings.timeIntegration.generalizedAlpha.spectralRadius = 0.95
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = step
        settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
        self._system.SolveDynamic(settings)
        return np.array(self._system.GetSensorStoredData(sensor))[:, 2]


def in_exudyn(degrees: float, kmh: float) -> tuple[float, float, float]:
    """Return rms velocities of E1 z by Exudyn and by our modes under one profile, and of the error.

    The links are without damping, which Exudyn's beams would not have in proportion to the mass.
    """
    shipped, _ = _shipped()
    mechanism = replace(shipped, damping=Rayleigh(0.0, 0.0))
    mounts, model = vertical_mounts(mechanism), LinkageModel(mechanism)
    solution = model.solve(math.radians(degrees))
    step, u, rate = delayed(mounts, kmh * KMH, EXUDYN_TIME + WARM_UP, CLASS_C, 11)
    u, rate = (
        x * np.minimum(step * np.arange(len(x)) / 2.0, 1.0)[:, np.newaxis] for x in (u, rate)
    )
    ours = simulate(solution, mounts, step, u, rate).velocity
    stiffness, damping = np.array([(m.stiffness[1], m.damping[1]) for m in mounts]).T
    theirs = TyresInExudyn(mechanism, solution.configuration, EXUDYN_ELEMENTS)
    forces = u * stiffness + rate * damping
    velocity = theirs.velocity(("lower_link", "E1"), forces, step)[-len(ours) :]
    return rms(velocity), rms(ours), rms(velocity - ours)


def levels(density: FloatArray, f: FloatArray, n_forces: int) -> FloatArray:
    """Return rms velocity and acceleration of the first response, then forces, (2 + n_forces,)."""
    w2 = (2.0 * math.pi * f) ** 2
    rows = [density[0] * w2, density[0] * w2**2, *density[1 : 1 + n_forces]]
    return np.sqrt([trapezoid(row, f) for row in rows])


def in_places(rows: FloatArray, forces: tuple[Place, ...]) -> FloatArray:
    """Return velocity, acceleration and the magnitude of each force from its components."""
    first = [i for i, (name, _) in enumerate(forces) if i == 0 or forces[i - 1][0] != name]
    return np.vstack([rows[:2], np.sqrt(np.add.reduceat(rows[2:] ** 2, first))])


def errors_of_lines() -> tuple[FloatArray, FloatArray]:
    """Return the largest errors of sums over the lines, and of the lookup, (3,) each.

    They are those of velocity, acceleration and forces at 10 angles, none of which is one of the
    lookup's, and 10 speeds, relative to sums over many lines at the same angle of the table.
    """
    mechanism, shipped = _shipped()
    mounts = vertical_mounts(mechanism)
    response, forces = ("E1", "z"), tuple(x for x in shipped.forces if x[0] in shipped.load_places)
    lookup = GroundTable(shipped, mechanism, CLASS_C, forces)
    inputs = [(mount.name, "z") for mount in mounts]
    speeds = np.linspace(5.0, 50.0, 10) * KMH
    fine, lines = np.linspace(*CLASS_C.band, REFERENCE_LINES), ground_lines(CLASS_C)
    orders = [1, 2, *[0] * len(forces)]
    worst = np.zeros((2, 3))
    for alpha3 in np.radians(90.5 + 9.9 * np.arange(10) % 89.0).tolist():
        frf = shipped.frf(alpha3, [response, *forces], inputs)
        exact = np.transpose(
            [levels(densities(frf, mounts, CLASS_C, v, fine), fine, len(forces)) for v in speeds]
        )
        places = [response, response, *forces]
        transfer = ground_transfer(shipped.frf(alpha3, places, inputs), mounts, lines, places)
        summed = mean_squares(ground_squares(transfer, orders, mounts, CLASS_C, lines), speeds)
        level = lookup.at(np.full(len(speeds), alpha3), speeds)
        looked_up = np.vstack([level.velocity, level.acceleration, np.sqrt(level.forces2)])
        true = in_places(exact, forces)
        for i, each in enumerate((np.sqrt(summed), looked_up)):
            error = np.abs(in_places(each, forces) / true - 1.0)
            worst[i] = np.fmax(worst[i], [error[0].max(), error[1].max(), error[2:].max()])
    return worst[0], worst[1]


def errors_of_reduction() -> list[tuple[float, FloatArray]]:
    """Return, for angles in deg, errors of the lookup against the unreduced model.

    They are those of velocity, acceleration and the cylinders' force, the largest of four speeds.
    """
    mechanism, shipped = _shipped()
    mounts, model = vertical_mounts(mechanism), LinkageModel(mechanism, reduced=False)
    cylinders = ("lift_cylinders", "force")
    lookup = GroundTable(shipped, mechanism, CLASS_C, [cylinders])
    inputs, fine = [(mount.name, "z") for mount in mounts], np.linspace(*CLASS_C.band, 20_001)
    rows, speeds = [], np.array([10.0, 20.0, 30.0, 50.0]) * KMH
    for degrees in (90.3, 134.6, 179.2):
        alpha3 = math.radians(degrees)
        frf = model.solve(alpha3).frf([("E1", "z"), cylinders], inputs, CLASS_C.band)
        exact = [levels(densities(frf, mounts, CLASS_C, v, fine), fine, 1) for v in speeds]
        level = lookup.at(np.full(len(speeds), alpha3), speeds)
        result = np.vstack([level.velocity, level.acceleration, np.sqrt(level.forces2)])
        rows.append((degrees, np.abs(result / np.transpose(exact) - 1.0).max(axis=1)))
    return rows


def refused() -> list[tuple[str, list[float]]]:
    """Return the shares of a map of 91 angles and 48 speeds that are refused, by the terrain."""
    mechanism, shipped = _shipped()
    alpha3, speed = _map(shipped)
    rows = []
    for name, exponent in (("B", 1), ("C", 2), ("D", 3), ("E", 4)):
        for pitch in (None, 2.0 * math.pi * 0.8 / 20.0):
            terrain = Terrain(16e-6 * 4.0**exponent, lug_pitch=pitch)
            reason = GroundTable(shipped, mechanism, terrain).at(alpha3, speed).reason
            title = f"{name}, {'20 lugs, radius 0.8 m' if pitch else 'no lugs'}"
            rows.append((title, [float((reason == 4).mean()), float((reason == 6).mean())]))
    return rows


def _map(shipped: Table) -> tuple[FloatArray, FloatArray]:
    """Return 91 angles and 49 speeds from 2 to 50 km/h, each with each, (4459,)."""
    alpha3, speed = np.meshgrid(
        np.linspace(*shipped.alpha3_range, 91), np.linspace(2.0, 50.0, 49) * KMH
    )
    return alpha3.ravel(), speed.ravel()


def costs() -> list[tuple[str, str]]:
    """Return what the lookup costs, with all forces of the table."""
    mechanism, shipped = _shipped()

    def build() -> GroundTable:
        lookup = GroundTable(shipped, mechanism, CLASS_C, shipped.forces)
        _ = lookup.values  # which are computed when they are first needed
        return lookup

    lookup = build()
    first, every = (np.array([2.2]), np.array([5.0])), _map(shipped)
    return [
        ("start, s", f"{_lowest(build, 5):.2f}"),
        ("one angle and speed, us", f"{1e6 * _lowest(lambda: lookup.at(*first), 3000):.0f}"),
        (
            "map of 91 angles and 49 speeds, ms",
            f"{1e3 * _lowest(lambda: lookup.at(*every), 20):.0f}",
        ),
    ]


def _lowest(call: Callable[[], object], number: int) -> float:
    """Return the shortest time of a call, s of the processor."""
    best = math.inf
    for _ in range(number):
        start = time.process_time()
        call()
        best = min(best, time.process_time() - start)
    return best


def main() -> None:
    """Make all comparisons and publish the result."""
    lines, looked_up = errors_of_lines()
    parts = [
        "This page compares levels of the shipped tractor by the ground (ISO 8608, class C, from "
        "0.3 to 20 Hz) with sums over many lines, with simulations in time, with Exudyn, and with "
        "the unreduced model.",
        IN_PLANE,
        f"Relative errors against {REFERENCE_LINES} lines, the largest at 10 angles and 10 speeds "
        "from 5 to 50 km/h. The lookup also interpolates over the angle and the speed.",
        table(
            ["", "velocity", "acceleration", "forces"],
            [
                [name, *(f"{value:.1e}" for value in row)]
                for name, row in (("512 lines", lines), ("lookup", looked_up))
            ],
        ),
        "Relative errors of the lookup against the unreduced model, the largest of four speeds.",
        table(
            ["angle, deg", "velocity", "acceleration", "cylinders"],
            [[f"{at}", *(f"{value:.1e}" for value in row)] for at, row in errors_of_reduction()],
        ),
        f"Root mean squares of simulations over {MINUTES:g} minutes, divided by those of the "
        "lookup, with the standard error of the simulation. All modal coordinates are integrated "
        "under a random profile that passes under the front axle, and later under the rear one. "
        "The last columns are the largest share of the time in which a tyre would have to pull, "
        "in the simulation and by the lookup.",
        _simulations(),
        f"Velocities of E1 along z, mm/s rms over {EXUDYN_TIME:g} s, by Exudyn and by our modes "
        "under one profile with the same tyres, and the rms of their difference. Exudyn integrates "
        f"its geometrically exact beams ({EXUDYN_ELEMENTS} to a link) with all rotations. The "
        "links are undamped here, because those beams have no damping in proportion to the mass.",
        table(
            ["angle, deg", "km/h", "Exudyn", "modes", "difference"],
            [
                [f"{degrees:g}", f"{kmh:g}", *(f"{1e3 * x:.2f}" for x in in_exudyn(degrees, kmh))]
                for degrees, kmh in CASES
            ],
        ),
        "Shares of the map of 91 angles and 49 speeds from 2 to 50 km/h at which the level is not "
        "known, by the class of the terrain.",
        table(
            ["class", "lugs", "off the ground"],
            [[name, *(f"{100.0 * x:.0f} %" for x in row)] for name, row in refused()],
        ),
        "Costs on one core, as times of the processor, the lowest of many.",
        table(["", ""], costs()),
    ]
    publish("ground", "Levels by the ground", parts, machine("exudyn"))


def _simulations() -> str:
    rows = [
        [
            f"{degrees:g}",
            f"{kmh:g}",
            *(f"{ratio:.3f} +- {error:.3f}" for ratio, error in ratios),
            f"{off:.3f}",
            f"{share:.3f}",
        ]
        for degrees, kmh, ratios, off, share in in_modes(MINUTES)
    ]
    columns = ["angle, deg", "km/h", "velocity", "acceleration", "cylinders", "pulls", "lookup"]
    return table(columns, rows)


if __name__ == "__main__":
    main()
