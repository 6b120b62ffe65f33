# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the numbers of a table into templates, as one C header and one source file."""

import math
import re
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.export.constants import FARTHEST, Constants, Export
from linkage_vibration.export.orders import ForceConstants, OrderConstants
from linkage_vibration.messages.fields import message_constants, message_fields
from linkage_vibration.messages.topics import LEVELS, LOAD_STATE, PREDICTION, RESONANCE
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.severity import BACK, DEFAULT_LIMITS, GAP
from linkage_vibration.support.version import VERSION

_TEMPLATES = Path(__file__).with_name("templates")
_WIDTH = 96  # characters of a line


def c_sources(export: Export) -> dict[str, str]:
    """Return the header and the source by their names."""
    values, files = _values(export), {".h": "table.h.in", ".c": "table.c.in"}
    return {f"{export.name}{suffix}": filled(name, values) for suffix, name in files.items()}


def filled(template: str, values: Mapping[str, str]) -> str:
    """Return the template of a file name, with a value for each name between two ``@``."""
    text = (_TEMPLATES / template).read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda match: values[match[1]], text)


def literal(value: float, suffix: str = "") -> str:
    """Return a number in C, as a hexadecimal float that is exact, with the suffix of its type.

    >>> literal(0.1), literal(-2.0, "f"), literal(float("nan"))
    ('0x1.999999999999ap-4', '-0x1p+1f', '(double)NAN')
    """
    if not math.isfinite(value):
        text = "NAN" if math.isnan(value) else "INFINITY" if value > 0.0 else "-INFINITY"
        return text if suffix else f"(double){text}"  # they are of type float
    mantissa, exponent = float(value).hex().split("p")
    return f"{mantissa.rstrip('0').rstrip('.')}p{exponent}{suffix}"


def comment(text: str) -> str:
    """Return a text that cannot end a comment in C, nor disturb its line.

    >>> comment("crank */ int main(void)")
    'crank * / int main(void)'
    """
    plain = "".join(c if c.isascii() and c.isprintable() else f"<U+{ord(c):04X}>" for c in text)
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")


def _texts(texts: Iterable[str]) -> str:
    """Return the inside of an array of strings in a macro."""
    plain = (comment(text).replace("\\", "\\\\").replace('"', '\\"') for text in texts)
    return ", \\\n".join(f'    "{text}"' for text in plain)


def existing_table(header: str) -> str:
    """Return the identifier of the table that a header was exported from; empty if there is none.

    >>> existing_table('#define HITCH_TABLE_ID "0123456789abcdef"')
    '0123456789abcdef'
    """
    match = re.search(r'^#define \w+_TABLE_ID "(\w+)"$', header, re.MULTILINE)
    return match[1] if match else ""


def common_values(export: Export) -> dict[str, str]:
    """Return what stands for each name in all templates."""
    values = {"prefix": export.name, "PREFIX": export.name.upper()}
    values |= dict.fromkeys(("excites", "if_excited", "or_infinity"), "")
    orders = export.constants.orders
    if orders and orders.excites:
        rows = (", ".join(f"{mode:d}u" for mode in order) for order in orders.excites)
        text = "/* Whether an order excites a mode. */\nstatic const uint8_t excites"
        text += f"[{len(orders.excites)}][{export.constants.n_modes}] = {{\n"
        values |= {
            "excites": text + ",\n".join(f"    {{{row}}}" for row in rows) + "\n};\n\n",
            "if_excited": "(excites[i][mode] > 0u) ? ",
            "or_infinity": " : (double)INFINITY",
        }
    return values


def _values(export: Export) -> dict[str, str]:
    """Return what stands for each name in the templates of header and source."""
    constants, prefix, table = export.constants, export.name, export.table
    orders = constants.orders
    low, high = (math.degrees(angle) for angle in constants.alpha3_range)
    turns = ", of any turn" if constants.turns else ""
    fields = [f for kind in (RESONANCE, LEVELS, PREDICTION) for f in message_fields(kind)]
    values = {
        **{field.name: comment(field.comment) for field in fields},
        **_numbers(constants),
        **common_values(export),
        "version": VERSION,
        "title": comment(
            f"Vibration of {table.mechanism_name}: natural frequencies at any crank angle."
        ),
        "facts": _facts(export),
        "table_id": table.table_id,
        "mode_names": _texts(export.mode_labels),
        "range": f"{low:.6g} to {high:.6g} deg{turns}",
        "statuses": _macros(prefix, PREDICTION),
        "turn": literal(2.0 * math.pi),
        "farthest": literal(FARTHEST),
        "orders_header": "",
        "orders_source": "",
    }
    if orders is not None:
        values |= _numbers(orders, "response_") | _order_values(orders)
        values |= {"states": _macros(prefix, LOAD_STATE), "forces_source": ""}
        if orders.forces is not None:
            values |= _numbers(orders.forces, "force_")
            values["forces_source"] = filled("forces.c.in", values)
        values["orders_header"] = filled("orders.h.in", values)
        values["orders_source"] = filled("orders.c.in", values)
    return values


