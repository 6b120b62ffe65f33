# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the numbers of a table into templates, as one C header, one source file and a test."""

import math
import re
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from linkage_vibration.export.constants import (
    Constants,
    ExportError,
    ForceConstants,
    MemberConstants,
    OrderConstants,
    Reals,
)
from linkage_vibration.export.evaluation import ASSESSED, NUMBERS, SOURCES, assess, evaluate
from linkage_vibration.messages.fields import message_constants, message_fields
from linkage_vibration.messages.topics import LOAD_STATE, PREDICTION, RESONANCE
from linkage_vibration.support.version import VERSION
from linkage_vibration.table.table import Table

NAME = "linkage_vibration"
"""How names begin unless another name is wanted."""

_TEMPLATES = Path(__file__).with_name("templates")
_WIDTH = 96  # characters of a line
_TESTED = 1000  # angles of the generated test
_ASSESSED = 200  # of them are those at which excitations are compared
_HIGHEST_SPEEDS = 3000.0, 1200.0, 12.0  # rpm and m/s, of that test
_SEED = 2
_VALID_NAME = re.compile(r"[a-z][0-9a-z_]{0,19}")


@dataclass(frozen=True)
class Description:
    """What an export says about its table.

    Attributes
    ----------
    name : str
        How the names of files and of everything in C begin.
    mechanism_name, table_id : str
    mode_labels : tuple of str, (n_modes,)
        As `Table.mode_label` returns them.
    errors : str
        A sentence about bounds of errors.
    """

    name: str
    mechanism_name: str
    table_id: str
    mode_labels: tuple[str, ...]
    errors: str


def description_of(table: Table, errors: str, name: str = NAME) -> Description:
    """Return what an export says about a table, with a sentence about its errors.

    Raises
    ------
    ExportError
        If the name cannot begin names in C that differ in their first 31 characters.
    """
    if not _VALID_NAME.fullmatch(name):
        raise ExportError(
            f"{name!r} cannot begin names in C; give up to 20 lower-case letters, digits and "
            "underscores, of which the first is a letter."
        )
    labels = tuple(table.mode_label(mode) for mode in range(table.n_modes))
    return Description(name, table.mechanism_name, table.table_id, labels, errors)


def c_files(description: Description, constants: Constants) -> dict[str, str]:
    """Return the header, the source and the test by their names."""
    prefix = description.name
    values = _values(description, constants)
    files = {f"{prefix}.h": "table.h.in", f"{prefix}.c": "table.c.in"}
    texts = {name: filled(template, values) for name, template in files.items()}
    texts[f"{prefix}_test.c"] = filled("test.c.in", values | _test_values(constants, prefix))
    return texts


def filled(template: str, values: Mapping[str, str]) -> str:
    """Return the template of a file name, with a value for each name between two ``@``."""
    text = (_TEMPLATES / template).read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda match: values[match[1]], text)


def literal(value: float, suffix: str = "") -> str:
    """Return a number in C, as a hexadecimal float that is exact, with the suffix of its type.

    Examples
    --------
    >>> literal(0.1), literal(-2.0, "f"), literal(float("nan")), literal(-3)
    ('0x1.999999999999ap-4', '-0x1p+1f', 'NAN', '-3')
    """
    if isinstance(value, int):
        return str(value)
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    mantissa, exponent = float(value).hex().split("p")
    return f"{mantissa.rstrip('0').rstrip('.')}p{exponent}{suffix}"


def comment(text: str) -> str:
    """Return a text that cannot end a comment in C, nor disturb its line.

    Examples
    --------
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

    Examples
    --------
    >>> existing_table('#define HITCH_TABLE_ID "0123456789abcdef"')
    '0123456789abcdef'
    """
    match = re.search(r'^#define \w+_TABLE_ID "(\w+)"$', header, re.MULTILINE)
    return match[1] if match else ""


def _suffix(constants: Constants) -> str:
    return "f" if constants.starts.dtype == np.float32 else ""


