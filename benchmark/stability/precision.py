# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Single precision, wrong units, extreme masses and stiffnesses, and beams that are too short."""

import dataclasses
import functools
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from benchmark.report import table
from benchmark.stability.static_limit import ALPHA3, PLACES, component_frfs, linkage, plain_lm_fbs
from linkage_vibration.drawing.palette import COLOURS, GREY
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.bodies.beam import Beam, Segment, beam_matrices
from linkage_vibration.mechanics.coupling import assembled_frf
from linkage_vibration.mechanics.description import Material, Mechanism, Section
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.sections.rectangle import rectangle
from linkage_vibration.mechanics.sections.tube import tube
from linkage_vibration.readers.frfs import read_frfs
from linkage_vibration.readers.matrices import read_matrices
from linkage_vibration.support.resources import config_file

TITLE = "Precision and scale"

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_LINES: FloatArray = np.arange(1, 2001) / 10.0  # Hz
_TOLD: FloatArray = np.array([0.1, 1.0, 10.0, 100.0])  # Hz
_STEEL = Material(210e9, 7800.0, 0.3)


def section(pictures: Path) -> str:
    """Measure, draw, and return the section."""
    single = _single_precision()
    slenderness, theory = _beams_against_solids()
    _draw(single, slenderness, theory, pictures / "precision.png")
    at = np.searchsorted(_LINES, _TOLD - 1e-6)
    single_rows = [[name, *(f"{errors[i]:.0e}" for i in at)] for name, errors in single.items()]
    texts = [[name, f"`{words}`"] for name, words in _mistakes()]
    limits = [
        [
            case.name,
            case.against,
            f"{case.expected:.6g}",
            f"{nearest(case) / case.expected - 1:.0e}",
        ]
        for case in extremes()
    ]
    bars = [[f"{100.0 * off:.2g} %" for off in theory]]
    return "\n\n".join(
        [
            "**Single precision.** A free link moves so much more than it deforms that its FRFs "
            "need more digits than 24 bits hold. The table shows the error of the default "
            "linkage's FRFs at 140 deg, relative to the largest:",
            table(["", *(f"{frequency:g} Hz" for frequency in _TOLD)], single_rows),
            "The package computes in double precision with everything that it reads from files. "
            "This alone does not help FRFs in single precision (second row). As with all measured "
            "FRFs, their flexibility is fitted before they are coupled (third row). With matrices, "
            "the assembly replaces LM-FBS where it loses digits (0.1 Hz). Matrices in single "
            f"precision are rejected: *{_single_matrices()}*",
            "**Units.** The paper's linkage in other units than SI causes these errors:",
            table(["mistake", "error"], texts),
            "Large or small values in SI units are accepted: implements of 1 g or 100 t, "
            "linkages of 25 m, bars of 1e15 Pa or 0.001 kg/m3. A mass *and* its inertia in t, or "
            "a spring in N/mm, are possible values in SI units, so they are accepted, too.",
            "**Extremes.** The next table compares a natural frequency of the paper's linkage at "
            "140 deg with an independent computation. The shift-and-invert solver (`solve_modes`) "
            "preserves the digits of low frequencies beside stiff bars:",
            table(["case", "against", "Hz", "ours off by"], limits),
            f"**Beams.** {_slender()} For a bar that is too short, beam theory is not "
            "valid. The next table shows, by length / depth, how far the first elastic frequency "
            "of a free bar is above that of plane-stress elasticity:",
            table([f"{ratio:g}" for ratio in slenderness], bars),
            f"Therefore a bar that is deeper than long is rejected: *{_too_short()}*",
            "![Errors over frequency and over the length of a bar](stability/precision.png)",
            "Tests: `test/mechanics/test_precision.py`, `test_wrong_units_are_refused`, "
            "`test_large_and_small_is_not_refused` in `test/mechanics/test_parsing.py`.",
        ]
    )