def _macros(prefix: str, kind: str) -> str:
    """Return the statuses or the states of a message as macros."""
    constants = message_constants(kind).items()
    lines = (f"#define {prefix.upper()}_{n} {v}" for n, v in constants if n.startswith("STAT"))
    return "\n".join(lines)


def _numbers(
    holder: Constants | OrderConstants | ForceConstants, prefix: str = ""
) -> dict[str, str]:
    """Return the numbers of a dataclass, and the lengths of its arrays, by the names of fields."""
    texts = {}
    for field, value in vars(holder).items():
        name = f"{prefix}{field}"
        if isinstance(value, np.ndarray):
            texts[f"n_{name}"], texts[f"width_of_{name}"] = str(len(value)), str(value.shape[-1])
            rows = value.swapaxes(1, 2) if value.ndim == 3 else value
            texts[name] = _rows(rows)
        elif isinstance(value, float):
            texts[name] = literal(value)
        elif isinstance(value, int):
            texts[name] = str(int(value))
        elif field.endswith(("range", "band")):
            texts[f"{name}_low"], texts[f"{name}_high"] = map(literal, value)
    return texts


def _facts(export: Export) -> str:
    """Return the lines of a comment about the table."""
    constants, table = export.constants, export.table
    lines = [f"Table {table.table_id}, of the mechanism {table.mechanism_name}."]
    lines += [f"M{label[1:]}" for label in export.mode_labels]
    lines += [f"{len(constants.starts)} cells; {constants.size} bytes of constants."]
    lines += [export.accuracy] + [constants.gap_text] * bool(constants.gaps)
    lines += [table.unknown_deviations] * bool(table.unknown_deviations)
    wrapped = [text for line in lines for text in textwrap.wrap(comment(line), _WIDTH) or [""]]
    return "\n".join(f" * {line}".rstrip() for line in wrapped)


def _rows(values: NDArray[np.floating[Any]], indent: str = "    ") -> str:
    """Return the inside of an array's braces."""
    if values.ndim == 1:
        suffix = "f" if values.dtype == np.float32 else ""
        text = indent + ", ".join(literal(value, suffix) for value in values.tolist())
        return textwrap.fill(text, _WIDTH, subsequent_indent=indent, break_on_hyphens=False)
    inside = (_rows(row, f"{indent} ") for row in values)
    if values.ndim == 2:
        return ",\n".join(f"{indent}{{{row.lstrip()}}}" for row in inside)
    return ",\n".join(f"{indent}{{\n{rows}}}" for rows in inside)


def _order_values(orders: OrderConstants) -> dict[str, str]:
    """Return what stands for the excitations in their templates."""
    rows, sources = [], list(Source)
    for excitation, which in zip(orders.excitations, orders.inputs, strict=True):
        load, rms, power = excitation.load, math.nan, 0
        speed, exponent = 1.0, 0.0
        if load is not None:
            rms, speed, exponent = load.amplitude / math.sqrt(2.0), load.speed, load.exponent
            power = load.kind.power
        ratio = excitation.ratio
        numbers = ", ".join(map(literal, (ratio, 2.0 * math.pi * ratio, rms, speed, exponent)))
        last = f"{power}, {which}u, {excitation.warns:d}u"
        rows.append(f"    {{{sources.index(excitation.source)}u, {numbers}, {last}}}")
    components = orders.forces.components if orders.forces else ()
    limits = DEFAULT_LIMITS
    dwell, gap, back = (f"INT64_C({round(1e9 * time)})" for time in (limits.dwell, GAP, BACK))
    return {
        "order_names": _texts(excitation.name for excitation in orders.excitations),
        "n_orders": str(len(rows)),
        "excitations": ",\n".join(rows),
        "n_forces": str(len(components)),
        "n_totals": str(len(components) or 1),
        "n_components": str(sum(components)),
        "components": ", ".join(f"{count}u" for count in components),
        "limits": ", ".join([*map(literal, (limits.warning, limits.note, limits.near)), dwell]),
        "gap": gap,
        "back": back,
        "highest_omega": literal(2.0 * math.pi * orders.highest_frequency),
    }
