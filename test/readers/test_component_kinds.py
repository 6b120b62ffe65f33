# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Links of every kind in one linkage: beams, matrices and FRFs, read from files."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.fbs import component_frf
from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.table.tabulation import build_table

FREQUENCIES = np.linspace(0.1, 200.0, 2000)  # Hz
LINES = FREQUENCIES[::10]
PLACES = [("E1", "z"), ("V1", "x")]


def component(model: LinkageModel, name: str) -> Component:
    """Return a component that has matrices."""
    actual = next(c for c in model.components if c.name == name)
    assert isinstance(actual, Component)
    return actual


def write(folder: Path, mapping: Any) -> Path:
    """Write a mechanism and return its path."""
    path = folder / "mixed.yaml"
    path.write_text(yaml.safe_dump(mapping, sort_keys=False))
    return path


def replace_body(mapping: Any, link: str, **file: Any) -> None:
    """Describe a link by a file instead of as a beam."""
    keys = mapping["links"][link]
    for key in ("section", "material", "elements"):
        keys.pop(key)
    keys["file"] = file


def save_matrices(path: Path, model: LinkageModel, link: str) -> None:
    """Save the matrices of a link without its damping, which the mechanism adds."""
    single = component(model, link)
    count = next(body.count for body in model.mechanism.links if body.name == link)
    np.savez(
        path,
        mass=single.mass / count,
        stiffness=single.stiffness / count,
        dofs=np.array([str(dof) for dof in single.dofs]),
    )


def save_frfs(path: Path, model: LinkageModel, link: str) -> None:
    """Save the FRFs of one of a link's equal parts, as a measurement of it would give them."""
    single = component(model, link)
    count = next(body.count for body in model.mechanism.links if body.name == link)
    np.savez(
        path,
        frequencies=FREQUENCIES,
        frf=count
        * component_frf(
            single.mass, single.stiffness, single.damping, len(single.dofs), FREQUENCIES
        ),
        dofs=np.array([str(dof) for dof in single.dofs]),
    )


def test_matrices_from_a_file_are_the_beam_that_they_came_from(
    mapping: Any, model: LinkageModel, tmp_path: Path
) -> None:
    """A link saved as unreduced matrices and read again changes no result."""
    full = LinkageModel(model.mechanism, reduced=False)
    save_matrices(tmp_path / "lower.npz", full, "lower_link")
    replace_body(mapping, "lower_link", kind="matrices", path="lower.npz")
    mixed = LinkageModel(read_mechanism(write(tmp_path, mapping)))
    for alpha3 in (1.7, 2.4, 3.1):
        ours, before = mixed.solve(alpha3), model.solve(alpha3)
        np.testing.assert_allclose(
            ours.natural_frequencies[:6], before.natural_frequencies[:6], rtol=1e-8
        )
        np.testing.assert_allclose(ours.damping_ratios[:6], before.damping_ratios[:6], rtol=1e-6)
    assert mixed.mechanism.model_hash != model.mechanism.model_hash


@pytest.mark.parametrize("direction", ["x", "z"])
def test_a_held_link_is_refused(
    mapping: Any, model: LinkageModel, tmp_path: Path, direction: str
) -> None:
    """A spring to the ground resists a translation; up to 1e-4 of the stiffness it may be rounding.

    The stiffness has seven digits, as in a file of single precision.
    """
    save_matrices(path := tmp_path / "lower.npz", model, "lower_link")
    replace_body(mapping, "lower_link", kind="matrices", path="lower.npz")
    arrays = dict(np.load(path))
    free = arrays["stiffness"].astype(np.float32).astype(float)
    names = arrays["dofs"].tolist()
    rows = [i for i, name in enumerate(names) if name.endswith(f" {direction}")]
    at, size = names.index(f"P1 {direction}"), free.diagonal()[rows].sum()

    def hold(share: float) -> None:
        """Write the link with a spring at P1 of a share of its stiffness."""
        arrays["stiffness"] = free.copy()
        arrays["stiffness"][at, at] += share * size
        np.savez(path, **arrays)

    for share in (0.0, 0.9e-4):
        hold(share)
        LinkageModel(read_mechanism(write(tmp_path, mapping))).solve(2.3)
    hold(1.1e-4)
    with pytest.raises(
        MechanismError, match=rf"lower\.npz.*along {direction}, .*of the free component"
    ):
        LinkageModel(read_mechanism(write(tmp_path, mapping)))


