# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Components from measured or computed FRFs: UFF 58 and ``.npz``.

``.npz``
    ``frequencies`` (n_freq,) in Hz, ``frf`` (n_freq, n, n), complex receptance with the response
    along the rows and the force along the columns, and ``dofs``, n texts such as ``P1 x`` (see
    `matrices`). SI: m/N, rad/N, m/(N m), rad/(N m).
UFF
    All functions of type 4 (FRF) in data sets 58, text or binary, whose response and reference
    nodes are mapped to points. Directions 1, 2, 3 are x, y, z of the component, 5 is rotation about
    y; theta turns x towards z, which is the negative of it. A negative direction turns the sign.
    Displacement, velocity and acceleration are told by the ordinate's type and become receptance by
    1/(i omega)^n; a line at 0 Hz is left out where that divides by zero. Where H_ij alone was
    measured, H_ji is filled in by reciprocity.

FRFs of time dependence exp(i omega t) are meant, as analysers make them.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.readers.component_files import (
    ComponentFileError,
    check_file,
    choose_rows,
    damaged,
    load_npz,
    parse_dofs,
)

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_UFF = (".uff", ".unv")
_FRF = 4  # function type
_DIRECTIONS = {1: ("x", 1.0), 2: ("y", 1.0), 3: ("z", 1.0), 5: ("theta", -1.0)}
# Power of i omega in the response, by the specific data type of the ordinate.
_POWERS = {8: 0, 11: 1, 12: 2}
_QUANTITIES = {8: "a displacement", 11: "a velocity", 12: "an acceleration"}
_RESPONSE_LABELS = {
    8: ("m", "rad"),
    11: ("m/s", "rad/s"),
    12: ("m/s2", "m/s/s", "m/sec2", "rad/s2", "rad/s/s", "rad/sec2"),
}
_FORCES = (9, 13)  # reaction, excitation
_FORCE_LABELS = ("n", "nm", "newton")
_FREQUENCY = (0, 18)  # unknown, frequency
_UNITS = {2: "feet", 3: "kilograms force", 4: "feet", 5: "mm", 6: "cm", 7: "inches", 8: "mm"}

_RECIPROCITY = 0.8  # |H_ij - H_ji| / |H_ij + H_ji|; 1 where they have nothing in common
_FINITE = 1e100  # m/N; the square of what is larger is infinite
_ACTIVE = 0.05  # of a drive point's accelerance: power that comes out rather than goes in
_COUPLED = 0.2  # of the two drive points; less than that may be all noise
_UNEQUAL = 0.1  # by which H_ij and H_ji may differ on the mean of all lines, where noise goes out
_MASSES = (0.02, 1e6)  # kg, between which a part's apparent mass lies at most frequencies


@dataclass(frozen=True, slots=True)
class _Function:
    """One measured function as receptance, signs applied."""

    response: InterfaceDof
    reference: InterfaceDof
    frequencies: FloatArray
    values: ComplexArray


def read_frfs(
    path: Path,
    dofs: Sequence[InterfaceDof] | None = None,
    nodes: Mapping[int, str] | None = None,
) -> Frfs:
    """Read and check the receptances of a component.

    Parameters
    ----------
    path : Path
        ``.npz``, or ``.uff`` or ``.unv``; the module tells the layouts.
    dofs : sequence of InterfaceDof, optional
        The interface DoFs, in the order wanted; all that the file has by default. Others of the
        file are left out: they are free.
    nodes : mapping of int to str, optional
        The point of each node of a UFF file; nodes that are not in it are left out.

    Raises
    ------
    ComponentFileError
        If the file is missing, damaged or too large, or pyuff is missing; if a DoF is missing, or
        a function between two of them; if frequencies differ or do not ascend; if a value is not
        finite; if the units are not SI, or cannot be; if H_ij and H_ji differ.
    """
    if path.suffix.lower() == ".npz":
        frfs = _read_npz(path, dofs)
    elif path.suffix.lower() in _UFF:
        frfs = _read_uff(path, dofs, nodes or {})
    else:
        raise ComponentFileError(path, "is no file of FRFs; give a .npz, .uff or .unv.")
    _check_values(path, frfs)
    _check_physics(path, frfs)
    return frfs


