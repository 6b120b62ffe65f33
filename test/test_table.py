# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The table: what it holds, how near it comes, and what it refuses."""

import json
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.resources import config_file
from linkage_vibration.table import Table, TableError, build_table, load_table, save_table


@pytest.fixture(scope="module")
def small(model: LinkageModel) -> Table:
    """Return a table of few points."""
    return build_table(model, 13)


@pytest.fixture
def file(small: Table, tmp_path: Path) -> Path:
    """Return the small table's file."""
    path = tmp_path / "small.npz"
    save_table(small, path)
    return path


def test_shipped_table_is_that_of_the_shipped_mechanism(
    mechanism: Mechanism, model: LinkageModel
) -> None:
    """The default table loads for the default mechanism and is what a build gives today."""
    shipped = load_table(config_file("tables/three_point_linkage.npz"), mechanism)
    built = build_table(model)
    for name in ("alpha3", "natural_frequencies", "damping_ratios"):
        np.testing.assert_allclose(getattr(shipped, name), getattr(built, name), rtol=1e-9)
    for name in ("frf_peak_frequency", "frf_peak_magnitude"):
        np.testing.assert_allclose(getattr(shipped, name), getattr(built, name), rtol=1e-7)
    np.testing.assert_allclose(
        shipped.interpolation_error, built.interpolation_error, rtol=1e-2, atol=1e-9
    )


def test_points_are_the_models(small: Table, model: LinkageModel) -> None:
    """At its points the table gives the model's own numbers."""
    for alpha3 in small.alpha3[::4]:
        solution = model.solve(float(alpha3))
        values, _ = small.interpolate(float(alpha3))
        np.testing.assert_allclose(values[:3], solution.natural_frequencies[:3], rtol=1e-12)
        np.testing.assert_allclose(values[3:6], solution.damping_ratios[:3], rtol=1e-9)
        assert values[6] == pytest.approx(solution.peak((0.0, 200.0)).frequency, rel=1e-9)
        assert math.exp(values[7]) == pytest.approx(solution.peak((0.0, 200.0)).magnitude, rel=1e-9)


def test_error_is_what_it_says(small: Table, model: LinkageModel) -> None:
    """At angles that the table was not measured at, the error is no more than twice that told.

    Between a point and the middle of its interval a cubic spline's error can exceed the middle's;
    twice the largest of three intervals bounds it here with a wide margin.
    """
    rng = np.random.default_rng(3)
    for alpha3 in rng.uniform(*small.alpha3_range, 60):
        values, told = small.interpolate(float(alpha3))
        exact = model.solve(float(alpha3)).natural_frequencies[:3]
        assert np.abs(values[:3] / exact - 1.0).max() <= 2.0 * told


def test_error_falls_at_fourth_order(model: LinkageModel) -> None:
    """Halving the step divides a cubic spline's error by nearly sixteen."""
    errors = [build_table(model, n).interpolation_error.max() for n in (46, 91, 181)]
    rates = -np.diff(np.log2(errors))
    assert rates == pytest.approx([4.0, 4.0], abs=0.4)


def test_progress_is_told(model: LinkageModel) -> None:
    """Every solution is reported, at the points and between them."""
    calls: list[None] = []
    build_table(model, 4, lambda: calls.append(None))
    assert len(calls) == 7


def test_too_few_points(model: LinkageModel) -> None:
    """A table that cannot be interpolated is not built."""
    with pytest.raises(TableError, match="4 or more"):
        build_table(model, 3)


def test_more_modes_than_the_model_has(mapping: Any) -> None:
    """The error names the key that asks for too much."""
    mapping["response"]["modes"] = 1000
    with pytest.raises(TableError, match=r"response\.modes asks for 1000"):
        build_table(LinkageModel(mechanism_from_mapping(mapping)), 4)


def test_round_trip(small: Table, file: Path, mechanism: Mechanism) -> None:
    """What is saved is what is loaded, to the last bit, and the file is small."""
    loaded = load_table(file, mechanism)
    assert loaded.table_id == small.table_id
    assert loaded.checksum == small.checksum
    np.testing.assert_array_equal(loaded.natural_frequencies, small.natural_frequencies)
    assert loaded.interpolate(2.0)[0].tolist() == small.interpolate(2.0)[0].tolist()
    assert [path.name for path in file.parent.iterdir()] == ["small.npz"]


def test_metadata_can_be_read_by_others(file: Path) -> None:
    """The file is a plain .npz with JSON: hash, units, range and version."""
    with np.load(file, allow_pickle=False) as archive:
        metadata = json.loads(str(archive["metadata"]))
        assert archive["natural_frequencies"].shape == (13, 3)
    assert metadata["units"]["natural_frequencies"] == "Hz"
    assert metadata["range_rad"] == pytest.approx([math.pi / 2, math.pi])
    assert {"model_hash", "package_version", "checksum"} <= metadata.keys()


def test_table_of_another_mechanism_is_refused(file: Path, printed: Mechanism) -> None:
    """A table serves the mechanism that it was built from and no other."""
    with pytest.raises(TableError, match="built from another mechanism"):
        load_table(file, printed)


def test_damage_is_refused(file: Path, small: Table) -> None:
    """With any one bit flipped the file is refused, or is still the same table."""
    sound = file.read_bytes()
    rng = np.random.default_rng(1)
    refused = 0
    for at in np.unique(rng.integers(0, len(sound), 400)):
        spoilt = bytearray(sound)
        spoilt[at] ^= 1 << rng.integers(0, 8)
        file.write_bytes(spoilt)
        try:
            assert load_table(file).checksum == small.checksum
        except TableError as error:
            assert "small.npz" in str(error)
            refused += 1
    assert refused > 300


@pytest.mark.parametrize("length", [0, 1, 100, -1])
def test_truncation_is_refused(file: Path, length: int) -> None:
    """A file cut short is refused in words."""
    file.write_bytes(file.read_bytes()[:length])
    with pytest.raises(TableError, match="build"):
        load_table(file)


def test_number_changed_on_purpose_is_refused(file: Path) -> None:
    """A sound .npz with one number changed does not pass the checksum."""
    with np.load(file) as archive:
        arrays = dict(archive)
    arrays["natural_frequencies"][3, 1] += 1e-9
    with file.open("wb") as out:
        np.savez(out, **arrays)
    with pytest.raises(TableError, match="checksum differs"):
        load_table(file)


def test_pickles_are_refused(tmp_path: Path, file: Path) -> None:
    """Neither a pickle nor an archive that holds one is ever executed."""
    plain = tmp_path / "pickle.npz"
    plain.write_bytes(pickle.dumps({"alpha3": 1}))
    with pytest.raises(TableError, match="pickle"):
        load_table(plain)
    with np.load(file) as archive:
        arrays = dict(archive)
    arrays["alpha3"] = np.array([print], dtype=object)
    inside = tmp_path / "inside.npz"
    with inside.open("wb") as out:
        np.savez(out, **arrays)
    with pytest.raises(TableError, match="pickle"):
        load_table(inside)


def test_missing_file_and_folder(tmp_path: Path, small: Table) -> None:
    """Paths that cannot be read or written are told."""
    with pytest.raises(TableError, match="No such file"):
        load_table(tmp_path / "none.npz")
    with pytest.raises(TableError, match="cannot be written"):
        save_table(small, tmp_path / "none" / "table.npz")
