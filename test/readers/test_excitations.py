# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Files of excitations: the one that comes with the package, and invalid ones."""

from pathlib import Path

import pytest

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.support.resources import config_file


def test_shipped_file() -> None:
    """The shipped file has every source, and no order or name twice."""
    found = read_excitations(config_file("excitations.yaml"))
    assert {one.source for one in found} == set(Source)
    assert len({one.name for one in found}) == len(found) == 12


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "excitations: None is not a mapping"),
        ("engine: {speed: engine}", "excitations.engine.orders"),
        ("engine: [", "is not valid YAML"),
        ("engine: {speed: engine, orders: [1]}\nengine: {speed: pto, orders: [1]}", "occurs twice"),
    ],
)
def test_bad_files(tmp_path: Path, text: str, words: str) -> None:
    """The error names the file and the key."""
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(LinkageVibrationError, match=words) as caught:
        read_excitations(path)
    assert "bad.yaml" in str(caught.value)
