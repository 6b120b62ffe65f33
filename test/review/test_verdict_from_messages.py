# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What page, summary and comparison say about random logs is what follows from their messages."""

import html
import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from linkage_vibration.bags import streams
from linkage_vibration.cli.main import main
from linkage_vibration.prediction.verdict import contributions, durations, episodes, worst_message
from linkage_vibration.review import findings
from linkage_vibration.review import log as logs
from linkage_vibration.review.findings import DOUBTFUL, first_sentence, load_problems
from linkage_vibration.review.log import Log, read_log
from linkage_vibration.review.overview import drive_summary, overview_html
from linkage_vibration.testing import bag_checks
from linkage_vibration.testing.limits import Limits
from test.support.random_resonances import (
    CLEAR,
    NAMES,
    Message,
    durations_of,
    holding_times,
    random_drive,
    rows_of,
    warnings_of,
    worst_of,
    write_drive,
)

# In 100 the clock goes back by less than ten usual steps.
SEEDS = (0, 100, *(pytest.param(seed, marks=pytest.mark.nightly) for seed in (1, 2, 3)))
SINGLE = 1e-6  # relative, of float32


@pytest.fixture(scope="module", params=SEEDS)
def drive(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[list[Message], Path]:
    """Return the messages of a random drive and its log."""
    messages = random_drive(request.param)
    path = tmp_path_factory.mktemp("random") / "drive.mcap"
    return messages, write_drive(path, messages)


def test_verdict(drive: tuple[list[Message], Path]) -> None:
    """Warnings, their durations, the order of the rows and the worst moment are those of a loop."""
    check_verdict(drive[0], read_log(drive[1]))


def sure(messages: list[Message], log: Log) -> list[Message]:
    """Return messages without the loads of those whose inputs are doubted, which are no worst."""
    assert log.drive is not None
    none, pairs = (math.nan,) * len(NAMES), zip(messages, log.drive.doubted, strict=True)
    return [replace(each, ratios=none, total=math.nan) if bad else each for each, bad in pairs]


def check_verdict(messages: list[Message], log: Log) -> None:
    """Compare warnings, rows, durations and the worst moment with those of a loop."""
    assert log.drive is not None
    spent, every, messages = durations(log.drive), messages, sure(messages, log)
    assert log.drive.held == pytest.approx(holding_times(messages), abs=1e-9)
    actual = [
        (e.start, e.duration, float(log.drive.severity()[e.worst])) for e in episodes(log.drive)
    ]
    expected = warnings_of(messages)
    assert len(actual) == len(expected)
    for each, other in zip(actual, expected, strict=True):
        # A small step back is a message that comes late, so the log begins with the earliest one.
        start = other[0] + 1e-9 * (messages[0].stamp - int(log.stamps[0]))
        assert each == pytest.approx((start, *other[1:]), rel=SINGLE, abs=1e-6)
    for part, row in zip(contributions(log.drive), rows_of(messages), strict=True):
        assert (part.name, part.warnings) == (row.name, row.warnings)
        numbers = part.load_ratio, part.warning_time, part.note_time
        assert numbers == pytest.approx(
            (row.largest, row.warning, row.note), rel=SINGLE, abs=1e-9, nan_ok=True
        )
    if (worst := worst_of(messages)) is not None:
        at = worst_message(log.drive)
        time = 1e-9 * (worst.stamp - int(log.stamps[0]))
        assert log.drive.times[at] == pytest.approx(time, abs=1e-6)
        # A message has no angle, so that of any with its stamp may be meant.
        angles = [each.angle for each in messages if each.stamp == worst.stamp]
        assert np.isclose(angles, log.drive.angles[at], rtol=SINGLE, atol=0.0).any()
    known = spent.above, spent.below, spent.unknown
    assert known == pytest.approx(durations_of(every), rel=SINGLE, abs=1e-6)


def test_summary(drive: tuple[list[Message], Path], capsys: Any) -> None:
    """`review --json` prints the same numbers with six digits."""
    messages, path = drive
    assert main(["review", str(path), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["schema_version"], content["failures"]) == (1, [])
    [actual] = content["drives"]
    above, below, unknown = durations_of(messages)
    judged = worst_of(messages) is not None or above > 0.0
    limits = sorted({message.limit for message in messages})
    messages = sure(messages, read_log(path))
    warnings, worst = warnings_of(messages), worst_of(messages)
    assert actual["warnings"] == (len(warnings) if judged else None)
    keys = "above_limit_s", "below_limit_s", "unknown_s", "known_share"
    known = above + below
    share = known / (known + unknown) if known else 0.0
    numbers = [above, below, unknown, share]
    assert [actual[key] for key in keys] == pytest.approx(numbers, rel=1e-5, abs=1e-9)
    assert actual["load_ratio_limits"] == pytest.approx(limits, rel=1e-5)
    assert actual["in_warning_s"] == pytest.approx(sum(w[1] for w in warnings), rel=1e-5)
    keys = "name", "load_ratio", "in_warning_s", "in_note_s"
    shown = [tuple(each[key] for key in keys) for each in actual["excitations"]]
    for each, row in zip(shown, rows_of(messages), strict=True):
        largest = None if math.isnan(row.largest) else pytest.approx(row.largest, rel=1e-5)
        assert each[:2] == (row.name, largest)
        assert each[2:] == pytest.approx((row.warning, row.note), rel=1e-5, abs=1e-9)
    assert (actual["worst"] is None) == (worst is None)
    if worst is not None:
        assert actual["worst"]["load_ratio"] == pytest.approx(worst.total, rel=1e-5)
        assert actual["worst"]["excitation"] == worst.excitation
        time = 1e-9 * (worst.stamp - int(read_log(path).stamps[0]))
        assert actual["worst"]["time_s"] == pytest.approx(time, rel=1e-5, abs=1e-9)


def check_sentence(messages: list[Message], log: Log) -> str:
    """Return the sentence of a log, which has the numbers of messages and is not better."""
    sentence = first_sentence(log)
    warnings, worst = warnings_of(messages), worst_of(sure(messages, log))
    if worst is None:
        assert ("not known" if worst_of(messages) is None else "No moment is named") in sentence
        return sentence
    assert sentence.startswith(DOUBTFUL) == bool(log.input_faults)
    sentence = sentence.removeprefix(DOUBTFUL)
    time = 1e-9 * (worst.stamp - int(log.stamps[0]))
    assert f"{worst.total:.2g} of the static force" in sentence
    assert f"at {time:.2f} s" in sentence
    if warnings:
        total = sum(duration for _, duration, _ in warnings)
        often = "one warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
        assert f"{often} of {total:.1f} s" in sentence
    calm = is_calm(messages)
    assert sentence.startswith("No load exceeded") == calm
    above = any(message.total > message.limit for message in messages)
    assert sentence.startswith(("Loads exceeded", "Tyres were")) == (above or bool(warnings))
    return sentence


def is_calm(messages: list[Message]) -> bool:
    """Return whether nothing was above its limit, and at least 95 % of the drive are known."""
    if warnings_of(messages) or any(message.total > message.limit for message in messages):
        return False
    _, below, unknown = durations_of(messages)
    return below > 0.0 and below >= 0.95 * (below + unknown)


def check_answers(messages: list[Message], log: Log) -> None:
    """Compare the colour, the exit code of `--strict` and `--limits` with what the messages say."""
    calm, summary = is_calm(messages), drive_summary(log)
    green = " class=calm" in overview_html([(summary, "page.html")], [])
    assert green == (calm and not log.input_faults)
    assert (not load_problems(log)) == calm
    limit = 0.2
    same = [replace(message, limit=limit, state=CLEAR) for message in messages]
    assert bag_checks.check_bag(log.path, Limits(load_ratio=limit)).passed <= is_calm(same)


def prepare_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all drives share what follows from their model and from the types of their messages."""
    kept: tuple[tuple[Any, str, Callable[..., str]], ...] = (
        (streams, "_store", lambda connections: connections[0].msgtype if connections else ""),
        (logs, "_read_model", lambda _, table_id: table_id),
        (logs, "topic_types", lambda _: ""),
        (bag_checks, "topic_types", lambda _: ""),
        (findings, "kept_levels", lambda predictor, *_: predictor.table.table_id),
    )
    for module, name, key in kept:
        monkeypatch.setattr(module, name, once(getattr(module, name), key))
    monkeypatch.setattr(bag_checks, "read_log", lru_cache(1)(read_log))


def once(function: Callable[..., Any], key: Callable[..., str]) -> Callable[..., Any]:
    """Return a function that returns the same for arguments of the same key."""
    known: dict[str, Any] = {}

    def read(*arguments: Any) -> Any:
        name = key(*arguments)
        if name not in known:
            known[name] = function(*arguments)
        return known[name]

    return read


def check_drive(folder: Path, seed: int) -> list[Message]:
    """Compare all answers about a random drive with its messages, which are returned."""
    messages = random_drive(seed)
    path = write_drive(folder / f"{seed}.mcap", messages)
    log = bag_checks.read_log(path)
    check_verdict(messages, log)
    check_sentence(messages, log)
    check_answers(messages, log)
    path.unlink()
    return messages


HUNDREDS = [range(first, first + 100) for first in range(100, 10_100, 100)]
NIGHTLY = [pytest.param(each, marks=pytest.mark.nightly) for each in HUNDREDS]


@pytest.mark.parametrize("seeds", [range(100, 104), *NIGHTLY], ids=str)
def test_random_drives(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seeds: range) -> None:
    """No duration, sentence or colour of 10,000 drives is better than their messages."""
    prepare_once(monkeypatch)
    drives = [check_drive(tmp_path, seed) for seed in seeds]
    assert len(seeds) < 100 or 3 < sum(map(is_calm, drives)) < 50  # Both sides are there.


def test_page(drive: tuple[list[Message], Path], tmp_path: Path) -> None:
    """The page has all of the sentence, the load of each source, and rows in this order."""
    messages, path = drive
    sentence = check_sentence(messages, read_log(path))
    warnings = warnings_of(messages)
    page = tmp_path / "page.html"
    assert main(["review", str(path), "-o", str(page)]) == 0
    text = page.read_text()
    first, _, rest = sentence.removeprefix(DOUBTFUL).partition(". ")
    assert first in html.unescape(text)
    assert rest in html.unescape(text)
    calm = is_calm(messages) and not read_log(path).input_faults
    assert ('"calm": true' in text) == calm
    begin = text.index('"tables": ') + len('"tables": ')
    tables = {each["id"]: each["rows"] for each in json.JSONDecoder().raw_decode(text[begin:])[0]}
    shown = [line["cells"] for line in tables["contributions"]]
    for cells, row in zip(shown, rows_of(sure(messages, read_log(path))), strict=True):
        assert [cells[0], cells[4]] == [row.name, str(row.warnings)]
        load = math.nan if cells[1] == "not known" else float(cells[1])
        assert load == pytest.approx(row.largest, rel=0.051, nan_ok=True)  # it has two digits
        assert float(cells[3]) == pytest.approx(row.warning, abs=0.051)  # and these have tenths
        assert float(cells[5]) == pytest.approx(row.note, abs=0.051)
    lengths = sorted(line["length"] for line in tables.get("moments", ()))
    expected = sorted(duration for _, duration, _ in warnings)
    assert lengths == pytest.approx(expected, abs=1e-6)
