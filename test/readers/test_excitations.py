# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Files of excitations: the one that comes with the package, and invalid ones."""

from pathlib import Path

import pytest

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.loads import ExcitationError
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.served import read_described, read_loads, read_served
from linkage_vibration.support.resources import PAPER_MECHANISM, PAPER_TABLE, config_file


def test_shipped_file() -> None:
    """The shipped file has every source, and no order or name twice."""
    actual = read_excitations(config_file("excitations.yaml"))
    assert {each.source for each in actual} == set(Source)
    assert len({each.name for each in actual}) == len(actual) == 13


def test_descriptions_of_excitations(tmp_path: Path) -> None:
    """An excitation has words for what it is and how often a turn; without a key, its name."""
    path = tmp_path / "excitations.yaml"
    path.write_text(
        "a_b: {speed: pto, orders: [0.5, 1, 2, 6], description: tines of the harrow}\n"
        "c_d: {speed: pto, orders: [1.5]}\n"
        "e: {speed: ground, terrain: {class: C}, raised: true}\n"
    )
    words = "every second turn", "once a turn", "twice a turn", "6 times a turn"
    expected = [f"tines of the harrow, {often}" for often in words]
    actual = [each.description for each in read_excitations(path)]
    assert actual == [*expected, "c d, 1.5 times a turn", "e (class C)"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "excitations: None is not a mapping"),
        ("engine: {speed: engine}", "excitations.engine.orders"),
        ("engine: [", "is not valid YAML"),
        ("engine: {speed: engine, orders: [1]}\nengine: {speed: pto, orders: [1]}", "occurs twice"),
    ],
)
def test_bad_files(tmp_path: Path, text: str, words: str) -> None:
    """The error names the file and the key."""
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(LinkageVibrationError, match=words) as caught:
        read_excitations(path)
    assert "bad.yaml" in str(caught.value)


def test_places_that_a_mechanism_lacks() -> None:
    """The paper's linkage has no tractor, so the default file keeps only what acts on the hitch."""
    settings = Parameters(
        mechanism_file=str(config_file(PAPER_MECHANISM)), table_file=str(config_file(PAPER_TABLE))
    )
    served, notices = read_served(settings), list[str]()
    loads = {each.name: each.load for each in read_loads(settings, served, notices.append)}
    kept = {"pto_shaft 1", "cardan_joint 2", "rotor 1", "tines 2"}
    assert {name for name, load in loads.items() if load is not None} == kept
    assert len(loads) == 13
    [notice] = notices
    refused = "engine 0.5, engine 1.5, engine 3, engine 6, crankshaft 1, crankshaft 2"
    refused += ", tyre_lugs 1, tyre_lugs 20, ground (class B)"
    assert f" {refused} of {settings.excitation_path()} act" in notice


def test_places_that_the_tractor_has() -> None:
    """On the shipped tractor nothing is left out."""
    settings, notices = Parameters(), list[str]()
    excitations = read_loads(settings, read_served(settings), notices.append)
    amplitudes = [each.load or each.terrain for each in excitations]
    assert all(each is not None and each.relative_stddev > 0.0 for each in amplitudes)
    assert not notices


def test_places_of_a_named_file(tmp_path: Path) -> None:
    """A file that the user names keeps its loads, so that an unknown place is an error."""
    path = tmp_path / "own.yaml"
    path.write_bytes(config_file("excitations.yaml").read_bytes())
    settings = Parameters(
        mechanism_file=str(config_file(PAPER_MECHANISM)),
        table_file=str(config_file(PAPER_TABLE)),
        excitation_file=str(path),
    )
    served = read_served(settings)
    excitations = read_loads(settings, served, pytest.fail)
    with pytest.raises(ExcitationError, match=r"excitation engine 0\.5: a moment acts on a rigid"):
        LevelTable(served.predictor, served.mechanism, excitations)


def test_as_many_as_messages_can_hold(tmp_path: Path) -> None:
    """The limits are those of ``TableInfo``: 64 excitations and 32 modes, and not one more."""
    path, served = tmp_path / "many.yaml", read_served(Parameters())
    settings = Parameters(excitation_file=str(path))
    path.write_text(f"engine: {{speed: engine, orders: {list(range(1, 65))}}}")
    assert len(read_loads(settings, served)) == 64
    path.write_text(f"engine: {{speed: engine, orders: {list(range(1, 66))}}}")
    with pytest.raises(LinkageVibrationError, match=r"many\.yaml has 65 excitations.* for 64; red"):
        read_loads(settings, served)
    text, own = config_file("four_bar.yaml").read_text(), tmp_path / "own.yaml"
    assert text.count("  modes: 3\n") == 1
    for modes in (32, 33):
        own.write_text(text.replace("  modes: 3\n", f"  modes: {modes}\n"))
        if modes == 32:
            assert (
                read_described(Parameters(mechanism_file=str(own))).mechanism.response.modes == 32
            )
        else:
            with pytest.raises(
                LinkageVibrationError, match=r"own\.yaml has 33 modes.* for 32; red"
            ):
                read_described(Parameters(mechanism_file=str(own)))
