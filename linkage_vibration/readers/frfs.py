# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads components from measured or computed FRFs: UFF 58 and ``.npz``.

``.npz``
    ``frequencies`` (n_freq,) in Hz; ``frf`` (n_freq, n, n), complex receptances in m/N, rad/N,
    m/(N m) and rad/(N m), with responses along the rows and forces along the columns; and
    ``dofs``, n texts such as ``P1 x`` (see `matrices`).
UFF
    All FRFs (functions of type 4) in data sets 58, text or binary, whose response and reference
    nodes are mapped to points. Directions 1, 2 and 3 are x, y and z of the component. Direction 5
    is rotation about y; theta has the opposite sign, as it turns x towards z. A negative direction
    changes the sign. The type of the ordinate distinguishes displacement, velocity and
    acceleration, which are divided by (i omega)^n; the line at 0 Hz is omitted where that divides
    by zero. If only H_ij was measured, H_ji is set equal to it (reciprocity).

The time dependence is exp(i omega t), as in all analysers.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.description import Point
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.readers.component_files import (
    ComponentFileError,
    FileError,
    check_file,
    choose_rows,
    file_errors,
    load_npz,
    parse_dofs,
)
from linkage_vibration.readers.frf_faults import check_faults, name_frf
from linkage_vibration.support.missing_library import needed

_FRF = 4  # function type
_DIRECTIONS = {1: ("x", 1.0), 2: ("y", 1.0), 3: ("z", 1.0), 5: ("theta", -1.0)}
# The response by the specific data type of the ordinate: its name, the power of i omega in it, and
# the labels of its units.
_RESPONSES = {
    8: ("a displacement", 0, ("m", "rad")),
    11: ("a velocity", 1, ("m/s", "rad/s")),
    12: ("an acceleration", 2, ("m/s2", "m/s/s", "m/sec2", "rad/s2", "rad/s/s", "rad/sec2")),
}
_FORCES = (9, 13)  # data types of a reaction and an excitation force
_FORCE_LABELS = ("n", "nm", "newton")
_FREQUENCY = (0, 18)  # data types: unknown, frequency
_UNITS = {2: "feet", 3: "kilograms force", 4: "feet", 5: "mm", 6: "cm", 7: "inches", 8: "mm"}

_FINITE = 1e100  # m/N; the square of a larger value may overflow


_Pair = tuple[InterfaceDof, InterfaceDof]
"""A response and the reference, where the force acts."""

_Function = tuple[FloatArray, ComplexArray]
"""The frequencies of a measured FRF, Hz, and its receptances."""


def read_frfs(
    path: Path,
    nodes: Mapping[int, str] | None = None,
    points: Mapping[str, Point] | None = None,
    mass: float | None = None,
) -> Frfs:
    """Read and check the receptances of a component from ``.npz``, ``.uff`` or ``.unv``.

    ``nodes`` are the points of a UFF file's nodes. A ComponentFileError says how FRFs contradict
    the points, m, or the mass, kg, of one equal link.
    """
    kind = path.suffix.lower()
    if kind not in (".npz", ".uff", ".unv"):
        raise ComponentFileError(f"{path}: is not a file of FRFs; give a .npz, .uff or .unv file.")
    with file_errors(path):
        frfs = _read_npz(path) if kind == ".npz" else _read_uff(path, nodes or {})
        _check_values(frfs)
        check_faults(frfs, points, mass)
    return replace(frfs, mass=mass)