def _single_precision() -> dict[str, FloatArray]:
    """Error of coupled FRFs over `_LINES`, of the largest, method by method."""
    model = linkage()
    configuration = model.kinematics.at(ALPHA3)
    joining, rows = model.interface.join(configuration), model.rows(PLACES, configuration)
    exact = assembled_frf(model.solve(ALPHA3).coupled, _LINES, rows, rows)
    blocks = component_frfs(model, _LINES)
    single = [block.astype(np.complex64) for block in blocks]
    b = joining.compatibility

    def error(result: ComplexArray) -> FloatArray:
        worst = np.abs(result - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))
        return np.asarray(worst, dtype=float)

    at = [component.name for component in model.components].index("input_crank")
    return {
        "LM-FBS in single precision": error(coupled_in_single(single, b, rows)),
        "in double, of FRFs in single": error(
            plain_lm_fbs([block.astype(complex) for block in single], b, rows)
        ),
        "ours, the crank's FRFs from a file in single": error(
            with_frfs_from_file(model.mechanism, at, _LINES, single[at])
            .coupled_frf(ALPHA3, _LINES, PLACES, PLACES)
            .values
        ),
        "ours, from matrices": error(model.coupled_frf(ALPHA3, _LINES, PLACES, PLACES).values),
    }


def coupled_in_single(
    blocks: list[NDArray[np.complex64]], b: FloatArray, rows: FloatArray
) -> ComplexArray:
    """Equation 19 with every number in single precision."""
    sizes = np.cumsum([0] + [block.shape[1] for block in blocks])
    h = np.zeros((len(blocks[0]), sizes[-1], sizes[-1]), dtype=np.complex64)
    for start, end, block in zip(sizes, sizes[1:], blocks, strict=False):
        h[:, start:end, start:end] = block
    b, rows = b.astype(np.float32), rows.astype(np.float32)
    forces = np.linalg.solve(b @ h @ b.T, b @ h @ rows.T)
    return np.asarray(rows @ h @ rows.T - rows @ h @ b.T @ forces)


def with_frfs_from_file(
    mechanism: Mechanism, at: int, lines: FloatArray, frf: NDArray[np.complexfloating]
) -> LinkageModel:
    """Return the linkage with one link from a file of FRFs, in the precision that they have."""
    link = mechanism.links[at]
    component = LinkageModel(mechanism).components[at]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "link.npz"
        names = np.array([str(dof) for dof in component.dofs])
        np.savez(path, frequencies=lines, frf=frf * link.count, dofs=names)
        measured = dataclasses.replace(link, body=read_frfs(path))
    links = (*mechanism.links[:at], measured, *mechanism.links[at + 1 :])
    return LinkageModel(dataclasses.replace(mechanism, links=links))


def _single_matrices() -> str:
    """Return the error for a file of matrices in single precision."""
    link = linkage().mechanism.links[0]
    assert isinstance(link.body, Beam)
    beam = beam_matrices(link.body, link.points)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "link.npz"
        np.savez(
            path,
            mass=beam.mass.astype(np.float32),
            stiffness=beam.stiffness.astype(np.float32),
            dofs=np.array([str(dof) for dof in beam.dofs]),
        )
        words = _message(lambda: read_matrices(path))
    return words.removeprefix(f"{path}: ")


def _message(call: Callable[[], object]) -> str:
    try:
        call()
    except LinkageVibrationError as error:
        return str(error)
    raise AssertionError("it was to be refused")


def description() -> Any:
    """Return the paper's linkage as a mapping of its own, materials of links apart."""
    result = yaml.safe_load(config_file("three_point_linkage.yaml").read_text(encoding="utf-8"))
    for link in result["links"].values():
        link["material"] = dict(link["material"])
    return result


def scaled(mapping: Any, points: float = 1.0, sections: float = 1.0) -> Any:
    """Multiply all points of a description, or all dimensions of its sections."""
    mapping["ground"] = _times(mapping["ground"], points)
    for body in (*mapping["links"].values(), *mapping["rigid_bodies"].values()):
        body["points"] = _times(body["points"], points)
        for key, factor in (("section", sections), ("centre_of_gravity", points)):
            if key in body:
                body[key] = _times(body[key], factor)
    return mapping


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, dict):
        return {key: _times(item, factor) for key, item in value.items()}
    if isinstance(value, list):
        return [_times(item, factor) for item in value]
    return value * factor if isinstance(value, float | int) else value


