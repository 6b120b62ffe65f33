# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The table: what it holds, how near it comes, and what it refuses."""

import json
import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.atomic_files import OutputError
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table, TableError, load_table, save_table, table_bytes
from linkage_vibration.table.tabulation import build_table
from test.support.served import turning_table


@pytest.fixture(scope="module")
def small(model: LinkageModel) -> Table:
    """Return a table of few points."""
    return build_table(model, 1e-3)


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
    for name in ("peak_frequencies", "peak_magnitudes"):
        np.testing.assert_allclose(getattr(shipped, name), getattr(built, name), rtol=1e-7)
    np.testing.assert_allclose(
        shipped.interpolation_error, built.interpolation_error, rtol=1e-2, atol=1e-9
    )
    assert len(table_bytes(shipped)) < 350_000


def test_lookup_one_by_one_and_many_at_once(small: Table) -> None:
    """Both give the same bits, at the ends, at points and between."""
    rng = np.random.default_rng(5)
    angles = np.concatenate([small.alpha3, rng.uniform(*small.alpha3_range, 10_000)])
    every = small.evaluate(angles)
    for angle, row in zip(angles[:200], every[:200], strict=True):
        values, frequency, magnitude, _ = small.interpolate(float(angle))
        assert [*values, frequency, magnitude] == row.tolist()


def test_frf_is_the_models(model: LinkageModel, mechanism: Mechanism) -> None:
    """Between all points of the shipped table, each single FRF is within 1e-4 of the model's."""
    table = load_table(config_file("tables/three_point_linkage.npz"), mechanism)
    assert {point for point, _ in table.places} == {"E1", "E2", "V1", "V2"}
    lines = np.linspace(*table.band, 2001)
    for alpha3 in (math.pi / 2, 1.8, 2.3, 2.9, math.pi):
        exact = model.solve(alpha3).frf(table.places, table.places).frf(lines)
        receptances = table.frf(alpha3, table.places, table.places).frf(lines)
        apart = np.linalg.norm(receptances - exact, axis=0) / np.linalg.norm(exact, axis=0)
        assert apart.max() < 1e-4


def test_frf_of_some_places(small: Table) -> None:
    """What is asked for comes in the order in which it is asked for."""
    lines = np.array([5.0, 80.0])
    full = small.frf(2.0, small.places, small.places).frf(lines)
    some = small.frf(2.0, [("V1", "x"), ("E1", "z")], [("E2", "x")]).frf(lines)
    at = [small.places.index(place) for place in (("V1", "x"), ("E1", "z"), ("E2", "x"))]
    np.testing.assert_array_equal(some, full[:, at[:2]][:, :, at[2:]])


def test_frfs_at_many_angles() -> None:
    """In any order, and in each piece of the stroke, they are those of the model at each angle."""
    table, lines = turning_table(), np.linspace(5.0, 60.0, 12)
    model, places = LinkageModel(read_mechanism(config_file("four_bar.yaml"))), table.places[:2]
    assert len(table.pieces) > 3
    angles = np.random.default_rng(2).uniform(*table.alpha3_range, 9)
    for alpha3, frf in zip(angles.tolist(), table.frf_at_each(angles, places, places), strict=True):
        exact = model.solve(alpha3).frf(places, places).frf(lines)
        assert np.abs(frf.frf(lines) - exact).max() < 0.02 * np.abs(exact).max()
    with pytest.raises(TableError, match="outside the table"):
        table.frf_at_each([*angles, 1e3], places, places)
    assert table.frf_at_each([], places, places) == []


def test_frf_that_the_table_does_not_have(small: Table) -> None:
    """Angles outside the range and unknown places are refused, with a list of those available."""
    with pytest.raises(TableError, match=r"no FRF at P1 z; it has these: E1 z, E1 x, "):
        small.frf(2.0, [("P1", "z")], [("E1", "z")])
    with pytest.raises(TableError, match="outside the table"):
        small.frf(4.0, [("E1", "z")], [("E1", "z")])


def test_angles_outside_are_refused(small: Table) -> None:
    """No value is extrapolated, and the error has the range and what was probably meant."""
    low, high = small.alpha3_range
    ends = np.array([low, high])
    assert np.isfinite(small.evaluate(ends)).all()
    for angle in (np.nextafter(low, 0.0), np.nextafter(high, 4.0), math.nan, -4.9):
        many = np.array([2.3, angle])
        for function in (small.evaluate, small.evaluate_slopes, small.forces_at_rest):
            with pytest.raises(TableError, match=r"outside the table \(90 to 180 deg\); choose"):
                function(many)
        with pytest.raises(TableError, match="outside the table"):
            small.interpolate(angle)
    with pytest.raises(TableError, match=r"131\.8 deg is in range, so were degrees given"):
        small.evaluate([131.8])
    with pytest.raises(LinkageVibrationError, match="call it for each of them"):
        small.frf(ends, [("E1", "z")], [("E1", "z")])


