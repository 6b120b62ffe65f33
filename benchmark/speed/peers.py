# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Other codes on the same linkage; a code that is missing or cannot compute a part says so."""

import importlib.util
import os
import shutil
import tempfile
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from benchmark.speed.coupled import NO_MODES, component_frfs, held_frfs, joints_left
from benchmark.speed.method import Method, counted
from benchmark.speed.scene import MODES, Rows, Scene, eleven
from linkage_vibration.mechanics.model import LinkageModel

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

EXUDYN, PYFBS, CALCULIX = "Exudyn", "pyFBS", "CalculiX, solid links"
SDYNPY_FRF, SDYNPY_MODES = "SDynPy by FRFs", "SDynPy by modes"
SUBSTRUCTURED = "solid links, substructured"


def methods(scene: Scene, exudyn_elements: tuple[int, ...], modes: tuple[int, ...]) -> list[Method]:
    """Return the peers, with these numbers of elements or modes per link."""
    return [
        *_exudyn(scene, exudyn_elements),
        *_sdynpy(scene, modes),
        *_pyfbs(scene, modes),
        *_solids(scene),
    ]


def lacks(package: str) -> bool:
    """Return whether a package is not installed."""
    return importlib.util.find_spec(package) is None


def installed() -> list[str]:
    """Return the distributions of the peers that are installed."""
    packages = {"exudyn": "exudyn", "sdynpy": "sdynpy", "pyfbs": "pyFBS"}
    return [name for package, name in packages.items() if not lacks(package)]


def _exudyn(scene: Scene, elements: tuple[int, ...]) -> list[Method]:
    if lacks("exudyn"):
        return [Method(EXUDYN, "", missing="not installed")]
    from benchmark.validation.exudyn_beams import ExudynModel

    def frequencies(n: int, alpha3: float) -> FloatArray:
        model = ExudynModel(scene.mechanism, scene.kinematics.at(alpha3), n)
        return model.natural_frequencies()[:MODES]

    missing = "Exudyn has eigenvalues, and no FRFs of its own"
    return [
        Method(EXUDYN, counted(n, "element"), partial(frequencies, n), None, missing)
        for n in elements
    ]


def _sdynpy(scene: Scene, modes: tuple[int, ...]) -> list[Method]:
    if lacks("sdynpy"):
        return [
            Method(family, "", missing="not installed") for family in (SDYNPY_FRF, SDYNPY_MODES)
        ]
    result = []
    for n in modes:
        model = scene.model(elements=scene.fine, modes=n)
        by_modes = SdynpyModes(model)
        result += [
            Method(
                SDYNPY_FRF, counted(n, "mode"), None, SdynpyFrfs(model, scene.lines[1:]), NO_MODES
            ),
            Method(
                SDYNPY_MODES,
                counted(n, "mode"),
                by_modes.frequencies,
                partial(by_modes.frf, lines=scene.lines),
            ),
        ]
    return result


def _load_sdynpy() -> Any:
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")  # it loads Qt
    import sdynpy

    return sdynpy


class SdynpyFrfs:
    """LM-FBS by SDynPy, which uses a pseudo-inverse.

    Parameters
    ----------
    model : LinkageModel
        Its components' FRFs are made once.
    lines : ndarray, (n_lines,)
        Hz, above 0.
    rows : callable
        Responses and force.
    held : bool
        Whether the ground's constraints are applied to the components before, as in ours.
    """

    def __init__(
        self, model: LinkageModel, lines: FloatArray, rows: Rows = eleven, *, held: bool = False
    ) -> None:
        sdynpy = _load_sdynpy()
        self._model, self._rows, self._held = model, rows, held
        blocks = held_frfs(model, lines) if held else component_frfs(model, lines)
        stacked = [block_diag(*matrices) for matrices in zip(*blocks, strict=True)]
        # With one node for every DoF, SDynPy keeps our order.
        self._dofs = sdynpy.coordinate_array(np.arange(stacked[0].shape[0]) + 1, 1)
        self._functions = sdynpy.data_array(
            sdynpy.data.FunctionTypes.FREQUENCY_RESPONSE_FUNCTION,
            lines,
            np.stack(stacked, axis=-1),
            np.stack(np.broadcast_arrays(self._dofs[:, None], self._dofs[None, :]), axis=-1),
        )

    def __call__(self, alpha3: float) -> ComplexArray:
        """Return the eleven FRFs, (n_lines, 11)."""
        model = self._model
        configuration = model.kinematics.at(alpha3)
        outputs, inputs = self._rows(model, configuration)
        compatibility = model.interface.join(configuration).compatibility
        if self._held:
            outputs, inputs = (given[:, ~model.interface.held] for given in (outputs, inputs))
            compatibility = joints_left(model, compatibility)
        coupled = self._functions.substructure_by_constraint_matrix(self._dofs, compatibility)
        # With the force first, each line is a product of a matrix and a vector.
        return np.asarray((outputs @ (coupled.ordinate.transpose(2, 0, 1) @ inputs[0]).T).T)


