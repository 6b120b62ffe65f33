# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies that the vibration of a drive shows, beside those of a table."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from linkage_vibration.drawing.intervals import gap_starts
from linkage_vibration.listening.mode_checks import (
    damping_doubt,
    line_doubt,
    low_damping_doubt,
    order_doubt,
    tone_doubt,
    wheelbase_lines,
    window_doubt,
)
from linkage_vibration.listening.output_only import Candidate, PausableTask, identify, mac
from linkage_vibration.listening.segments import (
    SHORTEST,
    find_segments,
    longest_still,
    over_phase,
    phase_rate,
)
from linkage_vibration.listening.signals import Signal, known_at
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import Place
from linkage_vibration.mechanics.uncertainty import INTERVAL
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.ground import Terrain, vertical_mounts
from linkage_vibration.readers.targets import INCLINOMETER
from linkage_vibration.table.table import Table

_AROUND = 0.7, 1.4  # of a predicted frequency: the band in which its mode is sought
_MODEL = 0.12  # standard deviation of ln(frequency) of a model, where modes are paired
_ALIKE = 0.5  # least MAC of a measured shape and that of the model
_LINE = "a line of the wheelbase"
_GROUND = Excitation(_LINE, Source.GROUND, math.nan, terrain=Terrain(64e-6))  # class B
_BESIDE = 0.2  # s on both sides of a gap
_STANDS = 0.3  # m/s, below which a tractor stands
_LOWEST, _HIGHEST = 0.5, 0.3  # Hz of a mode, and its share of the sampling rate


@dataclass(frozen=True, slots=True)
class DriveMode:
    """A mode at one height, as predicted and as measured."""

    alpha3: float  # rad, mean over its segments
    mode: int  # from 0
    predicted: float  # Hz
    predicted_stddev: float  # relative, by uncertain numbers; NaN if not known
    angle_stddev: float  # relative, of the frequency by the angle
    frequency: float  # Hz, measured, undamped
    frequency_stddev: float  # Hz
    ratio: float  # damping ratio, measured, 1
    ratio_stddev: float
    times: tuple[float, ...]  # s, middles of its segments
    doubt: str = ""  # why it is not reported; empty if it is

    @property
    def deviation(self) -> float:
        """Relative standard deviation of the measured frequency, with that of the angle."""
        return math.hypot(self.frequency_stddev / self.frequency, self.angle_stddev)

    @property
    def difference(self) -> float:
        """ln(measured / predicted) over the standard deviation of both, 1."""
        both = math.hypot(self.predicted_stddev, self.deviation)
        return math.log(self.frequency / self.predicted) / both

    @property
    def consistent(self) -> bool | None:
        """Whether the difference is within the 95 % interval of both; None if not known."""
        return None if math.isnan(self.difference) else abs(self.difference) <= INTERVAL


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredDrive:
    """The arguments of `search_modes`."""

    table: Table
    mechanism: Mechanism
    times: FloatArray  # (n,), s, even
    signals: FloatArray  # (n, n_channels), accelerations without gaps, m/s^2
    places: Sequence[Place]  # (n_channels,)
    angle: FloatArray  # (n,), rad; NaN if not known
    speeds: Mapping[Source, FloatArray]  # (n,), rpm or m/s; NaN if not known
    excitations: Sequence[Excitation] = ()  # without a terrain, wheels roll on a usual one
    damped: bool = True  # also modes whose damping leaves their deviation unknown

    @property
    def rate(self) -> float:
        """The rate of the signals, Hz."""
        return 1.0 / float(self.times[1] - self.times[0])


def search_modes(drive: MeasuredDrive) -> PausableTask[tuple[DriveMode, ...]]:
    """Return the modes at each height of a drive; it yields between parts of some milliseconds."""
    table, excitations = drive.table, drive.excitations
    low, high = table.alpha3_range
    angle = np.where((drive.angle >= low) & (drive.angle <= high), drive.angle, np.nan)
    predicted = np.full((len(angle), table.n_modes), np.nan)
    known = np.isfinite(angle)
    predicted[known] = table.evaluate(angle[known])[:, : table.n_modes]
    yield
    if wheelbase(drive.mechanism) and not any(each.terrain for each in excitations):
        excitations = *excitations, _GROUND
    speeds = {source: np.abs(speed) for source, speed in drive.speeds.items()}  # also in reverse
    drive = replace(drive, angle=angle, speeds=speeds, excitations=excitations)
    modes: list[DriveMode] = []
    for segments in find_segments(drive.times, angle):
        yield
        modes += yield from _at_height(drive, predicted, segments)
    return tuple(modes)