def _read_npz(path: Path) -> Frfs:
    arrays = load_npz(path, ("frequencies", "frf", "dofs"))
    frequencies, frf = arrays["frequencies"], arrays["frf"]
    if frequencies.ndim != 1 or frequencies.dtype.kind not in "fiu":
        raise FileError("has frequencies that are not a list of real numbers; give them in Hz.")
    if frf.dtype.kind != "c":
        raise FileError("has a real frf; give complex receptances in m/N.")
    labels = parse_dofs(np.ravel(arrays["dofs"]).tolist())
    if frf.shape != (len(frequencies), len(labels), len(labels)):
        lines, n = len(frequencies), len(labels)
        hint = f"write one of {lines} by {n} by {n}, as there are {lines} frequencies and {n} dofs"
        raise FileError(f"has an frf of {' by '.join(map(str, frf.shape))}; {hint}.")
    dofs, rows = choose_rows(labels)
    chosen = frf[:, rows][:, :, rows].astype(np.complex128)
    return Frfs(dofs, frequencies.astype(np.float64), chosen)


def _read_uff(path: Path, nodes: Mapping[int, str]) -> Frfs:
    functions: dict[_Pair, _Function] = {}
    for data_set in _data_sets(path):
        if data_set["type"] == 164:
            _check_system(data_set)
            continue
        pair, sign = _pair(data_set, nodes)
        if pair is None:
            continue
        if pair in functions:
            raise FileError(f"has the FRF of {name_frf(*pair)} twice; remove one.")
        frequencies, values = _receptance(data_set, f"the FRF of {name_frf(*pair)}")
        functions[pair] = frequencies, sign * values
    dofs = tuple(dict.fromkeys(dof for pair in functions for dof in pair))
    if not dofs:
        given = ", ".join(f"{node}: {point}" for node, point in nodes.items()) or "none"
        problem = "holds no FRF (function type 4) between nodes that are mapped to points"
        raise FileError(f"{problem} ({given}).")
    first, (lines, _) = next(iter(functions.items()))
    for pair, (other, _) in functions.items():
        if len(other) != len(lines) or not np.allclose(other, lines, rtol=1e-5, atol=0.0):
            problem = f"has other frequencies than that of {name_frf(*first)}"
            hint = "measure or resample them alike"
            raise FileError(f"the FRF of {name_frf(*pair)} {problem}; {hint}.")
    frf = np.empty((len(lines), len(dofs), len(dofs)), dtype=np.complex128)
    for i, response in enumerate(dofs):
        for j, reference in enumerate(dofs):
            there = functions.get((response, reference)) or functions.get((reference, response))
            if there is None:
                problem = f"has no FRF of {name_frf(response, reference)}, nor the reverse"
                raise FileError(f"{problem}; measure one.")
            frf[:, i, j] = there[1]
    return Frfs(dofs, lines, frf)


def _data_sets(path: Path) -> list[dict[str, Any]]:
    """Return the data sets 58 (functions) and 164 (units) of a UFF file."""
    with needed("uff", "needs pyuff to be read", FileError):
        import pyuff
    check_file(path)
    with path.open("rb") as opened:
        if not opened.read(4096).lstrip().startswith(b"-1"):
            raise FileError("does not begin like a Universal File; export it again.")
    # pyuff raises plain exceptions; infinite numbers are reported later.
    with file_errors(path, Exception), np.errstate(all="ignore"):
        file = pyuff.UFF(str(path))
        types = [int(kind) for kind in file.get_set_types()]
        return [file.read_sets(i) for i, kind in enumerate(types) if kind in (58, 164)]


def _check_system(units: Mapping[str, Any]) -> None:
    """Raise an error unless the units are SI; the factors of the set divide values into SI."""
    code = units["units_code"]
    if code in _UNITS or abs(units["length"] - 1.0) > 1e-6 or abs(units["force"] - 1.0) > 1e-6:
        factors = f"length factor {units['length']:g}, force factor {units['force']:g}"
        system = f"{_UNITS.get(code, 'its own')} in data set 164 (code {code}, {factors})"
        raise FileError(f"has units of {system}; export it in SI.")


