# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The difference between two logs of one drive."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

from linkage_vibration.cli.main import main
from linkage_vibration.playback.replay import WhatIf, replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.review.difference import compare, difference_summary, problems, sentence
from linkage_vibration.review.log import ReviewError, read_log
from linkage_vibration.support.resources import config_file
from test.support.drive import hitch_duty_cycle
from test.support.messages import read_messages


@pytest.fixture(scope="module")
def heavier(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return logs of the shipped drive with the shipped linkage and with a 1200 kg implement."""
    folder = tmp_path_factory.mktemp("heavier")
    bag = config_file("drives/hitch_duty_cycle.mcap")
    replay([bag], folder / "a.mcap", Parameters())
    replay([bag], folder / "b.mcap", Parameters(), what_if=WhatIf(mass=1200.0))
    return folder / "a.mcap", folder / "b.mcap"


def test_same_log_differs_in_nothing(drive: Path) -> None:
    """A log compared with itself gives zeros, and every number of it is compared."""
    comparison = compare(drive, drive)
    assert [q.largest for q in comparison.quantities] == [0.0] * len(comparison.quantities)
    assert [q.rms for q in comparison.quantities] == [0.0] * len(comparison.quantities)
    sound = int(np.isfinite(read_log(drive).natural_frequencies[:, 0]).sum())
    assert np.isfinite(comparison.quantities[1].change).sum() == sound
    assert comparison.status_changes == 0


def test_known_difference(write_log: Any, tmp_path: Path) -> None:
    """An angle that is changed by 1 deg is reported with its time and its root mean square."""
    times, alpha3 = hitch_duty_cycle()
    a = write_log(tmp_path / "a.mcap", times[:100], alpha3[:100], False)
    changed = alpha3[:100].copy()
    changed[40] += np.deg2rad(1.0)
    changed[60] = np.nan
    b = write_log(tmp_path / "b.mcap", times[10:100], changed[10:], False)
    comparison = compare(a, b)
    angle, mode = comparison.quantities[:2]
    assert len(comparison.stamps) == 90
    assert comparison.times[0] == 0.0
    assert angle.farthest == mode.farthest == 30
    assert np.rad2deg(angle.largest) == pytest.approx(1.0)
    assert np.rad2deg(angle.rms) == pytest.approx(np.sqrt(1.0 / 89.0))
    assert angle.largest_relative == pytest.approx(np.deg2rad(1.0) / alpha3[40])
    assert np.isfinite(angle.change).sum() == 89
    assert (angle.one_sided, comparison.status_changes) == (1, 1)
    shown = difference_summary(comparison)
    assert (
        "90 predictions have the same stamps, 10 are only in A, 0 are only in B; 1 differ" in shown
    )


def test_changed_values_are_reported(heavier: tuple[Path, Path]) -> None:
    """The summary lists the values that differ between two mechanisms, and no comments."""
    shown = difference_summary(compare(*heavier))
    changed = shown.split("mechanism, A -> B:\n")[1]
    assert changed.strip() == "rigid_bodies.implement.mass: 800.0 -> 1200.0"


def test_load_ratios_are_compared(heavier: tuple[Path, Path]) -> None:
    """The largest load ratios in the sentence are those of the messages of both logs."""
    largest = []
    for path in heavier:
        messages = read_messages(path, "/linkage_vibration/levels")
        largest.append(max(message.total_load_ratio for _, message in messages))
    a, b = largest
    expected = f"; the largest load ratio is {a:.2g} in A and {b:.2g} in B."
    assert sentence(compare(*heavier)).endswith(expected)


def test_a_log_without_loads_differs(write_log: Any, tmp_path: Path) -> None:
    """Equal predictions with loads in one log only are no equal logs, and the sentence says so."""
    times, alpha3 = hitch_duty_cycle()
    a = write_log(tmp_path / "a.mcap", times[:100], alpha3[:100], False)
    b = write_log(tmp_path / "b.mcap", times[:100], alpha3[:100])
    messages = read_messages(b, "/linkage_vibration/levels")
    largest = max(message.total_load_ratio for _, message in messages)
    text = sentence(compare(a, b))
    assert text.startswith("The natural frequencies are equal; the logs differ")
    assert text.endswith(f"; the largest load ratio is not known in A and {largest:.2g} in B.")
    assert sentence(compare(a, a)) == "The logs have equal predictions."


def test_difference_in_one_sentence(heavier: tuple[Path, Path]) -> None:
    """The sentence names what differs most and by how much."""
    text = sentence(compare(*heavier))
    assert text.startswith("Mode 1 (tractor pitch) differs most: in B it is 0.2")
    assert " Hz (15 %) lower at 10.18 s; " in text
    assert sentence(compare(heavier[0], heavier[0])) == "The logs have equal predictions."


def test_no_stamp_in_common(write_log: Any, tmp_path: Path) -> None:
    """Logs of two different drives are refused."""
    a = write_log(tmp_path / "a.mcap", [0.0, 0.01], [2.0, 2.0], False)
    b = write_log(tmp_path / "b.mcap", [5.0, 5.01], [2.0, 2.0], False)
    with pytest.raises(ReviewError, match="no stamp in common"):
        compare(a, b)


def test_equal_stamps(write_log: Any, tmp_path: Path) -> None:
    """The first of two predictions with one stamp matches the first, and the second the second."""
    times, angles = [0.0, 0.01, 0.02, 0.02, 0.03], [2.0, 2.1, 2.2, 2.3, 2.4]
    a = write_log(tmp_path / "a.mcap", times, angles, False)
    b = write_log(tmp_path / "b.mcap", times, [*angles[:3], 2.31, 2.4], False)
    comparison = compare(a, b)
    assert comparison.rows_a.tolist() == comparison.rows_b.tolist() == [0, 1, 2, 3, 4]
    assert comparison.quantities[0].farthest == 3
    assert comparison.quantities[0].largest == pytest.approx(0.01)
    less = write_log(tmp_path / "c.mcap", times[:3], angles[:3], False)
    assert compare(a, less).rows_a.tolist() == [0, 1, 2]


def test_clock_that_jumps_back(write_log: Any, tmp_path: Path) -> None:
    """Each pass is compared with the same pass, one after the other."""
    times = np.concatenate([np.arange(50), np.arange(30)]) / 100.0
    angles = np.linspace(2.0, 2.4, 80)
    a = write_log(tmp_path / "a.mcap", times, angles, False)
    b = write_log(
        tmp_path / "b.mcap", times, angles + np.where(np.arange(80) == 70, 0.01, 0), False
    )
    comparison = compare(a, b)
    assert (np.diff(comparison.times) > 0.0).all()
    assert comparison.quantities[0].farthest == 70


def test_command(heavier: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    """The command prints the summary, and its exit code says with --strict whether logs differ."""
    paths = [str(path) for path in heavier]
    assert main(["diff", *paths]) == 0
    assert capsys.readouterr().out.strip() == difference_summary(compare(*heavier)).strip()
    assert main(["diff", *paths, "--strict"]) != 0
    assert main(["diff", paths[0], paths[0], "--strict"]) == 0


def test_folders_of_bags(drive: Path, tmp_path: Path) -> None:
    """A log may be the folder of a bag, as rosbag2 writes it."""
    shutil.copy(drive, tmp_path / "drive.mcap")
    with drive.open("rb") as file:
        reader = make_reader(file)
        [record] = [m for m in reader.iter_metadata() if m.name == "rosbag2"]
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = summary.statistics.channel_message_counts
    about = yaml.safe_load(record.metadata["serialized_metadata"])
    about["relative_file_paths"] = ["drive.mcap"]
    about["message_count"] = sum(counts.values())
    about["topics_with_message_count"] = [
        {
            "topic_metadata": {
                "name": channel.topic,
                "type": summary.schemas[channel.schema_id].name,
                "serialization_format": "cdr",
                "offered_qos_profiles": channel.metadata["offered_qos_profiles"],
                "type_description_hash": channel.metadata["topic_type_hash"],
            },
            "message_count": counts[channel.id],
        }
        for channel in summary.channels.values()
    ]
    text = yaml.safe_dump({"rosbag2_bagfile_information": about})
    (tmp_path / "metadata.yaml").write_text(text)
    comparison = compare(tmp_path, drive)
    assert not problems(comparison)
    assert comparison.a.mechanism_text == comparison.b.mechanism_text != ""
