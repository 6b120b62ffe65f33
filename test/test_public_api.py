# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The public API offers what it promises, and importing the package stays fast."""

import ast
import inspect
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import linkage_vibration as lv

CHANGELOG = Path(__file__).parents[1] / "CHANGELOG.rst"

# A change of this list needs a line in the changelog.
FUNCTIONS = ["build_table", "check_bag", "load_table", "read_log", "read_mechanism"]
FUNCTIONS += ["plot", "read_parameters", "replay", "save_table", "summaries", "sweep"]
FUNCTIONS += ["transmissibility"]
CLASSES = ["Limits", "LinkageModel", "LinkageVibrationError", "Parameters", "Predictor", "WhatIf"]
RETURNED = ["Failure", "Frf", "IdentifiedSolution", "Log", "Mechanism", "ModeShape", "Peak"]
RETURNED += [
    "PoleResidue",
    "Prediction",
    "Replayed",
    "Report",
    "MessageColumns",
    "Solution",
    "Status",
    "Table",
]
RETURNED += ["Configuration", "Kinematics", "Toggle"]


def test_the_list_is_what_was_promised() -> None:
    """The public names are those of the list above, and completion offers no others."""
    assert lv.__all__ == sorted(FUNCTIONS + CLASSES + RETURNED)
    assert set(dir(lv)) == {*lv.__all__, "__version__"}


@pytest.mark.parametrize("name", lv.__all__)
def test_every_name_is_there_and_documented(name: str) -> None:
    """Every public name exists, has a docstring, and is mentioned in the changelog."""
    assert inspect.getdoc(getattr(lv, name))
    assert f"``{name}``" in CHANGELOG.read_text()


def test_an_unknown_name_is_reported() -> None:
    """A name that the package does not have raises the usual error."""
    with pytest.raises(AttributeError, match="has no attribute 'predictor'"):
        lv.predictor  # type: ignore[attr-defined]  # noqa: B018


