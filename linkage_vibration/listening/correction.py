# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Corrects predicted natural frequencies over the stroke from a few that were measured.

The uncertain numbers of the mechanism have their stated deviations as priors, and a measured
frequency has Student's t distribution, so that a single wrong one hardly counts. The most probable
numbers are found with the first-order changes of the frequencies. This is experimental: it has
been tried with simulated drives only.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.special import chdtri

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.listening.number_effects import NumberEffects
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.readers.targets import Target, read_targets
from linkage_vibration.support.commands import command
from linkage_vibration.table.table import Table

_FREEDOM = 4.0  # degrees of freedom of Student's t distribution
_REFUSED = 0.01  # share of drives of a model of the right form whose correction is refused
_STEPS, _ENOUGH = 100, 1e-9  # of the iteration, and the change of a number at which it ends


class CorrectionError(LinkageVibrationError):
    """Measured frequencies cannot correct a table."""


class Correction:
    """What measured frequencies say about those of a table; a `CorrectionError` says why not.

    It belongs to the table ``table_id``.
    """

    def __init__(self, table: Table, targets: Sequence[Target]) -> None:
        low, high = table.alpha3_range
        self.table_id = table.table_id
        if not len(table.ensemble_alpha3):
            problem = "The table does not know how uncertain numbers change its modes"
            raise CorrectionError(f"{problem}; state an uncertainty, and build it with FRFs.")
        heights = [each.at for each in targets if not isinstance(each.at, str)]
        if not heights or len(heights) < len(targets):
            raise CorrectionError("A correction needs targets at angles; give each an at_deg.")
        if not all(1 <= each.mode <= table.n_modes for each in targets):
            raise CorrectionError(f"The table has {table.n_modes} modes, counted from 1.")
        if min(heights) < low or max(heights) > high:
            angles = f"of the table, {math.degrees(low):g} to {math.degrees(high):g} deg"
            raise CorrectionError(f"A target is outside the angles {angles}; drop it.")
        at, rows = np.array(heights), np.arange(len(heights))
        every = table.evaluate(at)[:, : table.n_modes]  # Targets count modes as they ascend.
        modes = np.argsort(every, axis=1)[rows, [each.mode - 1 for each in targets]]
        predicted = every[rows, modes]
        if np.isnan(predicted).any():
            raise CorrectionError("A target is of a mode that is overdamped at its angle; drop it.")
        measured = np.array([each.frequency for each in targets])
        deviations = np.array([each.deviation for each in targets])
        self._effects = NumberEffects(table)
        rates = self._effects.at(at)[rows, modes] / deviations[:, np.newaxis]
        apart = np.log(measured / predicted) / deviations
        self._numbers, self._covariance = _most_probable(rates, apart)

    def at(self, alpha3: float) -> tuple[FloatArray, FloatArray]:
        """Return factors of the predicted frequencies at rad, and their relative deviations."""
        rates = self._effects.at(np.array([alpha3]))[0]
        variances = (rates @ self._covariance * rates).sum(axis=1)
        return np.exp(rates @ self._numbers), np.sqrt(np.maximum(variances, 0.0))


def read_correction(path: Path | None, table: Table) -> Correction | None:
    """Return the correction of a table by a file of targets, if there is one."""
    if path is None:
        return None
    try:
        return Correction(table, read_targets(path))
    except CorrectionError as error:
        raise CorrectionError(f"{path}: {error}") from None


def _most_probable(rates: FloatArray, apart: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return standard normal numbers, (m,), from differences, (n,), and their covariance.

    Rates, (n, m), and differences are over measured deviations; one far from its prediction counts
    less. It is refused if twice the lost log-probability is above the quantile of chi-square.
    """
    numbers: FloatArray = np.zeros(rates.shape[1])
    gain: FloatArray = np.zeros(rates.T.shape)
    for _ in range(_STEPS):
        left = apart - rates @ numbers
        # A weight above 1 would say that a measured deviation is too large.
        weights = np.minimum((_FREEDOM + 1.0) / (_FREEDOM + left**2), 1.0)
        gain = np.asarray(np.linalg.solve(rates @ rates.T + np.diag(1.0 / weights), rates).T)
        before, numbers = numbers, gain @ apart
        if np.abs(numbers - before).max() < _ENOUGH:
            break
    left = apart - rates @ numbers
    lost = (_FREEDOM + 1.0) * float(np.log1p(left**2 / _FREEDOM).sum()) + float(numbers @ numbers)
    most = float(chdtri(len(apart), _REFUSED))
    if lost > most:
        raise CorrectionError(
            "No values of the uncertain numbers near those of the mechanism explain the measured "
            f"frequencies (chi-square {lost:.3g} of {len(apart)} targets, at most "
            f"{most:.3g}), so its form may be wrong, or a target belongs to another mode; nothing "
            f"is corrected. Check them with `{command('calibrate')}`."
        )
    return numbers, np.eye(rates.shape[1]) - gain @ rates
