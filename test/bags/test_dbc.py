# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Signals of DBC files have the values that cantools gives them, in both directions."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from linkage_vibration.bags.can_frames import EXTENDED
from linkage_vibration.bags.can_reader import CanReader
from linkage_vibration.bags.can_signals import CanSignal
from linkage_vibration.bags.dbc import dbc_signal
from linkage_vibration.bags.schemas import FieldError
from test.support.can_bus import identifier

pytest.importorskip("cantools", reason="DBC files are read by cantools (extra can)")

from cantools.database import DecodeError, Message, Signal
from cantools.database.can import Database
from cantools.database.conversion import BaseConversion

MULTIPLEXED = """\
VERSION ""
BO_ 512 Arm: 8 Vector__XXX
 SG_ Page M : 0|4@1+ (1,0) [0|15] "" Vector__XXX
 SG_ Angle m3 : 15|16@0- (0.01,-5) [0|0] "deg" Vector__XXX
 SG_ Force m4 : 8|32@1- (1,0) [0|0] "N" Vector__XXX
 SG_ Part m5M : 8|8@1+ (1,0) [0|0] "" Vector__XXX
 SG_ Deep m2 : 16|16@1+ (0.5,0) [0|0] "mm" Vector__XXX
SIG_VALTYPE_ 512 Force : 1;
SG_MUL_VAL_ 512 Angle Page 3-3;
SG_MUL_VAL_ 512 Force Page 4-4;
SG_MUL_VAL_ 512 Part Page 5-6;
SG_MUL_VAL_ 512 Deep Part 2-2, 7-9;
"""


def values(signal: CanSignal, data: bytes, key: int) -> tuple[bool, float]:
    """Return whether a frame contains a signal, and the value that it then has."""
    payload = np.frombuffer(data[:8].ljust(8, b"\0"), np.uint8)[None]
    keys, dlc = np.array([key], np.uint32), np.array([len(data)], np.uint8)
    return bool(signal.present(keys, dlc, payload)[0]), float(signal.values(dlc, payload)[0])


def written(path: Path, text: str) -> Path:
    """Return a file with this text."""
    path.write_text(text)
    return path