def test_type_checkers_see_the_same_names() -> None:
    """The imports that type checkers read name the same modules as the imports at first use."""
    tree = ast.parse(Path(lv.__file__).read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    actual = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert actual == lv._HOMES


def test_nothing_slow_is_imported_before_it_is_used() -> None:
    """Importing the package imports neither NumPy nor SciPy nor anything else that is slow."""
    slow = {"numpy", "scipy", "yaml", "mcap", "matplotlib", "rclpy", "pytest"}
    code = f"import sys, linkage_vibration; print(*sorted({slow} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == ""


def test_rooms_do_not_replace_functions() -> None:
    """No room has the name of a public function, which importing the room would replace."""
    rooms = {path.stem for path in Path(lv.__file__).parent.iterdir()}
    assert rooms.isdisjoint(lv.__all__)


def test_a_first_result_takes_three_lines() -> None:
    """Import, make the model, solve it: at 140 deg three modes are the tractor's."""
    model = lv.LinkageModel(lv.read_mechanism())
    solution = model.solve(math.radians(140.0))
    assert solution.natural_frequencies[2:4] == pytest.approx([2.84, 6.74], abs=0.01)


def test_objects_are_shown_in_a_line() -> None:
    """The text of each object is a line that names what it is of."""
    model, table = lv.LinkageModel(lv.read_mechanism()), lv.load_table()
    predictor = lv.Predictor(table)
    shown = [model, model.mechanism, model.solve(2.3), table, predictor]
    texts = [*map(repr, shown), repr(predictor.predict(np.array([2.2, 2.3])))]
    assert all("\n" not in text and len(text) < 250 for text in texts)
    assert all("three_point_linkage_on_tractor" in text for text in texts[:-1])
    assert texts[4].endswith("_tractor: 12 modes, 90 to 180 deg))")
    assert texts[5].startswith("MessageColumns(crank_angle, status, natural_frequencies,")


def test_paths_may_be_strings(tmp_path: Path) -> None:
    """Every public function that takes a path takes it as text, too."""
    drive = str(Path(__file__).parents[1] / "config/drives/hitch_duty_cycle.mcap")
    predicted = str(tmp_path / "predicted.mcap")
    done = lv.replay([drive], predicted)
    assert done.predictions > 1000
    log = lv.read_log(predicted)
    assert len(log.stamps) == done.predictions
    assert repr(log) == f"Log({predicted}: {done.predictions} predictions of 12 modes)"
    assert lv.check_bag(predicted, lv.Limits(gap=1.0)).passed
    table = Path(__file__).parents[1] / "config/tables/three_point_linkage_on_tractor.npz"
    assert lv.load_table(str(table)).table_id == lv.load_table().table_id
    mechanism = Path(__file__).parents[1] / "config/three_point_linkage_on_tractor.yaml"
    assert lv.read_mechanism(str(mechanism)).name == lv.read_mechanism().name


COMPLEX = [2.0 + 0.0j, np.complex64(2.0), np.array([2.0 + 0.0j]), [2.0 + 1.0j]]
ANGLES_AND_FREQUENCIES = ["alpha3", "angles", "stddev", "frequencies", "band"]
OTHERS = {"outputs": ["E1.z"], "inputs": ["E1.z"], "modes": np.array([0]), "count": 3}


@pytest.mark.parametrize("number", COMPLEX, ids=repr)
def test_complex_numbers_are_refused(number: Any) -> None:
    """Each public function of an angle, its deviation, frequencies or a band says so in a line."""
    model, table = lv.LinkageModel(lv.read_mechanism()), lv.load_table()
    solution = model.solve(2.0)
    calls = []
    owners = [model, model.kinematics, solution, solution.drive_point, table, lv.Predictor(table)]
    for owner, name in ((each, name) for each in owners for name in dir(type(each))):
        public = inspect.isfunction(getattr(type(owner), name)) and not name.startswith("_")
        function = getattr(owner, name) if public else dict
        parameters = inspect.signature(function).parameters if public else {}
        for wrong in (each for each in parameters if each in ANGLES_AND_FREQUENCIES):
            right = {"alpha3": 2.0, "frequencies": np.array([5.0])} | OTHERS
            given = {each: right[each] for each in parameters if each in right} | {wrong: number}
            with pytest.raises(lv.LinkageVibrationError) as raised:
                function(**given)
            if name != "identify":  # which asks for links that are known by FRFs
                assert f"`{wrong}` is " in str(raised.value) or "array of shape" in str(
                    raised.value
                )
            calls.append(f"{type(owner).__name__}.{name}")
    assert len(calls) > 25, calls
    with pytest.raises(lv.LinkageVibrationError, match=r"number"):
        lv.replay("no.mcap", "log.mcap", lv.Parameters(engine_speed=number))


def test_wrong_types_end_in_a_sentence() -> None:
    """What is given in place of what, and how to get the right one."""
    mechanism = lv.read_mechanism()
    model = lv.LinkageModel(mechanism)
    calls: list[tuple[Callable[[Any], object], Any, str]] = [
        (lv.plot, model, "LinkageModel is given in place of Mechanism or .* or Log; give one of"),
        (lv.build_table, mechanism, "Mechanism is given in place of LinkageModel; make one"),
        (lv.Predictor, model, "LinkageModel is given in place of Table; use `build_table`"),
        (lv.LinkageModel, "a.yaml", "str is given in place of Mechanism; read the file"),
        (lambda it: lv.sweep(mechanism, it, [2.0]), 3, "int is given in place of Mapping; give"),
        (mechanism.with_values, 3, "int is given in place of Mapping; give numbers by"),
        (lv.summaries, "a.mcap", "str is given in place of list or tuple; give a list of paths"),
        (lambda it: lv.save_table(it, "a.npz"), mechanism, "Mechanism is given in place of Table;"),
        (lambda it: lv.check_bag("a.mcap", it), 0.33, "float is given in place of Limits; give"),
    ]
    for function, value, words in calls:
        with pytest.raises(lv.LinkageVibrationError, match=f"^The type {words}"):
            function(value)
