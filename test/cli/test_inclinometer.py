# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The calibration of a sensor from a simulated bag and an inclinometer on a simulated hitch."""

import math
from pathlib import Path

import numpy as np
import pytest

from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.cli.main import main
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.prediction.inputs.units import HitchCurve, HitchScale
from linkage_vibration.prediction.parameter_files import read_parameters
from linkage_vibration.prediction.settings import Parameters
from test.playback.test_replay import JOINT, START, Entry, float64, joint_state, write_mcap

REST = 3.0  # s, of each height
ALPHAS = np.radians([92.0, 105.0, 118.0, 131.0, 144.0, 157.0, 170.0, 178.0])
ERROR = 0.5  # deg, of the inclinometer
PITCH = 3.0  # deg, of the tractor


def volts(alpha3: float) -> float:
    """Return what a sensor shows that a lever turns, rad."""
    return 0.5 - 1.2 * math.asin(0.7 * (alpha3 - math.radians(135.0)) / math.radians(45.0))


def percent(alpha3: float) -> float:
    """Return a hitch position in steps of 0.4 %."""
    share = (math.pi - alpha3) / (math.pi / 2.0)
    return 0.4 * round(100.0 * share**1.1 / 0.4)


def bag_of(path: Path, kind: str) -> Path:
    """Write a bag in which the hitch rests at each height for some seconds, at 20 Hz."""
    rng, entries = np.random.default_rng(7), list[Entry]()
    for k in range(round(20 * REST * len(ALPHAS))):
        time = START + k * 50_000_000
        alpha3 = ALPHAS[int(k / 20 / REST)]
        if kind == "percent":
            entries.append(("/hitch_position", FLOAT64, time, float64(percent(alpha3))))
        else:
            position = volts(alpha3) + 0.005 * rng.normal()
            message = joint_state(time, ["other", JOINT], [9.0, position])
            entries.append(("/joint_states", JOINT_STATE, time, message))
    return write_mcap(path, entries)


def words(mechanism: Mechanism, body: str, seed: int) -> list[str]:
    """Return moments and what an inclinometer on a body shows on a tractor that is not level."""
    rng, kinematics, actual = np.random.default_rng(seed), Kinematics(mechanism), []
    for i, alpha3 in enumerate(ALPHAS):
        angle = math.degrees(kinematics.at(alpha3).angle(body)) + PITCH + ERROR * rng.normal()
        actual.append(f"{REST * (i + 0.5):g}={(angle + 90.0) % 180.0 - 90.0:.2f}")
    return actual


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        pytest.param("joint", "input_crank", marks=pytest.mark.nightly),
        pytest.param("joint", "lower_link", marks=pytest.mark.nightly),
        ("percent", "lift_rod"),
    ],
)
def test_from_a_bag_to_parameters(
    tmp_path: Path,
    mechanism: Mechanism,
    mechanism_file: Path,
    kind: str,
    body: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """With the printed parameters, the node's angles of new readings deviate as they state."""
    bag, params = bag_of(tmp_path / "bag.mcap", kind), tmp_path / "given.yaml"
    chosen = "percent" if kind == "percent" else "joint_states"
    params.write_text(f"/**: {{ros__parameters: {{hitch_input: {chosen}}}}}")
    ratios = []
    for seed in range(4):
        output = tmp_path / f"found_{seed}.yaml"
        arguments = [str(bag), "--times", *words(mechanism, body, seed), "--body", body]
        arguments += ["--mechanism", str(mechanism_file), "--tractor-deg", str(PITCH)]
        arguments += ["--params-file", str(params), "-o", str(output)]
        assert main(["calibrate", *arguments]) == 0
        printed = capsys.readouterr().out
        assert output.read_text() in printed
        actual = read_parameters(output)
        calibration = HitchCurve(actual.calibration)
        scale = HitchScale(actual.hitch_unit, 1, 1.0, 0.0, calibration, actual.angle_stddev)
        assert actual.hitch_unit == ("percent" if kind == "percent" else "any")
        rng = np.random.default_rng(100 + seed)
        for alpha3 in rng.uniform(ALPHAS[0], ALPHAS[-1], 30):
            noise = 0.005 * rng.normal()
            number = percent(alpha3) if kind == "percent" else volts(alpha3) + noise
            reading = scale.reading(number)
            ratios.append((reading.crank_angle - alpha3) / reading.stddev)
    known = np.abs(np.array(ratios)[np.isfinite(ratios)])
    assert len(known) > 0.95 * len(ratios)
    assert (known < 1.96).mean() > 0.93
    assert math.sqrt((known**2).mean()) > 0.25


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--times", "1=0"], "--times needs the bag"),
        (["BAG", "--times", "1=20", "4=x"], "4=x: write two numbers"),
        (
            ["BAG", "--times", "99=20"],
            "No reading is within 0.5 s of 99 s; choose a moment from 0 to 23",
        ),
        (["BAG", "--times", "1=50"], "No pose has input_crank at the inclination 50.00 deg"),
        (["BAG", "--times", "1=-88", "4=-75"], "2 points do not show their errors"),
        (["BAG", "--joint", "boom", "--times", "1=2"], "has no joint boom; it has"),
        (["--readings", "1=-88", "2=-60", "3=-30", "4=-60", "5=-88"], "points turns back"),
        (["--readings", "1=-88", "--body", "boom"], "There is no body 'boom'; name one of:"),
        (["--readings", "1=-88", "--stddev-deg", "0"], "have to be finite, the first above 0"),
        ([], "Give one YAML file of parameters and targets, or for the sensor of the hitch"),
    ],
)
def test_what_is_refused(
    tmp_path: Path,
    mechanism_file: Path,
    arguments: list[str],
    why: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Each fault of the points is refused in one sentence, and no file is written."""
    bag, output = bag_of(tmp_path / "bag.mcap", "joint"), tmp_path / "found.yaml"
    words = [str(bag) if word == "BAG" else word for word in arguments]
    command = ["calibrate", *words, "--mechanism", str(mechanism_file), "-o", str(output)]
    assert main(command) == 1
    assert why in capsys.readouterr().err
    assert not output.exists()


def test_defaults_are_those_of_the_node() -> None:
    """Without a file of parameters, the readings are those of the default input."""
    assert Parameters().hitch_input == "joint_states"