def _mistakes() -> list[tuple[str, str]]:
    """Return descriptions in wrong units with their errors."""

    def material(key: str, value: float) -> Any:
        mapping = description()
        for link in mapping["links"].values():
            link["material"][key] = value
        return mapping

    def implement(**values: float) -> Any:
        mapping = description()
        mapping["rigid_bodies"]["implement"].update(values)
        return mapping

    cases = {
        "points in mm": scaled(description(), points=1e3),
        "sections in mm": scaled(description(), sections=1e3),
        "both in mm": scaled(description(), points=1e3, sections=1e3),
        "both in mm, a linkage of a twentieth": scaled(description(), points=50, sections=50),
        "Young's modulus in GPa": material("youngs_modulus", 210.0),
        "Young's modulus in N/mm2": material("youngs_modulus", 210e3),
        "a dummy of 2.1e20 Pa for a rigid link": material("youngs_modulus", 2.1e20),
        "density in t/m3": material("density", 7.8),
        "implement's mass in t": implement(mass=0.8),
        "implement's inertia in kg mm2": implement(inertia=200e6),
    }
    return [
        (name, _message(functools.partial(mechanism_from_mapping, mapping)))
        for name, mapping in cases.items()
    ]


@dataclasses.dataclass(frozen=True)
class Extreme:
    """An extreme linkage, and one of its natural frequencies from an independent computation."""

    name: str
    against: str
    mapping: Any
    expected: float  # Hz


def extremes() -> list[Extreme]:
    """Return linkages at 140 deg; the first mode has a simple limit, except for the thin rod."""
    base = first_frequency(description())
    result = [
        Extreme(
            "implement of 1 g",
            "a stiff bar of 1 g in its place",
            _implement(1e-3, 1e-3 * (0.438**2 + 0.01**2) / 12.0, [0.219, 0.0]),
            first_frequency(_bar_as_implement(1e-3)),
        )
    ]
    for mass in (1e5, 1e8):
        heavy = _implement(mass, mass / 4.0)
        result.append(
            Extreme(f"implement of {mass / 1e3:g} t", "its static shapes", heavy, _static(heavy))
        )
    for stiffness in (1.0, 1e12):
        held = _crank_spring(stiffness)
        soft = stiffness < 1e6
        result.append(
            Extreme(
                f"crank held by {stiffness:g} N m/rad",
                "rigid bars, sqrt(k / J)" if soft else "the clamped crank",
                held,
                _rigid_frequency(held, stiffness) if soft else base,
            )
        )
    result.append(
        Extreme(
            "upper link 1e6 times as stiff",
            "a rigid body in its place",
            _stiff_upper_link(1e6),
            first_frequency(_rigid_upper_link()),
        )
    )
    return [
        *result,
        Extreme(
            "lift rod of 0.9 mm, 1e-6 times as stiff in bending",
            "the rod alone between pins",
            _lift_rod(0.9e-3),
            pinned_frequency(_STEEL, tube(0.9e-3, 0.0, 0.3), 0.534),
        ),
    ]


def solved(mapping: Any, *, reduced: bool = True) -> Solution:
    """Solve a linkage at 140 deg."""
    return LinkageModel(mechanism_from_mapping(mapping), reduced=reduced).solve(ALPHA3)


def nearest(extreme: Extreme) -> float:
    """Return the undamped natural frequency that is nearest to the expected one, Hz."""
    result = solved(extreme.mapping).modes.omega / (2.0 * math.pi)
    return float(result[np.abs(result / extreme.expected - 1.0).argmin()])


def first_frequency(mapping: Any) -> float:
    """First natural frequency at 140 deg, Hz."""
    return float(solved(mapping).natural_frequencies[0])


def _implement(mass: float, inertia: float, centre: list[float] | None = None) -> Any:
    mapping = description()
    mapping["rigid_bodies"]["implement"].update(mass=mass, inertia=inertia)
    if centre is not None:
        mapping["rigid_bodies"]["implement"]["centre_of_gravity"] = centre
    return mapping


def _bar_as_implement(mass: float) -> Any:
    mapping = description()
    del mapping["rigid_bodies"]
    mapping["links"]["implement"] = {
        "points": {"E1": 0.0, "E2": 0.438},
        "section": {"shape": "rectangle", "width": 1.0, "height": 0.01},
        "material": {
            "youngs_modulus": 1e15,
            "density": mass / (0.01 * 0.438),
            "poisson_ratio": 0.3,
        },
    }
    return mapping


