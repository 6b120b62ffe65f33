# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The pytest fixture ``check_bag``, for the tests of a software stack."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from linkage_vibration.prediction.settings import Parameters
    from linkage_vibration.testing.bag_checks import Report
    from linkage_vibration.testing.limits import Limits


@pytest.fixture
def check_bag(tmp_path: Path) -> "Callable[..., Report]":
    """Return a function that fails the test if a bag exceeds a limit."""

    def check(
        bag: Path,
        limits: "Limits",
        settings: "Parameters | None" = None,
        baseline: Path | None = None,
    ) -> "Report":
        # Every run of pytest loads this plugin, so it imports NumPy only when it is used.
        from linkage_vibration.errors import LinkageVibrationError
        from linkage_vibration.testing import bag_checks

        picture = tmp_path / f"{Path(bag).stem}.png"
        try:
            report = bag_checks.check_bag(bag, limits, settings, picture, baseline)
        except LinkageVibrationError as error:
            pytest.fail(str(error), pytrace=False)
        if not report.passed:
            pytest.fail(str(report), pytrace=False)
        return report

    return check