def _read_npz(path: Path, wanted: Sequence[InterfaceDof] | None) -> Frfs:
    known = ("frequencies", "frf", "dofs")
    arrays = load_npz(path, known)
    for name in known:
        if name not in arrays:
            raise ComponentFileError(path, f"holds no {name}; add it.")
    frequencies, frf = arrays["frequencies"], arrays["frf"]
    if frequencies.ndim != 1 or frequencies.dtype.kind not in "fiu":
        raise ComponentFileError(path, "frequencies is no list of real numbers, in Hz.")
    if frf.dtype.kind != "c":
        raise ComponentFileError(path, "frf is not complex; give receptance, m/N.")
    found = parse_dofs(path, np.ravel(arrays["dofs"]).tolist())
    if frf.shape != (len(frequencies), len(found), len(found)):
        raise ComponentFileError(
            path,
            f"frf is {' by '.join(map(str, frf.shape))}; {len(frequencies)} frequencies and "
            f"{len(found)} dofs need {len(frequencies)} by {len(found)} by {len(found)}.",
        )
    dofs, rows = choose_rows(path, found, wanted)
    chosen = frf[:, rows][:, :, rows].astype(np.complex128)
    return Frfs(dofs, frequencies.astype(np.float64), chosen)


def _read_uff(path: Path, wanted: Sequence[InterfaceDof] | None, nodes: Mapping[int, str]) -> Frfs:
    functions: dict[tuple[InterfaceDof, InterfaceDof], _Function] = {}
    for data_set in _data_sets(path):
        if data_set["type"] == 164:
            _check_system(path, data_set)
            continue
        function = _function(path, data_set, nodes)
        if function is None or not _asked(function, wanted):
            continue
        pair = (function.response, function.reference)
        if pair in functions:
            raise ComponentFileError(
                path, f"holds the FRF of {_pair(*pair)} twice; keep one of them."
            )
        functions[pair] = function
    found = list(dict.fromkeys(dof for pair in functions for dof in pair))
    if not found:
        raise ComponentFileError(
            path,
            "holds no FRF (function type 4) between nodes that are mapped to points "
            f"({', '.join(f'{node}: {point}' for node, point in nodes.items()) or 'none'}).",
        )
    dofs, _ = choose_rows(path, found, wanted)
    first = next(iter(functions.values()))
    for pair, function in functions.items():
        if len(function.frequencies) != len(first.frequencies) or not np.allclose(
            function.frequencies, first.frequencies, rtol=1e-5, atol=0.0
        ):
            raise ComponentFileError(
                path,
                f"the FRF of {_pair(*pair)} has other frequencies ({_axis(function)}) than that of "
                f"{_pair(first.response, first.reference)} ({_axis(first)}); measure or resample "
                "them alike.",
            )
    frf = np.empty((len(first.frequencies), len(dofs), len(dofs)), dtype=np.complex128)
    for i, response in enumerate(dofs):
        for j, reference in enumerate(dofs):
            there = functions.get((response, reference)) or functions.get((reference, response))
            if there is None:
                raise ComponentFileError(
                    path,
                    f"holds no FRF of {_pair(response, reference)}, nor the other way round; "
                    "measure it.",
                )
            frf[:, i, j] = there.values
    return Frfs(dofs, first.frequencies, frf)


def _data_sets(path: Path) -> list[dict[str, Any]]:
    """Return the data sets 58 and 164 of a UFF file."""
    try:
        import pyuff
    except ImportError:
        raise ComponentFileError(
            path, "needs pyuff; `pip install linkage_vibration[uff]`."
        ) from None
    check_file(path)
    try:
        file = pyuff.UFF(str(path))
        types = [int(kind) for kind in file.get_set_types()]
        with np.errstate(all="ignore"):  # infinite numbers are refused later
            return [file.read_sets(i) for i, kind in enumerate(types) if kind in (58, 164)]
    except Exception as error:  # pyuff raises plain exceptions
        raise damaged(path, error) from None


