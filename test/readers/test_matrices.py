# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Matrices of every layout are read alike, and invalid ones give a clear error."""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from linkage_vibration.mechanics.bodies.beam import element_matrices
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.description import Material
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.reduction import craig_bampton
from linkage_vibration.mechanics.sections.rectangle import rectangle
from linkage_vibration.readers import component_files
from linkage_vibration.readers.component_files import ComponentFileError
from linkage_vibration.readers.matrices import read_matrices

FloatArray = NDArray[np.float64]
ENDS = ["A x", "A z", "A theta", "B x", "B z", "B theta"]
PINS = [InterfaceDof("A", "x"), InterfaceDof("A", "z"), InterfaceDof("B", "x")]
PINS += [InterfaceDof("B", "z")]


def bar(elements: int = 8, free: tuple[str, ...] = ("A theta", "B theta")) -> dict[str, Any]:
    """Return the free 27 by 27 matrices of a steel bar of 9.4 kg, with shuffled rows.

    The rows of free DoFs have no names.
    """
    n = 3 * elements + 3
    mass, stiffness = np.zeros((n, n)), np.zeros((n, n))
    section, steel = rectangle(0.03, 0.05, 0.3), Material(210e9, 7800.0, 0.3)
    for e in range(elements):
        at = slice(3 * e, 3 * e + 6)
        m, k = element_matrices(0.8 / elements, section, steel)
        mass[at, at] += m
        stiffness[at, at] += k
    ends = ["-" if name in free else name for name in ENDS]
    names = [*ends[:3], *["-"] * (n - 6), *ends[3:]]
    order = np.random.default_rng(3).permutation(n)
    mass, stiffness = mass[np.ix_(order, order)], stiffness[np.ix_(order, order)]
    return {
        "mass": mass,
        "stiffness": stiffness,
        "damping": 2.0 * mass + 1e-5 * stiffness,
        "dofs": [names[i] for i in order],
    }


def dense_npz(folder: Path, content: dict[str, Any]) -> Path:
    """Write plain arrays."""
    path = folder / "bar.npz"
    np.savez(path, **{name: np.array(value) for name, value in content.items()})
    return path


def frequencies(body: Matrices) -> FloatArray:
    """Return natural frequencies of the free body, Hz."""
    values = eigh(body.stiffness, body.mass, eigvals_only=True)
    return np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi)


def test_order(tmp_path: Path) -> None:
    """The matrices are those of the file, with the interface DoFs first."""
    content = bar()
    body = read_matrices(dense_npz(tmp_path, content))
    assert set(body.dofs) == set(PINS)
    first = [i for i, name in enumerate(content["dofs"]) if name != "-"]
    assert [str(dof) for dof in body.dofs] == [content["dofs"][i] for i in first]
    order = first + [i for i in range(27) if i not in first]
    for name in ("mass", "stiffness", "damping"):
        expected = content[name][np.ix_(order, order)]
        scale = np.abs(expected).max()
        np.testing.assert_allclose(getattr(body, name), expected, rtol=0, atol=1e-15 * scale)
        assert (getattr(body, name) == getattr(body, name).T).all()


def test_damping_may_be_left_out(tmp_path: Path) -> None:
    """Missing damping is None, and all named DoFs are the default."""
    content = bar()
    del content["damping"]
    body = read_matrices(dense_npz(tmp_path, content))
    assert body.damping is None
    assert [str(dof) for dof in body.dofs] == [name for name in content["dofs"] if name != "-"]


def test_reduced_matrices_and_short_lists(tmp_path: Path) -> None:
    """Modal coordinates are inner ones, and dofs may end after the last name."""
    whole = read_matrices(dense_npz(tmp_path, bar()))
    reduction = craig_bampton(whole.mass, whole.stiffness, 4, 5)
    content = {
        "mass": reduction.mass,
        "stiffness": reduction.stiffness,
        "dofs": [str(dof) for dof in whole.dofs],
    }
    body = read_matrices(dense_npz(tmp_path, content))
    assert body.mass.shape == (9, 9)
    np.testing.assert_array_equal(body.stiffness, reduction.stiffness)


@pytest.mark.parametrize("frequency", [0.0999, 0.1001])
def test_rounding_where_a_component_has_no_stiffness(tmp_path: Path, frequency: float) -> None:
    """A bar between pins resists no lateral motion; a spring of less than 0.1 Hz is rounding."""
    whole = read_matrices(dense_npz(tmp_path, bar()))
    reduction = craig_bampton(whole.mass, whole.stiffness, 4, 5)
    lateral = [i for i, dof in enumerate(whole.dofs) if dof.direction == "z"]
    moved = reduction.mass.diagonal()[lateral].sum()
    stiffness = reduction.stiffness.copy()
    stiffness[np.ix_(lateral, lateral)] = 0.0
    stiffness[lateral[0], lateral[0]] = (2.0 * np.pi * frequency) ** 2 * moved
    names = [str(dof) for dof in whole.dofs]
    path = dense_npz(tmp_path, {"mass": reduction.mass, "stiffness": stiffness, "dofs": names})
    if frequency < 0.1:
        assert read_matrices(path).dofs == whole.dofs
    else:
        with pytest.raises(ComponentFileError, match="resists a translation along z"):
            read_matrices(path)


