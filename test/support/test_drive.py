# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The hitch duty cycle and the bag of it that ships."""

from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader

from linkage_vibration.support.resources import config_file
from test.support.drive import HITCH_JOINT, hitch_duty_cycle, write_drive
from test.support.messages import read_messages

SHIPPED = "drives/hitch_duty_cycle.mcap"


def test_duty_cycle_stays_well_within_the_stroke() -> None:
    """20 s at 100 Hz, between 100 and 170 deg, of a stroke of 90 to 180 deg."""
    times, alpha3 = hitch_duty_cycle()
    np.testing.assert_allclose(np.diff(times), 0.01, rtol=1e-9)
    assert times.size == 2000
    assert np.deg2rad(100) < alpha3.min() < np.deg2rad(105)
    assert np.deg2rad(165) < alpha3.max() < np.deg2rad(170)


def test_shipped_bag_is_what_the_generator_writes(tmp_path: Path) -> None:
    """The bag under config holds byte for byte the messages that the generator writes today."""
    write_drive(tmp_path / "drive.mcap")
    contents = []
    for path in (tmp_path / "drive.mcap", config_file(SHIPPED)):
        with AnyReader([path]) as reader:
            contents.append([(c.topic, c.msgtype, t, bytes(d)) for c, t, d in reader.messages()])
    assert contents[0] == contents[1]


def test_bag_holds_the_duty_cycle_among_other_joints() -> None:
    """The hitch is found by its name; its place among the names changes."""
    times, alpha3 = hitch_duty_cycle()
    records = [message for _, message in read_messages(config_file(SHIPPED), "/joint_states")]
    places = [record.name.index(HITCH_JOINT) for record in records]
    assert set(places) == {0, 1, 2}
    hitch = [record.position[k] for record, k in zip(records, places, strict=True)]
    np.testing.assert_array_equal(hitch, alpha3)
    headers = [record.header.stamp for record in records]
    stamps = np.array([stamp.sec * 10**9 + stamp.nanosec for stamp in headers])
    np.testing.assert_array_equal(stamps - stamps[0], np.rint(times * 1e9))
    velocities = [record.velocity[k] for record, k in zip(records, places, strict=True)]
    np.testing.assert_allclose(velocities, np.gradient(alpha3, times), rtol=1e-6, atol=1e-9)
    assert all(np.isnan(record.effort).all() for record in records)