def _values(description: Description, constants: Constants) -> dict[str, str]:
    """Return what stands for each name in the templates of header and source."""
    prefix, f, orders = description.name, _suffix(constants), constants.orders
    low, high = (math.degrees(angle) for angle in constants.alpha3_range)
    turns = ", of any turn" if constants.turns else ""
    fields = (*message_fields(RESONANCE), *message_fields(PREDICTION))
    values = {
        **{field.name: comment(field.comment) for field in fields},
        **_numbers(constants, f),
        "prefix": prefix,
        "PREFIX": prefix.upper(),
        "f": f,
        "version": VERSION,
        "title": comment(
            f"Vibration of {description.mechanism_name}: natural frequencies at any crank angle."
        ),
        "facts": _facts(description, constants),
        "table_id": description.table_id,
        "mode_names": _texts(description.mode_labels),
        "digits": "24" if f else "53",
        "DIGITS": "FLT_MANT_DIG" if f else "DBL_MANT_DIG",
        "real": "float" if f else "double",
        "in_double": ", whose numbers were rounded to single precision" if f else "",
        "range": f"{low:.6g} to {high:.6g} deg{turns}",
        "statuses": _macros(prefix, PREDICTION),
        "turn": literal(float(constants.starts.dtype.type(2.0 * math.pi)), f),
        "orders_header": "",
        "orders_source": "",
    }
    if orders is not None:
        values |= _numbers(orders, f, "response_") | _order_values(orders, f)
        values |= {"states": _macros(prefix, LOAD_STATE), "forces_source": ""}
        values |= {"ensemble_header": "", "ensemble_source": ""}
        if orders.forces is not None:
            values |= _numbers(orders.forces, f, "force_")
            values["forces_source"] = filled("forces.c.in", values)
        if orders.ensemble is not None:
            values |= _numbers(orders.ensemble, f, "member_")
            values["member_count"] = str(len(orders.ensemble.amplitudes))
            values["member_type"] = f"{orders.ensemble.values.dtype}_t"
            values["ensemble_header"] = filled("ensemble.h.in", values)
            values["ensemble_source"] = filled("ensemble.c.in", values)
        values["orders_header"] = filled("orders.h.in", values)
        values["orders_source"] = filled("orders.c.in", values)
    return values


def _macros(prefix: str, kind: str) -> str:
    """Return the constants of a message as macros."""
    constants = message_constants(kind).items()
    return "\n".join(f"#define {prefix.upper()}_{name} {value}" for name, value in constants)


def _numbers(
    holder: Constants | OrderConstants | ForceConstants | MemberConstants, f: str, prefix: str = ""
) -> dict[str, str]:
    """Return the numbers of a dataclass, and the lengths of its arrays, by the names of fields."""
    texts = {}
    for field, value in vars(holder).items():
        name = f"{prefix}{field}"
        if isinstance(value, np.ndarray):
            texts[f"n_{name}"], texts[f"width_of_{name}"] = str(len(value)), str(value.shape[-1])
            own = "f" if value.dtype == np.float32 else f
            texts[name] = _rows(value.swapaxes(1, 2) if value.ndim == 3 else value, own)
        elif isinstance(value, float):
            texts[name] = literal(value, f)
        elif isinstance(value, int):
            texts[name] = str(int(value))
        elif field.endswith(("range", "band")):
            texts[f"{name}_low"], texts[f"{name}_high"] = (literal(end, f) for end in value)
    return texts


def _facts(description: Description, constants: Constants) -> str:
    """Return the lines of a comment about the table."""
    n = len(constants.starts)
    lines = [f"Table {description.table_id}, of the mechanism {description.mechanism_name}."]
    lines += [f"M{label[1:]}" for label in description.mode_labels]
    lines += [f"{n} cells; {constants.size} bytes of constants.", description.errors]
    lines += [constants.gap_text] * bool(constants.gaps)
    wrapped = [text for line in lines for text in textwrap.wrap(comment(line), _WIDTH) or [""]]
    return "\n".join(f" * {line}".rstrip() for line in wrapped)


def _rows(values: Reals, f: str, indent: str = "    ") -> str:
    """Return the inside of an array's braces."""
    if values.ndim == 1:
        return "\n".join(_lines((literal(value, f) for value in values.tolist()), indent))
    inside = (_rows(row, f, f"{indent} ") for row in values)
    if values.ndim == 2:
        return ",\n".join(f"{indent}{{{row.lstrip()}}}" for row in inside)
    return ",\n".join(f"{indent}{{\n{rows}}}" for rows in inside)


def _lines(words: Iterable[str], indent: str) -> list[str]:
    """Return words with commas between them, in lines of the usual width."""
    lines, line = [], indent
    for word in words:
        if len(line) + len(word) > _WIDTH and line != indent:
            lines.append(line.rstrip())
            line = indent
        line += f"{word}, "
    return [*lines, line.removesuffix(", ")]