def change(name: str, to: Callable[[Any], Any]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return a function that changes one of the arrays."""
    return lambda content: {**content, name: to(content[name])}


def without(name: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return a function that removes one of the arrays."""
    return lambda content: {key: content[key] for key in content if key != name}


def entry(row: str, column: str, factor: float) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return a function that multiplies one entry of the stiffness."""

    def spoil(content: dict[str, Any]) -> dict[str, Any]:
        stiffness = content["stiffness"].copy()
        stiffness[content["dofs"].index(row), content["dofs"].index(column)] *= factor
        return {**content, "stiffness": stiffness}

    return spoil


def nothing_moves(content: dict[str, Any]) -> dict[str, Any]:
    """Remove the inertia of one row."""
    mass = content["mass"].copy()
    row = content["dofs"].index("B z")
    mass[row] = mass[:, row] = 0.0
    return {**content, "mass": mass}


def six_digits(matrix: FloatArray) -> FloatArray:
    """Round as a short number format does."""
    return np.array([[float(f"{number:.5e}") for number in row] for row in matrix])


BAD = {
    "DoF twice": (
        change("dofs", lambda names: ["A x" if name == "B x" else name for name in names]),
        r"entries \d+ and \d+ of dofs are both A x",
    ),
    "DoF misspelt": (
        change("dofs", lambda names: ["B q" if name == "B z" else name for name in names]),
        r"entry \d+ of dofs is 'B q'; write a point and one of x, y, z, theta",
    ),
    "DoFs not named": (without("dofs"), "has no dofs"),
    "too many DoFs": (
        change("dofs", lambda names: [*names, "-"]),
        "has 28 entries in dofs for 27 rows",
    ),
    "no stiffness": (without("stiffness"), "has no stiffness"),
    "unknown array": (
        lambda content: {**content, "Damping": content["damping"]},
        "holds 'Damping', which is unknown; use only dofs, mass",
    ),
    "unequal sizes": (
        change("stiffness", lambda k: k[:26, :26]),
        "stiffness is 26 by 26, but mass is 27 by 27",
    ),
    "not square": (change("mass", lambda m: m[:26]), "mass is 26 by 27; write a square matrix"),
    "complex": (change("stiffness", lambda k: k * (1 + 0.01j)), "stiffness is complex; write real"),
    "not finite": (entry("A x", "A x", np.nan), "stiffness is not finite at A x, A x"),
    "not symmetric": (
        change(
            "stiffness",
            lambda k: k + 1.3e-6 * np.eye(27, k=1) * np.outer(d := np.sqrt(np.diag(k)), d),
        ),
        r"stiffness is not symmetric: .* at .*, .* differ by 1\.3e-06 of",
    ),
    "too large": (
        lambda content: {**content, **dict.fromkeys(("mass", "stiffness"), np.eye(3001))},
        "mass has 3001 rows, more than 3000; reduce the component",
    ),
    "massless": (nothing_moves, "mass is not positive definite at B z; remove massless"),
    "negative stiffness": (
        entry("B x", "B x", -1.0),
        "stiffness is not positive semi-definite at B x; look for a wrong sign",
    ),
    "too few digits": (
        change("stiffness", six_digits),
        r"stiffness is not positive semi-definite .* write every digit \(%\.17g\)",
    ),
    "negative damping": (change("damping", lambda c: -c), "damping is not positive semi-definite"),
}


def test_free_rotations_at_pins(tmp_path: Path) -> None:
    """A row without a name stays free: the bar keeps its three rigid motions."""
    body = read_matrices(dense_npz(tmp_path, bar()))
    actual = frequencies(body)
    assert (actual[:3] < 0.01).all()
    assert actual[3] > 300.0


def test_planar_model_holds_y(tmp_path: Path) -> None:
    """Rows named y are held."""
    content = bar(free=())
    names = {"A theta": "A y", "B theta": "B y"}  # any rows will do
    content["dofs"] = [names.get(name, name) for name in content["dofs"]]
    path = dense_npz(tmp_path, content)
    free_rows = [i for i, name in enumerate(content["dofs"]) if not name.endswith("y")]
    body = read_matrices(path)
    assert set(body.dofs) == set(PINS)
    trace = np.trace(content["mass"][free_rows][:, free_rows])
    assert np.trace(body.mass) == pytest.approx(trace, rel=1e-12)


def test_bombs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that unpacks to more than the limit is refused before it is unpacked."""
    content = bar()
    content["mass"] = np.ones((400, 400))
    path = tmp_path / "bar.npz"
    np.savez_compressed(path, **{name: np.array(value) for name, value in content.items()})
    monkeypatch.setattr(component_files, "MAX_BYTES", 200_000)
    assert path.stat().st_size < 200_000
    with pytest.raises(ComponentFileError, match=r"holds \d+ MiB, more than 0 MiB"):
        read_matrices(path)
    path = dense_npz(tmp_path, bar())
    monkeypatch.setattr(component_files, "MAX_BYTES", path.stat().st_size)
    read_matrices(path)
    monkeypatch.setattr(component_files, "MAX_BYTES", path.stat().st_size - 1)
    with pytest.raises(ComponentFileError, match="holds 0 MiB, more than 0 MiB"):
        read_matrices(path)


def test_claims_that_no_memory_could_hold(tmp_path: Path) -> None:
    """A small file that claims to be huge is refused without using much memory."""
    array = io.BytesIO()
    np.save(array, np.ones((2, 2)))
    with zipfile.ZipFile(tmp_path / "bar.npz", "w") as archive:
        archive.writestr("mass.npy", array.getvalue().replace(b"(2, 2)", b"(2000000, 20000)"))
    with pytest.raises(ComponentFileError, match="damaged or has another format"):
        read_matrices(tmp_path / "bar.npz")