def test_all_three_kinds_in_one_linkage(mapping: Any, model: LinkageModel, tmp_path: Path) -> None:
    """A beam, matrices and FRFs give together what the same links give as matrices."""
    save_matrices(tmp_path / "lower.npz", model, "lower_link")
    replace_body(mapping, "lower_link", kind="matrices", path="lower.npz")
    judge = LinkageModel(read_mechanism(write(tmp_path, mapping)))
    save_frfs(tmp_path / "rod.npz", model, "lift_rod")
    replace_body(mapping, "lift_rod", kind="frfs", path="rod.npz")
    mixed = LinkageModel(read_mechanism(write(tmp_path, mapping)))
    for alpha3 in np.radians([90.0, 140.0, 180.0]):
        receptances = mixed.coupled_frf(alpha3, LINES, PLACES, PLACES).values
        exact = judge.solve(alpha3).frf(PLACES, PLACES).frf(LINES)
        np.testing.assert_allclose(receptances, exact, rtol=0, atol=1e-8 * np.abs(exact).max())
        assert np.linalg.norm(receptances - exact) < 1e-8 * np.linalg.norm(exact)
    with pytest.raises(ModelError, match="lift_rod is known by its FRFs alone"):
        mixed.solve(2.0)
    with pytest.raises(ModelError, match=r"lift_rod has no FRF at 0\.75 Hz"):
        mixed.coupled_frf(2.0, np.array([0.75]), PLACES, PLACES)


@pytest.mark.parametrize("rule", ["modal_ratio", "loss_factor", "mixed rayleigh"])
@pytest.mark.parametrize("name", ["three_point_linkage", "stephenson_six_bar"])
def test_both_couplings_agree_with_any_damping(rule: str, name: str) -> None:
    """LM-FBS and the primal modal sum agree within 1e-8, proportional damping or not."""
    from linkage_vibration.support.resources import config_file

    mapping = yaml.safe_load(config_file(f"{name}.yaml").read_text())
    first = next(iter(mapping["links"].values()))
    mapping["damping"] = {"ratio": 0.02, "at_hz": [4.0, 180.0]}
    first["damping"] = {
        "modal_ratio": {"rule": "modal_ratio", "ratio": 0.03},
        "loss_factor": {"rule": "loss_factor", "factor": 0.05},
        "mixed rayleigh": {"ratio": 0.05, "at_hz": [10.0, 300.0]},
    }[rule]
    if rule == "loss_factor":
        mapping["damping"] = {"rule": "loss_factor", "factor": 0.01}
        for spring in mapping.get("springs", {}).values():
            spring.pop("damping", None)
    from linkage_vibration.mechanics.parsing import mechanism_from_mapping

    model = LinkageModel(mechanism_from_mapping(mapping))
    point = model.mechanism.response.point
    places = [(point, "z"), (point, "x")]
    for alpha3 in np.linspace(*model.mechanism.stroke, 3):
        coupled = model.coupled_frf(alpha3, LINES, places, places).values
        modal = model.solve(alpha3).frf(places, places).frf(LINES)
        assert np.linalg.norm(coupled - modal) < 1e-8 * np.linalg.norm(modal)


def test_errors_name_the_key_of_a_wrong_file(mapping: Any, tmp_path: Path) -> None:
    """A missing file, an unknown kind and a missing key are named."""
    replace_body(mapping, "lower_link", kind="matrices", path="none.npz")
    with pytest.raises(MechanismError, match=r"lower_link\.file: .*none\.npz: does not exist"):
        read_mechanism(write(tmp_path, mapping))
    mapping["links"]["lower_link"]["file"] = {"kind": "magic", "path": "a"}
    with pytest.raises(MechanismError, match=r"links\.lower_link\.file\.kind: .*matrices, frfs"):
        read_mechanism(write(tmp_path, mapping))


