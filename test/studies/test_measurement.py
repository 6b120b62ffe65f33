# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""From simulated recordings of blows to a corrected mechanism, through the commands."""

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from linkage_vibration.cli.main import main
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.readers.targets import ModelMode
from linkage_vibration.studies.measurement import (
    ComparedMode,
    MeasurementError,
    angle_and_path,
    calibration_text,
    compare,
    comparison_table,
)
from linkage_vibration.studies.ringdown import MeasuredMode
from linkage_vibration.support.resources import config_file

SECOND, THIRD = ModelMode("vertical", 1), ModelMode("vertical", 2)
EXAMPLE = Path(__file__).parents[2] / "examples" / "simulated_hammer.py"


@pytest.mark.nightly(short="test_a_height_without_a_sure_mode")
def test_from_recordings_to_a_mechanism(tmp_path: Path) -> None:
    """The mass of the simulated recordings is in its interval of 95 %; the file is 25 % off.

    The file states 10 % of the mass and 20 % of the moment of inertia; both are known better.
    """
    subprocess.run([sys.executable, EXAMPLE, tmp_path], check=True, stdout=subprocess.DEVNULL)
    mechanism = str(config_file("three_point_linkage_on_tractor.yaml"))
    fit, fitted = str(tmp_path / "fit.yaml"), tmp_path / "fitted.yaml"
    recordings = [f"{angle}:{tmp_path}/{angle}.csv" for angle in (115, 175)]
    assert main(["measure", *recordings, "--mechanism", mechanism, "-o", fit]) == 0
    assert main(["calibrate", fit, "-o", str(fitted), "--starts", "1"]) == 0
    uncertainty = read_mechanism(fitted).uncertainty
    assert uncertainty is not None
    numbers = {number.path: number for number in uncertainty.numbers}
    for name, own, stated in (("mass", 1000.0, 0.1), ("inertia", 200.0, 0.2)):
        number = numbers[f"rigid_bodies.implement.{name}"]
        deviation = number.deviation / number.value
        assert abs(math.log(number.value / own)) < 1.96 * deviation
        assert deviation < 0.8 * stated


