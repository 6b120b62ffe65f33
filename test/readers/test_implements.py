# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Files of implements, what they change, and the errors that name the place."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.prediction.answers import (
    Implements,
    ModelWithoutTable,
    ServingError,
    replaced,
)
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.implements import read_implements
from linkage_vibration.readers.loaded_model import load_model, read_described, with_other_body
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table

PLOUGH: dict[str, Any] = {"mass": 1200.0, "inertia": 450.0, "centre_of_gravity": [0.2, 1.1]}
TAPE = {"E1": 1.0, "E2": 1.1, "side": "left"}


def written(folder: Path, implements: Any) -> Path:
    """Return a file of implements."""
    path = folder / "implements.yaml"
    path.write_text(yaml.safe_dump({"implements": implements}))
    return path


def test_implements_are_read(mechanism: Mechanism, tmp_path: Path) -> None:
    """Properties are those of the file, and distances become coordinates."""
    sower = {**PLOUGH, "centre_of_gravity": TAPE, "rigid_body": "implement"}
    actual = read_implements(written(tmp_path, {"plough": PLOUGH, "sower": sower}), mechanism)
    assert list(actual) == ["plough", "sower"]
    plough = actual["plough"]
    assert (plough.name, plough.rigid_body, plough.mass, plough.inertia) == (
        "plough",
        "implement",
        1200.0,
        450.0,
    )
    assert plough.centre_of_gravity == (0.2, 1.1)
    x, z = actual["sower"].centre_of_gravity
    assert (x**2 + z**2) ** 0.5 == pytest.approx(1.0)
    assert z > 0.0


@pytest.mark.parametrize(
    ("implements", "words"),
    [
        ({"plough": {**PLOUGH, "weight": 1.0}}, "implements.plough.weight: this key is not known"),
        ({"plough": {"mass": 1.0}}, "implements.plough.centre_of_gravity: this key is missing"),
        ({"plough": {**PLOUGH, "inertia": 1e9}}, "implements.plough.inertia: it gives a radius of"),
        (
            {"plough": {**PLOUGH, "centre_of_gravity": [-500.0, 300.0]}},
            "divide millimetres by 1000",
        ),
        ({"plough": 3}, "implements.plough: 3 is not a mapping"),
        ({1: PLOUGH}, "implements: the key 1 is not text"),
        ([], "implements: [] is not a mapping"),
        ({"plough": {**PLOUGH, "centre_of_gravity": {**TAPE, "E1": 9.0}}}, "apart"),
    ],
)
def test_errors_name_the_place(
    mechanism: Mechanism, tmp_path: Path, implements: Any, words: str
) -> None:
    """An invalid implement is refused with the file and the key."""
    path = written(tmp_path, implements)
    with pytest.raises(LinkageVibrationError) as raised:
        read_implements(path, mechanism)
    assert str(raised.value).startswith(f"{path}: ")
    assert words in str(raised.value)


def test_several_rigid_bodies_need_a_name(tmp_path: Path) -> None:
    """Where there are several, an implement says which one it replaces."""
    mechanism = read_mechanism(config_file("stephenson_six_bar.yaml"))
    path = written(tmp_path, {"plough": PLOUGH})
    with pytest.raises(LinkageVibrationError, match=r"plough\.rigid_body: .*name one of: rocker"):
        read_implements(path, mechanism)


def settings_for(path: Path, implement: str) -> Parameters:
    """Return parameters of the paper's linkage with its table and a file of implements."""
    return Parameters(
        mechanism_file=str(config_file("three_point_linkage.yaml")),
        table_file=str(config_file("tables/three_point_linkage.npz")),
        implement_file=str(path),
        implement=implement,
    )


def test_the_parameter_chooses(mechanism: Mechanism, tmp_path: Path) -> None:
    """The chosen implement is in the mechanism, and one that does not exist is refused."""
    path = written(tmp_path, {"plough": PLOUGH})
    described = read_described(settings_for(path, "plough"))
    assert described.mechanism.rigid_bodies[0].mass == 1200.0
    assert described.mechanism_text.startswith("# With the implement plough instead of that")
    own = load_model(settings_for(path, ""))
    assert own.implement is None
    assert own.table.model_hash == mechanism.model_hash
    with pytest.raises(ServingError, match=r"no implement 'drill'; name one of: plough"):
        read_described(settings_for(path, "drill"))
    with pytest.raises(LinkageVibrationError, match="implement is plough, but implement_file is"):
        read_described(Parameters(implement="plough"))


def test_an_implement_like_that_of_the_table_needs_no_other(
    mechanism: Mechanism, tmp_path: Path
) -> None:
    """If the table is that of the chosen implement, it is loaded."""
    [body] = mechanism.rigid_bodies
    same = {"mass": body.mass, "inertia": body.inertia, "centre_of_gravity": {**TAPE}}
    same["centre_of_gravity"] = {"E1": 1.020, "E2": 1.095, "side": "left"}
    path, reports = written(tmp_path, {"same": same}), list[str]()
    served = load_model(settings_for(path, "same"), reports.append)
    assert reports == []
    assert served.implement is not None
    assert served.implement.name == "same"


def test_a_named_implement_replaces_that_of_the_file(tmp_path: Path) -> None:
    """Nothing is left of an implement that was in use before, on another body."""
    path = config_file("stephenson_six_bar.yaml")
    mechanism, text = read_mechanism(path), path.read_text()
    implements = written(
        tmp_path,
        {
            "one": {**PLOUGH, "rigid_body": "rocker", "inertia": 500.0},
            "other": {**PLOUGH, "rigid_body": "pendulum", "inertia": 500.0},
        },
    )
    known = Implements(mechanism, text, read_implements(implements, mechanism))
    table = load_table(config_file("tables/three_point_linkage.npz"))  # of no importance here
    served = ModelWithoutTable(mechanism, text, None, known).with_predictor(Predictor(table))
    first = replaced(served, "one")
    second = replaced(first.with_predictor(Predictor(table)), "other")
    assert second.mechanism.rigid_bodies[0] == mechanism.rigid_bodies[0]
    assert second.mechanism.rigid_bodies[1].mass == 1200.0
    assert second.implement is not None
    assert second.implement.name == "other"


def test_another_mass_is_that_of_an_implement() -> None:
    """Roll and yaw change as a mass does that a command gives; without one, all stays."""
    path = config_file("three_point_linkage_on_tractor.yaml")
    described = read_described(Parameters(mechanism_file=str(path)))
    for mass, inertias in ((1200.0, (825.0, 975.0)), (None, (550.0, 650.0))):
        changed, text = with_other_body(described, path, mass=mass)
        assert changed.lateral is not None
        assert dict(changed.lateral.inertia)["implement"] == inertias
        assert changed.rigid_bodies[0].mass == (mass or 800.0)
        assert changed.rigid_bodies[0].inertia == described.mechanism.rigid_bodies[0].inertia
        assert yaml.safe_load(text)["lateral"]["inertia"]["implement"]["roll"] == inertias[0]