def _check_system(path: Path, units: Mapping[str, Any]) -> None:
    """Refuse a data set 164 of other units than SI; its factors divide values to make them SI."""
    code = units["units_code"]
    if code in _UNITS or abs(units["length"] - 1.0) > 1e-6 or abs(units["force"] - 1.0) > 1e-6:
        raise ComponentFileError(
            path,
            f"its data set 164 tells units of {_UNITS.get(code, 'its own')} (code {code}, length "
            f"factor {units['length']:g}, force factor {units['force']:g}); export it in SI.",
        )


def _function(path: Path, data: Mapping[str, Any], nodes: Mapping[int, str]) -> _Function | None:
    """Return a data set 58 as receptance, or None if it is no FRF between mapped DoFs."""
    if data["func_type"] != _FRF:
        return None
    ends = []
    sign = 1.0
    for end in ("rsp", "ref"):
        node, direction = data[f"{end}_node"], data[f"{end}_dir"]
        if node not in nodes or abs(direction) not in _DIRECTIONS:
            return None
        name, positive = _DIRECTIONS[abs(direction)]
        sign *= math.copysign(positive, positive * direction)
        ends.append(InterfaceDof(nodes[node], name))
    response, reference = ends
    where = f"the FRF of {_pair(response, reference)}"

    kind = data["ordinate_spec_data_type"]
    if kind not in _POWERS:
        raise ComponentFileError(
            path,
            f"{where} does not tell what it measures (ordinate data type {kind}); 8 is "
            "displacement, 11 velocity, 12 acceleration.",
        )
    if data["orddenom_spec_data_type"] not in _FORCES:
        raise ComponentFileError(
            path,
            f"{where} is not per force (ordinate denominator data type "
            f"{data['orddenom_spec_data_type']}, where 13 is excitation force).",
        )
    _check_label(path, where, data["ordinate_axis_units_lab"], _RESPONSE_LABELS[kind], kind)
    _check_label(path, where, data["orddenom_axis_units_lab"], _FORCE_LABELS, None)
    abscissa = _plain_label(data["abscissa_axis_units_lab"])
    if data["abscissa_spec_data_type"] not in _FREQUENCY or abscissa not in ("", "none", "hz"):
        raise ComponentFileError(path, f"{where} is not over frequency in Hz; export it so.")

    if "x" not in data or "data" not in data:
        raise ComponentFileError(path, f"{where} holds numbers of no known kind; export it again.")
    x, y = np.asarray(data["x"], dtype=np.float64), np.asarray(data["data"])
    if len(x) != data["num_pts"] or len(y) != data["num_pts"]:
        raise ComponentFileError(
            path, f"{where} tells {data['num_pts']} lines but holds {len(y)}; export it again."
        )
    if y.dtype.kind != "c":
        raise ComponentFileError(path, f"{where} is not complex; export real and imaginary parts.")
    power = _POWERS[kind]
    if power and len(x) and x[0] == 0.0:
        x, y = x[1:], y[1:]
    with np.errstate(all="ignore"):
        values = sign * y / (2j * np.pi * x) ** power
    return _Function(response, reference, x, values)


def _check_label(
    path: Path, where: str, label: str, allowed: Sequence[str], kind: int | None
) -> None:
    """Refuse a label of units that are not SI, or are those of another quantity."""
    plain = _plain_label(label)
    numerator = plain.split("/n")[0] if kind is not None else plain
    if numerator not in ("", "none", *allowed):
        what = "a force" if kind is None else _QUANTITIES[kind]
        raise ComponentFileError(
            path, f"{where} is labelled {label.strip()!r}, no SI unit of {what}; export it in SI."
        )


def _plain_label(label: str) -> str:
    return re.sub(r"[\s^*().\[\]·-]", "", label.lower().replace("²", "2"))


def _asked(function: _Function, wanted: Sequence[InterfaceDof] | None) -> bool:
    return wanted is None or (function.response in wanted and function.reference in wanted)