def search_signals(
    table: Table,
    mechanism: Mechanism,
    signals: Sequence[Signal],
    crank_angle: tuple[FloatArray, FloatArray],
    speeds: Mapping[Source, tuple[FloatArray, FloatArray]],
    excitations: Sequence[Excitation],
    *,
    damped: bool = True,
) -> PausableTask[tuple[DriveMode, ...]]:
    """Return what `search_modes` does, for sensors; angle and speeds are times, s, and values."""
    # A clock that is set far into the future makes no time at which the angle is known.
    first = max(crank_angle[0][0], *(s.times[0] for s in signals))
    last = min(crank_angle[0][-1], *(s.times[-1] for s in signals))
    if last - first < SHORTEST:
        return ()
    times = np.arange(first, last, 1.0 / max(s.rate for s in signals))
    angle = known_at(times, *crank_angle)
    for signal in signals:  # The values in gaps are interpolated, but no mode is sought there.
        for i in gap_starts(signal.times).tolist():
            start, end = signal.times[i : i + 2] + np.array([-_BESIDE, _BESIDE])
            angle[(times > start) & (times < end)] = math.nan
    axes = "xyz" if table.lateral else "xz"
    values = np.hstack([signal.at(times)[:, ["xyz".index(a) for a in axes]] for signal in signals])
    places = [(signal.sensor.at, axis) for signal in signals for axis in axes]
    alive = np.flatnonzero(np.ptp(values, axis=0)).tolist()  # An axis may not be measured.
    if not alive:
        return ()
    yield
    known = {source: known_at(times, *each) for source, each in speeds.items()}
    measured = times, values[:, alive], [places[i] for i in alive], angle, known
    drive = MeasuredDrive(table, mechanism, *measured, excitations, damped)
    return (yield from search_modes(drive))


def why_no_modes(
    table: Table, signals: Sequence[Signal], crank_angle: tuple[FloatArray, FloatArray]
) -> str:
    """Return the first condition of `search_signals` that is not met, with its numbers."""
    if not signals:
        return "No sensor measures accelerations on the linkage."
    first = max(crank_angle[0][0], *(s.times[0] for s in signals))
    last = min(crank_angle[0][-1], *(s.times[-1] for s in signals))
    if last - first < SHORTEST:
        text = "The crank angle and all accelerations are known at once for"
        return f"{text} {max(last - first, 0.0):.3g} s, and modes need {SHORTEST:g} s."
    times = np.arange(first, last, 0.1)
    angle = known_at(times, *crank_angle)
    low, high = np.degrees(table.alpha3_range)
    angle[~((np.degrees(angle) >= low) & (np.degrees(angle) <= high))] = math.nan
    if not np.isfinite(angle).any():
        return f"The crank angle is never between {low:.4g} and {high:.4g} deg, as in the table."
    if (seconds := longest_still(times, angle)) < SHORTEST:
        text = f"The crank moves less than 1 deg/s within the table for at most {seconds:.3g} s"
        return f"{text} at a time, and modes need {SHORTEST:g} s."
    every = table.evaluate(angle[np.isfinite(angle)])[:, : table.n_modes]
    lowest = float(np.nanmin(every))
    rate = max(s.rate for s in signals)
    if not _LOWEST < lowest < _HIGHEST * rate:
        text = f"The lowest predicted mode is at {lowest:.3g} Hz, and at {rate:.3g} Hz the sensors"
        return f"{text} show modes from {_LOWEST:g} to {_HIGHEST * rate:.3g} Hz."
    return "No estimate fits a predicted mode in frequency and shape; drive on rougher ground."


def _at_height(
    drive: MeasuredDrive, predicted: FloatArray, segments: Sequence[slice]
) -> PausableTask[list[DriveMode]]:
    """Return the modes that segments at one height show; predicted are Hz, (n, n_modes)."""
    table, rows = drive.table, np.concatenate([np.r_[each] for each in segments])
    alpha3 = float(drive.angle[rows].mean())
    ground = drive.speeds.get(Source.GROUND, np.zeros(len(drive.times)))[rows]
    rolling = ground[ground > _STANDS]
    slowest = float(np.quantile(rolling, 0.05)) if len(rolling) else math.inf
    shapes = model_shapes(table, alpha3, drive.places)
    means = predicted[rows].mean(axis=0)
    slopes, deviations = table.slopes(alpha3), table.parameter_deviations(alpha3)
    ratios = table.evaluate(np.array([alpha3]))[0, table.n_modes : 2 * table.n_modes]
    modes = []
    for mode in np.flatnonzero((means > _LOWEST) & (means < _HIGHEST * drive.rate)).tolist():
        mean = float(np.mean([predicted[part, mode].mean() for part in segments]))
        too_damped = damping_doubt(float(ratios[mode]))
        if too_damped and not drive.damped:
            continue
        windows, rate = [], phase_rate(mean, drive.rate)
        for part in segments:
            yield
            signals, expected = drive.signals[part], predicted[part, mode]
            windows.append(over_phase(signals, expected, mean, drive.rate))
        lag = 1 + math.ceil(rate * wheelbase(drive.mechanism) / slowest)
        candidates = yield from identify(windows, rate, (_AROUND[0] * mean, _AROUND[1] * mean), lag)
        best = _best(candidates, mode, means, shapes)
        if best is None:
            continue
        doubt, over_time = "", best.frequency / mean * predicted[:, mode]
        for part in segments:
            yield
            there = {source: speed[part] for source, speed in drive.speeds.items()}
            doubt = doubt or order_doubt(over_time[part], there, drive.excitations)
        doubt = doubt or (yield from window_doubt(windows, rate, lag, best))
        doubt = doubt or low_damping_doubt(best.ratio, best.ratio_stddev, float(ratios[mode]))
        doubt = doubt or (yield from _tone_doubt(drive, segments, mean)) or too_damped
        if not doubt and len(rolling):
            doubt = yield from _line_doubt(drive, rolling, alpha3, best, mean)
        calculated = mean, deviations[mode], INCLINOMETER * abs(slopes[mode]) / mean
        measured = best.frequency, best.frequency_stddev, best.ratio, best.ratio_stddev
        times = tuple(float(drive.times[each].mean()) for each in segments)
        modes.append(DriveMode(alpha3, mode, *calculated, *measured, times, doubt))
    return modes


