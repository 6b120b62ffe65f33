# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The netCDF file of a sweep."""

import io
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import netcdf_file

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.paths import split_paths
from linkage_vibration.studies.sweep.designs import Designs
from linkage_vibration.support.version import VERSION

BUILT, NOT_BUILDABLE, GIVEN_UP = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The result of a design, or the reason why it has none.

    ``values`` are those of `Table.evaluate`, (n_angles, 2 n_modes + 2), NaN outside the stroke.
    """

    status: int  # BUILT, NOT_BUILDABLE or GIVEN_UP
    message: str = ""  # why there is no result
    values: FloatArray | None = None  # None unless it was built
    interpolation_error: float = math.nan  # the worst of the table


def is_complete(output: Path, digest: str) -> bool:
    """Return whether a file holds the complete sweep of a digest, and nothing was given up."""
    try:
        with netcdf_file(output, mmap=False) as file:
            given_up = (file.variables["status"][:] == GIVEN_UP).any()
            return bool(file.digest == digest.encode() and not given_up)
    except (OSError, TypeError, ValueError, KeyError, AttributeError):
        return False  # it is missing, damaged, or another file


def netcdf(designs: Designs, hashes: Sequence[str], outcomes: Sequence[Outcome]) -> bytes:
    """Return the content of a sweep's file; the same designs give the same bytes.

    The hashes of models are empty for designs that describe no mechanism.
    """
    content = io.BytesIO()
    file = netcdf_file(content, "w", version=2)
    file.title = "Natural frequencies and FRF peaks over a grid of designs"
    file.source = f"linkage_vibration {VERSION}"
    file.mechanism = json.dumps(designs.mapping, default=str)
    file.digest = designs.digest(*hashes)
    file.tolerance = designs.tolerance
    n_modes = designs.mapping["response"]["modes"]
    for path, numbers in zip(designs.paths, designs.values, strict=True):
        _add(file, path, (path,), np.array(numbers, dtype=float), units=_units(path))
    angle, numbering = "angle of the input crank", "as numbered, then tracked, in each table"
    _add(file, "alpha3", ("alpha3",), designs.alpha3, units="rad", long_name=angle)
    modes = np.arange(1, n_modes + 1, dtype=np.int32)
    _add(file, "mode", ("mode",), modes, long_name=numbering)
    _add_results(file, designs, outcomes, n_modes)
    _add_text(file, designs, "message", [o.message for o in outcomes], "why there is no result")
    _add_text(file, designs, "model_hash", hashes, "of the design")
    file.flush()
    return content.getvalue()


def _add_results(file: Any, designs: Designs, outcomes: Sequence[Outcome], n_modes: int) -> None:
    values = np.full((len(outcomes), len(designs.alpha3), 2 * n_modes + 2), np.nan)
    for rows, outcome in zip(values, outcomes, strict=True):
        if outcome.values is not None:
            rows[:] = outcome.values
    values = values.reshape(*designs.shape, *values.shape[1:])
    errors = np.array([outcome.interpolation_error for outcome in outcomes])
    status = np.array([outcome.status for outcome in outcomes], dtype=np.int8)
    angles, modes = (*designs.paths, "alpha3"), (*designs.paths, "alpha3", "mode")
    _add(file, "natural_frequencies", modes, values[..., :n_modes], units="Hz")
    _add(file, "damping_ratios", modes, values[..., n_modes:-2], units="1")
    _add(file, "frf_peak_frequency", angles, values[..., -2], units="Hz")
    _add(file, "frf_peak_magnitude", angles, values[..., -1], units="m/N")
    worst = {"units": "1", "long_name": "worst, of the table"}
    _add(file, "interpolation_error", designs.paths, errors.reshape(designs.shape), **worst)
    kinds = np.array([BUILT, NOT_BUILDABLE, GIVEN_UP], dtype=np.int8)
    flags = {"flag_values": kinds, "flag_meanings": "built not_buildable given_up"}
    _add(file, "status", designs.paths, status.reshape(designs.shape), **flags)


def _add_text(file: Any, designs: Designs, name: str, texts: Iterable[str], meaning: str) -> None:
    rows = [text.encode() for text in texts]
    length = max(1, *map(len, rows))
    letters = np.array(rows, dtype=f"S{length}").view("S1").reshape(*designs.shape, length)
    dims = (*designs.paths, f"{name}_length")
    _add(file, name, dims, letters, long_name=meaning, _Encoding="utf-8")


def _add(file: Any, name: str, dims: tuple[str, ...], array: NDArray[Any], **about: Any) -> None:
    """Add a variable, and its dimensions if the file lacks them."""
    for dim, length in zip(dims, array.shape, strict=True):
        if dim not in file.dimensions:
            file.createDimension(dim, length)
    variable = file.createVariable(name, array.dtype.newbyteorder(">"), dims)
    variable[:] = array
    for attribute, value in about.items():
        setattr(variable, attribute, value)


def _units(path: str) -> str:
    """Return the unit of a parameter, which its path implies."""
    keys = split_paths(path)[0].split(".")
    if any(key.endswith("_deg") for key in keys):
        return "degree"
    return "Hz" if any(key.endswith("_hz") for key in keys) else "SI"
