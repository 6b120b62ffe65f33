# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The difference between two logs of one drive."""

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

from linkage_vibration.cli.main import main
from linkage_vibration.playback.replay import WhatIf, replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.review.difference import (
    Difference,
    Quantity,
    compare,
    difference_summary,
    problems,
    sentence,
)
from linkage_vibration.review.log import ReviewError, read_log
from linkage_vibration.support.resources import config_file
from test.support.drive import hitch_duty_cycle
from test.support.messages import read_messages
from test.support.random_resonances import START, Message, write_drive


@pytest.fixture(scope="module")
def heavier(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return logs of the shipped drive with the shipped linkage and with a 1200 kg implement."""
    folder = tmp_path_factory.mktemp("heavier")
    bag = config_file("drives/hitch_duty_cycle.mcap")
    replay([bag], folder / "a.mcap", Parameters())
    replay([bag], folder / "b.mcap", Parameters(), what_if=WhatIf(mass=1200.0))
    return folder / "a.mcap", folder / "b.mcap"


def compared(a: Path, b: Path) -> Difference:
    """Return the difference of two files."""
    return compare(read_log(a), read_log(b))


def test_same_log_differs_in_nothing(drive: Path) -> None:
    """A log compared with itself gives zeros, and every number of it is compared."""
    comparison = compared(drive, drive)
    assert [q.largest for q in comparison.quantities] == [0.0] * len(comparison.quantities)
    sound = int(np.isfinite(read_log(drive).natural_frequencies[:, 0]).sum())
    assert np.isfinite(comparison.quantities[1].change).sum() == sound
    assert not comparison.other_status.any()


def test_known_difference(write_log: Any, tmp_path: Path) -> None:
    """An angle that is changed by 1 deg is reported with its time."""
    times, alpha3 = hitch_duty_cycle()
    a = write_log(tmp_path / "a.mcap", times[:100], alpha3[:100], False)
    changed = alpha3[:100].copy()
    changed[40] += np.deg2rad(1.0)
    changed[60] = np.nan
    b = write_log(tmp_path / "b.mcap", times[10:100], changed[10:], False)
    comparison = compared(a, b)
    angle, mode = comparison.quantities[:2]
    assert len(comparison.rows_a) == 90
    assert angle.farthest == mode.farthest == 30
    assert comparison.clock(angle.farthest) == "0.30"  # s
    assert np.rad2deg(angle.largest) == pytest.approx(1.0)
    assert angle.largest_relative == pytest.approx(np.deg2rad(1.0) / alpha3[40])
    assert np.isfinite(angle.change).sum() == 89
    assert (angle.one_sided, comparison.other_status.sum()) == (1, 1)
    shown = difference_summary(comparison)
    assert "90 moments are in both logs; 10 are only in A, 0 are only in B; 1 differ" in shown


def test_changed_values_are_reported(heavier: tuple[Path, Path]) -> None:
    """The summary lists the values that differ between two mechanisms, and no comments."""
    shown = difference_summary(compared(*heavier))
    changed = shown.split("mechanism, A -> B:\n")[1]
    assert [line.strip() for line in changed.strip().splitlines()] == [
        "rigid_bodies.implement.mass: 800.0 -> 1200.0",
        "lateral.inertia.implement.roll: 550.0 -> 825.0",
        "lateral.inertia.implement.yaw: 650.0 -> 975.0",
    ]


def test_load_ratios_are_compared(heavier: tuple[Path, Path]) -> None:
    """The largest load ratios in the sentence are those of the messages of both logs."""
    largest = []
    for path in heavier:
        messages = read_messages(path, "/linkage_vibration/levels")
        largest.append(max(message.total_load_ratio for _, message in messages))
    a, b = largest
    expected = (
        f"; the largest load ratio is {a:.2g} in A and {b:.2g} in B; not all loads are known "
    )
    assert expected in sentence(compared(*heavier))


def test_a_log_without_loads_differs(write_log: Any, tmp_path: Path) -> None:
    """Equal predictions with loads in one log only are no equal logs, and the sentence says so."""
    times, alpha3 = hitch_duty_cycle()
    a = write_log(tmp_path / "a.mcap", times[:100], alpha3[:100], False)
    b = write_log(tmp_path / "b.mcap", times[:100], alpha3[:100])
    messages = read_messages(b, "/linkage_vibration/levels")
    largest = max(message.total_load_ratio for _, message in messages)
    text = sentence(compared(a, b))
    assert text.startswith("The natural frequencies are equal; the logs differ")
    assert f"; the largest load ratio is not known in A and {largest:.2g} in B; not all " in text
    nothing = "not all loads are known at 100 % of the moments in A and 100 % of the moments in B."
    assert sentence(compared(a, a)) == f"The logs have equal predictions; {nothing}"


def test_difference_in_one_sentence(heavier: tuple[Path, Path]) -> None:
    """The sentence names what differs most and by how much."""
    text = sentence(compared(*heavier))
    assert text.startswith("Mode 11 (implement yaw) differs most: in B it is 20.3 Hz (17 %) lower")
    text = sentence(compared(*heavier[::-1]))
    assert text.startswith("Mode 11 (implement yaw) differs most: in B it is 20.3 Hz (21 %) higher")
    equal = sentence(compared(heavier[0], heavier[0]))
    assert equal.startswith("The logs have equal predictions; not all loads are known at 100 % of")


@pytest.mark.parametrize("rows", [slice(0, 600), slice(100, 500)])
def test_another_clock(write_log: Any, tmp_path: Path, rows: slice) -> None:
    """The same drive with stamps 5 s later has no difference, also where a log has less of it."""
    times, alpha3 = hitch_duty_cycle()
    a = write_log(tmp_path / "a.mcap", times[:600], alpha3[:600], False)
    b = write_log(tmp_path / "b.mcap", times[rows] + 5.0, alpha3[rows], False)
    comparison = compared(a, b)
    assert comparison.offset == 5 * 10**9
    assert comparison.rows_a.tolist() == list(range(600))[rows]
    assert [q.largest for q in comparison.quantities[:-1]] == [0.0] * 6
    assert (problems(comparison) == []) == (rows == slice(0, 600))
    clock = "moments are in both logs, with the clock of B 5 s later, as the crank angles show; "
    assert clock in difference_summary(comparison)


def test_no_moment_in_common(write_log: Any, tmp_path: Path) -> None:
    """Logs of other stamps are refused if no difference of their clocks matches half of one."""
    angles = np.linspace(2.0, 2.01, 11)
    a = write_log(tmp_path / "a.mcap", np.arange(11) * 0.01, angles, False)
    steps = np.arange(11.0)
    for least, refused in ((4, True), (6, False)):
        later = np.where(steps < least, 0.0, np.where(steps < 8, 0.3, 0.7))
        b = write_log(tmp_path / "b.mcap", 5.0 + 0.01 * (steps + later), angles, False)
        if refused:
            with pytest.raises(ReviewError, match="have no moment in common"):
                compared(a, b)
        else:
            assert len(compared(a, b).rows_a) == 6


@pytest.mark.parametrize(
    ("apart", "turns", "differ"), [(1.9, 0, False), (1.9, 1, False), (2.1, 0, True)]
)
@pytest.mark.parametrize(("count", "refused"), [(5, False), (6, True)])
def test_other_angles(
    write_log: Any,
    tmp_path: Path,
    apart: float,
    turns: int,
    differ: bool,
    count: int,
    refused: bool,
) -> None:
    """Moments of more than 2 deg are not compared, and more than 5 % of them are another drive."""
    times, alpha3 = hitch_duty_cycle()
    changed = alpha3[:100].copy()
    changed[40 : 40 + count] += math.radians(apart) + turns * math.tau
    a = write_log(tmp_path / "a.mcap", times[:100], alpha3[:100], False)
    b = write_log(tmp_path / "b.mcap", times[:100], changed, False)
    if differ and refused:
        words = "of 100 moments .* 6 have crank angles more than 2 deg apart, up to 2.1 deg at 0.4"
        with pytest.raises(ReviewError, match=words):
            compared(a, b)
        return
    comparison = compared(a, b)
    assert comparison.apart == (count if differ else 0)
    assert len(comparison.rows_a) == 100 - comparison.apart
    assert problems(comparison)
    left_out = f"{count} more have crank angles above 2 deg apart, and are not compared."
    assert (left_out in difference_summary(comparison)) == differ


def test_modes_are_matched_by_name(
    heavier: tuple[Path, Path], write_log: Any, tmp_path: Path
) -> None:
    """Of two linkages, modes of one name are compared, and others are named; or all are refused."""
    a, b = write_log(tmp_path / "a.mcap", *hitch_duty_cycle(), False), heavier[0]
    comparison = compared(a, b)
    names = [q.name for q in comparison.frequencies]
    assert names == ["mode 1 (implement heave), 8 in B", "mode 2 (implement pitch), 10 in B"]
    heave = comparison.frequencies[0]
    topic = "/linkage_vibration/prediction"
    for values, path, mode in ((heave.a, a, 0), (heave.b, b, 7)):
        expected = [message.natural_frequencies[mode] for _, message in read_messages(path, topic)]
        assert values.tolist() == expected
    only = "mode 3 (lift rod bending) of A, mode 1 (tractor sway) of B, mode 2 (tractor pitch) of B"
    assert f"These modes are in one log only: {only}" in difference_summary(comparison)
    first, second = read_log(a), read_log(b)
    assert first.table is not None
    numbered = replace(first.table, mode_names=("mode 1", "mode 2", "mode 3"))
    first = replace(first, table=numbered)
    another = replace(numbered, mechanism_name="another")
    second = replace(first, table=another, table_id="another")
    with pytest.raises(ReviewError, match="two linkages without a mode of the same name"):
        compare(first, second)
    second = replace(second, table=numbered)  # the same mechanism
    assert len(compare(first, second).frequencies) == 3
    with pytest.raises(ReviewError, match=r"and .*a\.mcap does not hold its own"):
        compare(first, replace(second, table=None))


def test_what_is_not_known_is_never_equal(tmp_path: Path) -> None:
    """A load without a source is not compared with the whole, and its share is stated."""
    whole = [
        Message(
            START + 10**8 * k, 2.0 + 0.01 * k, 1, (1,) * 4, (0.1,) * 4, 0.2, "engine 1", 0, 0.33
        )
        for k in range(20)
    ]
    ratios = (math.nan, 0.01, 0.01, 0.01)
    less = [
        replace(each, ratios=ratios, total=0.02, unknown=2) if k < 5 else each
        for k, each in enumerate(whole)
    ]
    a, b = write_drive(tmp_path / "a.mcap", whole), write_drive(tmp_path / "b.mcap", less)
    comparison = compared(a, b)
    load = comparison.quantities[-1]
    assert (load.name, load.one_sided, load.largest) == ("load ratio", 5, 0.0)
    assert problems(comparison)
    assert sentence(comparison).endswith("; not all loads are known at 25 % of the moments in B.")
    assert sentence(compared(a, a)) == "The logs have equal predictions."
    same = compared(b, b)
    assert problems(same) == []
    shares = "25 % of the moments in A and 25 % of the moments in B."
    assert sentence(same) == f"The logs have equal predictions; not all loads are known at {shares}"


def test_nothing_known_is_not_equal(write_log: Any, tmp_path: Path) -> None:
    """Two logs without a natural frequency are not called equal."""
    path = write_log(tmp_path / "a.mcap", [0.0, 0.01], [math.nan] * 2, False)
    comparison = compared(path, path)
    assert sentence(comparison).startswith("Nothing can be compared, as the logs know no natural")
    assert problems(comparison)


def test_equal_stamps(write_log: Any, tmp_path: Path) -> None:
    """The first of two predictions with one stamp matches the first, and the second the second."""
    times, angles = [0.0, 0.01, 0.02, 0.02, 0.03], [2.0, 2.1, 2.2, 2.3, 2.4]
    a = write_log(tmp_path / "a.mcap", times, angles, False)
    b = write_log(tmp_path / "b.mcap", times, [*angles[:3], 2.31, 2.4], False)
    comparison = compared(a, b)
    assert comparison.rows_a.tolist() == comparison.rows_b.tolist() == [0, 1, 2, 3, 4]
    assert comparison.quantities[0].farthest == 3
    assert comparison.quantities[0].largest == pytest.approx(0.01)
    less = write_log(tmp_path / "c.mcap", times[:3], angles[:3], False)
    assert compared(a, less).rows_a.tolist() == [0, 1, 2]


def test_clock_that_jumps_back(write_log: Any, tmp_path: Path) -> None:
    """Each pass is compared with the same pass, one after the other."""
    times = np.concatenate([np.arange(50), np.arange(30)]) / 100.0
    angles = np.linspace(2.0, 2.4, 80)
    a = write_log(tmp_path / "a.mcap", times, angles, False)
    b = write_log(
        tmp_path / "b.mcap", times, angles + np.where(np.arange(80) == 70, 0.01, 0), False
    )
    comparison = compared(a, b)
    assert comparison.quantities[0].farthest == 70


def test_command(heavier: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    """The view prints the summary, writes no page, and with --strict differences have a code."""
    a, b = (str(path) for path in heavier)
    assert main(["review", b, "--against", a]) == 0
    assert capsys.readouterr().out.strip() == difference_summary(compared(*heavier)).strip()
    assert not heavier[1].with_suffix(".html").exists()
    assert main(["review", b, "--against", a, "--strict"]) == 3
    assert main(["review", a, "--against", a, "--strict"]) == 0


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
    comparison = compared(tmp_path, drive)
    assert not problems(comparison)
    assert comparison.a.mechanism_text == comparison.b.mechanism_text != ""


@pytest.mark.parametrize(
    ("a", "b", "beyond"),
    [
        (10.0, 10.49, False),
        (10.0, 10.51, True),
        (10.0, 9.49, True),
        (0.2, 0.249, False),  # a tenth of the largest number, 1, counts
        (0.2, 0.251, True),
        (2.0, 2.11, True),
        (math.nan, math.nan, False),
        (10.0, math.nan, True),
        (math.nan, 10.0, True),
    ],
)
def test_tolerance(a: float, b: float, beyond: bool) -> None:
    """Numbers may differ by 5 % of one or of a tenth of the largest; both logs have one or none."""
    values = np.array([10.0, a]), np.array([10.0, b])
    each = Quantity("mode 1", "Hz", *values, *map(np.isfinite, values))
    assert each.beyond(0.05).tolist() == [False, beyond]
    assert each.beyond(0.0).tolist() == [False, a != b and not (math.isnan(a) and math.isnan(b))]
