# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of linkages with a lateral half hold both halves."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.cli.main import main
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table, TableError, load_table, save_table
from linkage_vibration.table.tabulation import build_table

IN_SPACE = config_file("three_point_linkage_in_space.yaml")
LATERAL = ["tractor sway", "tractor yaw", "implement roll", "tractor roll", "implement sway"]


@pytest.fixture(scope="module")
def table() -> Table:
    """Return the table of the shipped hitch in space, exact."""
    mechanism = replace(read_mechanism(IN_SPACE), uncertainty=None)
    return build_table(LinkageModel(mechanism), 1e-5)


def test_both_halves_in_one_file(table: Table, tmp_path: Path) -> None:
    """A file keeps both, its checksum is of both, and its bytes are those of the vertical half."""
    save_table(table, tmp_path / "table.npz")
    again = load_table(tmp_path / "table.npz", replace(read_mechanism(IN_SPACE), uncertainty=None))
    assert again.lateral is not None
    assert table.lateral is not None
    assert again.lateral.checksum == table.lateral.checksum != table.checksum
    assert again.checksum == table.checksum != replace(table, lateral=None).checksum
    assert again.mode_names[3] == "implement heave"
    assert list(again.lateral.mode_names) == [*LATERAL, "implement yaw"]
    spoiled = dict(np.load(tmp_path / "table.npz"))
    spoiled["lateral_natural_frequencies"] *= 1.001
    np.savez(tmp_path / "spoiled.npz", **spoiled)
    with pytest.raises(TableError, match="checksum differs"):
        load_table(tmp_path / "spoiled.npz")


@pytest.mark.parametrize("alpha3_deg", [97.0, 135.0, 171.0])
def test_lateral_predictions(table: Table, alpha3_deg: float) -> None:
    """They are those of the model, which finite elements confirm, within the tolerance."""
    predictor, alpha3 = Predictor(table).lateral, math.radians(alpha3_deg)
    assert predictor is not None
    found = predictor.predict(alpha3).natural_frequencies
    model = LinkageModel(read_mechanism(IN_SPACE), half="lateral")
    np.testing.assert_allclose(found, model.solve(alpha3).natural_frequencies[:6], rtol=1e-5)
    places, lines = ["E1.y", "V1.x"], np.array([0.5, 2.0, 20.0])
    expected = model.solve(alpha3).frf(places, ["E1.y"]).frf(lines)
    table_frf = predictor.table.frf(alpha3, places, ["E1.y"]).frf(lines)
    np.testing.assert_allclose(table_frf, expected, rtol=2e-3, atol=1e-3 * np.abs(expected).max())


def test_without_lateral_there_is_one_half() -> None:
    """A committed table has none, and neither has its predictor."""
    shipped = load_table(config_file("tables/three_point_linkage_on_tractor.npz"))
    assert shipped.lateral is None
    assert Predictor(shipped).lateral is None


def test_an_uncertain_chain() -> None:
    """The deviation of each mode is what its own change with the chain gives, to first order."""
    mapping: Any = yaml.safe_load(IN_SPACE.read_text())
    mapping["uncertainty"] = {"relative": {"lateral.chains.check_chain.stiffness": 0.05}}
    lateral = build_table(
        LinkageModel(mechanism_from_mapping(mapping), half="lateral"), 1e-3, points=["E1"]
    )
    del mapping["uncertainty"]
    frequencies = []
    for stiffness in (4.9e6, 5.1e6):
        mapping["lateral"]["chains"]["check_chain"]["stiffness"] = stiffness
        model = LinkageModel(mechanism_from_mapping(mapping), half="lateral")
        frequencies.append(model.solve(2.2).natural_frequencies[:5])
    rate = np.log(frequencies[1] / frequencies[0]) / math.log(5.1 / 4.9)
    prediction = Predictor(lateral).predict(2.2)
    found = (prediction.frequency_stddevs / prediction.natural_frequencies)[:5]
    assert found[4] == pytest.approx(0.05 * abs(rate[4]), rel=0.15)
    assert found[3] < 0.2 * found[4]


def test_commands(table: Table, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`predict` prints the modes of both halves, with the names of the lateral ones."""
    save_table(table, tmp_path / "both.npz")
    assert main(["predict", str(tmp_path / "both.npz"), "135"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "Sway, roll and yaw: mode 1 (tractor sway), mode 2 (tractor yaw)" in lines[2]
    assert len(lines) == 5
    assert float(lines[4].split()[5]) == pytest.approx(5.05, abs=0.02)  # of the prototype
