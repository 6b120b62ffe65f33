# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of several readers share: files spoilt at random."""

import random
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

from linkage_vibration.errors import LinkageVibrationError

Mutations = Callable[[bytes, int], Iterator[bytes]]

FOREIGN = [b"9", b"0", b"-", b"nan", b"inf", b"1e400", b" ", b"\n", b"99999999", b"\0", b"\xff"]


@pytest.fixture
def mutations() -> Mutations:
    """Return what spoils a file in one of many ways, the same ones at every run."""

    def spoil(content: bytes, count: int) -> Iterator[bytes]:
        rng = random.Random(1)
        for _ in range(count):
            yield _spoilt(content, rng)

    return spoil


def refuse_spoilt(path: Path, contents: Iterable[bytes], read: Callable[[], object]) -> None:
    """Read contents of a file; more than 50 give one sentence, and nothing else is raised."""
    refused = 0
    for content in contents:
        path.write_bytes(content)
        try:
            read()
        except LinkageVibrationError as error:
            assert str(error).startswith(str(path))
            assert "\n" not in str(error)
            refused += 1
    assert refused > 50


def _spoilt(content: bytes, rng: random.Random) -> bytes:
    spoilt = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 5, 20])):
        at = rng.randrange(len(spoilt) + 1)
        match rng.randrange(6):
            case 0:
                spoilt[at : at + 1] = rng.randbytes(1)
            case 1:
                del spoilt[at : at + rng.choice([1, 4, 20, 200])]
            case 2:
                spoilt[at:at] = rng.randbytes(rng.choice([1, 4]))
            case 3:
                spoilt[at : at + 1] = rng.choice(FOREIGN)
            case 4:
                del spoilt[at:]
            case _:
                other = rng.randrange(len(spoilt) + 1)
                spoilt[at : at + 8] = spoilt[other : other + 8]
    return bytes(spoilt)