def test_a_height_without_a_sure_mode(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is named with the reasons, beside heights that have one; alone, it is an error."""
    times = np.arange(0.0, 42.0, 0.005)
    since = np.where(times > 2.0, (times - 2.0) % 8.0, 99.0)
    noise = np.random.default_rng(1).normal(0.0, 1e-3, len(times))
    for name, falls in (("linear.csv", 0.0), ("bent.csv", 0.04)):
        phase = 2.0 * math.pi * 7.0 * (since + falls * (1.0 - np.exp(-2.0 * since)))
        moved = np.exp(-since) * np.cos(phase) + noise
        np.savetxt(tmp_path / name, np.column_stack([times, moved]), delimiter=",", header="t,z")
    words = [f"120:{tmp_path}/bent.csv", f"150:{tmp_path}/linear.csv"]
    given = ["--mechanism", str(config_file("three_point_linkage_on_tractor.yaml")), "--filtered"]
    assert main(["measure", *words, *given]) == 0
    shown = capsys.readouterr().out
    assert "7.00" in shown
    assert main(["measure", words[0], *given]) == 1
    failed = capsys.readouterr().err
    assert "\\n" not in failed
    for text in (shown, failed):
        assert "bent.csv: its decays show no mode that is sure" in text
        assert "not linear: the frequency falls" in text


def test_several_recordings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Stamps may repeat, recordings at one angle make one target, and none is given twice.

    A mode of 70 Hz in a recording at 200 Hz is none of 30 Hz if its stamps are those of 100 Hz.
    """
    times = np.arange(0.0, 42.0, 0.005)
    since = np.where(times > 2.0, (times - 2.0) % 8.0, 99.0)
    wave = np.exp(-since) * np.cos(2.0 * math.pi * 6.4 * since)
    fast = 0.2 * np.exp(-4.0 * since) * np.cos(2.0 * math.pi * 70.0 * since)
    for name, stamps, noise in (("pairs.csv", np.floor(100.0 * times + 1e-6) / 100.0, 1e-3),
                                ("noisy.csv", times, 1e-2)):  # fmt: skip
        random, counter = np.random.default_rng(1), np.arange(len(times))
        columns = [stamps, wave + fast + random.normal(0.0, noise, len(times)), counter]
        np.savetxt(tmp_path / name, np.column_stack(columns), delimiter=",", header="t,z,n")
    pairs, noisy = f"135:{tmp_path}/pairs.csv", f"135:{tmp_path}/noisy.csv"
    given = ["--mechanism", str(config_file("three_point_linkage_on_tractor.yaml"))]
    fit = tmp_path / "fit.yaml"
    assert main(["measure", pairs, noisy, *given, "-o", str(fit)]) == 0
    shown = capsys.readouterr().out
    assert "modes above 100 Hz appear below it" in shown
    assert "6.402" in shown
    assert shown.count("135.00 deg: 70.0") == 2
    assert not re.search(r"\b(29|30)\.\d", shown)
    assert "pairs.csv: channel 2 changes in one direction" in shown
    assert "each mode there is one target" in shown
    [target] = yaml.safe_load(fit.read_text())["targets"]
    assert target["hz"] == pytest.approx(
        6.4 * math.hypot(1.0, 1.0 / (2.0 * math.pi * 6.4)), rel=1e-3
    )
    again = f"140:{tmp_path}/../{tmp_path.name}/pairs.csv"
    assert main(["measure", pairs, again, *given]) == 1
    assert "pairs.csv is given twice; give each recording once" in capsys.readouterr().err


def test_the_surest_target_of_an_angle(tmp_path: Path) -> None:
    """Of equal modes at equal angles, the smallest deviation counts; other angles have others."""
    mode, path = MeasuredMode(7.5, 0.02, 0.1, 0.001, 5), config_file("three_point_linkage.yaml")
    modes = [
        ComparedMode(math.radians(angle), mode, each, 7.4, deviation)
        for angle, each, deviation in (
            (120.0, SECOND, 0.02), (120.0, SECOND, 0.01), (120.0, SECOND, 0.03),
            (120.0, THIRD, 0.04), (121.0, SECOND, 0.05),
        )
    ]  # fmt: skip
    targets = yaml.safe_load(calibration_text(modes, path, tmp_path / "fit.yaml"))["targets"]
    assert [each["deviation"] for each in targets] == [0.01, 0.04, 0.05]


def test_modes_of_the_model(model: LinkageModel) -> None:
    """A frequency belongs to the nearest mode; one that is far from all belongs to none."""
    exact = model.solve(2.0).natural_frequencies
    measured = [
        MeasuredMode(hz, 0.01, math.nan, math.nan, 1) for hz in (0.9 * exact[0], 20.0, exact[1])
    ]
    comparison = compare(model, 2.0, measured)
    first, second = (ModelMode("vertical", i) for i in (0, 1))
    assert [each.mode for each in comparison] == [first, None, second]
    assert comparison[0].predicted == exact[0]
    assert comparison[0].deviation > 0.01  # 1 % as it is unknown, and the angle's


def test_what_is_refused(model: LinkageModel) -> None:
    """An angle outside the stroke, and a word without an angle."""
    for angle in (1.0, 0.03, 5.0):  # also where the cylinder or the loops do not close
        with pytest.raises(MeasurementError, match=r"outside the stroke .* 90 to 180 deg"):
            compare(model, angle, [MeasuredMode(3.0, 0.01, 0.1, 0.1, 5)])
    for word in ("low.csv", "x:low.csv", "90:", "nan:low.csv"):
        with pytest.raises(MeasurementError, match=r"write ANGLE:FILE, such as 112.5:low\.csv"):
            angle_and_path(word)


def test_deviations_of_compared_modes(model: LinkageModel) -> None:
    """They are those of the frequency, 1 % if it is not known, and of half a degree of the angle.

    Of both sides of the angle the larger change counts; at an end of the stroke only one is there.
    """
    half = math.radians(0.5)
    for alpha3, steps in ((2.0, (-half, half)), (math.pi / 2.0, (half,)), (math.pi, (-half,))):
        exact = model.solve(alpha3).natural_frequencies
        measured = [
            MeasuredMode(float(exact[0]), 0.01, math.nan, math.nan, 1),
            MeasuredMode(float(exact[1]), 0.01, 0.03 * float(exact[1]), 0.001, 5),
        ]
        comparison = compare(model, alpha3, measured)
        for i, own in enumerate((0.01, 0.03)):
            beside = [model.solve(alpha3 + step).natural_frequencies[i] for step in steps]
            turned = max(abs(math.log(hz / exact[i])) for hz in beside)
            assert comparison[i].mode == ModelMode("vertical", i)
            assert comparison[i].deviation == pytest.approx(math.hypot(own, turned), rel=1e-6)


def test_targets_and_bounds_of_a_calibration(tmp_path: Path) -> None:
    """Modes count from 1 at angles in degrees; a third to three times a number are its bounds."""
    mode = MeasuredMode(7.5, 0.02, 0.1, 0.001, 5)
    modes = [
        ComparedMode(math.radians(112.5), mode, ModelMode("vertical", 2), 7.4, 0.0123456),
        ComparedMode(math.radians(112.5), mode, ModelMode("lateral", 0), 7.4, 0.0123456),
        ComparedMode(math.radians(112.5), mode, SECOND, 7.9, 0.01, (THIRD,)),
        ComparedMode(math.radians(112.5), mode, None, math.nan, math.nan),
    ]
    path = config_file("three_point_linkage.yaml")
    content = yaml.safe_load(calibration_text(modes, path, tmp_path / "fit.yaml"))
    target = {"mode": 3, "at_deg": 112.5, "hz": 7.5, "deviation": 0.0123}
    assert content["targets"] == [target, target | {"half": "lateral", "mode": 1}]
    assert (tmp_path / content["mechanism"]).resolve() == path.resolve()
    [implement] = read_mechanism(path).rigid_bodies
    bounds = content["parameters"]
    for key, value in (("mass", implement.mass), ("inertia", implement.inertia)):
        assert bounds[f"rigid_bodies.implement.{key}"] == [
            pytest.approx(value / 3.0),
            pytest.approx(value * 3.0),
        ]
    with pytest.raises(MeasurementError, match=r"is within a factor of 1\.5 of one mode"):
        calibration_text(modes[2:], path, tmp_path / "fit.yaml")


def test_table_of_compared_modes() -> None:
    """Each row has the angle, the numbers with their deviations, and the name of the mode."""
    known = MeasuredMode(7.5, 0.02, 0.1, 0.001, 5)
    unknown = MeasuredMode(19.0, 0.03, math.nan, math.nan, 1)
    rows = [
        ComparedMode(math.radians(112.5), known, ModelMode("vertical", 0, "lift"), 7.4, 0.01),
        ComparedMode(math.radians(112.5), known, SECOND, 8.0, 0.01),
        ComparedMode(math.radians(112.5), unknown, None, math.nan, math.nan),
        ComparedMode(math.radians(112.5), known, SECOND, 8.0, 0.01, (THIRD,)),
        ComparedMode(math.radians(112.5), known, SECOND, 8.0, 0.01, (None,)),
    ]
    lines = comparison_table(rows).splitlines()[1:]
    assert lines[0].split()[:5] == ["112.50", "7.500", "+-", "0.100", "0.0200"]
    assert lines[0].endswith("5       7.400  mode 1 (lift)")
    assert lines[1].endswith("8.000  mode 2")
    assert lines[2].split()[1:8] == ["19.000", "+-", "unknown", "0.0300", "+-", "unknown", "1"]
    assert lines[2].endswith("belongs to no mode of the model")
    assert lines[3].endswith("8.000  mode 2, or mode 3: not a target")
    assert lines[4].endswith("8.000  mode 2, or no mode: not a target")


def test_angle_and_path_of_a_word() -> None:
    """The angle is in degrees, and a path may have colons."""
    assert angle_and_path("180:a:b.csv") == (pytest.approx(math.pi), Path("a:b.csv"))
