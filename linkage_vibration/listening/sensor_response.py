# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a table says a sensor measures for each unit of an excitation, and how sure that is."""

import math
from collections.abc import Sequence

import numpy as np

from linkage_vibration.listening.signals import SignalError
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.prediction.ensemble import EnsembleResponses, load_factors
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.loads import load_input, load_powers, unit_sizes, weights_at
from linkage_vibration.readers.sensors import Sensor
from linkage_vibration.table.table import Table


class SensorResponse:
    """Amplitudes at a sensor per unit of each excitation; a `SignalError` names a lacking place."""

    def __init__(
        self, table: Table, mechanism: Mechanism, excitations: Sequence[Excitation], sensor: Sensor
    ) -> None:
        self._table, self.sensor = table, sensor
        point, _, part = sensor.at.partition(".")
        if sensor.accelerates:
            self._outputs = [(sensor.at, axis) for axis in "xz"]
        else:
            forces = [row for row in table.forces if row[0] == point in table.load_places]
            self._outputs = [row for row in forces if part in ("", row[1])]
        if not self._outputs or not set(self._outputs) <= set(table.frf_outputs):
            places = sorted({place for place, _ in table.places})
            known = places if sensor.accelerates else table.load_places
            raise SignalError(
                f"The table has no response at {sensor.at}, where {sensor.name} measures; name one "
                f"of {', '.join(known) or 'none'}, or build a table with --frf-points."
            )
        # The response of the lateral half, to what acts across the plane, is not known here.
        self.loaded = [i for i, e in enumerate(excitations) if e.load and not e.load.across]
        loaded = [excitations[i] for i in self.loaded]
        self._loads = [load_input(each.load, each.name, table, mechanism) for each in loaded]
        self._powers = load_powers([each.load for each in loaded])
        self._members: EnsembleResponses | None = None
        self.amplitudes = np.empty((len(excitations), 0))
        """Factors of the amplitudes of the members, (n_excitations, n_members)."""
        if len(table.ensemble_alpha3) and self._loads:
            self._members = EnsembleResponses(table, self._loads, self._outputs, 0, self._at_nodes)
            self.amplitudes = load_factors(excitations, table.ensemble_coordinates)[0]
        self.n_members = self._members.n if self._members else 0
        self.alpha3_range = table.alpha3_range

    def gains(self, alpha3: float, omega: FloatArray) -> FloatArray:
        """Return amplitudes per unit, (1 + n_members, n_loaded), the mechanism itself first.

        They are in m/s^2 or N, root sums of squares over the axes, at rad/s, (n_loaded,), which are
        NaN where they are not known.
        """
        known = np.isfinite(omega)
        w = np.where(known, omega, 1.0)
        responses = [self._nominal(alpha3, w)[np.newaxis]]
        if self._members is not None:
            which: IntArray = np.arange(len(w))
            at, each = np.array([alpha3]), np.tile(w, (1, self.n_members, 1))
            parts = self._members.responses(at, self._members.at(at), each, which)[0]
            responses.append(parts[:, 0] + 1j * parts[:, 1])
        gains = np.sqrt((np.abs(np.concatenate(responses)) ** 2).sum(axis=2))
        gains = gains * (w**2 if self.sensor.accelerates else 1.0)
        return np.asarray(np.where(known, unit_sizes(gains, w, self._powers), math.nan))

    def _nominal(self, alpha3: float, omega: FloatArray) -> ComplexArray:
        """Return responses of the table to unit loads, (n_loaded, n_outputs)."""
        places = list(dict.fromkeys(place for load in self._loads for place in load.places))
        weights = weights_at(self._loads, places, alpha3)
        # All loads together: a table yields one large response much faster than many small ones.
        response = self._table.frf(alpha3, self._outputs, places).driven(*weights)
        of_each: IntArray = np.arange(len(omega))
        return np.asarray(response.frf(omega / (2.0 * math.pi))[of_each, :, of_each])

    def _at_nodes(self, nodes: IntArray, omega: FloatArray) -> FloatArray:
        pairs = zip(self._table.ensemble_alpha3[nodes].tolist(), omega, strict=True)
        responses = np.array([self._nominal(angle, w) for angle, w in pairs])
        return np.stack([responses.real, responses.imag], axis=1)
