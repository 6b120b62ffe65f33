# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Damages files: single bytes and words, or the structure of a format.

An archive (``.npz``) or a YAML text is taken apart, damaged and put together again, so that the
damage is not always found by a checksum or by the YAML parser.
"""

import io
import random
import re
import struct
import traceback
import zipfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path, PurePath
from typing import Any

import yaml

from linkage_vibration.errors import LinkageVibrationError
from test.support.file_readers import Files, Reader

REFUSED, ACCEPTED, TRACEBACK, INVALID = "refused", "accepted", "traceback", "invalid result"

Damager = Callable[[bytes, Sequence[bytes], random.Random], bytes]
"""From a content, contents of other such files and a random generator to damaged content."""

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


def damaged(reader: Reader, number: int) -> tuple[str, Files]:
    """Return input ``number`` of a reader: the path to read, and the files, one of them damaged."""
    rng = random.Random(f"{reader.name} {number}")
    main, files = reader.seeds[number % len(reader.seeds)]
    name = rng.choice(sorted(files))
    others = [seed[other] for _, seed in reader.seeds for other in seed]
    return main, {**files, name: damage_file(name, files[name], others, rng)}


def write_files(folder: Path, files: Files) -> None:
    """Write files into a folder."""
    for name, content in files.items():
        (folder / name).write_bytes(content)


def read_outcome(reader: Reader, path: Path) -> tuple[str, str]:
    """Read a path; return the kind of outcome, and the traceback of an outcome that is a fault."""
    try:
        reader.read(path)
    except LinkageVibrationError:
        return REFUSED, ""
    except AssertionError:
        return INVALID, traceback.format_exc()
    except Exception:
        return TRACEBACK, traceback.format_exc()
    return ACCEPTED, ""


def damage_bytes(content: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """Damage bytes, words and numbers, mostly in one place only."""
    target = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 4, 16])):
        rng.choice(_WAYS)(target, others, rng)
    return bytes(target)


def damage_npz(content: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """Damage an archive, or one of its members with a checksum that matches the damage."""
    if rng.random() < 0.3:
        return damage_bytes(content, others, rng)
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
            members[at] = (name, damage_bytes(data[:end], [data[:end]], rng) + data[end:])
        case _:
            members[at] = (name, damage_bytes(data, [other for _, other in members], rng))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", rng.choice([0, 8])) as archive:
        for name, data in members:
            archive.writestr(zipfile.ZipInfo(name), data)
    return packed.getvalue()


def damage_yaml(content: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """Damage a YAML text, or the tree that it describes."""
    chance = rng.random()
    if chance < 0.01:
        return rng.choice(BOMBS).encode()
    if chance < 0.4:
        return damage_bytes(content, others, rng)
    tree = yaml.load(content, yaml.CSafeLoader)
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        _damage_tree(tree, rng)
    return yaml.dump(tree, sort_keys=False, Dumper=yaml.CSafeDumper).encode()


def damage_file(name: str, content: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    """Damage a file in the way that fits the suffix of its name."""
    return _BY_SUFFIX.get(PurePath(name).suffix, damage_bytes)(content, others, rng)


def _damage_tree(tree: Any, rng: random.Random) -> None:
    places: list[tuple[Any, Any]] = []
    seen = set()

    def gather(node: Any) -> None:
        if id(node) in seen:  # anchors can make a branch contain itself
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


def _flip(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    if target:
        target[rng.randrange(len(target))] ^= 1 << rng.randrange(8)


def _overwrite(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    if target:
        target[rng.randrange(len(target))] = rng.randrange(256)


def _integer(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    code = rng.choice(["<B", "<H", ">H", "<I", "<I", ">I", "<Q", ">Q"])
    size = struct.calcsize(code)
    if len(target) >= size:
        at = rng.randrange(len(target) - size + 1)
        if rng.random() < 0.5:
            at -= at % min(size, 4)
        value = rng.choice(_INTEGERS) % 256**size
        if rng.random() < 0.3:
            value = (struct.unpack_from(code, target, at)[0] + rng.choice([-1, 1])) % 256**size
        struct.pack_into(code, target, at, value)


def _delete(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(target) + 1)
    del target[at : at + rng.choice([1, 4, 8, 20, 200])]


def _cut(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    del target[rng.randrange(len(target) + 1) :]


def _duplicate(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(target) + 1)
    target[at:at] = target[at : at + rng.choice([1, 8, 80, 800])] * rng.choice([1, 1, 3, 30])


def _splice(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    other = rng.choice(others)
    at, start = rng.randrange(len(target) + 1), rng.randrange(len(other) + 1)
    length = rng.choice([4, 8, 40, 400])
    target[at : at + length] = other[start : start + length]


def _token(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(target) + 1)
    target[at : at + rng.choice([0, 0, 1, 4])] = rng.choice(_TOKENS)


def _number(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    """Replace the first number after a random place by an unusual or a longer one."""
    match = _NUMBER.search(target, rng.randrange(len(target) + 1))
    if match:
        new = match[0] + b"9" if rng.random() < 0.2 else rng.choice(_NUMBERS)
        target[match.start() : match.end()] = new


def _lines(target: bytearray, others: Sequence[bytes], rng: random.Random) -> None:
    """Delete, repeat or swap lines."""
    lines = bytes(target).splitlines(keepends=True)
    if len(lines) > 1:
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(3):
            case 0:
                del lines[min(i, j) : max(i, j)]
            case 1:
                lines[i:i] = lines[min(i, j) : max(i, j)]
            case _:
                lines[i], lines[j] = lines[j], lines[i]
        target[:] = b"".join(lines)


_WAYS = [_flip, _overwrite, _integer, _integer, _delete, _cut, _duplicate, _splice, _token]
_WAYS += [_number, _number, _lines]
_BY_SUFFIX: dict[str, Damager] = {".npz": damage_npz, ".yaml": damage_yaml}