def _tone_doubt(drive: MeasuredDrive, segments: Sequence[slice], mean: float) -> PausableTask[str]:
    """Return that a tone that no excitation describes is in the band of a mode; else ""."""
    speeds = drive.speeds
    known = [each for each in drive.excitations if each.is_order and each.source in speeds]
    orders = [
        [each.ratio * float(speeds[each.source][part].mean()) for each in known]
        for part in segments
    ]
    windows = [drive.signals[part] for part in segments]
    band = _AROUND[0] * mean, _AROUND[1] * mean
    return (yield from tone_doubt(windows, drive.rate, band, orders))


def _line_doubt(
    drive: MeasuredDrive, rolling: FloatArray, alpha3: float, best: Candidate, predicted: float
) -> PausableTask[str]:
    """Return that a line of the wheelbase, at the speeds of rolling, m/s, is there; else ""."""
    speeds = np.quantile(rolling, (0.05, 0.35, 0.65, 0.95)).tolist()
    place = drive.places[int(np.abs(best.shape).argmax())]
    for terrain in filter(None, (each.terrain for each in drive.excitations)):
        raised = replace(terrain, raised=True)  # A tool in the soil ends no rolling.
        given = drive.table, drive.mechanism, raised, place, alpha3, speeds
        lines = yield from wheelbase_lines(*given)
        if doubt := line_doubt(best.frequency, predicted, lines):
            return doubt
    return ""


def _best(
    candidates: Sequence[Candidate], mode: int, means: FloatArray, shapes: ComplexArray
) -> Candidate | None:
    """Return the candidate that fits a mode best, and no other mode better; or None."""
    scored = []  # not by their deviations: those that are too small would be preferred
    for each in candidates:
        alike = mac(each.shape, shapes)
        scores = alike * np.exp(-0.5 * (np.log(each.frequency / means) / _MODEL) ** 2)
        known = math.isfinite(each.frequency_stddev)
        if known and np.nanargmax(scores) == mode and alike[mode] > _ALIKE:
            scored.append((float(scores[mode]), each))
    return max(scored, key=lambda pair: pair[0])[1] if scored else None


def model_shapes(table: Table, alpha3: float, places: Sequence[Place]) -> ComplexArray:
    """Return shapes of the table's modes at places, on the left side, (n_places, n_modes)."""
    return table.listed([_half_shapes(half, alpha3, places) for half in table.halves])


def _half_shapes(table: Table, alpha3: float, places: Sequence[Place]) -> ComplexArray:
    """Return the same of one half, which does not move at places that its table does not have."""
    moved = [i for i, place in enumerate(places) if place in table.frf_outputs]
    known, shapes = [places[i] for i in moved], np.zeros((len(places), table.n_modes), complex)
    if not known:
        return shapes
    terms = table.frf(alpha3, known, table.places)
    hertz = np.sqrt(np.abs(terms.stiffness)) / (2.0 * math.pi)
    for mode, each in enumerate(table.evaluate(np.array([alpha3]))[0, : table.n_modes].tolist()):
        k = int(np.abs(hertz - each).argmin())
        half = terms.decay[k] / 2.0
        s = -half + 1j * np.sqrt(terms.stiffness[k] - half**2 + 0j)  # the pole
        residues = terms.residues[:, :, k] + s * terms.rates[:, :, k]
        shape = residues[:, np.linalg.norm(residues, axis=0).argmax()]
        shapes[moved, mode] = shape / (shape[np.abs(shape).argmax()] or 1.0)  # 0: it is at rest
    return shapes


def wheelbase(mechanism: Mechanism) -> float:
    """Return the distance of the first and last mount that roll over the ground, m."""
    at = [mount.at[0] for mount in vertical_mounts(mechanism)]
    return max(at) - min(at) if at else 0.0