def _crank_spring(stiffness: float) -> Any:
    mapping = description()
    del mapping["links"]["input_crank"]["clamped"]
    mapping["springs"] = {"hold": {"joint": "P3", "stiffness": stiffness}}
    return mapping


def _stiff_upper_link(factor: float) -> Any:
    mapping = description()
    mapping["links"]["upper_link"]["material"]["youngs_modulus"] *= factor
    return mapping


def _rigid_upper_link() -> Any:
    mapping = description()
    del mapping["links"]["upper_link"]
    pipe, length = tube(0.080, 0.040, 0.3), 0.520
    mass = _STEEL.density * pipe.area * length
    mapping["rigid_bodies"]["upper_link"] = {
        "points": {"P2": [0.0, 0.0], "E2": [length, 0.0]},
        "centre_of_gravity": [length / 2.0, 0.0],
        "mass": mass,
        "inertia": mass * (length**2 / 12.0 + pipe.second_moment / pipe.area),
    }
    return mapping


def _lift_rod(diameter: float) -> Any:
    mapping = description()
    mapping["links"]["lift_rod"]["section"]["diameter"] = diameter
    return mapping


def _static(mapping: Any) -> float:
    """Return the first frequency from static shapes, as if links had no modes."""
    solution = solved(mapping)
    interface, coupled = solution.model.interface, solution.coupled
    body = solution.model.components[-1]
    rows = np.zeros((3, len(interface)))
    rows[:, -3:] = np.eye(3)  # the implement's are the last
    assert len(body.dofs) == 3
    on = coupled.restrict(rows)
    shapes = np.linalg.solve(coupled.stiffness, on.T)
    least = eigh(
        shapes.T @ coupled.stiffness @ shapes, shapes.T @ coupled.mass @ shapes, eigvals_only=True
    )[0]
    return math.sqrt(least) / (2.0 * math.pi)


def _rigid_frequency(mapping: Any, stiffness: float) -> float:
    """Frequency of rigid bars on a spring k at the crank: sqrt(k / J), J their inertia about it."""
    mechanism = mechanism_from_mapping(mapping)
    at = Kinematics(mechanism).at(ALPHA3)

    def inertia(body: str, centre: tuple[float, float], mass: float, own: float) -> float:
        speed = at.place_rate(body, centre)
        return float(mass * speed @ speed + own * at.velocity_ratio(body) ** 2)

    total = sum(
        inertia(b.name, b.centre_of_gravity, b.mass, b.inertia) for b in mechanism.rigid_bodies
    )
    for link in mechanism.links:
        assert isinstance(link.body, Beam)
        (segment,) = link.body.segments
        mass = link.count * link.body.material.density * segment.section.area * segment.end
        gyration = segment.end**2 / 12.0 + segment.section.second_moment / segment.section.area
        total += inertia(link.name, (segment.end / 2.0, 0.0), mass, mass * gyration)
    return math.sqrt(stiffness / total) / (2.0 * math.pi)


def pinned_frequency(material: Material, bar: Section, length: float) -> float:
    """First bending frequency of a Timoshenko beam between pins, Hz; w = sin(pi x / L) exactly."""
    q = math.pi / length
    bending, shear = (
        material.youngs_modulus * bar.second_moment,
        bar.shear_coefficient * material.shear_modulus * bar.area,
    )
    line, rotary = material.density * bar.area, material.density * bar.second_moment
    # line rotary w^4 - b w^2 + c = 0; the smaller root without cancellation.
    b = line * (bending * q**2 + shear) + shear * rotary * q**2
    c = shear * bending * q**4
    return math.sqrt(2.0 * c / (b + math.sqrt(b**2 - 4.0 * line * rotary * c))) / (2.0 * math.pi)


def pinned_beam(length: float, depth: float) -> tuple[float, float]:
    """First bending frequency of a square bar between pins, ours and exact, Hz."""
    bar = rectangle(depth, depth, _STEEL.poisson_ratio)
    beam = beam_matrices(
        Beam(_STEEL, (Segment(length, bar),), elements=24),
        [("A", (0.0, 0.0)), ("B", (length, 0.0))],
    )
    loose = [i for i, dof in enumerate(beam.dofs) if str(dof) == "B x"]
    free = np.ix_(*[[*loose, *range(len(beam.dofs), len(beam.mass))]] * 2)
    exact = pinned_frequency(_STEEL, bar, length)
    mu = eigh(beam.mass[free], beam.stiffness[free], eigvals_only=True)
    result = 1.0 / np.sqrt(mu[mu > 0.0]) / (2.0 * math.pi)
    return float(result[np.abs(result - exact).argmin()]), exact


