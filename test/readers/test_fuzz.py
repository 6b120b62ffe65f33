# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Damaged files of every format give an error of the package, or something valid.

Each run reads a thousand; ``python -m benchmark.fuzz`` reads a hundred times as many, and measures
their time and memory.
"""

from collections import Counter
from pathlib import Path

import pytest

for name in ("pyuff", "rosbags"):
    pytest.importorskip(name, reason="reads or writes files of one kind (extras uff and bags)")

from linkage_vibration.errors import LinkageVibrationError  # noqa: E402
from test.support.damage import ACCEPTED, BOMBS, REFUSED, damaged, read_outcome, write_files  # noqa: E402
from test.support.file_readers import Reader, all_readers  # noqa: E402

READERS = {reader.name: reader for reader in all_readers()}
INPUTS = 80


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
def test_damaged_files(tmp_path: Path, reader: Reader) -> None:
    """Valid files are damaged at random; most give an error, and always one of the package."""
    for main, files in reader.seeds:
        write_files(tmp_path, files)
        assert read_outcome(reader, tmp_path / main) == (ACCEPTED, "")
    outcomes = Counter[str]()
    for number in range(INPUTS):
        main, files = damaged(reader, number)
        write_files(tmp_path, files)
        actual, trace = read_outcome(reader, tmp_path / main)
        assert actual in (REFUSED, ACCEPTED), f"input {number}: {trace}"
        outcomes[actual] += 1
    assert outcomes[REFUSED] > INPUTS / 4


@pytest.mark.parametrize("bomb", BOMBS, ids=["laughs", "merges", "itself", "flow", "indents"])
def test_yaml_without_bound(tmp_path: Path, bomb: str) -> None:
    """A page of YAML that would fill the memory or the stack gives an error that says so."""
    path = tmp_path / "m.yaml"
    path.write_text(bomb)
    with pytest.raises(LinkageVibrationError, match=r"m\.yaml: .*(expanded|RecursionError)"):
        READERS["mechanism (YAML)"].read(path)


@pytest.mark.parametrize(
    "value", ["!!bool x", "!!timestamp x", "!!int ''", "!!map x", "0x" + "f" * 5000, "1" * 5000]
)
def test_yaml_values_that_are_not_what_they_say(tmp_path: Path, value: str) -> None:
    """A tag that does not fit its value, or a whole number beyond every float, is an error."""
    path = tmp_path / "m.yaml"
    path.write_text(f"name: {value}\n")
    with pytest.raises(LinkageVibrationError, match=r"m\.yaml"):
        READERS["mechanism (YAML)"].read(path)
