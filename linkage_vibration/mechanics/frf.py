# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""FRFs at the frequencies at which they are shown, stored and compared."""

from dataclasses import dataclass
from typing import Any

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.forces import SOIL, is_force
from linkage_vibration.support.conversions import import_xarray, public_plot


@dataclass(frozen=True, slots=True, eq=False)
class Frf:
    """FRFs between places, which `PoleResidue.at` and `LinkageModel.coupled_frf` return.

    Attributes
    ----------
    frequencies : ndarray, (n_freq,)
        Hz.
    outputs, inputs : tuple of (point, direction)
        Places of the responses, and of the forces or the motions of the soil that cause them.
    values : complex ndarray, (n_freq, n_out, n_in)
        Response per input in `units`; infinite at an undamped resonance.
    error : ndarray, (n_out,)
        Relative errors, L2 norm over frequency: those that a table states for its band, or the
        standard deviations by the noise of measured links. 0 without these, NaN if not known, as
        of identified modes or with `FarPoles`.

    Examples
    --------
    >>> import linkage_vibration as lv
    >>> frf = lv.load_table().frf(2.3, ["E1.z", "lower_link:E1.force_x"], ["E2.x"]).at([1.0, 10.0])
    >>> frf.values.shape
    (2, 2, 1)
    >>> frf.units
    [['m/N'], ['N/N']]
    >>> bool((frf.error < 1e-3).all())
    True
    """

    frequencies: FloatArray
    outputs: tuple[tuple[str, str], ...]
    inputs: tuple[tuple[str, str], ...]
    values: ComplexArray
    error: FloatArray

    def __repr__(self) -> str:
        """Return the places and the number of frequencies, in a line."""
        outputs, inputs = (", ".join(names) for names in self._names())
        return f"Frf({outputs} per {inputs} at {len(self.frequencies)} frequencies)"

    def _names(self) -> list[list[str]]:
        """Return the names of the outputs and of the inputs, such as "E1.z"."""
        return [[".".join(place) for place in each] for each in (self.outputs, self.inputs)]

    @property
    def units(self) -> list[list[str]]:
        """The unit of each output per input, such as "m/N", (n_out, n_in)."""
        per = ["m" if f"{point}:".startswith(SOIL) else "N" for point, _ in self.inputs]
        of = ["m" if not is_force(p) else "N m" if p[1] == "moment" else "N" for p in self.outputs]
        return [[f"{unit}/{each}" for each in per] for unit in of]

    def to_xarray(self) -> Any:
        """Return the values as an `xarray.DataArray` over frequency, output and input.

        Places are such as "E1.z"; ``unit`` and ``error`` are coordinates. It needs the extra
        `xarray`.

        Raises
        ------
        LinkageVibrationError
            If xarray is not installed.
        """
        places = self._names()
        coordinates = {
            "frequency": ("frequency", self.frequencies, {"units": "Hz"}),
            "output": places[0],
            "input": places[1],
            "unit": (("output", "input"), self.units),
            "error": ("output", self.error),
        }
        axes = ("frequency", "output", "input")
        return import_xarray().DataArray(self.values, coordinates, axes, "frf")

    def plot(self, picture: Any = None) -> Any:
        """Draw magnitudes and phases, as `linkage_vibration.plot` does, which may write a PNG."""
        return public_plot(self, picture)