@st.composite
def messages(draw: st.DrawFn) -> Message:
    """Return a message with one signal at any place, of any kind."""
    order = draw(st.sampled_from(["little_endian", "big_endian"]))
    real = draw(st.booleans())
    length = draw(st.sampled_from([32, 64])) if real else draw(st.integers(1, 64))
    start = draw(st.integers(0, 63))
    before = start if order == "little_endian" else 8 * (start // 8) + 7 - start % 8
    assume(before + length <= 64)
    scale = draw(st.sampled_from([1, 2, 0.125, 0.1, -0.5]))
    conversion = BaseConversion.factory(scale, draw(st.sampled_from([0, -40, 0.3])), None, real)
    signed = not real and draw(st.booleans())
    signal = Signal("S", start, length, order, signed, conversion=conversion)
    return Message(draw(st.integers(0, 0x7FF)), "M", 8, [signal])


@given(message=messages(), data=st.binary(min_size=8, max_size=8))
@settings(max_examples=50)
def test_any_signal_in_both_directions(
    tmp_path_factory: pytest.TempPathFactory, message: Message, data: bytes
) -> None:
    """Ours decodes as cantools does, and what ours decodes cantools encodes to the same bits."""
    database = Database([message])
    path = tmp_path_factory.mktemp("dbc") / "one.dbc"
    path.write_text(database.as_dbc_string())
    ours = dbc_signal(path, "M.S")
    decoded = message.decode(data)
    assert isinstance(decoded, dict)
    theirs = float(decoded["S"])
    actual, value = values(ours, data, message.frame_id)
    assert actual
    assert value == pytest.approx(theirs, rel=1e-14, abs=1e-14, nan_ok=True)
    if math.isfinite(value) and message.signals[0].length <= 32:
        again = message.encode({"S": value}, strict=False, padding=False)
        assert values(ours, again, message.frame_id)[1] == pytest.approx(value, rel=1e-6)


@given(page=st.integers(0, 15), rest=st.binary(min_size=7, max_size=7))
@settings(max_examples=50)
def test_multiplexed_signals(
    tmp_path_factory: pytest.TempPathFactory, page: int, rest: bytes
) -> None:
    """A frame contains the signals that its multiplexers choose, also one within another."""
    path = written(tmp_path_factory.getbasetemp() / "multiplexed.dbc", MULTIPLEXED)
    database = Database()
    database.add_dbc_string(MULTIPLEXED)
    message = database.get_message_by_name("Arm")
    data = bytes([page]) + rest
    try:
        theirs: Any = message.decode(data)
    except DecodeError:
        theirs = {}
    for name in ("Angle", "Force", "Part", "Deep"):
        actual, value = values(dbc_signal(path, f"Arm.{name}"), data, 512)
        if theirs:
            assert actual == (name in theirs)
        if actual and name in theirs:
            assert value == pytest.approx(float(theirs[name]), rel=1e-14, nan_ok=True)


def test_parameter_groups(tmp_path: Path) -> None:
    """A message of J1939 is recognised from every sender; another extended one is not."""
    own, null = identifier(0xFF21, 0x1C, 6), identifier(0xFF21, 254, 6)
    text = 'VERSION ""\nBO_ {} M: 8 Vector__XXX\n SG_ S : 0|16@1+ (0.5,0) [0|0] "%" Vector__XXX\n'
    group = 'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
    group += f'BA_DEF_DEF_ "VFrameFormat" "J1939PG";\nBA_ "VFrameFormat" BO_ {EXTENDED | own} 3;\n'
    exact = dbc_signal(written(tmp_path / "a.dbc", text.format(EXTENDED | own)), "M.S")
    address = dbc_signal(written(tmp_path / "b.dbc", text.format(EXTENDED | null)), "M.S")
    attribute = dbc_signal(written(tmp_path / "c.dbc", text.format(EXTENDED | own) + group), "M.S")
    assert address == attribute
    other = EXTENDED | identifier(0xFF21, 0x2C, 3)
    for signal, anyone in ((exact, False), (address, True)):
        assert values(signal, bytes(8), EXTENDED | own) == (True, 0.0)
        assert values(signal, bytes(8), other)[0] == anyone
        assert not values(signal, bytes(8), own)[0]
        unknown = values(signal, b"\xff" * 8, EXTENDED | own)[1]
        assert np.isnan(unknown) if anyone else unknown == 0.5 * 0xFFFF
    assert not values(address.from_address(3), bytes(8), other)[0]
    destination = identifier(0xEF00 | 0x26, 254, 6)
    proprietary = written(tmp_path / "d.dbc", text.format(EXTENDED | destination))
    assert values(dbc_signal(proprietary, "M.S"), bytes(8), EXTENDED | identifier(0xEF99, 7))[0]


def test_range_of_the_file(tmp_path: Path) -> None:
    """A number outside of the range that the file states is not a value."""
    text = 'VERSION ""\nBO_ 7 M: 2 Vector__XXX\n SG_ S : 0|8@1+ (1,0) [10|90] "deg" Vector__XXX\n'
    signal = dbc_signal(written(tmp_path / "a.dbc", text), "M.S")
    assert values(signal, bytes([90]), 7) == (True, 90.0)
    assert np.isnan(values(signal, bytes([91]), 7)[1])
    sentence = "M.S is 91 deg, outside of its range from 10 to 90."
    assert signal.explain(1, bytes([91]).ljust(8)) == sentence


FAULTS = {
    "Amr.Angle": r"has no message Amr; choose for example Arm",
    "Long.Far": r"reaches into byte 9, but a frame has 8 bytes",
    "Short.Wide": r"reaches into byte 2, but a frame has 1 bytes",
    "Empty.Any": r"has no signal of Empty Any; it has none at all",
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults(tmp_path: Path, name: str) -> None:
    """An error names the file, what it lacks, and what it has instead."""
    text = MULTIPLEXED.replace(
        "SIG_VALTYPE_",
        """BO_ 600 Long: 64 Vector__XXX
 SG_ Near : 0|8@1+ (1,0) [0|0] "" Vector__XXX
 SG_ Far : 64|8@1+ (1,0) [0|0] "" Vector__XXX
BO_ 601 Short: 1 Vector__XXX
 SG_ Wide : 0|9@1+ (1,0) [0|0] "" Vector__XXX
BO_ 602 Empty: 1 Vector__XXX
SIG_VALTYPE_""",
        1,
    )
    path = written(tmp_path / "bus.dbc", text)
    assert dbc_signal(path, "Long.Near").bits.length == 8
    with pytest.raises(FieldError, match=FAULTS[name]):
        dbc_signal(path, name)


def test_files_that_are_not_dbc(tmp_path: Path) -> None:
    """A missing file, a folder, another format and a damaged file give one sentence each."""
    with pytest.raises(FieldError, match=r"missing.dbc cannot be opened: No such file"):
        dbc_signal(tmp_path / "missing.dbc", "A.B")
    with pytest.raises(FieldError, match=r"cannot be opened: Is a directory"):
        dbc_signal(tmp_path, "A.B")
    for text in ("", "hello", MULTIPLEXED[:150], "\x00\xff" * 100):
        path = written(tmp_path / "bad.dbc", text)
        with pytest.raises(FieldError, match=r"bad.dbc (is not a valid DBC file|has no)"):
            dbc_signal(path, "Arm.Nothing")
    first = dbc_signal(written(tmp_path / "changed.dbc", MULTIPLEXED), "Arm.Angle")
    changed = MULTIPLEXED.replace("(0.01,-5)", "(0.02,-5)")
    second = dbc_signal(written(tmp_path / "changed.dbc", changed), "Arm.Angle")
    assert (first.scale, second.scale) == (0.01, 0.02)


def test_one_name_twice(tmp_path: Path) -> None:
    """A name that a file has twice is refused, as either could be meant."""
    signal = ' SG_ S : {}|8@1+ (1,0) [0|0] "" X\n'
    single, other = "BO_ 512 M: 8 X\n" + signal.format(0), "BO_ 513 {}: 8 X\n" + signal.format(8)
    with pytest.raises(FieldError, match=r"signal of M S 2 times; give each a name"):
        dbc_signal(written(tmp_path / "s.dbc", 'VERSION ""\n' + single + signal.format(8)), "M.S")
    text = 'VERSION ""\n' + single + other
    with pytest.raises(FieldError, match=r"message M 2 times; give each a name"):
        dbc_signal(written(tmp_path / "m.dbc", text.format("M")), "M.S")
    assert dbc_signal(written(tmp_path / "n.dbc", text.format("N")), "M.S").bits.first == 0


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    """A file is in UTF-8, with a byte order mark or without, or in the Windows code page."""
    text = 'VERSION ""\nBO_ 512 M: 8 X\n SG_ S : 0|8@1+ (1,0) [0|0] "°" X\nCM_ "Größe{}";\n'
    path = tmp_path / "a.dbc"
    # The second byte of this letter in UTF-8 is not in the code page.
    path.write_bytes(text.format("Á" * (encoding != "cp1252")).encode(encoding))
    assert dbc_signal(path, "M.S").unit == "°"


def test_reasons(tmp_path: Path) -> None:
    """A NaN, and a page that no frame has, are named."""
    signal = dbc_signal(written(tmp_path / "a.dbc", MULTIPLEXED), "Arm.Force")
    assert signal.explain(8, b"\4" + b"\xff" * 7) == "Arm.Force is not a finite number (nan)."
    words = CanReader(signal).explain_missing("/can0", ["identifier 0x200"])
    assert "no CAN signal Arm.Force; it has identifier 0x200. It is in frames of id" in words
    assert "identifier 0x200 whose multiplexer selects it;" in words
