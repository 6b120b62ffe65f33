# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Ways of spoiling a file: byte by byte, word by word, and as its format is built.

What is packed (``.npz``) or would not be YAML any more is taken apart, spoilt and put together
again, so that checksums and syntax do not refuse everything at the door.
"""

import io
import random
import re
import struct
import zipfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import PurePath
from typing import Any

import yaml

Spoiler = Callable[[bytes, Sequence[bytes], random.Random], bytes]
"""Content, contents of like files, and a source of chance go in; spoilt content comes out."""

_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_NUMBERS = b"0 -1 1 2 nan inf -inf 1e400 1e300 -1e300 1e-320 0x10 99999999999999999999".split()
_NUMBERS += [b"1" * 400, b"0x" + b"f" * 5000, b"1e", b"1_0", b"2147483648", b"-9223372036854775808"]
_TOKENS = (
    b"\0|\xff|\n|\r\n| |\t|,|:|-|#|'|\"|{|}|[|]|&a|*a|<<: *a|!!binary|!!bool|!!int|!!set".split(
        b"|"
    )
)
_TOKENS += (
    b"    -1\n|\n    58\n|\n   164\n|%%MatrixMarket|%|symmetric|complex|$EndNodes|$Nodes".split(
        b"|"
    )
)
_TOKENS += [b"\xef\xbb\xbf", b"\xed\xa0\x80", b"$PhysicalNames", b"PK\x05\x06", b"\x89MCAP0\r\n"]
_INTEGERS = [0, 1, 2, 3, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**24, 2**31 - 1, 2**31, 2**32 - 1]
_INTEGERS += [2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1]
_VALUES: list[Any] = [None, True, "", "x", 0, -1, 1, 2, 1.5, -0.0, 1e300, 5e-324, 10**400, 2**63]
_VALUES += [float("nan"), float("inf"), [], {}, [0], [[0]], {"x": 0}, [1, 2], [2, 1], "nan", "\0"]
_LAUGHS = "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n"
    for before, name in zip("abcdefghijk", "bcdefghijkl", strict=True)
)
_MERGES = "".join(
    f"{name}: &{name} {{<<: [{', '.join([f'*{before}'] * 9)}]}}\n"
    for before, name in zip("abcdefghijk", "bcdefghijkl", strict=True)
)
BOMBS = [
    f"a: &a [1]\n{_LAUGHS}name: *l\n",
    f"a: &a {{k: 1}}\n{_MERGES}name: *l\n",
    "name: &a [*a]\nground: &b {b: *b}\n",
    "name: " + "[" * 5000 + "]" * 5000,
    "".join(" " * depth + "a:\n" for depth in range(2000)),
]


def spoil_bytes(content: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """Spoil bytes, words and numbers here and there, mostly in one place only."""
    spoilt = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 4, 16])):
        rng.choice(_WAYS)(spoilt, others, rng)
    return bytes(spoilt)


def spoil_npz(content: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """Spoil an archive, or one of its members while its checksum stays right."""
    if rng.random() < 0.3:
        return spoil_bytes(content, others, rng)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    at = rng.randrange(len(members))
    name, data = members[at]
    match rng.randrange(10):
        case 0:
            del members[at]
        case 1:
            members.append((rng.choice([name, name[::-1], "a.npy", "a", ""]), data))
        case 2:
            members[at] = (name, rng.choice(members)[1])
        case 3 | 4 | 5:  # its header: type, order and shape
            end = data.find(b"\n") + 1 or len(data)
            members[at] = (name, spoil_bytes(data[:end], [data[:end]], rng) + data[end:])
        case _:
            members[at] = (name, spoil_bytes(data, [other for _, other in members], rng))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", rng.choice([0, 8])) as archive:
        for name, data in members:
            archive.writestr(zipfile.ZipInfo(name), data)
    return packed.getvalue()


def spoil_yaml(content: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """Spoil a YAML text, or the tree that it tells."""
    chance = rng.random()
    if chance < 0.01:
        return rng.choice(BOMBS).encode()
    if chance < 0.4:
        return spoil_bytes(content, others, rng)
    tree = yaml.load(content, yaml.CSafeLoader)
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        _spoil_tree(tree, rng)
    return yaml.dump(tree, sort_keys=False, Dumper=yaml.CSafeDumper).encode()


def spoil_file(name: str, content: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """Spoil a file as its name tells."""
    return _BY_SUFFIX.get(PurePath(name).suffix, spoil_bytes)(content, others, rng)


def _spoil_tree(tree: Any, rng: random.Random) -> None:
    places: list[tuple[Any, Any]] = []
    seen = set()

    def gather(node: Any) -> None:
        if id(node) in seen:  # a branch that hangs below itself, as anchors can make it
            return
        seen.add(id(node))
        keys = node if isinstance(node, dict) else range(len(node))
        for key in keys:
            places.append((node, key))
            if isinstance(node[key], dict | list):
                gather(node[key])

    gather(tree)
    if not places:
        return
    node, key = rng.choice(places)
    match rng.randrange(6):
        case 0:
            del node[key]
        case 1 if isinstance(node, dict):
            node[rng.choice([str(key) + "x", 5, None, "", 1.5, True])] = node[key]
        case 2:
            other, place = rng.choice(places)
            node[key] = other[place] if place in other or isinstance(other, list) else None
        case 3 if isinstance(node[key], int | float):
            with suppress(OverflowError):  # a whole number beyond every float
                node[key] *= rng.choice([-1, 0, 1e-9, 1e-3, 1e3, 1e9, 1e200])
        case 4:
            for _ in range(rng.choice([1, 3, 100])):
                node[key] = rng.choice([[node[key]], {"x": node[key]}])
        case _:
            node[key] = rng.choice(_VALUES)


def _flip(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    if spoilt:
        spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)


def _overwrite(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    if spoilt:
        spoilt[rng.randrange(len(spoilt))] = rng.randrange(256)


def _integer(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    code = rng.choice(["<B", "<H", ">H", "<I", "<I", ">I", "<Q", ">Q"])
    size = struct.calcsize(code)
    if len(spoilt) >= size:
        at = rng.randrange(len(spoilt) - size + 1)
        if rng.random() < 0.5:
            at -= at % min(size, 4)
        value = rng.choice(_INTEGERS) % 256**size
        if rng.random() < 0.3:
            value = (struct.unpack_from(code, spoilt, at)[0] + rng.choice([-1, 1])) % 256**size
        struct.pack_into(code, spoilt, at, value)


def _delete(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(spoilt) + 1)
    del spoilt[at : at + rng.choice([1, 4, 8, 20, 200])]


def _cut(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    del spoilt[rng.randrange(len(spoilt) + 1) :]


def _duplicate(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(spoilt) + 1)
    spoilt[at:at] = spoilt[at : at + rng.choice([1, 8, 80, 800])] * rng.choice([1, 1, 3, 30])


def _splice(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    other = rng.choice(others)
    at, start = rng.randrange(len(spoilt) + 1), rng.randrange(len(other) + 1)
    length = rng.choice([4, 8, 40, 400])
    spoilt[at : at + length] = other[start : start + length]


def _token(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(spoilt) + 1)
    spoilt[at : at + rng.choice([0, 0, 1, 4])] = rng.choice(_TOKENS)


def _number(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    """Replace the first number after some place by an odd one, or by one a digit longer."""
    found = _NUMBER.search(spoilt, rng.randrange(len(spoilt) + 1))
    if found:
        new = found[0] + b"9" if rng.random() < 0.2 else rng.choice(_NUMBERS)
        spoilt[found.start() : found.end()] = new


def _lines(spoilt: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    """Delete, repeat or swap lines."""
    lines = bytes(spoilt).splitlines(keepends=True)
    if len(lines) > 1:
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(3):
            case 0:
                del lines[min(i, j) : max(i, j)]
            case 1:
                lines[i:i] = lines[min(i, j) : max(i, j)]
            case _:
                lines[i], lines[j] = lines[j], lines[i]
        spoilt[:] = b"".join(lines)


_WAYS = [_flip, _overwrite, _integer, _integer, _delete, _cut, _duplicate, _splice, _token]
_WAYS += [_number, _number, _lines]
_BY_SUFFIX: dict[str, Spoiler] = {".npz": spoil_npz, ".yaml": spoil_yaml}
