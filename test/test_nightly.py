# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The nightly set cannot rot: what it shows at length, a test of every run shows for a seed."""

import pytest

from test.conftest import COLLECTED


def test_each_nightly_test_runs_in_short(request: pytest.FixtureRequest) -> None:
    """It has an own case for every run, or names another test of its module, or why there is none.

    In a run of this module alone, no nightly test is collected.
    """
    assert not request.config.getoption("lf"), "Run all tests again; alone, this one finds nothing."
    usual, nightly = set(), {}
    for item in request.config.stash[COLLECTED]:
        name = item.nodeid.partition("[")[0]
        if mark := item.get_closest_marker("nightly"):
            nightly[name] = mark.kwargs
        else:
            usual.add(name)
    for name, given in nightly.items():
        short = f"{name.partition('::')[0]}::{given.get('short', '')}"
        assert name in usual or short in usual or given.get("alone"), name
