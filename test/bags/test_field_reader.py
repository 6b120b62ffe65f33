# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Numbers that are read from messages of any type are those that rosbags decodes."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from linkage_vibration.bags.blocks import Block
from linkage_vibration.bags.field_reader import FieldReader
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.bags.scalar_reader import MAX_NAMES, CdrError, ReadingError, SkippedMessages
from linkage_vibration.bags.schemas import (
    NUMBERS,
    FieldError,
    find_path,
    schema_of_store,
    schema_of_text,
)

SEPARATOR = "\n" + "=" * 80 + "\n"
PART = f"{SEPARATOR}MSG: a/Part\nstring label\nint16[2] pair\nfloat64 value\nuint8[] rest"
HEADER = (
    f"{SEPARATOR}MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
    f"{SEPARATOR}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
)
KINDS = [kind for kind in NUMBERS if kind not in ("octet", "char", "byte")]
NAMES = st.lists(st.sampled_from(["up", "down", "a b", "ä"]), max_size=4)
LATEST = get_typestore(Stores.LATEST)
JOINTS = schema_of_store(LATEST, JOINT_STATE)


def block_of(data: list[bytes]) -> Block:
    """Return a block of messages with other bytes between them."""
    sizes = np.array([len(message) for message in data], np.int64)
    starts = 3 + np.cumsum(sizes + 5) - sizes - 5
    buffer = np.frombuffer(b"abc" + b"".join(message + b"other" for message in data), np.uint8)
    zeros = np.zeros(len(data), np.int64)
    return Block(buffer, starts, sizes, zeros, zeros, zeros)


def joint_state(
    names: list[str], positions: list[float], velocities: list[float], *, little: bool = True
) -> bytes:
    """Return a joint state in CDR."""
    header = LATEST.types["std_msgs/msg/Header"](
        LATEST.types["builtin_interfaces/msg/Time"](3, 4), "base"
    )
    numbers = [np.array(values, float) for values in (positions, velocities, [])]
    message = LATEST.types[JOINT_STATE](header, names, *numbers)
    return bytes(LATEST.serialize_cdr(message, JOINT_STATE, little_endian=little))


def value_of(draw: Any, kind: str, store: Any) -> Any:
    """Return a random value of a type: a number, a text, or a part."""
    if kind == "string":
        return draw(st.text(st.characters(exclude_categories=["C"]), max_size=5))
    if kind == "a/msg/Part":
        pair = np.array(draw(st.lists(st.integers(-9, 9), min_size=2, max_size=2)), np.int16)
        rest = np.array(draw(st.lists(st.integers(0, 255), max_size=3)), np.uint8)
        label = value_of(draw, "string", store)
        return store.types[kind](label, pair, draw(st.floats()), rest)
    if kind == "bool":
        return draw(st.booleans())
    code = NUMBERS[kind]
    if code[0] == "f":
        return np.array(draw(st.floats(width=8 * int(code[1]))), code)[()].item()
    info = np.iinfo(code)
    return draw(st.integers(int(info.min), int(info.max)))


@st.composite
def messages(draw: Any) -> tuple[str, Any, list[Any]]:
    """Return the definition of a type with random fields, a store that knows it, and messages."""
    kinds = draw(
        st.lists(st.sampled_from([*KINDS, "bool", "string", "a/Part"]), min_size=1, max_size=6)
    )
    forms = [draw(st.sampled_from(["", "[]", "[3]", "[<=5]"])) for _ in kinds]
    header = draw(st.booleans())
    lines = ["std_msgs/Header header"] * header
    lines += [f"{kind}{form} f{i}" for i, (kind, form) in enumerate(zip(kinds, forms, strict=True))]
    text = "\n".join(lines) + PART + HEADER * header
    store = get_typestore(Stores.EMPTY)
    types = get_types_from_msg(text, "a/msg/Any")
    store.register({name: kind for name, kind in types.items() if name not in store.fielddefs})
    actual = []
    for _ in range(draw(st.integers(1, 5))):
        values: list[Any] = []
        if header:
            stamp = store.types["builtin_interfaces/msg/Time"](draw(st.integers(0, 99)), 7)
            values.append(
                store.types["std_msgs/msg/Header"](stamp, value_of(draw, "string", store))
            )
        for kind, form in zip(kinds, forms, strict=True):
            full = kind.replace("/", "/msg/")
            if not form:
                values.append(value_of(draw, full, store))
                continue
            count = 3 if form == "[3]" else draw(st.integers(0, 4))
            items = [value_of(draw, full, store) for _ in range(count)]
            plain = full in NUMBERS or full == "bool"
            values.append(np.array(items, NUMBERS.get(full, "?")) if plain else items)
        actual.append(store.types["a/msg/Any"](*values))
    return text, store, actual


