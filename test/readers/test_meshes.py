# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Meshed solid bars agree with beams and rigid bodies; invalid meshes give a clear error."""

import itertools
import re
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from linkage_vibration.mechanics.bodies.beam import element_matrices
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.description import Material
from linkage_vibration.mechanics.sections.rectangle import rectangle
from linkage_vibration.readers.component_files import ComponentFileError
from linkage_vibration.readers.meshes import mesh_matrices
from test.readers.conftest import refuse_spoilt

pytest.importorskip("skfem", reason="solids are assembled by scikit-fem (extra fe)")
pytest.importorskip("meshio", reason="meshes are read by meshio (extra fe)")

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int_]

STEEL = Material(210e9, 7800.0, 0.3)
SIZE = (0.8, 0.03, 0.05)  # along x, y, z, m
PINS = {"A": "left", "B": "right"}
POINTS = [("A", (0.0, 0.0)), ("B", (0.8, 0.0))]
EDGES = [(0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)]  # gmsh's order of the nodes between
CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


def write_bar(
    path: Path,
    cells: tuple[int, int, int],
    *,
    order: int = 2,
    version: str = "4.1",
    size: tuple[float, float, float] = SIZE,
    middle: bool = False,
) -> Path:
    """Mesh a bar along x, each brick cut into six tetrahedra about its diagonal.

    Its ends are the surfaces ``left`` and ``right``; ``middle`` names the top of its middle third.
    """
    counts = order * np.array(cells) + 1
    grid = np.array(list(itertools.product(*map(range, counts))))
    nodes = grid / (counts - 1) * size - np.array([0.0, size[1] / 2, size[2] / 2])

    def numbered(corners: list[IntArray]) -> list[int]:
        """Return node numbers of an element, with those between its corners."""
        between = [(corners[a] + corners[b]) // 2 for a, b in EDGES if b < len(corners)]
        if len(corners) == 3:
            between = [between[0], between[1], between[2]]
        places = corners + between if order == 2 else corners
        return [int((i * counts[1] + j) * counts[2] + k) + 1 for i, j, k in places]

    tetrahedra = []
    for cell in itertools.product(*map(range, cells)):
        for path_along in itertools.permutations(range(3)):
            corners = [order * np.array(cell)]
            for axis in path_along:
                corners.append(corners[-1] + order * np.eye(3, dtype=int)[axis])
            if np.linalg.det(np.diff(corners, axis=0)) < 0.0:
                corners[1], corners[2] = corners[2], corners[1]
            tetrahedra.append(numbered(corners))

    def face(axis: int, layer: int, ranges: tuple[range, range]) -> list[list[int]]:
        """Return triangles on a plane of the grid, cut as the bricks are."""
        actual = []
        others = [k for k in range(3) if k != axis]
        for i, j in itertools.product(*ranges):
            square = []
            for a, b in CORNERS:
                place = np.zeros(3, dtype=int)
                place[axis], place[others[0]], place[others[1]] = layer, i + a, j + b
                square.append(order * place)
            actual += [numbered([square[k] for k in corners]) for corners in ((0, 1, 2), (0, 2, 3))]
        return actual

    sides = (range(cells[1]), range(cells[2]))
    surfaces = {"left": face(0, 0, sides), "right": face(0, cells[0], sides)}
    if middle:
        third = range(cells[0] // 3, 2 * cells[0] // 3)
        surfaces["middle"] = face(2, cells[2], (third, range(cells[1])))
    blocks = [(2, tag, triangles) for tag, triangles in enumerate(surfaces.values(), 1)]
    blocks.append((3, len(surfaces) + 1, tetrahedra))
    names = [
        f'{d} {tag} "{name}"' for (d, tag, _), name in zip(blocks, [*surfaces, "bar"], strict=True)
    ]
    write = write_version_2 if version == "2.2" else write_version_4
    head = f"$MeshFormat\n{version} 0 8\n$EndMeshFormat\n$PhysicalNames\n{len(names)}\n"
    names_section = "\n".join(names) + "\n$EndPhysicalNames\n"
    path.write_text(head + names_section + write(nodes, blocks))
    return path


KINDS = {3: 2, 6: 9, 4: 4, 10: 11}  # gmsh's element types by their number of nodes
Blocks = list[tuple[int, int, list[list[int]]]]


def write_version_2(nodes: FloatArray, blocks: Blocks) -> str:
    """Return nodes and elements in version 2.2."""
    lines = [f"$Nodes\n{len(nodes)}"]
    lines += [f"{i} {x:.16g} {y:.16g} {z:.16g}" for i, (x, y, z) in enumerate(nodes, 1)]
    lines.append(f"$EndNodes\n$Elements\n{sum(len(elements) for *_, elements in blocks)}")
    number = itertools.count(1)
    for _, tag, elements in blocks:
        for element in elements:
            corners = " ".join(map(str, element))
            lines.append(f"{next(number)} {KINDS[len(element)]} 2 {tag} {tag} {corners}")
    return "\n".join([*lines, "$EndElements\n"])


def write_version_4(nodes: FloatArray, blocks: Blocks) -> str:
    """Return entities, nodes and elements in version 4.1."""
    surfaces = len(blocks) - 1
    lines = [f"$Entities\n0 0 {surfaces} 1"]
    lines += [f"{tag} 0 0 0 1 1 1 1 {tag} 0" for _, tag, _ in blocks]
    lines.append(f"$EndEntities\n$Nodes\n1 {len(nodes)} 1 {len(nodes)}")
    lines.append(f"3 {len(blocks)} 0 {len(nodes)}")
    lines += [str(i) for i in range(1, len(nodes) + 1)]
    lines += [f"{x:.16g} {y:.16g} {z:.16g}" for x, y, z in nodes]
    total = sum(len(elements) for *_, elements in blocks)
    lines.append(f"$EndNodes\n$Elements\n{len(blocks)} {total} 1 {total}")
    number = itertools.count(1)
    for dimension, tag, elements in blocks:
        lines.append(f"{dimension} {tag} {KINDS[len(elements[0])]} {len(elements)}")
        lines += [f"{next(number)} {' '.join(map(str, element))}" for element in elements]
    return "\n".join([*lines, "$EndElements\n"])


def held(body: Matrices) -> FloatArray:
    """Return natural frequencies with the interface held, Hz."""
    inner = slice(len(body.dofs), None)
    return np.sqrt(np.diag(body.stiffness)[inner]) / (2.0 * np.pi)


def free(body: Matrices) -> FloatArray:
    """Return natural frequencies of the free body, Hz."""
    values = eigh(body.stiffness, body.mass, eigvals_only=True)
    return np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi)


def pinned_beam(width: float, height: float, *, clamped: bool = False) -> FloatArray:
    """Return frequencies of a Timoshenko beam of 64 elements with pins (or clamps) at its ends."""
    mass, stiffness = np.zeros((195, 195)), np.zeros((195, 195))
    for e in range(64):
        at = slice(3 * e, 3 * e + 6)
        m, k = element_matrices(SIZE[0] / 64, rectangle(width, height, 0.3), STEEL)
        mass[at, at] += m
        stiffness[at, at] += k
    inner = slice(3, 192) if clamped else [2, *range(3, 192), 194]
    values = eigh(stiffness[inner][:, inner], mass[inner][:, inner], eigvals_only=True)
    return np.sqrt(values) / (2.0 * np.pi)


def test_bar_is_a_timoshenko_beam(tmp_path: Path) -> None:
    """Five bending and one axial mode agree within 2.5e-3 and 4e-3 (ends that cannot contract)."""
    path = write_bar(tmp_path / "bar.msh", (32, 2, 3))
    actual = held(mesh_matrices(path, STEEL, PINS, POINTS, 6))
    error = actual / pinned_beam(*SIZE[1:])[:6] - 1.0
    axial = 4
    assert (error > 0.0).all()
    assert error[0] < 2e-4
    assert np.delete(error, axial).max() < 4e-3
    assert np.delete(error, axial)[:4].max() < 2.5e-3
    assert error[axial] < 4e-3


def test_convergence(tmp_path: Path) -> None:
    """Frequencies approach those of the beam as the mesh is refined, faster with 2nd order."""
    actual: dict[int, list[float]] = {1: [], 2: []}
    for cells in [(4, 1, 1), (8, 2, 2), (16, 4, 4)]:
        for order, frequencies in actual.items():
            path = write_bar(tmp_path / "bar.msh", cells, order=order)
            frequencies.append(held(mesh_matrices(path, STEEL, PINS, POINTS, 1))[0])
    coarse, fine = -np.diff(actual[2])
    assert coarse > 4.0 * fine > 0.0
    assert (np.diff(actual[1]) < 0.0).all()
    assert actual[2][2] == pytest.approx(pinned_beam(*SIZE[1:])[0], rel=1e-3)
    assert (np.array(actual[1]) > 1.1 * np.array(actual[2])).all()


@pytest.mark.parametrize("order", [1, 2])
def test_rigid_body(tmp_path: Path, order: int) -> None:
    """Mass, moment and inertia are exact, and rigid motion needs no force."""
    path = write_bar(tmp_path / "bar.msh", (6, 1, 2), order=order)
    body = mesh_matrices(path, STEEL, PINS, POINTS, 4, rotations={"A"})
    assert [str(dof) for dof in body.dofs] == ["A x", "A z", "A theta", "B x", "B z"]
    length, _, height = SIZE
    total = STEEL.density * np.prod(SIZE)
    motions = np.zeros((9, 3))
    motions[[0, 3], 0] = motions[[1, 4], 1] = 1.0
    motions[[2, 4], 2] = 1.0, length
    inertia = np.diag([total, total, total * (length**2 / 3 + height**2 / 12)])
    inertia[1, 2] = inertia[2, 1] = total * length / 2
    np.testing.assert_allclose(motions.T @ body.mass @ motions, inertia, rtol=1e-9, atol=1e-9)
    force = np.abs(body.stiffness[:5] @ motions).max()
    assert force < 1e-9 * np.abs(body.stiffness[:5, :5]).max()


def test_statics_of_a_cantilever(tmp_path: Path) -> None:
    """Clamped at one end it is half a percent stiffer than a beam, whose ends may contract."""
    path = write_bar(tmp_path / "bar.msh", (48, 2, 4))
    body = mesh_matrices(path, STEEL, PINS, POINTS, 0, rotations={"A", "B"})
    assert body.mass.shape == (6, 6)
    actual = np.linalg.inv(body.stiffness[3:, 3:])
    section, length = rectangle(*SIZE[1:], 0.3), SIZE[0]
    rigidity = STEEL.youngs_modulus * section.second_moment
    shear = length / (section.shear_coefficient * section.area * STEEL.shear_modulus)
    bending = length**3 / (3 * rigidity)
    assert 0.995 < actual[1, 1] / (bending + shear) < 1.0
    assert 0.995 < actual[1, 2] / (length**2 / (2 * rigidity)) < 1.0  # theta turns x towards z
    assert 0.995 < actual[0, 0] / (length / (STEEL.youngs_modulus * section.area)) < 1.0


def test_versions_agree(tmp_path: Path) -> None:
    """A mesh of version 2.2 and one of 4.1 give the same matrices."""
    bodies = [
        mesh_matrices(
            write_bar(tmp_path / f"{version}.msh", (6, 1, 1), version=version),
            STEEL,
            PINS,
            POINTS,
            3,
        )
        for version in ("2.2", "4.1")
    ]
    np.testing.assert_array_equal(bodies[0].mass, bodies[1].mass)
    np.testing.assert_array_equal(bodies[0].stiffness, bodies[1].stiffness)


def test_elements_in_two_groups_count_once(tmp_path: Path) -> None:
    """Version 2.2 repeats elements that are in two physical volumes; the mass stays the same."""
    path = write_bar(tmp_path / "bar.msh", (4, 1, 1), order=1, version="2.2")
    once = mesh_matrices(path, STEEL, PINS, POINTS, 2)
    text = path.read_text()
    repeated = re.findall(r"^(\d+) (4 2 3 3 .*)$", text, re.MULTILINE)
    number = int(repeated[-1][0])
    extra = "".join(f"{number + i} {rest}\n" for i, (_, rest) in enumerate(repeated, 1))
    text = text.replace("$EndElements", extra + "$EndElements")
    text = text.replace(f"$Elements\n{number}", f"$Elements\n{number + len(repeated)}")
    path.write_text(text)
    twice = mesh_matrices(path, STEEL, PINS, POINTS, 2)
    np.testing.assert_array_equal(once.mass, twice.mass)


def test_planar_modes_of_a_square_bar(tmp_path: Path) -> None:
    """A frequency that both planes share occurs once.

    Faces that cannot contract make it up to 1.5 % stiffer than a beam.
    """
    size = (0.8, 0.04, 0.04)
    path = write_bar(tmp_path / "bar.msh", (20, 2, 2), size=size)
    body = mesh_matrices(path, STEEL, PINS, POINTS, 3, rotations={"A", "B"})
    expected = pinned_beam(0.04, 0.04, clamped=True)[:3]
    assert (held(body) > expected).all()
    np.testing.assert_allclose(held(body), expected, rtol=1.6e-2)


def test_three_pins_off_one_line(tmp_path: Path) -> None:
    """A third pin off the line turns with the bar: it has the inertia of a rigid body."""
    path = write_bar(tmp_path / "bar.msh", (9, 2, 2), middle=True)
    pins = {**PINS, "M": "middle"}
    points = [*POINTS, ("M", (0.4, 0.025))]
    body = mesh_matrices(path, STEEL, pins, points, 5)
    assert (free(body)[:3] < 0.01).all()
    assert free(body)[3] > 100.0
    total = STEEL.density * np.prod(SIZE)
    turned = np.zeros(len(body.mass))
    turned[[1, 3, 4, 5]] = -0.4, 0.4, -0.025, 0.0  # A, B and M turn from x to z about (0.4, 0)
    inertia = total * (SIZE[0] ** 2 + SIZE[2] ** 2) / 12
    assert turned @ body.mass @ turned == pytest.approx(inertia, rel=1e-9)


def replaced(old: str, new: str) -> Callable[[str], str]:
    """Return a function that replaces one text by another."""

    def spoil(text: str) -> str:
        assert old in text
        return text.replace(old, new)

    return spoil


def numbers_scaled(text: str) -> str:
    """Convert the coordinates of version 2.2 to millimetres."""
    lines = text.splitlines()
    first, last = lines.index("$Nodes") + 2, lines.index("$EndNodes")
    for k in range(first, last):
        number, *place = lines[k].split()
        lines[k] = " ".join([number, *(f"{1e3 * float(x):.16g}" for x in place)])
    return "\n".join(lines) + "\n"


BAD: dict[str, tuple[Callable[[str], str], str]] = {
    "no mesh": (
        lambda text: "solid bar\n" + text,
        "is damaged or has another format than its name",
    ),
    "old version": (replaced("2.2 0 8", "1 0 8"), "another format .*Need mesh format in .*2.2"),
    "no groups": (
        replaced("PhysicalNames", "Comments"),
        "has no physical surface 'left' for the point A; choose one of none, or add it",
    ),
    "cut short": (lambda text: text[: len(text) // 3], "is damaged .*; write it again"),
    "surface misspelt": (
        replaced('"right"', '"rihgt"'),
        "has no physical surface 'right' for the point B; choose one of left, rihgt",
    ),
    "millimetres": (numbers_scaled, "is 800 m long, which no link is; convert it to metres"),
    "elsewhere": (
        lambda text: (
            text.replace(' "left"', ' "x"').replace('"right"', '"left"').replace('"x"', '"right"')
        ),
        r"surface 'left' around x, y, z = 0\.8, 0, 0 m and the point A at 0, 0, 0 m",
    ),
    "no volume": (
        lambda text: re.sub(
            r"^(\d+) 4 2 3 3 (\d+) (\d+) (\d+) \d+$",
            r"\1 2 2 3 3 \2 \3 \4",
            text,
            flags=re.MULTILINE,
        ),
        "has no volume elements; define a physical group",
    ),
    "inverted": (
        lambda text: re.sub(r"( 4 2 3 3) (\d+) (\d+) ", r"\1 \3 \2 ", text, count=1),
        "has flat or inverted elements; mesh it again",
    ),
    "unknown node": (
        lambda text: re.sub(r"( 4 2 3 3) (\d+) ", r"\1 0 ", text, count=1),
        "inverted elements|elements on nodes that it does not have",
    ),
    "huge counts": (replaced("$Nodes\n20", "$Nodes\n2000000000"), "is damaged .*; write it again"),
    "not a number": (
        lambda text: re.sub(r"^2 0 ", "2 nan ", text, flags=re.MULTILINE),
        "coordinates are not finite",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_files(tmp_path: Path, name: str) -> None:
    """Each invalid mesh gives one sentence that names the file, the place and the fix."""
    spoil, words = BAD[name]
    path = write_bar(tmp_path / "bar.msh", (4, 1, 1), order=1, version="2.2")
    path.write_text(spoil(path.read_text()))
    with pytest.raises(ComponentFileError, match=words) as caught:
        mesh_matrices(path, STEEL, PINS, POINTS, 2)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_two_parts(tmp_path: Path) -> None:
    """A bar without its second quarter is an error, as it falls into two parts."""
    path = write_bar(tmp_path / "bar.msh", (4, 1, 1), order=1, version="2.2")
    lines = path.read_text().splitlines()
    at = lines.index("$Elements") + 1

    def quarter(line: str) -> int:
        """Return the quarter of a tetrahedron; the quarters are four nodes long."""
        numbers = [int(number) for number in line.split()]
        return (min(numbers[5:]) - 1) // 4 if len(numbers) == 9 else -1

    kept = [line for line in lines[at + 1 : -1] if quarter(line) != 1]
    path.write_text("\n".join([*lines[:at], str(len(kept)), *kept, "$EndElements\n"]))
    with pytest.raises(
        ComponentFileError, match="The solid consists of 2 separate parts; join their meshes"
    ):
        mesh_matrices(path, STEEL, PINS, POINTS, 2)


def test_points_without_surface(tmp_path: Path) -> None:
    """Every point needs a surface and every surface a point; one pin cannot hold a bar."""
    path = write_bar(tmp_path / "bar.msh", (4, 1, 1))
    with pytest.raises(ComponentFileError, match="has no pin for the point B; add it"):
        mesh_matrices(path, STEEL, {"A": "left"}, POINTS, 2)
    with pytest.raises(
        ComponentFileError, match="has pins for C, which is not a point of the link"
    ):
        mesh_matrices(path, STEEL, {**PINS, "C": "right"}, POINTS, 2)
    with pytest.raises(ComponentFileError, match=r"2 interface DoFs held .* can still move"):
        mesh_matrices(path, STEEL, {"A": "left"}, POINTS[:1], 2)


@pytest.mark.parametrize("module", ["meshio", "skfem"])
def test_missing_extra(tmp_path: Path, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the extra, the error names the command that installs it."""
    path = write_bar(tmp_path / "bar.msh", (4, 1, 1))
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ComponentFileError, match=r"pip install linkage_vibration\[fe\]"):
        mesh_matrices(path, STEEL, PINS, POINTS, 2)


@pytest.mark.parametrize(("version", "order"), [("2.2", 1), ("4.1", 1), ("4.1", 2)])
def test_spoilt_files(
    tmp_path: Path, version: str, order: int, mutations: Callable[[bytes, int], Iterator[bytes]]
) -> None:
    """Each of 200 damaged files is read or gives one sentence; nothing else is raised."""
    path = write_bar(tmp_path / "bar.msh", (3, 1, 1), order=order, version=version)
    spoilt = mutations(path.read_bytes(), 200)
    refuse_spoilt(path, spoilt, lambda: mesh_matrices(path, STEEL, PINS, POINTS, 3))


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_meshes_of_gmsh(tmp_path: Path, version: float) -> None:
    """A link with two bored eyes, meshed by gmsh in both versions, has its mass at its middle."""
    gmsh: Any = pytest.importorskip("gmsh", reason="gmsh itself is not installed")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        bar = occ.addBox(-0.04, -0.01, -0.03, 0.38, 0.02, 0.06)
        bores = [(3, occ.addCylinder(x, -0.01, 0, 0, 0.02, 0, 0.012)) for x in (0.0, 0.3)]
        occ.cut([(3, bar)], bores)
        occ.synchronize()
        for name, x in (("left", 0.0), ("right", 0.3)):
            box = (x - 0.013, -0.011, -0.013, x + 0.013, 0.011, 0.013)
            walls = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*box, 2)]
            gmsh.model.addPhysicalGroup(2, walls, name=name)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="eye")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.02)
        gmsh.option.setNumber("Mesh.ElementOrder", 2)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(tmp_path / "eye.msh"))
    finally:
        gmsh.finalize()
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # as Python has it; gmsh lets it kill
    points = [("A", (0.0, 0.0)), ("B", (0.3, 0.0))]
    body = mesh_matrices(tmp_path / "eye.msh", STEEL, PINS, points, 5)
    along = np.array([1.0, 0.0, 1.0, 0.0, *np.zeros(5)])
    area = 0.38 * 0.06 - 2 * np.pi * 0.012**2
    assert along @ body.mass @ along == pytest.approx(7800.0 * 0.02 * area, rel=1e-4)
    assert (free(body)[:3] < 0.01).all()
    assert free(body)[3] > 1000.0
