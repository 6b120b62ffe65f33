# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""FRFs of every layout are read alike, and invalid ones give a clear error."""

import random
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from linkage_vibration.mechanics.bodies.beam import element_matrices
from linkage_vibration.mechanics.description import Material
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.sections.rectangle import rectangle
from linkage_vibration.readers.component_files import ComponentFileError
from linkage_vibration.readers.frfs import read_frfs

pyuff = pytest.importorskip("pyuff", reason="UFF files are written with pyuff (extra uff)")

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

NODES = {11: "A", 22: "B"}
NUMBERS = {"A": 11, "B": 22}
DIRECTIONS = {"x": 1, "z": 3, "theta": -5}
NAMES = ["A x", "A z", "A theta", "B x", "B z"]
ROWS = [0, 1, 2, 24, 25]
DOFS = tuple(InterfaceDof(*name.split()) for name in NAMES)
FREQUENCIES = np.linspace(0.0, 500.0, 51)
LABELS = {8: ("m", 0), 11: ("m/s", 1), 12: ("m/s^2", 2)}


def receptance(frequencies: FloatArray) -> ComplexArray:
    """Return the receptance of a free, damped steel bar of 0.8 m, (n_freq, 5, 5)."""
    mass, stiffness = np.zeros((27, 27)), np.zeros((27, 27))
    section, steel = rectangle(0.03, 0.05, 0.3), Material(210e9, 7800.0, 0.3)
    for e in range(8):
        at = slice(3 * e, 3 * e + 6)
        m, k = element_matrices(0.1, section, steel)
        mass[at, at] += m
        stiffness[at, at] += k
    omega = 2.0 * np.pi * frequencies[:, None, None]
    damping = 2.0 * mass + 1e-5 * stiffness
    inverse = np.linalg.inv(stiffness - omega**2 * mass + 1j * omega * damping)
    return np.asarray(inverse[:, ROWS][:, :, ROWS])


@pytest.fixture(scope="module")
def expected() -> ComplexArray:
    """Return the receptance at all frequencies but zero."""
    return receptance(FREQUENCIES[1:])


def npz(folder: Path, **changes: Any) -> Path:
    """Write the bar as ``.npz``, with some arrays changed."""
    content = {
        "frequencies": FREQUENCIES[1:],
        "frf": receptance(FREQUENCIES[1:]),
        "dofs": np.array(NAMES),
        **changes,
    }
    path = folder / "bar.npz"
    np.savez(path, **{name: array for name, array in content.items() if array is not None})
    return path


def functions(quantity: int = 12, turned: tuple[str, ...] = ()) -> list[dict[str, Any]]:
    """Return the bar as data sets 58, with a line at 0 Hz unless they are displacements."""
    label, power = LABELS[quantity]
    f = FREQUENCIES if power else FREQUENCIES[1:]
    frf = np.zeros((len(f), 5, 5), dtype=complex)
    frf[-50:] = receptance(FREQUENCIES[1:])
    actual = []
    for i, response in enumerate(NAMES):
        for j, reference in enumerate(NAMES):
            signs = [-1 if name in turned else 1 for name in (response, reference)]
            ends = [name.split() for name in (response, reference)]
            actual.append(
                {
                    "type": 58,
                    "func_type": 4,
                    "rsp_node": NUMBERS[ends[0][0]],
                    "rsp_dir": signs[0] * DIRECTIONS[ends[0][1]],
                    "ref_node": NUMBERS[ends[1][0]],
                    "ref_dir": signs[1] * DIRECTIONS[ends[1][1]],
                    "x": f,
                    "data": signs[0] * signs[1] * frf[:, i, j] * (2j * np.pi * f) ** power,
                    "abscissa_spacing": 1,
                    "abscissa_spec_data_type": 18,
                    "abscissa_axis_units_lab": "Hz",
                    "ordinate_spec_data_type": quantity,
                    "ordinate_axis_units_lab": label,
                    "orddenom_spec_data_type": 13,
                    "orddenom_axis_units_lab": "N",
                }
            )
    return actual