def test_dataset_of_a_table(small: Table) -> None:
    """It has the values at the points over alpha3 and mode, with their names and units."""
    pytest.importorskip("xarray", reason="xarray is not installed")
    data = small.to_xarray()
    at = data.sel(mode=2).isel(alpha3=3)
    assert float(at.alpha3) == small.alpha3[3]
    assert float(at.natural_frequencies) == pytest.approx(small.natural_frequencies[3, 1])
    assert float(at.damping_ratios) == pytest.approx(small.damping_ratios[3, 1])
    assert float(at.frf_peak_frequency) == pytest.approx(small.peak_frequencies[3])
    assert str(at.mode_name.values) == small.mode_names[1]
    assert data.frf_peak_magnitude.attrs == {"units": "m/N"}
    assert len(data.to_dataframe()) == len(small.alpha3) * small.n_modes


def test_table_of_another_kind_is_not_written(small: Table, tmp_path: Path) -> None:
    """A name that promises another format is refused, and no file is left."""
    with pytest.raises(OutputError, match=r"t\.csv: the output is a \.npz file; use .*t\.npz"):
        save_table(small, tmp_path / "t.csv")
    assert not list(tmp_path.iterdir())


def test_round_trip(small: Table, file: Path, mechanism: Mechanism) -> None:
    """What is saved is what is loaded, to the last bit, and the file is small."""
    loaded = load_table(file, mechanism)
    assert loaded.table_id == small.table_id
    assert loaded.checksum == small.checksum
    np.testing.assert_array_equal(loaded.natural_frequencies, small.natural_frequencies)
    assert loaded.interpolate(2.0) == small.interpolate(2.0)
    assert loaded.places == small.places
    assert [path.name for path in file.parent.iterdir()] == ["small.npz"]


def test_metadata_can_be_read_by_others(file: Path) -> None:
    """The file is a plain .npz with JSON: hash, units, range and version."""
    with np.load(file, allow_pickle=False) as archive:
        metadata = json.loads(str(archive["metadata"]))
        assert archive["natural_frequencies"].shape == (len(archive["alpha3"]), 3)
    assert metadata["units"]["natural_frequencies"] == "Hz"
    assert metadata["range_rad"] == pytest.approx([math.pi / 2, math.pi])
    assert {"model_hash", "package_version", "checksum"} <= metadata.keys()


def test_table_of_another_mechanism_is_refused(file: Path, printed: Mechanism) -> None:
    """A table serves the mechanism that it was built from and no other."""
    with pytest.raises(TableError, match="built from another mechanism"):
        load_table(file, printed)


@pytest.mark.parametrize("step", [3, pytest.param(1, marks=pytest.mark.nightly)])
def test_damage_in_any_byte_is_refused(model: LinkageModel, tmp_path: Path, step: int) -> None:
    """With any one byte changed the file is refused, or is still the same table."""
    path = tmp_path / "small.npz"
    smallest = build_table(model, 0.5)
    bare = replace(
        smallest,
        places=(),
        forces=(),
        reduced=(),
        static_forces=np.empty(0),
        cell_starts=smallest.cell_starts[:1],
        cell_cubics=smallest.cell_cubics[:1],
        cell_poles=np.empty(0, complex),
    )
    save_table(bare, path)
    sound = path.read_bytes()
    refused, tried = 0, range(0, len(sound), step)
    with path.open("r+b", buffering=0) as file:  # changed in place: making files takes longest
        for at in tried:
            file.seek(at)
            file.write(bytes([sound[at] ^ 1 << at % 8]))
            try:
                assert load_table(path).checksum == bare.checksum
            except TableError as error:
                assert "small.npz" in str(error)
                refused += 1
            file.seek(at)
            file.write(bytes([sound[at]]))
    assert path.read_bytes() == sound
    assert refused > 0.7 * len(tried)


@pytest.mark.parametrize("length", [0, 1, 100, -1])
def test_truncation_is_refused(file: Path, length: int) -> None:
    """A file cut short is rejected with an error."""
    file.write_bytes(file.read_bytes()[:length])
    with pytest.raises(TableError, match="build"):
        load_table(file)


def test_number_changed_on_purpose_is_refused(file: Path) -> None:
    """A sound .npz with one number changed does not pass the checksum."""
    with np.load(file) as archive:
        arrays = dict(archive)
    arrays["natural_frequencies"][3, 1] += 1e-9
    with file.open("wb") as out:
        np.savez_compressed(out, **arrays)
    with pytest.raises(TableError, match="checksum differs"):
        load_table(file)


def test_pickles_are_refused(tmp_path: Path, file: Path) -> None:
    """Neither a pickle nor an archive that holds one is executed, and no error says how to."""
    plain = tmp_path / "pickle.npz"
    plain.write_bytes(pickle.dumps({"alpha3": 1}))
    with pytest.raises(TableError, match=r"it is no \.npz archive\); build one"):
        load_table(plain)
    with np.load(file) as archive:
        arrays = dict(archive)
    arrays["alpha3"] = np.array([print], dtype=object)
    inside = tmp_path / "inside.npz"
    with inside.open("wb") as out:
        np.savez_compressed(out, **arrays)
    with pytest.raises(TableError, match="pickle") as raised:
        load_table(inside)
    assert "unsafely" not in str(raised.value)


def test_missing_file_and_folder(tmp_path: Path, small: Table) -> None:
    """Paths that cannot be read or written are reported."""
    with pytest.raises(TableError, match="No such file"):
        load_table(tmp_path / "none.npz")
    with pytest.raises(TableError, match="cannot be written"):
        save_table(small, tmp_path / "none" / "table.npz")
