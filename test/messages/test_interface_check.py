# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node refuses messages of another version."""

import re
from pathlib import Path

import pytest

from linkage_vibration.messages.definitions import DefinitionError, check_interfaces
from linkage_vibration.support.resources import share_directory


def test_installed_definitions_fit() -> None:
    """The definitions of this environment are those that this package encodes."""
    check_interfaces()


@pytest.mark.parametrize(
    ("name", "before", "after", "refused"),
    [
        ("msg/Resonance.msg", r"float64 approach_rate.*\n", "", True),
        ("msg/Resonance.msg", r"float64 (approach_rate)", r"float32 \1", True),
        ("msg/Resonance.msg", r"(.*approach_rate.*\n)(.*\n)", r"\2\1", True),
        ("msg/Resonance.msg", r"#.*", "# other words", False),
        ("srv/PredictVibration.srv", r"bool shares.*\n", "", True),
        ("action/SetImplement.action", r"float64 mass.*\n", "", True),
    ],
    ids=["field", "type", "order", "comments", "service", "action"],
)
def test_another_version(
    name: str,
    before: str,
    after: str,
    refused: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """CDR has no names, so fields, their types and their order count; the error names the type."""
    own = share_directory() / "linkage_vibration_interfaces" / name
    other = tmp_path / "share" / "linkage_vibration_interfaces" / name
    other.parent.mkdir(parents=True)
    text, count = re.subn(before, after, own.read_text())
    assert count > 0
    other.write_text(text)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    if not refused:
        return check_interfaces()
    match = rf"{name.partition('.')[0]} differs, .* install linkage_vibration_interfaces \d"
    with pytest.raises(DefinitionError, match=match):
        check_interfaces()
    return None
