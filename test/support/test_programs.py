# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A run of the tests names the programs that would enable more of them."""

import shutil

import pytest

from test.support.programs import missing_programs, require


def test_first_program_that_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of the programs that do the same is used; with none, the test is skipped."""
    monkeypatch.setattr(shutil, "which", {"google-chrome": "/opt/chrome", "nm": "/bin/nm"}.get)
    assert require("nm") == "/bin/nm"
    assert require("chromium", "chromium-browser", "google-chrome") == "/opt/chrome"
    with pytest.raises(pytest.skip.Exception, match="run apt-get install qemu-user"):
        require("qemu-arm")


def test_no_line_without_a_missing_program() -> None:
    """A library that is missing, or nothing, gives no line."""
    assert missing_programs([]) == ""
    assert missing_programs(["Skipped: pyuff is not installed"]) == ""


def test_line_at_the_end_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """The line counts the tests that each program would enable."""
    monkeypatch.setenv("PATH", "")
    reasons = ["Skipped: no reason"]
    for program in ("clang", "arm-none-eabi-gcc", "clang", "clang"):
        with pytest.raises(pytest.skip.Exception) as skipped:
            require(program)
        reasons.append(f"('test_c.py', 9, 'Skipped: {skipped.value.msg}')")
    assert missing_programs(reasons) == (
        "More tests would run: 1 with arm-none-eabi-gcc, 3 with clang; "
        "run `apt-get install clang gcc-arm-none-eabi`."
    )
