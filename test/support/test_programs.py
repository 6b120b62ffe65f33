# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A run of the tests names the programs that would enable more of them."""

import shutil
from pathlib import Path

import pytest

from test.support.programs import missing_programs, require

pytest_plugins = ["pytester"]


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


def test_line_at_the_end_of_a_run(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line counts tests and fixtures that skip, also where workers run them."""
    root = Path(__file__).parents[2]
    monkeypatch.setenv("PYTHONPATH", str(root))
    pytester.makeconftest("from test.conftest import pytest_terminal_summary")
    pytester.makepyfile("""
        import pytest
        from test.support.programs import require

        @pytest.mark.parametrize("n", range(3))
        def test_clang(n, monkeypatch):
            monkeypatch.setenv("PATH", "")
            require("clang")

        @pytest.fixture
        def compiler(monkeypatch):
            monkeypatch.setenv("PATH", "")
            return require("arm-none-eabi-gcc")

        def test_fixture(compiler):
            pass

        def test_other():
            pytest.skip("no reason")
    """)
    run = pytester.runpytest_subprocess("-n", "1")
    run.assert_outcomes(skipped=5)
    [line] = [each for each in run.outlines if each.startswith("More tests")]
    assert line == (
        "More tests would run: 1 with arm-none-eabi-gcc, 3 with clang; "
        "run `apt-get install clang gcc-arm-none-eabi`."
    )