class SdynpyModes:
    """Assembly, modes and modal superposition by SDynPy.

    Parameters
    ----------
    model : LinkageModel
        The model with the components' matrices.
    """

    def __init__(self, model: LinkageModel) -> None:
        sdynpy = _load_sdynpy()
        self._model = model
        system = model.system
        self._dofs = sdynpy.coordinate_array(np.arange(len(system.mass)) + 1, 1)
        self._system = sdynpy.System(self._dofs, system.mass, system.stiffness, system.damping)

    def _shapes(self, alpha3: float) -> Any:
        joining = self._model.interface.join(self._model.kinematics.at(alpha3))
        n_inner = len(self._dofs) - len(self._model.interface)
        rows = np.pad(joining.compatibility, ((0, 0), (0, n_inner)))
        return self._system.constrain(rows).eigensolution()

    def frequencies(self, alpha3: float) -> FloatArray:
        """Return the first natural frequencies, (3,), Hz."""
        return np.asarray(self._shapes(alpha3).frequency[:MODES])

    def frf(self, alpha3: float, lines: FloatArray) -> ComplexArray:
        """Return the eleven FRFs, (n_lines, 11)."""
        outputs, inputs = eleven(self._model, self._model.kinematics.at(alpha3))
        n = len(self._model.interface)
        used = self._dofs[:n]
        shapes = self._shapes(alpha3)
        forced = np.flatnonzero(inputs[0])
        result = shapes.compute_frf(lines, used, used[forced], 0).ordinate  # (n, n_forced, n_lines)
        at_force = np.tensordot(result, inputs[0, forced], axes=(1, 0))
        return np.asarray((outputs @ at_force).T)


def _pyfbs(scene: Scene, modes: tuple[int, ...]) -> list[Method]:
    if lacks("pyfbs"):
        return [Method(PYFBS, "", missing="not installed")]
    return [
        Method(
            PYFBS,
            counted(n, "mode"),
            None,
            PyfbsCoupling(scene.model(elements=scene.fine, modes=n), scene.lines[1:]),
            "pyFBS couples FRFs by NumPy expressions around its own pseudo-inverse; no modes",
        )
        for n in modes
    ]


class PyfbsCoupling:
    """LM-FBS with pyFBS's pseudo-inverse; pyFBS has no function for a given B.

    Parameters
    ----------
    model : LinkageModel
        Its components' FRFs are made once.
    lines : ndarray, (n_lines,)
        Hz, above 0.
    """

    def __init__(self, model: LinkageModel, lines: FloatArray) -> None:
        self._model = model
        blocks = component_frfs(model, lines)
        self._frf = np.stack([block_diag(*matrices) for matrices in zip(*blocks, strict=True)])

    def __call__(self, alpha3: float) -> ComplexArray:
        """Return the eleven FRFs, (n_lines, 11)."""
        from pyfbs import tpinv

        configuration = self._model.kinematics.at(alpha3)
        outputs, inputs = eleven(self._model, configuration)
        b = self._model.interface.join(configuration).compatibility
        h = self._frf
        coupled = h - h @ b.T @ tpinv(b @ h @ b.T, trunc=0) @ b @ h
        return np.asarray((outputs @ (coupled @ inputs[0]).T).T)


def _solids(scene: Scene) -> list[Method]:
    """Return CalculiX on solid meshes, and our substructuring of the same meshes."""
    if lacks("gmsh") or shutil.which("ccx") is None:
        return [Method(CALCULIX, "", missing="gmsh or CalculiX (ccx) is not installed")]
    from benchmark.validation.calculix import calculix_frequencies, read_mesh
    from benchmark.validation.solids import write_mesh
    from benchmark.validation.substructure import solid_link

    mechanism = scene.mechanism
    keep = tempfile.TemporaryDirectory()
    folder = Path(keep.name)
    files = {link.name: folder / f"{link.name}.msh" for link in mechanism.links}
    for link in mechanism.links:
        write_mesh(files[link.name], link)
    meshes = {name: read_mesh(path) for name, path in files.items()}
    links = tuple(
        solid_link(link, meshes[link.name], mechanism.rotations(link.name))
        for link in mechanism.links
    )
    model = LinkageModel(replace(mechanism, links=links), kinematics=scene.kinematics)

    def assembled(alpha3: float, folder: Path = folder, keep: object = keep) -> FloatArray:
        configuration = scene.kinematics.at(alpha3)
        return calculix_frequencies(mechanism, configuration, meshes, MODES, folder)

    n = sum(len(mesh.nodes) for mesh in meshes.values())
    return [
        Method(CALCULIX, counted(n, "node"), assembled, None, "only frequencies were computed"),
        Method(
            SUBSTRUCTURED,
            "20 modes",
            lambda alpha3: model.solve(alpha3).natural_frequencies[:MODES],
            None,
            "only frequencies were computed",
        ),
    ]
