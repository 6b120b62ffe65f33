# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Columns of messages as tables, and tables as CSV."""

import csv
import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.messages.fields import Field, message_fields
from linkage_vibration.messages.topics import PREDICTION


def prediction_table(
    predictions: Mapping[str, NDArray[Any]], why: str = ""
) -> dict[str, NDArray[Any]]:
    """Return predictions as columns of a CSV file, with ``why`` beside deviations that are NaN."""
    table: dict[str, NDArray[Any]] = {}
    for field in message_fields(PREDICTION):
        if field.name in predictions and field.is_sequence:
            for mode, values in enumerate(predictions[field.name].T, 1):
                table[f"{_singular(field.name)}_{mode}{unit_suffix(field)}"] = values
        elif field.name in predictions:
            table[field.name + unit_suffix(field)] = predictions[field.name]
    if why:
        lost = np.isnan(predictions["damping_ratio_stddevs"])
        unknown = (lost & np.isfinite(predictions["damping_ratios"])).any(axis=-1)
        table["unknown_deviations"] = np.where(unknown, why, "")
    return table


def table_text(table: Mapping[str, NDArray[Any]]) -> str:
    """Return columns, (n,), as CSV with their names in the first line."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(table)
    lines.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    return text.getvalue()


def unit_suffix(field: Field) -> str:
    """Return the unit of a number as the end of a name, such as ``_m_per_s2``; 1 has none."""
    unit = field.unit.replace(" or ", "_or_").split()[0] if field.type.startswith("float") else "1"
    return "" if unit == "1" else "_" + unit.lower().replace("/", "_per_").replace("^", "")


def _singular(name: str) -> str:
    """Return the name of one number of a sequence."""
    return name.removesuffix("ies") + "y" if name.endswith("ies") else name.removesuffix("s")