def _order_values(orders: OrderConstants, f: str) -> dict[str, str]:
    """Return what stands for the excitations in their templates."""
    real, rows = orders.starts.dtype.type, []
    given = orders.ratios.tolist(), orders.omegas.tolist(), orders.loads.tolist()
    every = zip(orders.sources, *given, orders.inputs, orders.warns, strict=True)
    for source, *pair, (*load, soil), which, warns in every:
        numbers = [literal(v, f) for v in (*pair, *load)]
        last = str(int(soil)), f"{which}u", f"{warns:d}u"
        rows.append(f"    {{{', '.join([f'{SOURCES.index(source)}u', *numbers, *last])}}}")
    components = orders.forces.components if orders.forces else ()
    dwell, gap = (f"INT64_C({time})" for time in orders.times)
    return {
        "order_names": _texts(orders.names),
        "n_orders": str(len(orders.names)),
        "excitations": ",\n".join(rows),
        "n_forces": str(len(components)),
        "n_totals": str(len(components) or 1),
        "n_components": str(sum(components)),
        "components": ", ".join(f"{count}u" for count in components),
        "limits": ", ".join([*(literal(float(real(v)), f) for v in orders.limits), dwell]),
        "ranks": ", ".join(map(str, orders.ranks)),
        "gap": gap,
        "tiny": literal(1e-37 if f else 1e-300, f),
        "highest_omega": literal(float(real(2.0 * math.pi * orders.highest_frequency)), f),
    }


def _test_values(constants: Constants, name: str) -> dict[str, str]:
    """Return what stands for each name in the template of the test."""
    f, dtype = _suffix(constants), constants.starts.dtype
    angles = angles_to_test(constants)
    stddev = np.where(np.arange(len(angles)) % 2, 1e-3, 0.0).astype(dtype)
    outputs = evaluate(constants, angles, stddev)
    numbers = np.hstack([getattr(outputs, name).reshape(len(angles), -1) for name in NUMBERS])
    with np.errstate(all="ignore"):
        largest = np.fmax.reduce(np.abs(numbers), axis=0, initial=0.0)
    values = dict.fromkeys(("orders_test", "orders_calls", "order_count", "assess_too"), "")
    if constants.orders is not None:
        given = {"f": f, "prefix": name, "PREFIX": name.upper()}
        values = {
            "orders_test": filled(
                "orders_test.c.in", given | _order_test_values(constants, angles, stddev)
            ),
            "orders_calls": "    assess_all(&wrong, &equal, &worst);\n",
            "order_count": " + (long)ASSESSED * LEVELS",
            "assess_too": f" and {name}_assess",
        }
    return values | {
        "count": str(len(angles)),
        "limit": "1e-4" if f else "1e-12",
        "angles": _rows(np.stack([angles, stddev], axis=1), f),
        "expected_statuses": "\n".join(_lines(map(str, outputs.status.tolist()), "    ")),
        "expected": _rows(numbers, f),
        "largest": _rows(np.where(largest > 0.0, largest, 1.0), f),
    }


def _order_test_values(constants: Constants, angles: Reals, stddev: Reals) -> dict[str, str]:
    """Return what stands for each name in the template of the test of excitations."""
    assert constants.orders is not None
    f, random = _suffix(constants), np.random.default_rng(_SEED)
    low, high = constants.alpha3_range
    rows = np.flatnonzero((angles >= low) & (angles <= high))[-_ASSESSED:]
    angles, stddev = angles[rows], stddev[rows]
    speeds = random.uniform(0.0, _HIGHEST_SPEEDS, (len(rows), 3)).astype(angles.dtype)
    speeds[::7], speeds[::11, 1] = 0.0, math.nan
    outputs = evaluate(constants, angles, stddev)
    assessed = assess(constants.orders, outputs, angles, speeds)
    numbers = np.hstack([assessed[name].reshape(len(rows), -1) for name in ASSESSED])
    largest = np.fmax.reduce(np.abs(numbers), axis=0, initial=0.0)
    return {
        "assessed": str(len(rows)),
        "cases": _rows(np.column_stack([angles, speeds]), f),
        "assessments": _rows(numbers, f),
        "largest_assessments": _rows(np.where(largest > 0.0, largest, 1.0), f),
    }


def angles_to_test(constants: Constants, count: int = _TESTED) -> Reals:
    """Return angles in and around the range, with its ends, borders of cells, NaN and infinity.

    There are at least 20.
    """
    real = constants.starts.dtype.type
    low, high = constants.alpha3_range
    special = [math.nan, math.inf, -math.inf, 0.0, low, high, -low, high + 2.0 * math.pi]
    special += [low - 20.0 * math.pi, 1e5, 1e30]
    ends = [np.nextafter(real(x), real(y)) for x in (low, high) for y in (-math.inf, math.inf)]
    chosen = np.array([*special, *ends], dtype=constants.starts.dtype)
    borders = constants.starts[:: max(1, 4 * len(constants.starts) // count)]
    below = np.nextafter(borders, real(-math.inf))
    chosen = np.concatenate([chosen, borders, below])[:count]
    random = np.random.default_rng(_SEED)
    rest = count - len(chosen)
    inside = random.uniform(low, high, rest)
    far = random.uniform(-constants.farthest, constants.farthest, rest)
    others = np.where(np.arange(rest) % 10 == 0, far, inside)
    return np.concatenate([chosen, others.astype(constants.starts.dtype)])
