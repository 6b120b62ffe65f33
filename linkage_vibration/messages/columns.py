# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of one type by columns, for the node, the replay, logs and tables alike."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.messages.definitions import OWN_PACKAGE
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.support.conversions import import_xarray

_TYPES = "VibrationPrediction", "Resonance"  # of which columns have units

Rows = int | slice | NDArray[np.int64] | NDArray[np.bool_]


class MessageColumns(SimpleNamespace):
    """Messages of one type by columns, which are attributes with the names of the message's fields.

    The ``.msg`` file of the type in ``linkage_vibration_interfaces`` has their units and meanings.
    A column is an array, (n,), or (n, length) of a sequence; a text that all messages share is a
    single string. Other columns may be beside those of the message.
    """

    def __len__(self) -> int:
        """Return the number of messages."""
        return len(next(column for column in vars(self).values() if not isinstance(column, str)))

    def __repr__(self) -> str:
        """Return the names of the columns, in a line."""
        return f"MessageColumns({', '.join(vars(self))})"

    def rows(self, which: Rows) -> "MessageColumns":
        """Return the messages with these indices."""
        columns = vars(self).items()
        return MessageColumns(**{n: c if isinstance(c, str) else c[which] for n, c in columns})

    def message(self, row: int) -> "MessageColumns":
        """Return one message, whose attributes have no axis of rows."""
        return self.rows(row)

    def to_xarray(self) -> Any:
        """Return the messages as an `xarray.Dataset`, with units; it needs the extra `xarray`.

        Its dimensions are ``row``, for which ``crank_angle`` is a coordinate, and ``mode``, counted
        from 1. Other sequences have a dimension of their own, and texts are attributes.

        Raises
        ------
        LinkageVibrationError
            If xarray is not installed.
        """
        xarray = import_xarray()
        kinds = [message_fields(f"{OWN_PACKAGE}/msg/{kind}") for kind in _TYPES]
        modal = {"frequency_slopes", *(field.name for field in kinds[0] if field.is_sequence)}
        units = {f.name: f.unit for kind in kinds for f in kind if f.type.startswith("float")}
        texts = {name: text for name, text in vars(self).items() if isinstance(text, str)}
        columns = {}
        for name, column in vars(self).items():
            if name in texts:
                continue
            axes = ("row", "mode" if name in modal else f"{name}_index")[: column.ndim]
            columns[name] = axes, column, {"units": units[name]} if name in units else {}
        data = xarray.Dataset(columns, attrs=texts).set_coords({"crank_angle"} & columns.keys())
        modes = np.arange(1, data.sizes.get("mode", 0) + 1)
        return data.assign_coords(mode=modes) if len(modes) else data


def joined(parts: Sequence[MessageColumns]) -> MessageColumns:
    """Return messages one part after the other; a text that all messages share is equal in all."""
    if len(parts) == 1:
        return parts[0]
    names = vars(parts[0])
    columns = {name: [getattr(part, name) for part in parts] for name in names}
    return MessageColumns(
        **{
            name: values[0] if isinstance(values[0], str) else np.concatenate(values)
            for name, values in columns.items()
        }
    )
