# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Variants of a mechanism, also on a pool of processes and on a cluster."""

import math
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import linkage_vibration as lv
from test.mechanics.test_forces import CANTILEVER

MODULUS = "links.bar.material.youngs_modulus"
DENSITY = "links.bar.material.density"
ANGLES = [0.3, 0.8]


@pytest.fixture
def cantilever(tmp_path: Path) -> lv.Mechanism:
    """Return a bar that is clamped, read from a file."""
    file = tmp_path / "cantilever.yaml"
    file.write_text(yaml.safe_dump(CANTILEVER, sort_keys=False))
    return lv.read_mechanism(file)


def exact(modulus: float, density: float, of: dict[str, float]) -> float:
    """Return how much a frequency of a bar changes: it goes with the root of E / rho."""
    return math.sqrt(modulus / of["youngs_modulus"] / (density / of["density"]))


def test_a_grid_of_materials(cantilever: lv.Mechanism) -> None:
    """Frequencies go with the root of E / rho in each cell, and flexibilities with 1 / E."""
    material = CANTILEVER["links"]["bar"]["material"]
    moduli = [material["youngs_modulus"] * factor for factor in (0.25, 1.0, 4.0)]
    densities = [material["density"], material["density"] / 4.0]
    data = lv.sweep(cantilever, {MODULUS: moduli, DENSITY: densities}, ANGLES)
    assert data.natural_frequencies.dims == (MODULUS, DENSITY, "alpha3", "mode")
    assert data.natural_frequencies.units == "Hz"
    own = lv.LinkageModel(cantilever).solve(ANGLES[1]).natural_frequencies[0]
    for modulus in moduli:
        for density in densities:
            cell = data.sel({MODULUS: modulus, DENSITY: density})
            expected = own * exact(modulus, density, material)
            assert cell.natural_frequencies.values[1] == pytest.approx([expected], rel=1e-9)
    assert not data.problem.values.any(), data.problem.values


def test_a_combination_without_a_solution(cantilever: lv.Mechanism) -> None:
    """It is not a number, and says why; if there is no other one, that is an error."""
    data = lv.sweep(cantilever, {DENSITY: [7800.0, -1.0]}, ANGLES)
    assert np.isfinite(data.natural_frequencies[0]).all()
    assert np.isnan(data.natural_frequencies[1]).all()
    assert data.problem[0] == ""
    assert "links.bar.material.density" in data.problem.item(1)
    with pytest.raises(lv.LinkageVibrationError, match="No combination has a solution; the first"):
        lv.sweep(cantilever, {DENSITY: [-1.0]}, ANGLES)
    with pytest.raises(lv.LinkageVibrationError, match="the mechanism has no key 'mass' there"):
        lv.sweep(cantilever, {"links.bar.mass": [1.0]}, ANGLES)
    with pytest.raises(lv.LinkageVibrationError, match="There is nothing to solve"):
        lv.sweep(cantilever, {DENSITY: []}, ANGLES)
    with pytest.raises(lv.LinkageVibrationError, match="in place of Mechanism"):
        lv.sweep("cantilever.yaml", {}, ANGLES)


def test_values_of_a_mechanism(cantilever: lv.Mechanism) -> None:
    """A changed mechanism can be changed again, and its own hash tells it apart."""
    heavy = cantilever.with_values({DENSITY: 8000.0})
    assert heavy.model_hash != cantilever.model_hash
    back = heavy.with_values({MODULUS: 2e11}).with_values(
        {
            path: CANTILEVER["links"]["bar"]["material"][path.split(".")[-1]]
            for path in (MODULUS, DENSITY)
        }
    )
    assert back == cantilever
    assert back.model_hash == cantilever.model_hash
    both = cantilever.with_values({"input.range_deg.0,assembly.alpha3_deg": 20.0})
    assert both.stroke[0] == both.assembly_alpha3 == math.radians(20.0)


def test_a_mechanism_in_space_with_uncertainties(tmp_path: Path) -> None:
    """Its variant is the mechanism of a file with the other number in it."""
    shipped = Path(__file__).parents[2] / "config" / "three_point_linkage_on_tractor.yaml"
    mapping = yaml.safe_load(shipped.read_text())
    mapping["rigid_bodies"]["implement"]["mass"] = 700.0
    file = tmp_path / "light.yaml"
    file.write_text(yaml.safe_dump(mapping, sort_keys=False))
    light = lv.read_mechanism(shipped).with_values({"rigid_bodies.implement.mass": 700.0})
    assert light.model_hash == lv.read_mechanism(file).model_hash


@pytest.fixture(params=["processes", pytest.param("Dask", marks=pytest.mark.nightly)])
def cluster(request: pytest.FixtureRequest) -> Iterator[Any]:
    """Return the `map` of a pool, and that of a client of a cluster on this computer."""
    if request.param == "processes":
        with ProcessPoolExecutor(2) as pool:
            yield pool.map
        return
    distributed = pytest.importorskip("distributed", reason="rosdep has no Dask")
    local = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with local, distributed.Client(local) as client:
        yield client.map


def test_the_same_on_a_cluster(cluster: Any, cantilever: lv.Mechanism, tmp_path: Path) -> None:
    """Another `map` returns the same data in the same order, of designs and of drives."""
    values = {DENSITY: [7000.0, 7800.0, -1.0, 8000.0]}
    alone = lv.sweep(cantilever, values, ANGLES)
    assert lv.sweep(cantilever, values, ANGLES, map=cluster).identical(alone)
    (tmp_path / "empty.mcap").touch()
    drives = lv.summaries([tmp_path / "empty.mcap"], map=cluster)
    assert drives == lv.summaries([tmp_path / "empty.mcap"])
    assert set(drives[0]) == {"log", "error"}
