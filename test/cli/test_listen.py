# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated drive is heard, and its page and its excitations say what was simulated."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from linkage_vibration.cli.main import main
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.playback.replay import replay
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.studies.calibration import read_calibration
from linkage_vibration.support.resources import config_file

EXAMPLE = Path(__file__).parents[2] / "examples" / "simulated_drive.py"


def test_recordings_that_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A place that the table lacks, another time and the name of the recording are refused."""
    log, page, sensors = (tmp_path / name for name in ("log.mcap", "page.html", "sensors.yaml"))
    replay(config_file("drives/hitch_duty_cycle.mcap"), log)
    command = ["listen", str(log), "--sensors", str(sensors), "-o"]
    (tmp_path / "phone.csv").write_text("\n".join(f"{k / 200},0,0,9.8" for k in range(2000)))
    sensors.write_text("imu: {file: phone.csv, unit: m/s2, at: P9}")
    assert main([*command, str(page)]) == 1
    assert "The table has no response at P9" in capsys.readouterr().err
    for starts_at, problem in ((-10.0, "from -10 to -0.005 s"), (20.0, "from 20 to 29.995 s")):
        text = f"file: phone.csv, unit: m/s2, at: E1, starts_at: {starts_at}"
        sensors.write_text(f"imu: {{{text}}}")
        assert main([*command, str(page)]) == 1
        answer = capsys.readouterr().err
        assert problem in answer
        assert "the drive ends at 19.99 s; correct the clocks" in answer
    assert not page.exists()
    recording = tmp_path / "imu.html"
    recording.write_text("time\n")
    sensors.write_text(f"imu: {{file: {recording.name}, topic: /imu, unit: g, at: E1}}")
    assert main([*command, str(recording)]) == 1
    assert recording.read_text() == "time\n"


@pytest.mark.nightly(short="test_recordings_that_are_refused")
def test_listen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The true amplitudes, 600 and 150 N, are within two deviations of what the drive shows."""
    pytest.importorskip("matplotlib", reason="the extra plots is not installed")
    subprocess.run([sys.executable, EXAMPLE, tmp_path], check=True, capture_output=True)
    log, page, written = (tmp_path / name for name in ("log.mcap", "page.html", "out.yaml"))
    replay(tmp_path / "simulated_drive.mcap", log)
    sensors = tmp_path / "sensors.yaml"
    command = ["listen", str(log), "--sensors", str(sensors), "-o", str(page)]
    targets = tmp_path / "targets.yaml"
    assert main([*command, "--amplitudes", str(written), "--targets", str(targets)]) == 0
    answer = capsys.readouterr().out
    assert re.search(r"The implement sway at .* \+- (.*) Hz: consistent", answer)
    # The true frequency is that of an implement which is 10 % heavier.
    mechanism = read_mechanism(config_file("three_point_linkage_on_tractor.yaml"))
    body = replace(mechanism.rigid_bodies[0], mass=1.1 * mechanism.rigid_bodies[0].mass)
    model = LinkageModel(replace(mechanism, rigid_bodies=(body,)), half="lateral")
    found = read_calibration(targets).targets  # an order hides the heave at 166 deg
    for target, degrees in zip(found, (104.0, 166.0), strict=True):
        assert (target.half, target.mode) == ("lateral", 5)
        assert target.at == pytest.approx(np.radians(degrees), abs=np.radians(0.05))
        true = float(model.solve(float(target.at)).natural_frequencies[4])
        assert abs(target.frequency / true - 1.0) < 3.0 * target.deviation
    other = ["--targets", str(targets), "--mechanism", str(config_file("three_point_linkage.yaml"))]
    before = targets.read_text()
    assert main([*command, *other]) == 1
    assert "the log has another mechanism" in capsys.readouterr().err
    assert targets.read_text() == before
    assert "3 of 5 orders agree with the prediction" in answer
    # No tyre shakes the simulated tractor, for which 80 to 100 mm/s are predicted on the road.
    first = re.match(
        r"tyre_lugs 1 at implement is at least (\d+) times weaker than predicted", answer
    )
    assert first is not None
    assert int(first[1]) > 50
    assert "They make 94 % of what is predicted; whether the rest agrees is not known" in answer
    text = page.read_text()
    assert '<p id="answer">tyre_lugs 1 at implement is at least' in text
    assert "rotor 1 was within 5 % of it" in text  # the heave at 166 deg
    assert "Orders at implement" in text
    loads = {each.name: each.load for each in read_excitations(written)}
    for name, true in (("crankshaft 1", 600.0), ("rotor 1", 150.0)):
        load = loads[name]
        assert load is not None
        assert abs(np.log(load.amplitude / true)) < 2.0 * load.relative_stddev
    noise = np.random.default_rng(3).normal((0.0, 0.0, 9.81), 0.1, (36000, 3))
    rows = [f"{k / 200},{x:.5f},{y:.5f},{z:.5f}" for k, (x, y, z) in enumerate(noise.tolist())]
    (tmp_path / "phone.csv").write_text("\n".join(rows))
    sensors.write_text("imu: {file: phone.csv, unit: m/s2, at: E1}")
    why, none = tmp_path / "why.html", tmp_path / "none.yaml"
    assert main([*command[:4], "-o", str(why), "--targets", str(none)]) == 1
    refused = capsys.readouterr()
    assert f"{none}: no mode of the drive is without doubt" in refused.err
    assert refused.err.count("No mechanism is given") == 1
    assert refused.out.endswith(f"Written: {why}\n")
    assert not none.exists()
    doubtful = re.findall(r"<tr>.*?doubtful.*?</tr>", why.read_text(), re.DOTALL)
    assert doubtful
    assert all(row.count("±") < 2 for row in doubtful)  # that of the prediction
