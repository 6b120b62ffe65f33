# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Motions of a hitch whose velocity is known, and sensors that read them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

STROKE = math.pi / 2.0  # rad
DURATION = 8.0  # s
START = 1_700_000_000 * 10**9  # ns
_STEP = 1e-3  # s, of the true motion


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor of the crank angle with a rate, Hz, a resolution and noise, rad (0 if it is fine).

    `jitter` is the standard deviation of the delay of a stamp, s, and `stated` whether the node
    knows the resolution. `lost` and `repeated` are shares of readings that are lost, and that
    arrive twice.
    """

    rate: int
    step: float = 0.0
    noise: float = 0.0
    jitter: float = 0.0
    stated: bool = False
    lost: float = 0.0
    repeated: float = 0.0


PERCENT = Sensor(10, step=0.004 * STROKE, stated=True)
SENSORS = {
    "percent, 10 Hz": PERCENT,
    "percent, 10 Hz, 5 ms of jitter": replace(PERCENT, jitter=5e-3),
    "percent, 10 Hz, lost and repeated": replace(PERCENT, lost=0.1, repeated=0.1),
    "percent, 10 Hz, resolution not stated": replace(PERCENT, stated=False),
    "percent, 50 Hz": replace(PERCENT, rate=50),
    "encoder of 14 bits, 100 Hz": Sensor(100, 2.0 * math.pi / 2**14, math.radians(0.02)),
    "exact, 50 Hz": Sensor(50),
    "noise of 0.1 deg, 10 Hz": Sensor(10, noise=math.radians(0.1)),
    "noise of 0.02 deg, 1 kHz": Sensor(1000, noise=math.radians(0.02)),
    "noise of 0.1 deg, 1 kHz": Sensor(1000, noise=math.radians(0.1)),
    "noise of 0.5 deg, 1 kHz": Sensor(1000, noise=math.radians(0.5)),
}


def _move(times: FloatArray, start: float, duration: float) -> FloatArray:
    """Return the minimum-jerk polynomial that rises from 0 to 1."""
    s = np.clip((times - start) / duration, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def _lift(duration: float) -> Callable[[FloatArray], FloatArray]:
    """Return a lift over the whole stroke, from 180 to 90 deg."""
    return lambda times: math.pi - STROKE * _move(times, 1.5, duration)


def _ramp(times: FloatArray) -> FloatArray:
    """Return a motion at a steady 0.3 rad/s that begins and ends with 1 rad/s^2."""
    velocity = np.clip(np.minimum(times - 2.0, 5.5 - times), 0.0, 0.3)
    return 1.9 + np.concatenate([[0.0], np.cumsum(velocity[1:] * np.diff(times))])


def _draft(times: FloatArray) -> FloatArray:
    """Return the motion of depth control: 1.4 deg below 1 Hz."""
    phases = np.random.default_rng(3).uniform(0.0, 2.0 * np.pi, 6)
    waves = np.sin(2.0 * np.pi * np.outer(times, np.linspace(0.1, 0.9, 6)) + phases)
    return np.asarray(2.6 + math.radians(1.4) * math.sqrt(2.0 / 6.0) * waves.sum(axis=1))


MOTIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "standing still": lambda times: np.full(len(times), 2.1234),
    "lift in 1.5 s": _lift(1.5),
    "lift in 2.5 s": _lift(2.5),
    "lift in 4 s": _lift(4.0),
    "slow lift in 6 s": _lift(6.0),
    "ramp": _ramp,
    "reversals": lambda times: (
        2.3
        + 0.3 * _move(times, 1.0, 1.5)
        - 0.5 * _move(times, 2.3, 2.0)
        + 0.3 * _move(times, 4.6, 1.9)
    ),
    "depth control": _draft,
}


def read(
    motion: Callable[[FloatArray], FloatArray], sensor: Sensor, seed: int
) -> tuple[list[int], list[float], FloatArray, FloatArray]:
    """Return stamps, ns, and values, rad, of a motion (angles at times, rad and s) by a sensor.

    Also return when the readings were truly taken, and the true velocities then, s and rad/s.
    """
    rng = np.random.default_rng(seed)
    fine = np.arange(round(DURATION / _STEP), dtype=np.float64) * _STEP
    angles = motion(fine)
    velocity: FloatArray = np.asarray(np.gradient(angles, _STEP), np.float64)
    every = round(1.0 / (sensor.rate * _STEP))
    rows = np.arange(int(rng.integers(every)), len(fine), every)
    rows = rows[rng.random(len(rows)) >= sensor.lost]
    rows = np.repeat(rows, 1 + (rng.random(len(rows)) < sensor.repeated))
    values: FloatArray = angles[rows] + sensor.noise * rng.normal(size=len(fine))[rows]
    if sensor.step:
        values = sensor.step * np.rint(values / sensor.step)
    delays = sensor.jitter * np.abs(rng.normal(size=len(fine)))[rows]
    stamps: list[int] = (START + np.rint(1e9 * (fine[rows] + delays)).astype(np.int64)).tolist()
    readings: list[float] = values.tolist()
    times: FloatArray = fine[rows]
    return stamps, readings, times, velocity[rows]
