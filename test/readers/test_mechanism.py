# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Mechanism files: the ones that come with the package, and invalid ones."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from benchmark.uncertainty import LOADER
from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.doubts import linkage_doubts
from linkage_vibration.readers.mechanism import load_yaml, read_mechanism
from linkage_vibration.support.resources import config_file


def test_the_printed_linkage_differs_by_one_length(
    mechanism: Mechanism, printed: Mechanism
) -> None:
    """Upper link 0.520 m against 0.420 m, and nothing else but the name."""
    assert dict(mechanism.links[1].points)["E2"] == (0.520, 0.0)
    assert dict(printed.links[1].points)["E2"] == (0.420, 0.0)
    assert mechanism.links[0] == printed.links[0]
    assert mechanism.links[2:] == printed.links[2:]
    assert mechanism.rigid_bodies == printed.rigid_bodies


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"!!python/object:os.system {}", "valid YAML"),
        (b"", "mapping"),
        (b"? [1]\n: 2\n", "unhashable key"),
        (b"2026-99-99: 1", "YAML"),
        (b"- " * 200_000, "recursion"),
        (b"[" * 200_000, "recursion"),
        (b"name: a\nmodes:\t3", "line 2: .* write spaces instead of tabs"),
        (b"a:\n  modes: 010", "line 2: YAML reads 010 as 8; write"),
        (b"a: 1:30.5", "line 1: YAML reads 1:30.5 as 90.5; write"),
        (b"name: a\nb: 2026-02-30", "line 2: '2026-02-30' does not fit its tag"),
        (b"<<: {a: 1}\n<<: {b: 2}", "line 2: the key '<<' occurs twice"),
        (b"a: 1\n<<: [2]", "line 2: only mappings can be merged"),
    ],
)
def test_invalid_files(tmp_path: Path, text: bytes, words: str) -> None:
    """Whatever the file holds, the error names it and what is wrong with it."""
    path = tmp_path / "bad.yaml"
    path.write_bytes(text)
    with pytest.raises(MechanismError, match=f"bad.yaml.*{words}"):
        read_mechanism(path)


@pytest.mark.parametrize("end", ["", "# \t"])  # for the loader in C, and for that in Python
def test_merged_mappings_and_numbers(tmp_path: Path, end: str) -> None:
    """The rules of YAML 1.1 for `<<`: own keys count most, then those of the earlier mapping.

    A merge of a merge, before or after it is used itself, changes nothing about that.
    """
    path = tmp_path / "merged.yaml"
    path.write_text(
        "first: &first {mass: 1, m: 1, a: 0x10}\n"
        "below: {in: {it: &second {<<: *first, m: 2, b: 0.10, d: 10}}}\n"
        "both: {<<: [*second, *first], mass: 3}\n"
        "other: {<<: [*first, *second], c: -0}\n" + end
    )
    content = load_yaml(path)[0]
    assert content["below"]["in"]["it"] == {"mass": 1, "m": 2, "a": 16, "b": 0.1, "d": 10}
    assert content["both"] == {"mass": 3, "m": 2, "a": 16, "b": 0.1, "d": 10}
    assert content["other"] == {"mass": 1, "m": 1, "a": 16, "b": 0.1, "d": 10, "c": 0}


def shipped_mechanisms() -> list[Path]:
    """Return every mechanism file of the repository."""
    root = Path(__file__).parents[2]
    files = [p for top in ("config", "examples", "docs") for p in (root / top).rglob("*.yaml")]
    return [path for path in files if "\nassembly:" in path.read_text()]


@pytest.mark.parametrize("path", shipped_mechanisms(), ids=lambda path: path.stem)
def test_shipped_files_have_no_doubt(path: Path) -> None:
    """Nothing is doubtful about any mechanism that comes with the package."""
    assert not [*linkage_doubts(LinkageModel(read_mechanism(path)))]


@pytest.mark.parametrize(("aside", "doubted"), [(0.26, False), (0.28, True)])
def test_lift_rods_that_lean_are_doubted(aside: float, doubted: bool) -> None:
    """V1 is 0.366 m of 0.81 m on the way from P1 to E1, which is 0.4 m, and V2 0.25 m aside."""
    mapping = yaml.safe_load(config_file("three_point_linkage_on_tractor.yaml").read_text())
    mapping["lateral"]["y"]["P1"] = aside
    length = mapping["links"]["lift_rod"]["points"]["V1"]
    leans = (aside + (0.4 - aside) * 0.366 / 0.81 - 0.25) / length
    assert (leans > 0.15) == doubted
    text = " ".join(linkage_doubts(LinkageModel(mechanism_from_mapping(mapping))))
    assert ("lift_rod leans sideways by" in text) == doubted
    assert not doubted or f"{math.degrees(math.atan(leans)):.0f} deg" in text


def test_plausible_machines_have_no_doubt() -> None:
    """Nor is anything doubtful about a front loader, whose bucket lies ahead of upright pins."""
    machine = mechanism_from_mapping(yaml.safe_load(LOADER))
    assert not [*linkage_doubts(LinkageModel(machine))]
    bucket = replace(machine.rigid_bodies[0], centre_of_gravity=(-0.4, 0.1))
    wrong = LinkageModel(replace(machine, rigid_bodies=(bucket,)))
    assert "gravity of bucket is 0.4 m from the line of its pins towards the ground" in " ".join(
        linkage_doubts(wrong)
    )