def _check_values(path: Path, frfs: Frfs) -> None:
    """Refuse frequencies that do not ascend from 0 up, and values that are not finite."""
    f = frfs.frequencies
    if len(f) < 2:
        raise ComponentFileError(path, f"holds {len(f)} frequencies; 2 at least are needed.")
    if not ((f >= 0.0) & (f < 1e9)).all():
        raise ComponentFileError(path, "has frequencies that are negative or cannot be in Hz.")
    if (np.diff(f) <= 0.0).any():
        k = int(np.argmax(np.diff(f) <= 0.0))
        raise ComponentFileError(
            path, f"its frequencies do not ascend: {f[k + 1]:g} Hz comes after {f[k]:g} Hz."
        )
    finite = (np.abs(frfs.frf.real) < _FINITE) & (np.abs(frfs.frf.imag) < _FINITE)
    wrong = np.argwhere(~finite)
    if len(wrong):
        k, i, j = wrong[0]
        raise ComponentFileError(
            path,
            f"the FRF of {_pair(frfs.dofs[i], frfs.dofs[j])} is not finite at {f[k]:g} Hz; leave "
            "that line out of all of them.",
        )


def _check_physics(path: Path, frfs: Frfs) -> None:
    """Refuse what no passive part in SI can answer.

    All is judged as accelerance, whose noise is about the same at every frequency.
    """
    omega = 2.0 * np.pi * frfs.frequencies
    accelerance = omega[:, None, None] ** 2 * frfs.frf
    for j, dof in enumerate(frfs.dofs):
        drive = accelerance[:, j, j]
        size = float(np.abs(drive).sum())
        if size == 0.0:
            raise ComponentFileError(path, f"the FRF of {_pair(dof, dof)} is zero; measure it.")
        if float(drive.imag.sum()) > _ACTIVE * size:
            raise ComponentFileError(
                path,
                f"the FRF of {_pair(dof, dof)} gives out power: its imaginary part is positive on "
                "the whole; look for a wrong sign, exp(-i omega t), or a velocity or acceleration "
                "that is given as a displacement.",
            )
        mass = 1.0 / max(float(np.median(np.abs(drive))), 1e-300)
        if dof.direction != "theta" and not _MASSES[0] < mass < _MASSES[1]:
            unit = "mm/N or um/N, or an acceleration" if mass <= _MASSES[0] else "m/kN"
            raise ComponentFileError(
                path,
                f"the FRF of {_pair(dof, dof)} moves as if {mass:.2g} kg were there, which no link "
                f"has; is it in {unit}? Give m/N.",
            )
    sizes = np.linalg.norm(np.diagonal(accelerance, axis1=1, axis2=2), axis=0)
    for i, one in enumerate(frfs.dofs):
        for j, other in enumerate(frfs.dofs[:i]):
            there, back = accelerance[:, i, j], accelerance[:, j, i]
            odd, even = (float(np.linalg.norm(v)) for v in (there - back, there + back))
            noise = _COUPLED * math.sqrt(sizes[i] * sizes[j])
            if odd > max(_RECIPROCITY * even, noise):
                raise ComponentFileError(
                    path,
                    f"the FRFs of {_pair(one, other)} and the other way round have little in "
                    "common, where they should be equal; look for a wrong direction, sign or unit "
                    "in one of them.",
                )
            unequal = 2.0 * abs(np.vdot(there + back, there - back)) / max(even**2, 1e-300)
            if even > noise and unequal > _UNEQUAL:
                raise ComponentFileError(
                    path,
                    f"the FRFs of {_pair(one, other)} and the other way round differ by "
                    f"{100.0 * unequal:.0f} % on the mean, where they should be equal; look for a "
                    "wrong gain of a sensor, or measure them again.",
                )


def _pair(response: InterfaceDof, reference: InterfaceDof) -> str:
    return f"response {response} to a force at {reference}"


def _axis(function: _Function) -> str:
    f = function.frequencies
    return f"{len(f)} lines, {f[0]:g} to {f[-1]:g} Hz" if len(f) else "none"
