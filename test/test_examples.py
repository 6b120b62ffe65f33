# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every example runs, and prints what it should."""

import importlib.util
import json
import runpy
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from linkage_vibration.bags.message_columns import topic_types
from linkage_vibration.messages.topics import PREDICTION_TOPIC, RESONANCE_TOPIC
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from test.support.messages import read_messages

EXAMPLES = Path(__file__).parents[1] / "examples"

# What the output of each script contains.
EXPECTED = {
    "engine_speeds_to_avoid.py": "90 deg: avoid 1865 to 2200 rpm",
    "frf_between_two_points.py": "100.0 Hz: 5.98e-08 m/N",
    "substructuring_by_hand.py": "looked up:       4.20    98.90   167.66",
    "grid_of_designs.py": "800 kg, 0.366 m: 4.18, 98.89, 166.08 Hz",
    "heavier_implement.py": "mode 4 (implement heave): at most -6.2 %, at 169.0 deg",
    "resonances_at_an_angle.py": "mode 4:    6.48 Hz",
    "simulated_drive.py": "simulated_drive.mcap: 180 s",
    "simulated_hammer.py": "175.csv: 5 blows",
    "table_of_my_linkage.py": "mode 1 in the middle: 220.88 Hz",
    "test_my_drive.py": "2 passed",
}
REPLAY_TEST = "replay_testing_drive.py"  # needs ROS 2 packages that PyPI does not have
NODES = "ask_the_node.py", "slow_pto.py"  # test/ros runs them beside a node
NOTEBOOK = "first_look.ipynb"
WRITTEN = {
    "simulated_drive.py": {"simulated_drive.mcap", "sensors.yaml"},
    "simulated_hammer.py": {"95.csv", "115.csv", "135.csv", "155.csv", "175.csv"},
}


def test_every_example_is_run_and_listed() -> None:
    """The scripts in the folder, the list above and the table for readers agree."""
    assert {path.name for path in EXAMPLES.glob("*.py")} == {REPLAY_TEST, *NODES, *EXPECTED}
    text = (EXAMPLES / "README.md").read_text()
    assert all(f"]({name})" in text for name in (REPLAY_TEST, *NODES, NOTEBOOK, *EXPECTED))


LONG = pytest.param("simulated_drive.py", marks=pytest.mark.nightly)


@pytest.mark.parametrize("name", [*sorted(EXPECTED.keys() - {*LONG.values}), LONG])
def test_example(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An example runs from any folder, prints its answer and leaves only the files it names."""
    if name.startswith("test_"):
        command: list[Any] = [
            sys.executable,
            "-m",
            "pytest",
            "-p",
            "no:cacheprovider",
            "--rootdir",
            tmp_path,
        ]
        run = subprocess.run([*command, EXAMPLES / name], cwd=tmp_path, capture_output=True)
        printed = run.stdout.decode()
    else:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [name])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        printed = capsys.readouterr().out
    assert EXPECTED[name] in printed
    assert {path.name for path in tmp_path.iterdir()} == WRITTEN.get(name, set())


def test_notebook(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its cells run one after the other from any folder, and print the texts that it shows."""
    pytest.importorskip("matplotlib", reason="the extra plots is not installed")
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    cells = json.loads((EXAMPLES / NOTEBOOK).read_text())["cells"]
    names: dict[str, Any] = {}
    for cell in (cell for cell in cells if cell["cell_type"] == "code"):
        exec("".join(cell["source"]), names)
        texts = ["".join(each["text"]) for each in cell["outputs"] if "text" in each]
        assert capsys.readouterr().out == "".join(texts)
        names["plt"].close("all")
    assert sum("data" in each for cell in cells for each in cell.get("outputs", ())) == 2
    assert not list(tmp_path.iterdir())


@pytest.fixture
def replay_test(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the example for replay_testing, with stand-ins for what PyPI does not have.

    Decorators return what they get, actions keep their arguments, and a reader is a path.
    """

    class Kept:
        def __init__(self, *arguments: Any, **named: Any) -> None:
            self.arguments, self.named = arguments, named

    class Decorator:
        parameterize = staticmethod(lambda fixtures: lambda kind: kind)
        default = staticmethod(lambda: lambda kind: kind)

    def read(reader: Path, topics: Sequence[str]) -> Iterator[tuple[str, Any, int]]:
        for topic in topics:
            yield from ((topic, message, time) for time, message in read_messages(reader, topic))

    names: dict[str, dict[str, Any]] = {
        "launch": {"LaunchDescription": Kept},
        "launch.actions": {"IncludeLaunchDescription": Kept},
        "launch.launch_description_sources": {"PythonLaunchDescriptionSource": Kept},
        "replay_testing": {
            **{"LocalFixture": Kept, "fixtures": Decorator, "run": Decorator},
            **{"analyze": lambda kind: kind, "read_messages": read},
        },
    }
    for name, content in names.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("replay_test", EXAMPLES / REPLAY_TEST)
    assert spec is not None
    assert spec.loader is not None
    actual = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(actual)
    return actual


def test_replay_test(replay_test: Any, tmp_path: Path) -> None:
    """Its topics and its launch file exist, and its analysis tells right from wrong predictions."""
    drive = replay_test.ROOT / "config" / "drives" / "hitch_duty_cycle.mcap"
    assert set(replay_test.Fixtures.required_input_topics) <= topic_types(drive).keys()
    assert replay_test.Fixtures.expected_output_topics == [PREDICTION_TOPIC, RESONANCE_TOPIC]
    [include] = replay_test.Run().generate_launch_description().arguments[0]
    [launch_file] = include.arguments[0].arguments
    assert Path(launch_file).is_file()
    [(argument, _)] = include.named["launch_arguments"]
    assert f'"{argument}"' in Path(launch_file).read_text()
    analysis = replay_test.Analysis()
    for offset in (0.0, 0.3):
        analysis.reader = tmp_path / f"{offset}.mcap"
        replay(drive, analysis.reader, Parameters(hitch_offset=offset))
        if not offset:
            analysis.test_predictions()
    with pytest.raises(AssertionError):
        analysis.test_predictions()
