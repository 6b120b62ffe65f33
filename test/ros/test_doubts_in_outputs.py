# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that are probably mistakes are doubted by commands and by the log of the node alike."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from linkage_vibration.cli.main import main
from test.mechanics.test_forces import SECTION, STEEL
from test.prediction.test_doubts import tractor

EXCITATIONS = """
wheels: {speed: ground, rolling_radius: 1.6, orders: [1]}
runout: {speed: ground, rolling_radius: 0.8, orders: [1], at: "base:rear.z", at_speed: 5.0,
         base_displacement: [1.4]}
engine: {speed: engine, orders: [0.01], at: E.z, at_speed: 209.0, force: [1.0]}
shaft: {speed: pto, orders: [0.01], at: E.z, at_speed: 540.0, force: [1.0e+6]}
"""
OF_MECHANISM = (
    "The static load of rear at alpha3 = 0 deg is -96 kg, so the tractor tips; 800 kg or more",
    "The standard deviation of base.centre_of_gravity.0 is 10, and 0.01 with a tape measure",
    "bob has a radius of gyration of 0.1 m; with its mass and pins",
)
OF_MECHANISM_ALONE = (
    "The centre of gravity of the base is at x = -3.01 m, not between rear and front, so it tips;",
    "stay has count: 2, but rocker, which shares R with it, is single; write `count: 2` if there",
)
OF_EXCITATIONS = (
    "wheels has a rolling_radius of 1.6 m, and wheels have 0.2 to 1.2 m; write 0.8 if it is a dia",
    "runout 1 has a base_displacement of 1.4 m, and tyres run out by millimetres; write 0.0014",
    "engine has an at_speed of 209 rpm, and engine speeds are 400 to 4000 rpm; write 1996 if",
    "The load ratio of shaft 0.01 at alpha3 = ",
)


def tips_alone() -> dict[str, Any]:
    """Return a tractor that tips without its body, to which a stay and a rocker are pinned."""
    content = tractor(0.1, -3.01)
    content["ground"]["S"] = [2.0, -1.0]
    rod = {"section": SECTION, "material": STEEL, "elements": 4, "modes": 2}
    content["links"] = {
        "stay": {"points": {"E": 0.0, "R": 1.0}, "count": 2, **rod},
        "rocker": {"points": {"R": 0.0, "S": 1.0}, **rod},
    }
    content["assembly"]["angles_deg"] = {"stay": 270.0, "rocker": 0.0}
    return content


@pytest.mark.parametrize(
    ("output", "alone"),
    [("build", False), ("pose", False), ("pose", True), ("advise", False), ("node", False)],
)
def test_each_doubt_stands_in_each_output(
    tmp_path: Path,
    start: Callable[..., Any],
    capsys: pytest.CaptureFixture[str],
    output: str,
    alone: bool,
) -> None:
    """Only `advise` and the node read excitations; the tractor tips alone, or by its body."""
    mechanism, excitations = tmp_path / "tractor.yaml", tmp_path / "excitations.yaml"
    content = tips_alone() if alone else tractor(4800.0, place=10.0)
    if not alone:
        content["rigid_bodies"]["bob"]["inertia"] = 48.0
    mechanism.write_text(yaml.safe_dump(content))
    excitations.write_text(EXCITATIONS)
    expected = [*(OF_MECHANISM_ALONE if alone else OF_MECHANISM)]
    expected += OF_EXCITATIONS if output in ("advise", "node") else ()
    if output == "node":
        files = {"mechanism_file": mechanism, "excitation_file": excitations, "table_file": "''"}
        node = start(name="doubting", **files)
        node.wait_for(expected[-1])
        printed = node.printed
    else:
        options = {
            "build": [str(mechanism), "-o", str(tmp_path / "table.npz"), "--tolerance", "1e-2"],
            "pose": [str(mechanism)],
            "advise": ["0", "10", "--mechanism", str(mechanism), "--excitations", str(excitations)],
        }
        main([output, *options[output]])
        printed = "".join(capsys.readouterr())
    assert [text for text in expected if text not in printed] == []
