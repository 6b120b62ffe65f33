# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Signals of CAN frames have the values that the standards and cantools give them."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from linkage_vibration.bags.can_frames import ERROR, EXTENDED, REMOTE
from linkage_vibration.bags.can_signals import SIGNALS, CanSignal
from linkage_vibration.support.resources import share_directory
from test.support.can_bus import identifier, recorded_frames

pytest.importorskip("cantools", reason="signals are compared with cantools (extra can)")

from cantools.database.can import Database

# The same signals as a DBC file of J1939 states them; the address 254 stands for any.
STANDARD = """\
VERSION ""
BO_ {hitch} RearHitch: 8 Vector__XXX
 SG_ Position : 0|8@1+ (0.4,0) [0|100] "%" Vector__XXX
BO_ {draft} RearDraft: 8 Vector__XXX
 SG_ Draft : 24|16@1+ (10,-320000) [-320000|322550] "N" Vector__XXX
BO_ {force} RearForce: 8 Vector__XXX
 SG_ Force : 16|8@1+ (0.8,-100) [-100|100] "%" Vector__XXX
BO_ {front} FrontHitch: 8 Vector__XXX
 SG_ Position : 0|8@1+ (0.4,0) [0|100] "%" Vector__XXX
BO_ {engine} Engine: 8 Vector__XXX
 SG_ Speed : 24|16@1+ (0.125,0) [0|8031.875] "rpm" Vector__XXX
BO_ {pto} RearPto: 8 Vector__XXX
 SG_ Speed : 0|16@1+ (0.125,0) [0|8031.875] "rpm" Vector__XXX
BO_ {frontpto} FrontPto: 8 Vector__XXX
 SG_ Speed : 0|16@1+ (0.125,0) [0|8031.875] "rpm" Vector__XXX
BO_ {wheel} Wheel: 8 Vector__XXX
 SG_ Speed : 0|16@1+ (0.001,0) [0|64.255] "m/s" Vector__XXX
BO_ {ground} Ground: 8 Vector__XXX
 SG_ Speed : 0|16@1+ (0.001,0) [0|64.255] "m/s" Vector__XXX
BO_ {vehicle} Vehicle: 8 Vector__XXX
 SG_ Speed : 8|16@1+ (0.00390625,0) [0|250.996] "km/h" Vector__XXX
""".format(
    **{
        name: EXTENDED | identifier(group, 254, 3)
        for name, group in {
            "hitch": 65093,
            "front": 65094,
            "engine": 61444,
            "pto": 65091,
            "frontpto": 65092,
            "wheel": 65096,
            "ground": 65097,
            "vehicle": 65265,
        }.items()
    },
    # Other addresses, as a DBC file has one message for each identifier.
    draft=EXTENDED | identifier(65093, 253, 3),
    force=EXTENDED | identifier(65093, 252, 3),
)
SAME = {
    "rear_hitch_position": "RearHitch.Position",
    "rear_draft": "RearDraft.Draft",
    "rear_lower_link_force": "RearForce.Force",
    "front_hitch_position": "FrontHitch.Position",
    "engine_speed": "Engine.Speed",
    "rear_pto_speed": "RearPto.Speed",
    "front_pto_speed": "FrontPto.Speed",
    "wheel_based_speed": "Wheel.Speed",
    "ground_based_speed": "Ground.Speed",
    "vehicle_speed": "Vehicle.Speed",
}


def value(signal: CanSignal, data: bytes) -> float:
    """Return the value of a signal in a frame."""
    payload = np.frombuffer(data[:8].ljust(8, b"\0"), np.uint8)[None]
    return float(signal.values(np.array([len(data)], np.uint8), payload)[0])


def present(signal: CanSignal, number: int, data: bytes = bytes(8)) -> bool:
    """Return whether a frame with this identifier contains a signal."""
    payload = np.frombuffer(data[:8].ljust(8, b"\0"), np.uint8)[None]
    key, dlc = np.array([EXTENDED | number], np.uint32), np.array([len(data)], np.uint8)
    actual = bool(signal.present(key, dlc, payload)[0])
    assert signal.selectors or actual == signal.matches(EXTENDED | number)
    return actual


def explain(signal: CanSignal, data: bytes) -> str:
    """Return why a frame has no value."""
    return signal.explain(len(data), data.ljust(8, b"\0"))


