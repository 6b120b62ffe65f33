# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predicts at an angle from a table, for the node, the replay and the command line alike."""

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import overload

import numpy as np

from linkage_vibration.errors import LinkageVibrationError, check_type
from linkage_vibration.mechanics.arrays import FloatArray, Reals, real_number, real_numbers
from linkage_vibration.mechanics.kinematics import unit_question
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.table.interpolation import angles_in_table
from linkage_vibration.table.table import Table

_UNCERTAIN_FREQUENCY, _UNCERTAIN_RATIO = 1.0, 20.0  # %
_FARTHEST_ANGLE = 1e6  # deg; beyond it, nobody is asked whether the joint's zero is turns off


class Status(enum.IntEnum):
    """Whether the numbers of a prediction may be used; the constants of the message."""

    OK = 0
    OUT_OF_RANGE = 1
    INVALID_ANGLE = 2
    NEAR_TOGGLE = 3

    @property
    def has_numbers(self) -> bool:
        """Whether a prediction of this status has numbers."""
        return self in (Status.OK, Status.NEAR_TOGGLE)


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """How the mechanism vibrates at one angle.

    Attributes
    ----------
    crank_angle : float
        alpha3 as given, rad.
    status : Status
        Every number below is NaN unless it is OK or NEAR_TOGGLE.
    natural_frequencies, damping_ratios : ndarray, (n_modes,)
        Hz and 1; with their slopes and standard deviations NaN for a mode that is overdamped at
        this angle. It does not oscillate, so it has no frequency and no resonance. All other
        numbers hold.
    frequency_slopes : ndarray, (n_modes,)
        Change of the natural frequencies with alpha3, Hz/rad.
    frequency_stddevs : ndarray, (n_modes,)
        Standard deviation of the natural frequencies, Hz, by everything that `Shares` lists; NaN
        also where it is not known.
    frf_peak_frequency, frf_peak_magnitude : float
        Hz and m/N.
    interpolation_error : float
        Bound of the relative errors of natural frequencies and damping ratios, 1, against the
        model. It does not include the standard deviations.
    table_id : str
        Identifies the table of the numbers.
    damping_ratio_stddevs : ndarray, (n_modes,)
        Standard deviation of the damping ratios, 1, by the same; NaN also where it is not known.
    """

    crank_angle: float
    status: Status
    natural_frequencies: FloatArray
    damping_ratios: FloatArray
    frequency_slopes: FloatArray
    frequency_stddevs: FloatArray
    frf_peak_frequency: float
    frf_peak_magnitude: float
    interpolation_error: float
    table_id: str
    damping_ratio_stddevs: FloatArray


def uncertain_modes(
    frequencies: FloatArray,
    frequency_stddevs: FloatArray,
    ratios: FloatArray,
    ratio_stddevs: FloatArray,
    label: Callable[[int], str] = lambda mode: f"mode {mode + 1}",
) -> list[str]:
    """Return a sentence about each mode whose standard deviations are large.

    That is above 1 % of the natural frequency, Hz, or 20 % of the damping ratio, in any prediction,
    (..., n_modes). ``label`` returns how a mode, counted from 0, is called.
    """
    pairs = (frequencies, frequency_stddevs), (ratios, ratio_stddevs)
    worst = [largest_deviations(*pair) for pair in pairs]
    return [
        f"M{label(mode)[1:]} is uncertain: the standard deviation is {frequency:.2g} % of its "
        f"natural frequency and {ratio:.2g} % of its damping ratio."
        for mode, (frequency, ratio) in enumerate(np.transpose(worst))
        if frequency > _UNCERTAIN_FREQUENCY or ratio > _UNCERTAIN_RATIO
    ]