def _slender() -> str:
    ratios = (10.0, 1e3, 1e6)
    off = [abs(ours / exact - 1.0) for ours, exact in (pinned_beam(1.0, 1.0 / r) for r in ratios)]
    texts = ", ".join(f"{o:.0e} at {r:g}" for r, o in zip(ratios, off, strict=True))
    return (
        "Slenderness causes no error: a bar of 24 elements between pins differs from the exact "
        f"solution of Timoshenko's equations, by length / depth, by {texts}."
    )


def _too_short() -> str:
    mapping = description()
    mapping["links"]["input_crank"]["section"]["height"] = 0.210
    return _message(lambda: mechanism_from_mapping(mapping))


def _beams_against_solids() -> tuple[FloatArray, FloatArray]:
    """Length over depth, and how far beam theory is from plane-stress elasticity, relative."""
    ratios = np.array([10.0, 5.0, 3.0, 2.0, 1.5, 1.0, 0.8, 0.6, 0.5])
    return ratios, np.array([_free_beam(r) / _free_sheet(r) - 1.0 for r in ratios])


def _free_beam(ratio: float) -> float:
    """First elastic frequency of a free bar of depth 1 m, Hz."""
    bar = Beam(_STEEL, (Segment(ratio, rectangle(0.1, 1.0, _STEEL.poisson_ratio)),), elements=40)
    beam = beam_matrices(bar, [("A", (0.0, 0.0)), ("B", (ratio, 0.0))])
    squared = eigh(beam.stiffness, beam.mass, eigvals_only=True)
    return math.sqrt(squared[3]) / (2.0 * math.pi)


def _free_sheet(ratio: float) -> float:
    """First elastic frequency of a free sheet in plane stress, 1 m deep, Hz."""
    from skfem import Basis, BilinearForm, ElementQuad2, ElementVector, MeshQuad
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    across = np.linspace(0.0, 1.0, 13)
    along = np.linspace(0.0, ratio, 1 + math.ceil(12 * max(ratio, 1.0)))
    basis = Basis(MeshQuad.init_tensor(along, across), ElementVector(ElementQuad2()))
    lame, shear = lame_parameters(_STEEL.youngs_modulus, _STEEL.poisson_ratio)
    plane_stress = 2.0 * lame * shear / (lame + 2.0 * shear)
    stiffness = linear_elasticity(plane_stress, shear).assemble(basis)
    mass = BilinearForm(lambda u, v, _: _STEEL.density * dot(u, v)).assemble(basis)
    # Rigid motions are at 0 Hz, except for rounding.
    squared = eigsh(stiffness, k=6, M=mass, sigma=-1e6, return_eigenvectors=False)
    return math.sqrt(np.sort(squared)[3]) / (2.0 * math.pi)


def _draw(
    single: dict[str, FloatArray], ratios: FloatArray, theory: FloatArray, picture: Path
) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.2), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.6, 1.0])
    colours = (COLOURS[1], COLOURS[4], COLOURS[2], COLOURS[0])
    for (name, errors), colour in zip(single.items(), colours, strict=True):
        left.loglog(_LINES, np.maximum(errors, 1e-17), color=colour, lw=1, label=name)
    left.set_ylim(1e-17, 1e8)
    left.set_xlabel("frequency, Hz")
    left.set_ylabel("error, of the largest FRF")
    left.legend(fontsize=7, loc="upper right")
    right.semilogx(ratios, 100.0 * theory, "o-", color=COLOURS[0], ms=4)
    right.axvspan(0.45, 1.0, color=GREY, alpha=0.2, lw=0)
    right.annotate("refused", (0.67, 2.0), fontsize=8, color=GREY, ha="center")
    right.set_xlim(0.45, 11.0)
    right.set_xlabel("length / depth of a free bar")
    right.set_ylabel("beam theory above elasticity, %")
    figure.savefig(picture, format="png")
