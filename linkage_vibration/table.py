# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The lookup table over alpha3: built once from the model, then interpolated."""

import hashlib
import io
import json
import math
import zipfile
import zlib
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

import linkage_vibration
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.files import write_bytes
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.modes import track

FloatArray = NDArray[np.float64]

DEFAULT_POINTS = 181
FORMAT = "linkage_vibration table 1"
UNITS = {
    "alpha3": "rad",
    "natural_frequencies": "Hz",
    "damping_ratios": "1",
    "frf_peak_frequency": "Hz",
    "frf_peak_magnitude": "m/N",
    "interpolation_error": "1",
}


class TableError(LinkageVibrationError):
    """A table cannot be built, read or used."""


@dataclass(frozen=True, eq=False)
class Table:
    """What a prediction tells, at angles over the stroke, and a cubic spline between them.

    Attributes
    ----------
    alpha3 : ndarray, (n,)
        Angles, rad, ascending.
    natural_frequencies : ndarray, (n, n_modes)
        Hz; ascending at the first angle, then tracked by shape.
    damping_ratios : ndarray, (n, n_modes)
        1.
    frf_peak_frequency, frf_peak_magnitude : ndarray, (n,)
        Of the drive-point receptance within the band, Hz and m/N.
    interpolation_error : ndarray, (n - 1,)
        Relative error of the worst natural frequency, 1, measured against the model in the middle
        of each interval; the largest of an interval and its neighbours, since the error of one
        may happen to vanish just there.
    peak_error : tuple of float
        The same for the peak's frequency and magnitude, the worst of all intervals.
    model_hash : str
        Of the mechanism that it was built from.
    mechanism_name : str
        For people.
    package_version : str
        Of the package that built it.
    """

    alpha3: FloatArray
    natural_frequencies: FloatArray
    damping_ratios: FloatArray
    frf_peak_frequency: FloatArray
    frf_peak_magnitude: FloatArray
    interpolation_error: FloatArray
    peak_error: tuple[float, float]
    model_hash: str
    mechanism_name: str
    package_version: str

    @property
    def n_modes(self) -> int:
        """How many modes are tracked."""
        return int(self.natural_frequencies.shape[1])

    @property
    def alpha3_range(self) -> tuple[float, float]:
        """First and last angle, rad."""
        return self._breaks[0], self._breaks[-1]

    @property
    def table_id(self) -> str:
        """Sixteen hexadecimal digits that change with any number in the table."""
        return self.checksum[:16]

    @cached_property
    def checksum(self) -> str:
        """SHA-256 of every array and of the metadata."""
        digest = hashlib.sha256(json.dumps(self._metadata(), sort_keys=True).encode())
        for name in UNITS:
            array = np.ascontiguousarray(getattr(self, name), dtype="<f8")
            digest.update(f"{name}{array.shape}".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def interpolate(self, alpha3: float) -> tuple[FloatArray, float]:
        """Evaluate the table at an angle within its range.

        Parameters
        ----------
        alpha3 : float
            rad; outside the range the result has no meaning, so ask `alpha3_range` first.

        Returns
        -------
        values : ndarray, (2 n_modes + 2,)
            Natural frequencies (Hz), damping ratios (1), the peak's frequency (Hz) and the
            natural logarithm of its magnitude in m/N.
        error : float
            Relative error of the worst natural frequency in this interval.
        """
        breaks = self._breaks
        i = min(max(bisect_right(breaks, alpha3) - 1, 0), len(breaks) - 2)
        t = alpha3 - breaks[i]
        c3, c2, c1, c0 = self._coefficients[i]
        return ((c3 * t + c2) * t + c1) * t + c0, self._errors[i]

    @cached_property
    def _breaks(self) -> tuple[float, ...]:
        return tuple(self.alpha3.tolist())

    @cached_property
    def _errors(self) -> tuple[float, ...]:
        return tuple(self.interpolation_error.tolist())

    @cached_property
    def _coefficients(self) -> FloatArray:
        """Highest power first, (n - 1, 4, 2 n_modes + 2)."""
        values = np.column_stack(
            [
                self.natural_frequencies,
                self.damping_ratios,
                self.frf_peak_frequency,
                np.log(self.frf_peak_magnitude),
            ]
        )
        return np.ascontiguousarray(CubicSpline(self.alpha3, values).c.swapaxes(0, 1))

    def _metadata(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "mechanism_name": self.mechanism_name,
            "model_hash": self.model_hash,
            "package_version": self.package_version,
            "range_rad": list(self.alpha3_range),
            "units": UNITS,
            "peak_error": list(self.peak_error),
        }


def build_table(
    model: LinkageModel,
    n_points: int = DEFAULT_POINTS,
    solved: Callable[[], object] = lambda: None,
) -> Table:
    """Solve the model over its stroke and tabulate what a prediction tells.

    The model is solved at ``n_points`` equispaced angles, which the table holds, and in the middle
    of each interval, which measures the table's error there. Modes are tracked from angle to angle
    by their shapes, over both kinds of angle.

    Parameters
    ----------
    model : LinkageModel
        What to tabulate.
    n_points : int
        At least 4.
    solved : callable
        Called after each of the 2 n_points - 1 solutions, for a progress bar.

    Raises
    ------
    TableError
        If ``n_points`` is too small, or the band holds no response to speak of.
    """
    if n_points < 4:
        raise TableError(f"A table of {n_points} points cannot be interpolated; use 4 or more.")
    mechanism = model.mechanism
    n_modes, band = mechanism.response.modes, mechanism.response.band
    # Links known by FRFs have no matrices: modes are identified, and tracked by plain MAC.
    measured = model.measured_frequencies is not None
    mass = np.eye(len(model.interface)) if measured else model.system.mass
    alphas = np.linspace(*mechanism.stroke, 2 * n_points - 1)
    frequencies = np.empty((len(alphas), n_modes))
    ratios = np.empty((len(alphas), n_modes))
    peaks = np.empty((len(alphas), 2))
    shapes = None
    for i, alpha3 in enumerate(alphas):
        solution = model.identify(float(alpha3)) if measured else model.solve(float(alpha3))
        modes = solution.modes
        if len(modes.omega) < n_modes:
            raise TableError(
                f"response.modes asks for {n_modes} modes; {mechanism.name} shows "
                f"{len(modes.omega)} at {math.degrees(alpha3):.3f} deg; ask for fewer, keep more "
                "modes a link, or widen response.band_hz where modes are identified from FRFs."
            )
        first = modes.shapes[:, :n_modes] if shapes is None else shapes
        order, signs = track(first, modes, mass)
        shapes = modes.select(order, signs).shapes
        frequencies[i] = solution.natural_frequencies[order]
        ratios[i] = solution.damping_ratios[order]
        peak = solution.peak(band)
        peaks[i] = peak.frequency, peak.magnitude
        solved()
    if not (np.isfinite(peaks).all() and (peaks[:, 1] > 0.0).all()):
        raise TableError(
            f"{mechanism.name} does not respond at response.drive_point; choose another point."
        )

    def table(errors: FloatArray, peak_error: tuple[float, float]) -> Table:
        return Table(
            alpha3=alphas[::2],
            natural_frequencies=frequencies[::2],
            damping_ratios=ratios[::2],
            frf_peak_frequency=peaks[::2, 0],
            frf_peak_magnitude=peaks[::2, 1],
            interpolation_error=errors,
            peak_error=peak_error,
            model_hash=mechanism.model_hash,
            mechanism_name=mechanism.name,
            package_version=linkage_vibration.__version__,
        )

    draft = table(np.zeros(n_points - 1), (0.0, 0.0))
    middle = np.array([draft.interpolate(float(alpha3))[0] for alpha3 in alphas[1::2]])
    errors = np.abs(middle[:, :n_modes] / frequencies[1::2] - 1.0).max(axis=1)
    errors = np.pad(errors, 1, mode="edge")
    errors = np.maximum(np.maximum(errors[:-2], errors[1:-1]), errors[2:])
    peak_frequency = np.abs(middle[:, -2] / peaks[1::2, 0] - 1.0).max()
    peak_magnitude = np.abs(np.exp(middle[:, -1]) / peaks[1::2, 1] - 1.0).max()
    return table(errors, (float(peak_frequency), float(peak_magnitude)))


def table_bytes(table: Table) -> bytes:
    """Return a table as one ``.npz``: an array for each quantity, and JSON metadata."""
    metadata = json.dumps({**table._metadata(), "checksum": table.checksum}, sort_keys=True)
    archive = io.BytesIO()
    arrays = {name: getattr(table, name) for name in UNITS}
    np.savez(archive, metadata=np.array(metadata), **arrays)
    return archive.getvalue()


def save_table(table: Table, path: Path) -> None:
    """Write a table's `table_bytes` to a file, beside and renamed.

    Raises
    ------
    TableError
        If it cannot be written.
    """
    write_bytes(path, table_bytes(table), TableError)


def load_table(path: Path, mechanism: Mechanism | None = None) -> Table:
    """Read a table and check it.

    Parameters
    ----------
    path : Path
        Written by `save_table`.
    mechanism : Mechanism, optional
        The one in use; a table of any other is refused.

    Raises
    ------
    TableError
        If the file is missing, is not a table, holds pickles, is damaged, or belongs to another
        mechanism.
    """
    table, checksum = _read(path)
    if table.checksum != checksum:
        raise TableError(f"{path}: is damaged (its checksum differs); build the table again.")
    if mechanism is not None and table.model_hash != mechanism.model_hash:
        raise TableError(
            f"{path}: was built from another mechanism ({table.mechanism_name}, model "
            f"{table.model_hash[:12]}) than the one in use ({mechanism.name}, model "
            f"{mechanism.model_hash[:12]}); build it again with `linkage-vibration build`."
        )
    return table


def _read(path: Path) -> tuple[Table, str]:
    rebuild = "build one with `linkage-vibration build`."
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in UNITS}
            metadata = json.loads(str(archive["metadata"]))
        if metadata["format"] != FORMAT or metadata["units"] != UNITS:
            raise TableError(f"{path}: is a table of another format; {rebuild}")
        peak_frequency, peak_magnitude = metadata["peak_error"]
        table = Table(
            **{name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()},
            peak_error=(peak_frequency, peak_magnitude),
            model_hash=metadata["model_hash"],
            mechanism_name=metadata["mechanism_name"],
            package_version=metadata["package_version"],
        )
        table.checksum  # noqa: B018  reads every part, so that a wrong one shows here
        return table, metadata["checksum"]
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror or error}); {rebuild}") from None
    except (
        ValueError,
        KeyError,
        TypeError,
        IndexError,
        EOFError,
        NotImplementedError,
        RuntimeError,
        zipfile.BadZipFile,
        zlib.error,
    ) as error:
        raise TableError(
            f"{path}: is damaged or not a table ({type(error).__name__}: {error}); {rebuild}"
        ) from None
