# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Signals of CAN frames: which frames contain one, which bits it has, and what they mean.

The signals of ISO 11783-7 and SAE J1939 that a hitch needs are built in. Each value that these
standards reserve, such as "error" and "not available", gives NaN.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.can_frames import EXTENDED, FLAGS

FloatArray = NDArray[np.float64]

_ADDRESS = 0xFF  # the bits of the source address
_PRIORITY = 0b111 << 26
_LAST_VALUE = 0xFA  # of the highest byte; above are specific, reserved, "error", "not available"


@dataclass(frozen=True, slots=True)
class Bits:
    """An integer or a floating-point number in the data of a frame."""

    first: int  # lowest bit, from the lowest of byte 1, or of byte 8 if big-endian
    length: int  # in bits
    n_bytes: int  # that a frame needs to contain it
    big_endian: bool = False
    signed: bool = False
    real: bool = False

    def raw(self, payload: NDArray[np.uint8]) -> NDArray[np.uint64]:
        """Return the bits of frames with this data, (n, 8), as unsigned numbers, (n,)."""
        order = ">u8" if self.big_endian else "<u8"
        words = np.ascontiguousarray(payload).view(order)[:, 0].astype(np.uint64)
        return (words >> np.uint64(self.first)) & np.uint64((1 << self.length) - 1)

    def numbers(self, payload: NDArray[np.uint8]) -> FloatArray:
        """Return the numbers in frames with this data, (n, 8)."""
        raw = self.raw(payload)
        if self.real:
            sized = raw.astype(f"u{self.length // 8}")
            with np.errstate(invalid="ignore"):  # a NaN that signals
                return sized.view(f"f{self.length // 8}").astype(np.float64)
        if self.signed:
            unused = np.uint64(64 - self.length)
            return ((raw << unused).view(np.int64) >> unused.view(np.int64)).astype(np.float64)
        return raw.astype(np.float64)


@dataclass(frozen=True, slots=True)
class CanSignal:
    """A signal, scale * number + offset, of frames whose keys have these bits under the mask."""

    name: str
    unit: str  # of the values
    key: int
    mask: int
    bits: Bits
    scale: float = 1.0
    offset: float = 0.0
    reserved: bool = False  # the highest byte above 0xFA means "error" and the like
    range: tuple[float, float] = (-np.inf, np.inf)  # least and greatest value
    selectors: tuple[tuple[Bits, tuple[int, ...]], ...] = ()  # multiplexers

    def matches(self, key: int) -> bool:
        """Return whether a frame with this key may contain the signal."""
        return key & self.mask == self.key

    def present(
        self, key: NDArray[np.uint32], dlc: NDArray[np.uint8], payload: NDArray[np.uint8]
    ) -> NDArray[np.bool_]:
        """Return which frames contain the signal, (n,); the arguments are those of `Frames`."""
        present = (key & np.uint32(self.mask)) == np.uint32(self.key)
        for bits, values in self.selectors:
            present &= (dlc >= bits.n_bytes) & np.isin(bits.raw(payload), values)
        return np.asarray(present)

    def values(self, dlc: NDArray[np.uint8], payload: NDArray[np.uint8]) -> FloatArray:
        """Return the values in frames that contain the signal, (n,), with NaN for no value."""
        values = self.scale * self.bits.numbers(payload) + self.offset
        valid = dlc >= self.bits.n_bytes
        valid &= (self.range[0] <= values) & (values <= self.range[1])
        if self.reserved:
            valid &= self.bits.raw(payload) >> np.uint64(self.bits.length - 8) <= _LAST_VALUE
        return np.where(valid, values, np.nan)

    def explain(self, dlc: int, payload: bytes) -> str:
        """Return why a frame that contains the signal has no value, as a sentence."""
        if dlc < self.bits.n_bytes:
            return f"{self.name} is in a frame of {dlc} bytes, but needs {self.bits.n_bytes}."
        data = np.frombuffer(payload, np.uint8)[None]
        raw = int(self.bits.raw(data)[0])
        top = raw >> max(self.bits.length - 8, 0)
        if self.reserved and top > _LAST_VALUE:
            meaning = {0xFE: "an error", 0xFF: "not available"}.get(top, "reserved")
            return f"{self.name} is {meaning} (0x{raw:X})."
        value = float(self.scale * self.bits.numbers(data)[0] + self.offset)
        if not np.isfinite(value):
            return f"{self.name} is not a finite number ({value:g})."
        least, greatest = self.range
        where = f"outside of its range from {least:g} to {greatest:g}"
        return f"{self.name} is {value:g} {self.unit}, {where}."

    @property
    def any_sender(self) -> bool:
        """Whether frames contain the signal whatever their source address is."""
        return not self.mask & _ADDRESS

    def from_address(self, address: int) -> "CanSignal":
        """Return the signal as the sender with this source address, 0 to 253, sends it."""
        return replace(self, key=self.key & ~_ADDRESS | address, mask=self.mask | _ADDRESS)


def j1939_key(identifier: int) -> tuple[int, int]:
    """Return key and mask of a parameter group, of any sender, by the identifier of one frame."""
    mask = 0x1FFFFFFF & ~(_PRIORITY | _ADDRESS)
    if identifier >> 16 & 0xFF < 0xF0:  # to one destination, which is not compared
        mask &= ~0xFF00
    return EXTENDED | identifier & mask, FLAGS | mask


def _signal(
    name: str, group: int, first: int, n_bytes: int, scale: float, unit: str, offset: float = 0.0
) -> CanSignal:
    """Return a signal of a parameter group; bytes are counted from 1, as in the standards."""
    key, mask = j1939_key(group << 8)
    bits = Bits(8 * (first - 1), 8 * n_bytes, first - 1 + n_bytes)
    return CanSignal(name, unit, key, mask, bits, scale, offset, reserved=True)


# Name, parameter group, first byte (from 1), number of bytes, value of one bit, unit, offset.
_BUILT_IN = (
    ("rear_hitch_position", 65093, 1, 1, 0.4, "%"),  # SPN 1873
    ("rear_draft", 65093, 4, 2, 10.0, "N", -320e3),  # SPN 1879
    ("rear_lower_link_force", 65093, 3, 1, 0.8, "%", -100.0),  # SPN 1881
    ("front_hitch_position", 65094, 1, 1, 0.4, "%"),  # SPN 1872
    ("engine_speed", 61444, 4, 2, 0.125, "rpm"),  # SPN 190
    ("rear_pto_speed", 65091, 1, 2, 0.125, "rpm"),  # SPN 1883
    ("front_pto_speed", 65092, 1, 2, 0.125, "rpm"),  # SPN 1882
    ("wheel_based_speed", 65096, 1, 2, 0.001, "m/s"),  # SPN 1862
    ("ground_based_speed", 65097, 1, 2, 0.001, "m/s"),  # SPN 1859
    ("vehicle_speed", 65265, 2, 2, 1.0 / 256.0, "km/h"),  # SPN 84
)

SIGNALS: Mapping[str, CanSignal] = {entry[0]: _signal(*entry) for entry in _BUILT_IN}
"""The signals of ISO 11783-7 and SAE J1939 by their names."""
FORCES = "rear_draft", "rear_lower_link_force"
"""Those that are neither a position nor a speed."""