def test_a_file_without_a_dof_that_the_linkage_needs(
    mapping: Any, model: LinkageModel, tmp_path: Path
) -> None:
    """The DoF and the link are named."""
    save_matrices(tmp_path / "lower.npz", model, "lower_link")
    with np.load(tmp_path / "lower.npz") as archive:
        arrays: dict[str, NDArray[Any]] = dict(archive)
    arrays["dofs"][2] = "V2 x"
    np.savez(tmp_path / "lower.npz", **arrays)
    replace_body(mapping, "lower_link", kind="matrices", path="lower.npz")
    mechanism = read_mechanism(write(tmp_path, mapping))
    with pytest.raises(MechanismError, match=r"links\.lower_link: its body lacks the DoF V1 x"):
        LinkageModel(mechanism)
    assert math.isfinite(mechanism.stroke[0])


def test_modes_identified_from_frfs_are_the_assemblys(
    mapping: Any, model: LinkageModel, tmp_path: Path
) -> None:
    """With a link known by FRFs, frequencies, damping and shapes come within 0.1 % of `solve`."""
    save_frfs(tmp_path / "rod.npz", model, "lift_rod")
    replace_body(mapping, "lift_rod", kind="frfs", path="rod.npz")
    mixed = LinkageModel(read_mechanism(write(tmp_path, mapping)))
    for alpha3 in np.radians([90.0, 175.0]):
        actual, exact = mixed.identify(alpha3), model.solve(alpha3)
        assert len(actual.natural_frequencies) == 3
        np.testing.assert_allclose(
            actual.natural_frequencies, exact.natural_frequencies[:3], rtol=1e-3
        )
        np.testing.assert_allclose(actual.damping_ratios, exact.damping_ratios[:3], rtol=1e-2)
        shapes = exact.modes.shapes[: len(model.interface), :3]
        shapes = shapes / np.linalg.norm(shapes, axis=0)
        assert (np.diag(actual.modes.shapes.T @ shapes) ** 2 > 0.999).all()
        band = model.mechanism.response.band
        assert actual.peak(band).frequency == pytest.approx(exact.peak(band).frequency, rel=1e-3)
        assert actual.peak(band).magnitude == pytest.approx(exact.peak(band).magnitude, rel=1e-2)


def test_another_implement_on_a_link_that_was_weighed(
    mapping: Any, model: LinkageModel, tmp_path: Path
) -> None:
    """Numbers of the description may change beside a link by FRFs whose weight is given, too."""
    save_frfs(tmp_path / "rod.npz", model, "lift_rod")
    replace_body(mapping, "lift_rod", kind="frfs", path="rod.npz")
    rod = component(model, "lift_rod")
    along = [dof.direction == "x" for dof in rod.dofs]
    both = rod.mass[: len(along), : len(along)][along][:, along].sum()
    mapping["links"]["lift_rod"]["mass"] = float(both) / 2.0
    mechanism = read_mechanism(write(tmp_path, mapping))
    changed = mechanism.with_values({"rigid_bodies.implement.mass": 1200.0})
    assert changed.rigid_bodies[0].mass == 1200.0
    [before], [after] = ([x for x in m.links if x.name == "lift_rod"] for m in (mechanism, changed))
    assert after.body is before.body


@pytest.mark.nightly(short="test_modes_identified_from_frfs_are_the_assemblys")
def test_a_table_from_frfs(mapping: Any, model: LinkageModel, tmp_path: Path) -> None:
    """A table built from identified modes over 30 deg is that of the assembly within 1 %."""
    save_frfs(tmp_path / "rod.npz", model, "lift_rod")
    mapping["input"]["range_deg"] = [120.0, 150.0]
    exact = build_table(LinkageModel(read_mechanism(write(tmp_path, mapping))), 1e-4)
    replace_body(mapping, "lift_rod", kind="frfs", path="rod.npz")
    table = build_table(LinkageModel(read_mechanism(write(tmp_path, mapping))), 1e-2)
    angles = np.linspace(*exact.alpha3_range, 20)
    found_values, exact_values = table.evaluate(angles), exact.evaluate(angles)
    np.testing.assert_allclose(found_values[:, :3], exact_values[:, :3], rtol=1e-2)
    np.testing.assert_allclose(found_values[:, -1], exact_values[:, -1], rtol=2e-2)
    assert table.places == ()