def _pair(data: Mapping[str, Any], nodes: Mapping[int, str]) -> tuple[_Pair | None, float]:
    """Return between which DoFs a data set 58 is, with its sign; None if it is no mapped FRF."""
    ends = []
    sign = 1.0
    for end in ("rsp", "ref"):
        node, direction = data[f"{end}_node"], data[f"{end}_dir"]
        if data["func_type"] != _FRF or node not in nodes or abs(direction) not in _DIRECTIONS:
            return None, sign
        name, positive = _DIRECTIONS[abs(direction)]
        sign *= math.copysign(positive, positive * direction)
        ends.append(InterfaceDof(nodes[node], name))
    return (ends[0], ends[1]), sign


def _receptance(data: Mapping[str, Any], where: str) -> _Function:
    """Return a data set 58 as receptance; `where` begins its errors."""
    kind = data["ordinate_spec_data_type"]
    if kind not in _RESPONSES:
        problem = f"{where} has the ordinate data type {kind}"
        hint = "export it as displacement (8), velocity (11) or acceleration (12)"
        raise FileError(f"{problem}; {hint}.")
    if data["orddenom_spec_data_type"] not in _FORCES:
        problem = f"has the ordinate denominator data type {data['orddenom_spec_data_type']}"
        raise FileError(f"{where} {problem}; export it per excitation force (13).")
    quantity, power, labels = _RESPONSES[kind]
    _check_label(where, data["ordinate_axis_units_lab"], labels, quantity)
    _check_label(where, data["orddenom_axis_units_lab"], _FORCE_LABELS, "a force")
    abscissa = _plain_label(data["abscissa_axis_units_lab"])
    if data["abscissa_spec_data_type"] not in _FREQUENCY or abscissa not in ("", "none", "hz"):
        raise FileError(f"{where} is not over frequency in Hz; export it that way.")
    if not {"x", "data"} <= data.keys():
        raise FileError(f"{where} has no numbers that can be read; export it again.")
    x, y = np.asarray(data["x"], dtype=np.float64), np.asarray(data["data"])
    if {len(x), len(y)} != {n := data["num_pts"]}:
        raise FileError(f"{where} has {len(y)} lines instead of {n}; export it again.")
    if y.dtype.kind != "c":
        raise FileError(f"{where} is not complex; export real and imaginary parts.")
    if power and len(x) and x[0] == 0.0:
        x, y = x[1:], y[1:]
    with np.errstate(all="ignore"):  # what is not finite is reported later
        return x, y / (2j * np.pi * x) ** power


def _check_label(where: str, label: str, allowed: Sequence[str], what: str) -> None:
    """Raise an error if a label names a unit that is not the SI unit of the quantity."""
    # A function per newton may be labelled as 1/N times a unit.
    if re.sub("^1/n(?=.)", "", _plain_label(label)).split("/n")[0] not in ("", "none", *allowed):
        problem = f"{where} has the unit {label.strip()!r}, not the SI unit of {what}"
        raise FileError(f"{problem}; export it in SI.")


def _plain_label(label: str) -> str:
    return re.sub(r"[\s^*().\[\]·-]", "", label.lower().replace("²", "2"))


def _check_values(frfs: Frfs) -> None:
    """Raise an error unless frequencies ascend and all values are finite."""
    f = frfs.frequencies
    if len(f) < 2:
        raise FileError(f"has {len(f)} frequencies; give 2 or more.")
    if not ((f >= 0.0) & (f < 1e9)).all():
        raise FileError("has frequencies below 0 or above 1 GHz; give them in Hz.")
    if (np.diff(f) <= 0.0).any():
        k = int(np.argmax(np.diff(f) <= 0.0))
        raise FileError(f"has {f[k + 1]:g} Hz after {f[k]:g} Hz; sort the frequencies.")
    finite = (np.abs(frfs.frf.real) < _FINITE) & (np.abs(frfs.frf.imag) < _FINITE)
    wrong = np.argwhere(~finite)
    if len(wrong):
        k, i, j = wrong[0]
        problem = f"the FRF of {name_frf(frfs.dofs[i], frfs.dofs[j])} is not finite at {f[k]:g} Hz"
        raise FileError(f"{problem}; remove that line from all FRFs.")