def uff(folder: Path, sets: list[dict[str, Any]], *, double: bool = True) -> Path:
    """Write data sets with pyuff."""
    path = folder / "bar.uff"
    path.unlink(missing_ok=True)
    file = pyuff.UFF(str(path))
    for data_set in sets:
        if not double:
            data_set["ord_data_type"] = 5
        file.write_sets(data_set, "add", force_double=double)
    return path


def units(**changes: Any) -> dict[str, Any]:
    """Return a data set 164, SI unless changed."""
    return {
        "type": 164,
        "units_code": 1,
        "units_description": "SI",
        "temp_mode": 1,
        "length": 1.0,
        "force": 1.0,
        "temp": 1.0,
        "temp_offset": 273.15,
        **changes,
    }


def assert_bar(path: Path, expected: ComplexArray, tolerance: float = 1e-9) -> None:
    """Check that a file holds the bar."""
    frfs = read_frfs(path, NODES)
    assert set(frfs.dofs) == set(DOFS)
    order = [frfs.dofs.index(dof) for dof in DOFS]
    np.testing.assert_allclose(frfs.frequencies, FREQUENCIES[1:], rtol=1e-9)
    error = (
        np.abs(frfs.frf[:, order][:, :, order] - expected).max(axis=0)
        / np.abs(expected).max(axis=0).max()
    )
    assert error.max() < tolerance


def test_npz(tmp_path: Path, expected: ComplexArray) -> None:
    """The DoFs are returned unchanged and in order."""
    path = npz(tmp_path)
    assert_bar(path, expected)
    assert read_frfs(path).dofs == DOFS
    np.testing.assert_array_equal(read_frfs(path).frf, expected)


@pytest.mark.parametrize("quantity", LABELS)
def test_uff_of_every_quantity(tmp_path: Path, expected: ComplexArray, quantity: int) -> None:
    """Displacement, velocity and acceleration give one receptance, without a line at 0 Hz."""
    assert_bar(uff(tmp_path, [units(), *functions(quantity)]), expected)


@pytest.mark.parametrize("label", ["(1/N)*(m/s^2)", "(m/s^2)/N", "m/s/s", ""])
def test_unit_labels(tmp_path: Path, expected: ComplexArray, label: str) -> None:
    """The ways in which programs write the SI unit of an acceleration per force are read."""
    sets = [{**data, "ordinate_axis_units_lab": label} for data in functions()]
    own = units(units_code=9, length=1.0000008, force=0.9999992)  # SI but for digits
    assert_bar(uff(tmp_path, [own, *sets]), expected)


@pytest.mark.parametrize("kind", ["single", "binary", "uneven"])
def test_uff_of_every_number_format(tmp_path: Path, expected: ComplexArray, kind: str) -> None:
    """Single precision, binary numbers and an uneven abscissa are read alike."""
    sets = functions()
    for data_set in sets:
        data_set["binary"] = int(kind == "binary")
        data_set["abscissa_spacing"] = int(kind != "uneven")
    path = uff(tmp_path, sets, double=kind != "single")
    assert_bar(path, expected, 2e-6 if kind == "single" else 1e-9)


def check_odd_uff(folder: Path, expected: ComplexArray, seed: int) -> None:
    """Write a bar in a random but valid way, and compare it with the closed form."""
    rng = random.Random(seed)
    sets = functions(rng.choice([*LABELS]), tuple(rng.sample(NAMES, rng.randrange(len(NAMES)))))
    accelerations = ["m/s^2", "(1/N)*(m/s^2)", "(m/s^2)/N", "m/s/s", "NONE", ""]
    # Of single precision in binary, pyuff reads back twice the lines that it has written.
    double, binary = rng.choice([(True, 0), (True, 1), (False, 0)])
    for each in sets:
        if each["ordinate_spec_data_type"] == 12:
            each["ordinate_axis_units_lab"] = rng.choice(accelerations)
        each |= {"binary": binary, "abscissa_spacing": rng.randrange(2)}
        each["orddenom_axis_units_lab"] = rng.choice(["N", "newton", "NONE", ""])
        each["abscissa_axis_units_lab"] = rng.choice(["Hz", "NONE", ""])
        each["id1"] = "".join(rng.choice("abc -1") for _ in range(rng.randrange(20)))
    rng.shuffle(sets)
    if rng.random() < 0.5:
        sets.insert(rng.randrange(len(sets)), units())
    path = uff(folder, sets, double=double)
    assert len(pyuff.UFF(str(path)).get_set_types()) == len(sets), seed
    assert_bar(path, expected, 1e-9 if double else 2e-6)


