# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares estimated velocities and directions of approach with true motions."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmark.report import machine, publish, table
from linkage_vibration.drawing.palette import GREY, INK, mode_colours
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.motion import crank_filter
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor, described
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.support.resources import DEFAULT_EXCITATIONS, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.motions import MOTIONS, PERCENT, SENSORS, Sensor, read

FloatArray = NDArray[np.float64]

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "motion.png"
SEEDS = range(4)
MOVING = 0.05  # rad/s; slower motions count as standing
APART = 0.02  # s, around a reading, over which true distances are compared
COLUMNS = ["sensor", "motion", "bound", "error", "within", "known", "opposite", "at rest", "of"]
LIFT_COLUMNS = ["rise", "motion", "right before", "wrong before", "right", "wrong", "not known"]
RISES = 20.0, 50.0, 100.0, 200.0  # rpm/s
LIFTS = "slow lift in 6 s", "lift in 4 s", "lift in 2.5 s", "reversals", "standing still"


@dataclass(frozen=True)
class Estimates:
    """Estimates for readings of one motion, (n,) each."""

    velocity: FloatArray  # rad/s
    error: FloatArray  # rad/s, its bound
    true: FloatArray  # rad/s

    @property
    def known(self) -> NDArray[np.bool_]:
        """Where a velocity is estimated."""
        return np.isfinite(self.velocity)

    @property
    def directed(self) -> NDArray[np.bool_]:
        """Where a direction is claimed."""
        return np.abs(self.velocity) > self.error


def estimates(motion: str, sensor: Sensor) -> Estimates:
    """Estimate the velocities of a motion that a sensor reads several times."""
    columns = []
    for seed in SEEDS:
        stamps, values, _, true = read(MOTIONS[motion], sensor, seed)
        resolutions = [sensor.step if sensor.stated else 0.0] * len(values)
        columns.append((*crank_filter().add_many(stamps, values, resolutions), true))
    return Estimates(*np.hstack([np.array(each) for each in columns]))


def speed(at: FloatArray, rise: float) -> FloatArray:
    """Return an engine speed (rpm) that rises by so much (rpm/s), at times in s."""
    return 1200.0 + rise * np.asarray(at)


@dataclass(frozen=True)
class Directions:
    """How often a direction of approach was right, wrong, or not known."""

    right: int = 0
    wrong: int = 0
    unknown: int = 0

    @property
    def cells(self) -> list[str]:
        """The three numbers."""
        return [f"{self.right}", f"{self.wrong}", f"{self.unknown}"]


def approaches(motion: str, rise: float) -> tuple[Directions, Directions]:
    """Return the directions of a monitor without and with the filter, in percent at 10 Hz.

    The true direction is that of the distance between the same excitation and the same mode, by
    the true angle and the true speed.
    """
    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    excitations = read_excitations(config_file(DEFAULT_EXCITATIONS))
    ratios = {each.name: each.ratio for each in excitations}
    monitor, crank = ResonanceMonitor(excitations), crank_filter()
    stamps, values, times, _ = read(MOTIONS[motion], PERCENT, 0)
    before, after = [], []
    last = math.nan
    for stamp, value, now in zip(stamps, values, times.tolist(), strict=True):
        rpm = float(0.125 * np.rint(speed(np.array(now), rise) / 0.125))
        monitor.set_speed(Source.ENGINE, rpm, stamp)
        velocity, error = crank.add(stamp, value, PERCENT.step)()
        resonance = described(monitor.assess(predictor.predict(value), velocity, stamp, error))
        ratio = ratios[resonance.excitation]
        true = _true_direction(predictor, MOTIONS[motion], ratio, rise, resonance, now)
        rising = math.copysign(1.0, resonance.margin) * (rpm - last)  # as if the hitch stood still
        last = rpm
        if rising == rising:  # it is not NaN
            before.append((-np.sign(rising), true))
            after.append((resonance.approach, true))
    return _counted(before), _counted(after)


def _true_direction(
    predictor: Predictor,
    motion: Callable[[FloatArray], FloatArray],
    ratio: float,
    rise: float,
    result: MessageColumns,
    now: float,
) -> float:
    """Return 1 if the excitation truly approaches the mode, and -1 if it moves away."""
    at = np.array([now - APART, now + APART])
    fine = np.arange(0.0, 9.0, 1e-3)
    angles = np.interp(at, fine, motion(fine))
    apart = [
        abs(ratio * rpm - float(predictor.predict(angle).natural_frequencies[result.mode]))
        for rpm, angle in zip(speed(at, rise).tolist(), angles.tolist(), strict=True)
    ]
    return float(np.sign(apart[0] - apart[1]))


