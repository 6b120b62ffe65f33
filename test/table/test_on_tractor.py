# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The table of the linkage on its tractor, as it ships and as it is built."""

import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from linkage_vibration.cli.main import main
from linkage_vibration.mechanics.coupling import assembled_frf
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import PAPER_MECHANISM, config_file
from linkage_vibration.table.table import load_table
from linkage_vibration.table.tabulation import build_table
from linkage_vibration.table.tabulation.sampling import Sampler
from test.support.in_plane import in_plane

NAME = "three_point_linkage_on_tractor"


@pytest.fixture(scope="module")
def model() -> LinkageModel:
    """Return the model of the shipped file."""
    return LinkageModel(read_mechanism(config_file(f"{NAME}.yaml")))


def test_shipped_table_is_that_of_the_file(model: LinkageModel) -> None:
    """Natural frequencies of both halves are the models' to 1e-6, and its peak is to 1e-4."""
    table = load_table(config_file(f"tables/{NAME}.npz"), model.mechanism)
    assert table.n_modes == 12
    for alpha3 in np.random.default_rng(5).uniform(*model.mechanism.stroke, 6).tolist():
        solved = [half.solve(alpha3) for half in model.halves]
        values, frequency, magnitude, _ = table.interpolate(alpha3)
        for solution, aside in zip(solved, (False, True), strict=True):
            found = np.sort(np.array(values[:12])[table.lateral_modes == aside])
            np.testing.assert_allclose(found, solution.natural_frequencies[:6], rtol=1e-6)
        peak = solved[0].peak(table.peak_band)
        assert (frequency, magnitude) == pytest.approx((peak.frequency, peak.magnitude), rel=1e-4)


def test_peak_follows_the_implement(model: LinkageModel) -> None:
    """It is the highest of dense lines from 4.7 Hz on, and from 102 deg on that of the heave."""
    table = load_table(config_file(f"tables/{NAME}.npz"))
    lines = np.concatenate([np.arange(4.7, 12.0, 0.0125), np.linspace(12.0, 200.0, 500)])
    for alpha3_deg in (90.0, 97.0, 100.5, 102.0, 125.0, 150.0, 180.0):
        solution = model.solve(math.radians(alpha3_deg))
        row = model.rows([("E1", "z")], solution.configuration)
        sizes = np.abs(assembled_frf(solution.coupled, lines, row, row))[:, 0, 0]
        _, frequency, magnitude, _ = table.interpolate(math.radians(alpha3_deg))
        assert frequency == pytest.approx(lines[sizes.argmax()], abs=0.0125)
        assert sizes.max() * (1.0 - 1e-6) <= magnitude <= sizes.max() * (1.0 + 1e-3)
        if alpha3_deg >= 102.0:
            assert frequency == pytest.approx(solution.natural_frequencies[3], rel=0.02)


def test_table_needs_at_most_sixty_solutions(
    model: LinkageModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each half has 1e-6 in natural frequencies, by its own bound."""
    solved: dict[str, list[float]] = {"vertical": [], "lateral": []}

    def count(self: Sampler, alpha3: float) -> None:
        solved[self.model.half].append(alpha3)

    monkeypatch.setattr(Sampler, "_count", count)
    table = build_table(LinkageModel(replace(model.mechanism, uncertainty=None)))
    assert all(10 < len(angles) <= 60 for angles in solved.values())
    assert table.interpolation_error.max() <= 1e-6


def test_oil_and_tractor_change_the_modes_as_measured(model: LinkageModel) -> None:
    """Three modes of the tractor lie below 3 Hz; the implement's is higher than on clamps."""
    clamped = LinkageModel(read_mechanism(config_file(PAPER_MECHANISM)))
    for alpha3_deg in (90.0, 135.0, 180.0):
        alpha3 = math.radians(alpha3_deg)
        frequencies = model.solve(alpha3).natural_frequencies
        assert frequencies[2] < 3.0 < frequencies[3]
        assert 1.1 < frequencies[3] / clamped.solve(alpha3).natural_frequencies[0] < 1.9


def test_table_can_be_sent_to_another_process() -> None:
    """As `set_implement` does, also after its first lookup."""
    table = load_table(config_file(f"tables/{NAME}.npz"))
    table.interpolate(2.0)
    sent = pickle.loads(pickle.dumps(table))
    assert sent.interpolate(2.5) == table.interpolate(2.5)
    assert sent.checksum == table.checksum


def test_base_without_mounts_floats(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The table leaves out three modes at 0 Hz and has no FRFs, and `build` says how to hold it.

    It states the band in which the peak was sought: from a hundredth of the end, since a linkage
    that moves freely responds without limit towards 0 Hz.
    """
    mapping = in_plane(yaml.safe_load(config_file(f"{NAME}.yaml").read_text()))
    del mapping["uncertainty"]
    mapping["base"]["mounts"], mapping["response"]["modes"] = {}, 2
    mapping["response"]["peak_band_hz"] = [0.0, 200.0]
    mapping["input"]["range_deg"] = [134.0, 136.0]
    (tmp_path / "free.yaml").write_text(yaml.safe_dump(mapping, sort_keys=False))
    output = tmp_path / "free.npz"
    assert (
        main(["build", str(tmp_path / "free.yaml"), "--tolerance", "1e-3", "-o", str(output)]) == 0
    )
    table = load_table(output)
    assert (table.free_modes, table.places) == (3, ())
    assert table.peak_band == (2.0, 200.0)
    assert "3 modes at 0 Hz are left out of the table. To hold it, give its base mounts." in (
        capsys.readouterr().out
    )


def test_table_of_a_base_that_floats() -> None:
    """It has few cells, although poles nearly coincide at 0 Hz, and is as accurate as it says."""
    mapping = in_plane(yaml.safe_load(config_file(f"{NAME}.yaml").read_text()))
    del mapping["uncertainty"]
    mapping["base"]["mounts"], mapping["response"]["modes"] = {}, 2
    mapping["input"]["range_deg"] = [120.0, 150.0]
    model = LinkageModel(mechanism_from_mapping(mapping))
    table = build_table(model, 1e-5)
    assert len(table.cell_starts) < 200
    for alpha3 in np.radians([121.3, 134.9, 148.2]).tolist():
        solution = model.solve(alpha3)
        values, frequency, magnitude, error = table.interpolate(alpha3)
        np.testing.assert_allclose(values[:2], solution.natural_frequencies[:2], rtol=error)
        row = model.rows([("E1", "z")], solution.configuration)
        lines = frequency * np.array([1.0 - 1e-3, 1.0, 1.0 + 1e-3])
        sizes = np.abs(assembled_frf(solution.coupled, lines, row, row))[:, 0, 0]
        assert magnitude == pytest.approx(sizes[1], rel=max(table.peak_error, 1e-8))
        assert sizes[1] > max(sizes[0], sizes[2])