def paths(message: Any, prefix: str = "") -> dict[str, float]:
    """Return the numbers of a message by their paths."""
    actual: dict[str, float] = {}
    for name in (field for field in message.__dataclass_fields__ if field != "__msgtype__"):
        value = getattr(message, name)
        several = isinstance(value, list | np.ndarray)
        for key, item in (
            {f"[{i}]": v for i, v in enumerate(value)}.items() if several else [("", value)]
        ):
            if hasattr(item, "__dataclass_fields__"):
                actual |= paths(item, f"{prefix}{name}{key}.")
            elif not isinstance(item, str | bool | np.bool_):
                actual[f"{prefix}{name}{key}"] = float(item)
    return actual


@given(messages(), st.booleans())
def test_against_rosbags(drawn: tuple[str, Any, list[Any]], little: bool) -> None:
    """Every number of any type is exact, one by one and together, in either byte order."""
    text, store, actual = drawn
    data = [
        bytes(store.serialize_cdr(each, "a/msg/Any", little_endian=little)) for each in actual
    ] * 2
    numbers = [paths(each) for each in actual] * 2
    schema = schema_of_text(text, "a/msg/Any")
    for path in {path for each in numbers for path in each}:
        reader, alone = (FieldReader(schema, "a/msg/Any", path) for _ in range(2))
        left_out, rows = SkippedMessages(), dict[int, float]()
        for part in reader.read(block_of(data), np.arange(len(data)), left_out):
            rows |= dict(zip(part.rows.tolist(), part.value.tolist(), strict=True))
            for i, row in enumerate(part.rows.tolist()):
                reading = alone.read_one(data[row])
                assert reading is not None
                same = (part.sec[i], part.nanosec[i], part.frame_id)
                assert (reading.sec, reading.nanosec, reading.frame_id) == same
        assert left_out.refused + len(rows) == len(data)
        for row, each in enumerate(numbers):
            if path not in each:
                with pytest.raises(ReadingError, match="elements in"):
                    alone.read_one(data[row])
                continue
            single = alone.read_one(data[row])
            assert single is not None
            np.testing.assert_array_equal([rows[row], single.value], each[path])


TEXT = f"""std_msgs/Header header
string[] name
float64[] position
bool on
string text
uint8[] data
float32[3] fixed
a/Part part
a/Part[] parts
wstring wide
float64 after
{PART}{HEADER}"""


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("", "no number ''"),
        ("positions[0]", r"did you mean position\[NAME or INDEX\]\?"),
        ("position", "its numbers are header.stamp.sec, header.stamp.nanosec, position"),
        ("position[]", "has no number"),
        ("on", "has no number 'on'"),
        ("text", "has no number"),
        ("data", r"data\[NAME or INDEX\]"),
        ("fixed[3]", r"fixed\[0 to 2\]"),
        ("fixed[-1]", "has no number"),
        ("part", "part.value"),
        ("part.", "has no number"),
        ("part.value.x", "has no number"),
        ("part.label", "has no number"),
        ("parts.value", r"parts\[NAME or INDEX\].value"),
        ("header..stamp", "has no number"),
        ("part.value ", "has no number"),
    ],
)
def test_wrong_paths(path: str, words: str) -> None:
    """A path that leads to no number is answered with the numbers that the type has."""
    schema = schema_of_text(TEXT, "a/msg/Any")
    with pytest.raises(FieldError, match=words):
        find_path(schema, "a/msg/Any", path)