def _counted(pairs: Sequence[tuple[float, float]]) -> Directions:
    said, true = np.array(pairs).T
    return Directions(
        int((said == true).sum()), int(((said != true) & (said != 0)).sum()), int((said == 0).sum())
    )


def draw(picture: Path) -> None:
    """Draw a lift in percent at 10 Hz and one with a noisy encoder, true and as estimated."""
    figure = Figure(figsize=(11.0, 6.5), dpi=110, layout="constrained")
    colour = mode_colours(1)[0]
    names = ("percent, 10 Hz", "noise of 0.1 deg, 1 kHz")
    for axes, motion in zip(figure.subplots(2, 2), LIFTS[1:4:2], strict=True):
        for each, name in zip(axes, names, strict=True):
            sensor = SENSORS[name]
            stamps, values, times, true = read(MOTIONS[motion], sensor, 0)
            resolutions = [sensor.step if sensor.stated else 0.0] * len(values)
            velocity, error = crank_filter().add_many(stamps, values, resolutions)
            each.fill_between(
                times, velocity - error, velocity + error, color=colour, alpha=0.25, lw=0.0
            )
            each.plot(times, velocity, color=colour, label="estimate, with its bound")
            each.plot(times, true, color=INK, lw=1.0, label="true")
            each.axhline(0.0, color=GREY, lw=0.5)
            each.set(title=f"{motion}; {name}", xlabel="time [s]", ylabel="velocity [rad/s]")
            each.legend(fontsize=8)
    figure.savefig(picture)


def microseconds(sensor: Sensor) -> float:
    """Return the processor time of an estimate, us."""
    stamps, values, _, _ = read(MOTIONS["reversals"], sensor, 0)
    resolutions = [sensor.step if sensor.stated else 0.0] * len(values)
    best = math.inf
    for _ in range(20):
        begin = time.process_time()
        crank_filter().add_many(stamps, values, resolutions)
        best = min(best, time.process_time() - begin)
    return 1e6 * best / len(values)


def cells(sensor: str, motion: str) -> list[str]:
    """Return the row of a sensor and a motion, under `COLUMNS`.

    Parameters
    ----------
    sensor, motion
        Their names.
    """
    first = estimates(motion, SENSORS[sensor])
    known, directed = first.known, first.directed
    error = np.abs(first.velocity - first.true)[known]
    wrong = directed & (first.velocity * first.true < 0.0)
    moving = np.abs(first.true) > MOVING
    stopped = directed & (first.true == 0.0)
    return [
        sensor,
        motion,
        f"{np.median(first.error[known]):.3f}",
        f"{np.sqrt((error**2).mean()):.3f}",
        f"{100.0 * (error <= first.error[known]).mean():.1f} %",
        f"{100.0 * directed[moving].mean():.0f} %" if moving.any() else "",
        f"{wrong.sum()}",
        f"{stopped.sum()}",
        f"{len(first.true)}",
    ]


def main() -> None:
    """Estimate, compare with the truth, draw and publish."""
    rows = [cells(sensor, motion) for sensor in SENSORS for motion in MOTIONS]
    lifts = []
    for rise in RISES:
        for motion in LIFTS:
            before, after = approaches(motion, rise)
            lifts.append([f"{rise:g}", motion, *before.cells[:2], *after.cells])
    times = [
        [name, f"{microseconds(SENSORS[name]):.1f}"]
        for name in ("percent, 10 Hz", "noise of 0.1 deg, 1 kHz")
    ]
    draw(PICTURE)
    publish(
        "motion",
        "Velocities that are estimated from readings",
        [
            "This page compares velocities of the crank that are estimated from readings with "
            "those of known motions, and directions of approach with differences of true "
            "distances.",
            f"Each motion takes 8 s and is read {len(SEEDS)} times. The table shows the median of "
            "the reported bound and the error (rad/s, root mean square), the share of errors "
            f"within the bound, the share of readings faster than {MOVING:g} rad/s for which a "
            "direction is reported, how often the reported direction is opposite to the true one, "
            "and how often a direction is reported for a hitch that does not move.",
            table(COLUMNS, rows),
            f"These are {sum(int(row[-1]) for row in rows)} readings.",
            "The next table shows the direction of approach of the most severe excitation in "
            "percent at 10 Hz while the engine speed rises (rpm/s): before, when the hitch was "
            "taken to stand still, and now. In the first second, while the noise is not known, no "
            "direction is known.",
            table(LIFT_COLUMNS, lifts),
            "Processor time of an estimate, us:",
            table(["sensor", "time"], times),
        ],
        machine("matplotlib"),
    )


if __name__ == "__main__":
    main()