def save_noisy_frfs(
    path: Path,
    model: LinkageModel,
    link: str,
    share: float,
    frequencies: NDArray[np.float64],
    seed: int = 0,
) -> None:
    """Save the FRFs of one of a link's equal parts with relative noise."""
    single = component(model, link)
    count = next(body.count for body in model.mechanism.links if body.name == link)
    n = len(single.dofs)
    frf = count * component_frf(single.mass, single.stiffness, single.damping, n, frequencies)
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(frf.shape) + 1j * rng.standard_normal(frf.shape)
    frf = frf * (1.0 + share * noise / math.sqrt(2.0))
    dofs = np.array([str(dof) for dof in single.dofs])
    np.savez(path, frequencies=frequencies, frf=frf, dofs=dofs)


@pytest.mark.parametrize(
    ("link", "share"),
    [pytest.param("lift_rod", 0.1, marks=pytest.mark.nightly), ("lower_link", 0.01)],
)
def test_noisy_frfs_from_a_file(
    mapping: Any, model: LinkageModel, tmp_path: Path, link: str, share: float
) -> None:
    """Noise of 10 % in the rod, or 1 % in the lower link, leaves mode 1 within 1 %, and no fourth.

    Lines up to 20 Hz show too little deformation of the link, and are refused.
    """
    save_noisy_frfs(tmp_path / "link.npz", model, link, share, FREQUENCIES)
    replace_body(mapping, link, kind="frfs", path="link.npz")
    path = write(tmp_path, mapping)
    mixed, alpha3 = LinkageModel(read_mechanism(path)), math.radians(140.0)
    modes, exact = mixed.identify(alpha3), model.solve(alpha3)
    assert len(modes.natural_frequencies) == 3
    assert modes.natural_frequencies[0] == pytest.approx(exact.natural_frequencies[0], rel=0.01)
    assert modes.natural_frequencies == pytest.approx(exact.natural_frequencies[:3], rel=0.04)
    save_noisy_frfs(tmp_path / "link.npz", model, link, share, np.linspace(0.1, 20.0, 200))
    short = LinkageModel(read_mechanism(path))
    with pytest.raises(ModelError, match=rf"in the FRFs of links\.{link} becomes \d+ % in the"):
        short.coupled_frf(alpha3, np.linspace(0.1, 20.0, 200), PLACES[:1], PLACES[:1])


@pytest.mark.nightly(short="test_noisy_frfs_from_a_file")
def test_error_of_coupled_frfs_by_noise(mapping: Any, model: LinkageModel, tmp_path: Path) -> None:
    """Of measurements with new noise each, deviations from the exact FRFs have the stated size."""
    alpha3, lines = math.radians(140.0), FREQUENCIES[::4]
    exact = model.solve(alpha3).frf(PLACES, PLACES).frf(lines)
    replace_body(mapping, "lift_rod", kind="frfs", path="link.npz")
    deviations, stated = [], []
    for seed in range(8):
        save_noisy_frfs(tmp_path / "link.npz", model, "lift_rod", 0.01, lines, seed)
        mixed = LinkageModel(read_mechanism(write(tmp_path, mapping)))
        frf = mixed.coupled_frf(alpha3, lines, PLACES, PLACES)
        size = np.linalg.norm(exact, axis=(0, 2))
        deviations.append(np.linalg.norm(frf.values - exact, axis=(0, 2)) / size)
        stated.append(frf.error)
    ratio = np.sqrt(np.mean(np.square(deviations), axis=0)) / np.mean(stated, axis=0)
    assert (ratio > 0.6).all(), ratio
    assert (ratio < 1.7).all(), ratio