@pytest.mark.parametrize(
    "seeds", [range(1, 2), pytest.param(range(300), marks=pytest.mark.nightly)], ids=len
)
def test_odd_uff(tmp_path: Path, expected: ComplexArray, seeds: range) -> None:
    """Files that differ in all that UFF permits give the closed form."""
    for seed in seeds:
        check_odd_uff(tmp_path, expected, seed)


def test_negative_directions(tmp_path: Path, expected: ComplexArray) -> None:
    """An accelerometer or a hammer that points backwards only changes the sign."""
    assert_bar(uff(tmp_path, functions(turned=("A z", "B x", "A theta"))), expected)


def test_reciprocity_fills_in(tmp_path: Path, expected: ComplexArray) -> None:
    """One triangle of the matrix is enough; other nodes and other functions are ignored."""
    half = [data for k, data in enumerate(functions()) if k // 5 <= k % 5]
    other = {**half[0], "rsp_node": 99}
    coherence = {**half[0], "func_type": 6}
    assert_bar(uff(tmp_path, [*half, other, coherence]), expected)


def first(**changes: Any) -> list[dict[str, Any]]:
    """Return all functions, the first one changed: response and force at A x."""
    actual = functions()
    actual[0].update(changes)
    return actual


def short() -> list[dict[str, Any]]:
    """Return all functions, that of response B x to A z over fewer lines."""
    actual = functions()
    actual[16]["x"], actual[16]["data"] = actual[16]["x"][:40], actual[16]["data"][:40]
    return actual


BAD_UFF: dict[str, tuple[Callable[[], list[dict[str, Any]]], str]] = {
    "no function": (lambda: [units()], r"holds no FRF .* mapped to points \(11: A, 22: B\)"),
    "DoF missing": (
        lambda: [data for data in functions() if (data["rsp_node"], data["rsp_dir"]) != (22, 3)],
        "has no FRF of response B z to a force at B z, nor the reverse; measure one",
    ),
    "twice": (
        lambda: [*functions(), functions()[1]],
        "has the FRF of response A x to a force at A z twice",
    ),
    "unequal frequencies": (short, r"response B x to a force at A z has other frequencies than"),
    "millimetres by label": (
        lambda: first(ordinate_axis_units_lab="mm/s^2"),
        r"response A x to a force at A x has the unit 'mm/s\^2', not the SI unit of an accel",
    ),
    "acceleration of gravity": (
        lambda: first(ordinate_axis_units_lab="g/N"),
        "the unit 'g/N', not the SI unit of an acceleration",
    ),
    "millimetres by a label that begins with 1/N": (
        lambda: first(ordinate_axis_units_lab="(1/N)*(mm/s^2)"),
        r"has the unit '\(1/N\)\*\(mm/s\^2\)', not the SI unit of an acceleration",
    ),
    "label of another quantity": (
        lambda: first(ordinate_axis_units_lab="m"),
        "the unit 'm', not the SI unit of an acceleration",
    ),
    "kilonewtons": (
        lambda: first(orddenom_axis_units_lab="kN"),
        "the unit 'kN', not the SI unit of a f",
    ),
    "millimetres by system": (
        lambda: [units(units_code=5, length=1000.0, force=1000.0), *functions()],
        r"units of mm in data set 164 \(code 5, length factor 1000, .*export it in SI",
    ),
    "length nearly in metres": (
        lambda: [units(units_code=9, length=1.000002), *functions()],
        "has units of its own in data set 164",
    ),
    "force nearly in newtons": (
        lambda: [units(units_code=9, force=0.999998), *functions()],
        "has units of its own in data set 164",
    ),
    "quantity unknown": (
        lambda: first(ordinate_spec_data_type=0),
        r"has the ordinate data type 0; export it as displacement",
    ),
    "not per force": (lambda: first(orddenom_spec_data_type=8), "per excitation force"),
    "over time": (lambda: first(abscissa_spec_data_type=17), "is not over frequency in Hz"),
    "real": (lambda: first(data=np.ones(51)), "is not complex; export real and imaginary"),
    "exp(-i omega t)": (
        lambda: [{**data, "data": data["data"].conj()} for data in functions()],
        r"A z, .*B z gives out power, .* exp\(-i omega t\) \(take the complex",
    ),
    "one gain wrong": (
        lambda: [
            {**d, "data": 1.3 * d["data"]} if ends(d) == ["B x", "A x"] else d for d in functions()
        ],
        "response B x to a force at A x and its reverse differ by 26 % on average",
    ),
    "one sign wrong": (
        lambda: [{**d, "data": -d["data"]} if k == 9 else d for k, d in enumerate(functions())],
        "response B z to a force at A z and its reverse are unrelated",
    ),
}


def ends(data: dict[str, Any]) -> list[str]:
    """Name the response and the reference of a function."""
    names = {number: name for name, number in NUMBERS.items()}
    directions = {number: name for name, number in DIRECTIONS.items()}
    return [f"{names[data[e + '_node']]} {directions[data[e + '_dir']]}" for e in ("rsp", "ref")]


def spoilt(at: tuple[int, ...], value: complex) -> ComplexArray:
    """Return the receptance with one number changed."""
    frf = receptance(FREQUENCIES[1:])
    frf[at] = value
    return frf


OMEGA = 2.0 * np.pi * FREQUENCIES[1:, None, None]
BAD_NPZ: dict[str, tuple[dict[str, Any], str]] = {
    "missing": ({"dofs": None}, "has no dofs; add it"),
    "not ascending": (
        {"frequencies": np.array([*FREQUENCIES[1:50], 490.0])},
        "has 490 Hz after 490 Hz; sort",
    ),
    "negative frequencies": (
        {"frequencies": FREQUENCIES[1:] - 20.0},
        "below 0 or above 1 GHz; give them in",
    ),
    "not finite": (
        {"frf": spoilt((3, 4, 1), np.nan)},
        "response B z to a force at A z is not finite at 40 Hz; remove that line",
    ),
    "not square": (
        {"frf": receptance(FREQUENCIES[1:])[:, :, :4]},
        "frf of 50 by 5 by 4; write one of 50 by 5 by 5",
    ),
    "real": ({"frf": receptance(FREQUENCIES[1:]).real}, "has a real frf; give complex receptance"),
    "millimetres": (
        {"frf": 1e3 * receptance(FREQUENCIES[1:])},
        r"at A x belongs to a mass of 0\.00\d+ kg, .* if it is in mm/N or um/N, an acceler",
    ),
    "accelerance": (
        {"frf": -(OMEGA**2) * receptance(FREQUENCIES[1:])},
        r"belongs to a mass of .* convert it to m/N over Hz if it is in .*, an acceleration",
    ),
    "mobility": ({"frf": 1j * OMEGA * receptance(FREQUENCIES[1:])}, "belongs to a mass of"),
    "one line": (
        {"frequencies": FREQUENCIES[1:2], "frf": receptance(FREQUENCIES[1:2])},
        "has 1 frequencies; give 2 or more",
    ),
}


def test_noise_passes(tmp_path: Path) -> None:
    """Noise of 5 % of the drive points is accepted, even if x and z are not coupled."""
    rng = np.random.default_rng(2)
    accelerance = OMEGA**2 * receptance(FREQUENCIES[1:])
    drive = np.sqrt(np.abs(np.einsum("fii->fi", accelerance)).mean(axis=0))
    noise = rng.normal(size=(2, *accelerance.shape)) * 0.05 * np.outer(drive, drive)
    frf = (accelerance + noise[0] + 1j * noise[1]) / OMEGA**2
    assert read_frfs(npz(tmp_path, frf=frf)).frf.shape == (50, 5, 5)


def test_missing_pyuff(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error says how to install pyuff."""
    monkeypatch.setitem(sys.modules, "pyuff", None)
    with pytest.raises(ComponentFileError, match=r"pip install linkage_vibration\[uff\]"):
        read_frfs(tmp_path / "bar.uff")