@pytest.mark.parametrize("name", SIGNALS)
@given(raw=st.integers(0, 0xFFFF), source=st.integers(0, 253), priority=st.integers(0, 7))
@settings(max_examples=50)
def test_built_in_signals_are_those_of_a_dbc_file(
    name: str, raw: int, source: int, priority: int
) -> None:
    """Values are those that cantools encodes and decodes, from each sender."""
    database = Database()
    database.add_dbc_string(STANDARD)
    message_name, _, signal_name = SAME[name].partition(".")
    message = database.get_message_by_name(message_name)
    theirs, ours = message.get_signal_by_name(signal_name), SIGNALS[name]
    raw %= 0xFB if theirs.length == 8 else 0xFB00
    exact = theirs.raw_to_scaled(raw)
    data = message.encode({signal_name: exact}, padding=True)
    assert value(ours, data) == pytest.approx(exact, rel=1e-15)
    decoded = message.decode(data)
    assert isinstance(decoded, dict)
    assert value(ours, data) == pytest.approx(decoded[signal_name], rel=1e-15)
    group = message.frame_id >> 8 & 0xFFFF
    assert present(ours, identifier(group, source, priority))
    assert ours.unit == theirs.unit
    assert not present(ours, identifier(group ^ 1 << raw % 16, source, priority))


def test_table_of_the_manual() -> None:
    """The manual lists the signals as they are decoded."""
    text = (share_directory() / "docs" / "can.md").read_text()
    rows = re.findall(r"^\| (?:\*\*)?`(\w+)`(?:\*\*)? \|(.*)\|$", text, re.MULTILINE)
    assert [name for name, _ in rows] == list(SIGNALS)
    for name, columns in rows:
        signal = SIGNALS[name]
        group, _, first, n_bytes, bit, unit = (column.strip() for column in columns.split("|"))
        assert signal.matches(EXTENDED | identifier(int(group)))
        assert signal.bits.first == 8 * (int(first) - 1)
        assert signal.bits.length == 8 * int(n_bytes)
        assert (signal.scale, signal.unit) == (float(bit), unit)


@pytest.mark.parametrize("name", SIGNALS)
def test_reserved_numbers_are_not_values(name: str) -> None:
    """Above 0xFA, the highest byte says why there is no value."""
    signal = SIGNALS[name]
    first, width = signal.bits.first // 8, signal.bits.length // 8

    def frame(raw: int) -> bytes:
        return bytes(first) + raw.to_bytes(width, "little") + bytes(8 - first - width)

    last = 0xFA if width == 1 else 0xFAFF
    assert value(signal, frame(last)) == pytest.approx(signal.scale * last + signal.offset)
    assert "reserved" not in explain(signal, frame(last))
    for raw in range(last + 1, 1 << 8 * width):
        assert np.isnan(value(signal, frame(raw)))
    low = (width - 1) * 8
    for top, words in ((0xFF, "not available"), (0xFE, "an error"), (0xFB, "reserved")):
        sentence = explain(signal, frame(top << low))
        assert sentence.startswith(f"{name} is {words} (0x{top:X}")


def test_frames_that_contain_no_signal() -> None:
    """Remote frames, error frames, short identifiers and short frames give no value."""
    hitch, number = SIGNALS["rear_hitch_position"], identifier(65093, 0xF0)
    assert hitch.matches(EXTENDED | number)
    for flags in (0, EXTENDED | REMOTE, EXTENDED | ERROR, ERROR):
        assert not hitch.matches(flags | number)
    assert not hitch.matches(number & 0x7FF)
    assert np.isnan(value(hitch, b""))
    assert "frame of 0 bytes, but needs 1" in explain(hitch, b"")
    assert np.isnan(value(SIGNALS["engine_speed"], bytes(4)))
    assert value(SIGNALS["engine_speed"], bytes(5)) == 0.0


def test_one_sender_can_be_chosen() -> None:
    """With an address, the frames of all other senders are dismissed."""
    hitch = SIGNALS["rear_hitch_position"].from_address(0xF0)
    assert present(hitch, identifier(65093, 0xF0, 6))
    assert not present(hitch, identifier(65093, 0xF1))


def test_recorded_tractor() -> None:
    """The engine of a real tractor idles near 800 rpm, and its ground speed is not available."""
    frames = recorded_frames()
    key = np.array([EXTENDED | frame.identifier for frame in frames], np.uint32)
    dlc = np.array([len(frame.data) for frame in frames], np.uint8)
    data = np.frombuffer(b"".join(f.data[:8].ljust(8, b"\0") for f in frames), np.uint8)
    payload = data.reshape(-1, 8)
    actual = {}
    for name, signal in SIGNALS.items():
        rows = signal.present(key, dlc, payload)
        actual[name] = signal.values(dlc[rows], payload[rows])
    counts = {name: len(values) for name, values in actual.items() if len(values)}
    assert counts == {
        "engine_speed": 2190,
        "rear_pto_speed": 241,
        "front_pto_speed": 241,
        "ground_based_speed": 242,
        "vehicle_speed": 241,
    }
    assert np.isnan(actual["rear_pto_speed"][:6]).all()  # it is unknown before it is at rest
    assert (actual["rear_pto_speed"][6:] == 0.0).all()
    assert np.isnan(actual["ground_based_speed"]).all()
    assert (actual["front_pto_speed"] == 0.0).all()
    running = actual["engine_speed"][actual["engine_speed"] > 0.0]
    assert 700.0 < np.median(running) < 2500.0