def test_path_behind_an_unknown_type() -> None:
    """A message is unreadable if the size of a field before the path is not known."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("wstring wide\nfloat64 after", "a/msg/Wide"))
    schema = schema_of_store(store, "a/msg/Wide")
    with pytest.raises(CdrError, match="after lies behind a wstring, whose size is not known"):
        FieldReader(schema, "a/msg/Wide", "after").read_one(b"\0\1\0\0" + bytes(24))


@given(NAMES, st.integers(0, 4))
def test_elements_by_name(names: list[str], count: int) -> None:
    """An element is found by its name before or behind it; repeated or no names are a fault."""
    for text in ("string[] names\nfloat64[] value", "float64[] value\nstring[] names"):
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(text, "a/msg/Any"))
        given_values = {"names": names, "value": np.arange(count, dtype=float)}
        message = store.types["a/msg/Any"](**given_values)
        data = bytes(store.serialize_cdr(message, "a/msg/Any"))
        reader = FieldReader(schema_of_text(text, "a/msg/Any"), "a/msg/Any", "value[a b]")
        if "a b" not in names and (names or not count):
            assert reader.read_one(data) is None
            assert list(reader.other_names(data)) == names
        elif (times := names.count("a b")) > 1:
            with pytest.raises(ReadingError, match=f"the name a b {times} times; publish each"):
                reader.read_one(data)
            assert list(reader.other_names(data)) == []
        elif len(names) != count:
            words = f"{len(names)} names but {count} elements in value, so the one of a b"
            with pytest.raises(ReadingError, match=words):
                reader.read_one(data)
        else:
            assert reader.read_one(data)[0] == names.index("a b")  # type: ignore[index]


def test_names_are_listed_in_short() -> None:
    """A name of 60 characters is listed, of a longer one its beginning, and an empty one as ''.

    Of more than twenty names, the first twenty are listed.
    """
    explain = FieldReader(JOINTS, JOINT_STATE, "position[up]").explain_missing
    words = explain("/joints", [60 * "x", 61 * "y", ""])
    assert f"it has '', {60 * 'x'}, {60 * 'y'}..." in words
    names = "abcdefghijklmnopqrstu"
    assert "s, t. " in explain("/joints", names[:20])
    assert "s, t and 1 more. " in explain("/joints", names)


@given(st.lists(st.tuples(NAMES, st.integers(0, 4), st.booleans()), min_size=1, max_size=6))
def test_rates_of_elements(contents: list[tuple[list[str], int, bool]]) -> None:
    """The rate of an element is that of its name, or unknown unless each name has one."""
    reader, alone = (
        FieldReader(JOINTS, JOINT_STATE, "position[up]", rates="velocity") for _ in range(2)
    )
    data, expected = [], {}
    for row, (names, count, little) in enumerate(contents):
        positions, velocities = (
            [float(i) for i in range(len(names))],
            [10.0 + i for i in range(count)],
        )
        data.append(joint_state(names, positions, velocities, little=little))
        if names.count("up") == 1:
            rate = velocities[names.index("up")] if count == len(names) else math.nan
            expected[row] = positions[names.index("up")], rate
    actual = {
        row: (value, rate)
        for part in reader.read(block_of(data), np.arange(len(data)), SkippedMessages())
        for row, value, rate in zip(part.rows.tolist(), part.value, part.rate, strict=True)
    }
    assert actual.keys() == expected.keys()
    for row, numbers in expected.items():
        number = alone.read_one(data[row])
        assert number is not None
        np.testing.assert_array_equal([actual[row], number[:2]], [numbers, numbers])
        assert number[2:] == (3, 4, "base")


def test_padding_is_ignored() -> None:
    """Padding bytes may have any value, as they do in messages of DDS."""
    message = joint_state(["ab"], [1.0], [])
    at = message.index(b"ab\x00") + 3
    other = message[:at] + b"\x7f" + message[at + 1 :]
    reader = FieldReader(JOINTS, JOINT_STATE, "position[ab]")
    [part] = reader.read(block_of([message, other]), np.arange(2), SkippedMessages())
    np.testing.assert_array_equal(part.value, [1.0, 1.0])
    assert reader.read_one(message) == reader.read_one(other)
    assert len(reader._layouts._kept) == 1


@given(st.binary(max_size=60))
def test_bytes_that_are_not_a_message(data: bytes) -> None:
    """Any bytes give a number or an error, the same one by one and together."""
    schema = schema_of_text(TEXT, "a/msg/Any")
    for path in ("position[boom]", "parts[1].value", "fixed[2]"):
        for start in (b"", b"\x00\x01\x00\x00", b"\x00\x00\x00\x00" + bytes(8)):
            reader, left_out = FieldReader(schema, "a/msg/Any", path), SkippedMessages()
            actual = list(reader.read(block_of([start + data]), np.arange(1), left_out))
            try:
                reading = reader.read_one(start + data)
            except CdrError:
                assert left_out.unreadable == 1
            except ReadingError:
                assert left_out.refused == 1
            else:
                assert (reading is None) == (left_out.others == 1)
                if reading is not None:
                    np.testing.assert_array_equal(actual[0].value, reading.value)


def test_another_encapsulation_is_named() -> None:
    """A message in another encoding than plain CDR is refused with the remedy."""
    reader = FieldReader(schema_of_text("float32 value", "a/msg/Any"), "a/msg/Any", "value")
    number = reader.read_one(b"\0\1\0\0" + struct.pack("<f", 2.5))
    assert number is not None
    assert number.value == 2.5
    with pytest.raises(CdrError, match=r"begins with 0x0007, .* is plain CDR; .* XCDR1"):
        reader.read_one(b"\0\7\0\0" + struct.pack("<f", 2.5))


def test_layouts_are_bounded() -> None:
    """A text of another length in each message moves the number, and no memory grows."""
    text = "string text\nfloat32 value"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, "a/msg/Any"))
    kind = store.types["a/msg/Any"]
    data = [bytes(store.serialize_cdr(kind("x" * k, k), "a/msg/Any")) for k in range(300)]
    reader = FieldReader(schema_of_text(text, "a/msg/Any"), "a/msg/Any", "value")
    rows = dict[int, float]()
    for part in reader.read(block_of(data), np.arange(300), SkippedMessages()):
        rows |= dict(zip(part.rows.tolist(), part.value.tolist(), strict=True))
    assert rows == {k: float(k) for k in range(300)}
    assert len(reader._layouts._kept) <= 64
    assert math.isclose(reader.read_one(data[7])[0], 7.0)  # type: ignore[index]


def test_names_are_limited() -> None:
    """Of a message with very many names, the first thousand are kept."""
    names = [f"joint {k}" for k in range(1001)]
    data = joint_state(names, [0.0] * 1001, [])
    reader = FieldReader(JOINTS, JOINT_STATE, "position[boom]")
    assert list(reader.other_names(data)) == names[:1000]
    assert MAX_NAMES == 1000