def largest_deviations(values: FloatArray, stddev: FloatArray) -> FloatArray:
    """Return the largest relative standard deviation of each mode, %, (n_modes,); 0 if unknown.

    Values and their standard deviations are (..., n_modes).
    """
    shares = np.divide(stddev, values, out=np.zeros(np.shape(values)), where=values > 0.0)
    every = shares.reshape(-1, shares.shape[-1])
    return np.asarray(100.0 * np.fmax.reduce(every, axis=0, initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Shares:
    """Where standard deviations of a prediction come from; they add as squares.

    Each is (2, n_modes): of natural frequencies, Hz, and of damping ratios, 1.
    """

    parameters: FloatArray  # numbers of the mechanism; NaN where not known
    angle: FloatArray  # the crank angle
    links: FloatArray  # noise of measured links
    table: FloatArray  # interpolation: the bound of its error

    @property
    def total(self) -> FloatArray:
        """The standard deviations by all together, (2, n_modes)."""
        parts = self.parameters, self.angle, self.links, self.table
        return np.asarray(np.sqrt(sum(part**2 for part in parts)))


def fault(prediction: Prediction, alpha3_range: tuple[float, float]) -> str:
    """Return why a prediction has no numbers, or doubtful ones; empty if its status is OK.

    The range is that of the table, rad.
    """
    angle = math.degrees(prediction.crank_angle)
    if prediction.status is Status.INVALID_ANGLE:
        return f"crank angle {angle} deg is not a finite number"
    if prediction.status is Status.OUT_OF_RANGE:
        first, last = map(math.degrees, alpha3_range)
        text = f"crank angle {angle:.7g} deg is not in the table's {first:.7g} to {last:.7g} deg"
        if question := unit_question(prediction.crank_angle, *alpha3_range):
            return f"{text}; {question}"
        turned = first + (angle - first) % 360.0
        if turned <= last and abs(angle) < _FARTHEST_ANGLE:
            return f"{text}, but {turned:.7g} deg is: is the joint's zero turns off?"
        return text
    if prediction.status is Status.NEAR_TOGGLE:
        return (
            f"crank angle {angle:.7g} deg is less than 1 deg from a toggle, where a small error of "
            "the angle causes a large error of the configuration"
        )
    return ""


class Predictor:
    """Predicts from a table.

    A table over a whole turn belongs to a crank that turns all the way, and holds for every turn.
    """

    def __init__(self, table: Table) -> None:
        check_type(table, "use `build_table` or `load_table`", Table)
        self.table = table
        self._low, self._high = table.alpha3_range
        self._first_away, self._last_away = table.range_away_from_toggles
        self._n_modes = table.n_modes
        self._measured = table.measured
        self._table_id = table.table_id
        table.interpolate(self._low)  # the table prepares itself at the first use

    def __repr__(self) -> str:
        """Return the table by which it predicts, in a line."""
        return f"Predictor({self.table})"

    def angle_in_table(self, alpha3: float) -> float | None:
        """Return the angle of the table, rad, as `angles_in_table` does; None if there is none."""
        alpha3 = real_number(alpha3, "alpha3")
        if self._low <= alpha3 <= self._high:
            return alpha3
        angle = float(angles_in_table(np.array([alpha3]), self.table.alpha3_range)[0])
        return None if math.isnan(angle) else angle

    @overload
    def predict(self, alpha3: float, stddev: float = 0.0) -> Prediction: ...

    @overload
    def predict(self, alpha3: Reals, stddev: float | Reals = 0.0) -> MessageColumns: ...

    def predict(
        self, alpha3: float | Reals, stddev: float | Reals = 0.0
    ) -> Prediction | MessageColumns:
        """Predict at an angle or at many; every float has a prediction, possibly without numbers.

        Parameters
        ----------
        alpha3 : float, or ndarray, (n,)
            rad. An array gives columns with the names of the attributes of `Prediction`, which have
            n rows. Their text ``unknown_deviations`` says why standard deviations are NaN.
        stddev : float, or ndarray, (n,)
            Standard deviation of alpha3, rad. That of the frequencies is computed to first order,
            abs(df/dalpha3) stddev. This is too small at an extremum of a frequency, where only the
            second-order term abs(d2f/dalpha3^2) stddev^2 / sqrt(2) is left. At a distance d from
            a toggle, where frequencies vary with sqrt(d), it is too small by the fraction
            7/16 (stddev / d)^2; within a few stddev it is meaningless. The other parts (`Shares`)
            are added as the root of the sum of squares.

        Raises
        ------
        LinkageVibrationError
            If an argument is neither a real number nor an array of them with one axis, or if the
            number of standard deviations is not that of the angles.
        """
        if not (isinstance(alpha3, float) and isinstance(stddev, float)):
            angles, given = real_numbers(alpha3, "alpha3"), real_numbers(stddev, "stddev")
            if given.shape not in ((), angles.shape):
                raise LinkageVibrationError(
                    f"`stddev` has {given.size} numbers for {angles.size} angles; give one "
                    "number, or one for each angle."
                )
            if angles.ndim:
                return predict_many(self, angles, np.broadcast_to(given, angles.shape))
            alpha3, stddev = angles, given
        # NumPy numbers of another precision would change the arithmetic.
        alpha3, stddev = float(alpha3), float(stddev)
        angle = self.angle_in_table(alpha3)
        if angle is None:
            return self._refuse(alpha3)
        (values, peak_frequency, peak_magnitude, error), slopes, parameters = self.table.at(angle)
        n = self._n_modes
        parts = self._parts(angle, stddev, values, slopes, error, parameters)
        each = zip(*parts, strict=True)
        stddevs = [math.sqrt(a * a + b * b + c * c + d * d) for a, b, c, d in each]
        modes = np.array([*values, *slopes[:n], *stddevs]).reshape(5, n)
        frequencies, ratios, frequency_slopes, frequency_stddevs, ratio_stddevs = modes
        sound = self._first_away <= angle <= self._last_away
        return Prediction(
            crank_angle=alpha3,
            status=Status.OK if sound else Status.NEAR_TOGGLE,
            natural_frequencies=frequencies,
            damping_ratios=ratios,
            frequency_slopes=frequency_slopes,
            frequency_stddevs=frequency_stddevs,
            frf_peak_frequency=peak_frequency,
            frf_peak_magnitude=peak_magnitude,
            interpolation_error=error,
            table_id=self._table_id,
            damping_ratio_stddevs=ratio_stddevs,
        )

    def shares(self, alpha3: float, stddev: float = 0.0) -> Shares:
        """Return where the standard deviations of a prediction come from.

        Parameters
        ----------
        alpha3, stddev : float
            As `predict` takes them; without a prediction every share is NaN.
        """
        stddev, angle = real_number(stddev, "stddev"), self.angle_in_table(alpha3)
        if angle is None:
            return Shares(*np.full((4, 2, self._n_modes), math.nan))
        (values, _, _, error), slopes, parameters = self.table.at(angle)
        parts = self._parts(angle, stddev, values, slopes, error, parameters)
        return Shares(*np.array(parts).reshape(4, 2, self._n_modes))

    def _parts(
        self,
        angle: float,
        stddev: float,
        values: list[float],
        slopes: list[float],
        error: float,
        parameters: list[float],
    ) -> tuple[list[float], ...]:
        """Return the parts of the standard deviations of values, each (2 n_modes,)."""
        n = self._n_modes
        parameters[:n] = [part * value for part, value in zip(parameters, values[:n], strict=False)]
        noise = [0.0] * (2 * n)
        if self._measured:
            noise = self.table.deviations(np.array([angle]))[:, 0].ravel().tolist()
        turned = [abs(slope) * stddev for slope in slopes]
        return parameters, turned, noise, [error * value for value in values]

    def _refuse(self, alpha3: float) -> Prediction:
        unknown, nan = np.full(self._n_modes, math.nan), math.nan
        status = Status.OUT_OF_RANGE if math.isfinite(alpha3) else Status.INVALID_ANGLE
        modes = unknown, unknown, unknown, unknown
        return Prediction(alpha3, status, *modes, nan, nan, nan, self._table_id, unknown)


def predict_many(predictor: Predictor, alpha3: FloatArray, stddev: FloatArray) -> MessageColumns:
    """Predict at many angles as `Predictor` does at one, with the same results to the last bit.

    The formula is written twice: one row of arrays takes 15 times as long as floats, and the node
    predicts at each reading. Angles and deviations are (n,), rad.
    """
    table, n = predictor.table, len(alpha3)
    modes = table.n_modes
    angles = angles_in_table(alpha3, table.alpha3_range)
    inside = np.flatnonzero(~np.isnan(angles))
    angles = angles[inside]
    values, slopes = table.evaluate(angles), table.evaluate_slopes(angles)
    ends = table.alpha3[table.pieces]
    piece = np.clip(np.searchsorted(ends, angles, side="right") - 1, 0, len(ends) - 2)
    first, last = table.range_away_from_toggles
    sound = (first <= angles) & (angles <= last)

    status = np.where(np.isfinite(alpha3), Status.OUT_OF_RANGE, Status.INVALID_ANGLE)
    status[inside] = np.where(sound, Status.OK, Status.NEAR_TOGGLE)
    error = table.interpolation_error[piece]
    modal = values[:, : 2 * modes]
    parameters = table.evaluate_parameter_deviations(angles)
    parameters[:, :modes] *= modal[:, :modes]
    turned = np.abs(slopes) * stddev[inside, np.newaxis]
    noise = np.hstack(list(table.deviations(angles))) if table.measured else 0.0
    missed = error[:, np.newaxis] * modal
    total = np.sqrt(parameters**2 + turned**2 + noise**2 + missed**2)
    per_mode, single = np.full((5, n, modes), np.nan), np.full((3, n), np.nan)
    per_mode[:, inside] = *np.hsplit(modal, 2), slopes[:, :modes], *np.hsplit(total, 2)
    single[:2, inside] = values[:, 2 * modes :].T
    single[2, inside] = error
    frequencies, ratios, rates, frequency_stddevs, ratio_stddevs = per_mode
    return MessageColumns(
        crank_angle=alpha3,
        status=status.astype(np.uint8),
        natural_frequencies=frequencies,
        damping_ratios=ratios,
        frequency_slopes=rates,
        frequency_stddevs=frequency_stddevs,
        frf_peak_frequency=single[0],
        frf_peak_magnitude=single[1],
        interpolation_error=single[2],
        table_id=table.table_id,
        damping_ratio_stddevs=ratio_stddevs,
        unknown_deviations=table.unknown_deviations,
    )
