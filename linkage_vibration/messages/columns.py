# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of one type by columns, for the node, the replay, logs and tables alike."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rows = slice | NDArray[np.int64] | NDArray[np.bool_]


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
        """Return the number of messages and the names of the columns."""
        return f"MessageColumns({len(self)} of {', '.join(vars(self))})"

    def rows(self, which: Rows) -> "MessageColumns":
        """Return the messages with these indices."""
        return MessageColumns(**self._at(which))

    def message(self, row: int) -> "MessageColumns":
        """Return one message, whose attributes have no axis of rows."""
        return MessageColumns(**self._at(row))

    def _at(self, which: Rows | int) -> dict[str, Any]:
        return {
            name: column if isinstance(column, str) else column[which]
            for name, column in vars(self).items()
        }


def joined(parts: Sequence[MessageColumns]) -> MessageColumns:
    """Return messages one part after the other; a text that all messages share is equal in all."""
    names = vars(parts[0])
    columns = {name: [getattr(part, name) for part in parts] for name in names}
    return MessageColumns(
        **{
            name: values[0] if isinstance(values[0], str) else np.concatenate(values)
            for name, values in columns.items()
        }
    )
