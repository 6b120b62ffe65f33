# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Write a table as C source or as an FMU, where there is no Python.

With --excitations, the export also compares orders with natural frequencies, and computes the
response to each order where its amplitude and the FRFs of the table are known.
"""

import argparse
import math
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from linkage_vibration.cli.arguments import SHIPPED, mechanism_file

if TYPE_CHECKING:
    from collections.abc import Sequence

    from linkage_vibration.export.constants import Constants, MemberConstants, OrderConstants
    from linkage_vibration.mechanics.description import Mechanism
    from linkage_vibration.prediction.excitation import Excitation
    from linkage_vibration.table.table import Table

_LOAD_RATIOS = (
    " Load ratios come from numbers of their own in single precision, of which each differs by at "
    "most 1 % of its largest value."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add("table", nargs="?", type=Path, help="table to export (default: the shipped one)")
    text = "folder for a header, a source file in C99 and a test; it is created if it is missing"
    add("--c", type=Path, metavar="DIR", help=text)
    text = "FMU to write, for co-simulation and model exchange by FMI 2.0"
    add("--fmu", type=Path, metavar="FILE", help=text)
    text = "leave out the compiled library of the FMU; an importer compiles its sources"
    add("--source-only", action="store_true", help=text)
    text = "single instead of double precision; the files say how large the errors are"
    add("--single", action="store_true", help=text)
    text = "how the names of files and of everything in C begin (default: %(default)s)"
    add("--name", default="linkage_vibration", help=text)
    text = "use as few cells as give natural frequencies and damping ratios of the table within "
    text += "this relative error (at most 1e-3), and its peak within a hundred times as much "
    text += "(default: all cells, which give the same bits as Python)"
    add("--tolerance", type=float, help=text)
    text = "YAML file of excitations, for margins and responses by order"
    add("--excitations", type=Path, metavar="FILE", help=text)
    add("--mechanism", type=Path, help=f"for responses, the table's mechanism; {SHIPPED}")


def run(options: argparse.Namespace) -> int:
    """Write the files and print the errors; return the exit code."""
    from linkage_vibration.export.constants import ExportError, constants_of, fewer_cells
    from linkage_vibration.export.evaluation import exported
    from linkage_vibration.support.atomic_files import (
        check_output,
        check_outputs,
        new_folder,
        write_files,
    )
    from linkage_vibration.support.resources import DEFAULT_TABLE, config_file

    if options.c is None and options.fmu is None:
        raise ExportError("Nothing is written; give --c DIR for C, or --fmu FILE for an FMU.")
    path = options.table or config_file(DEFAULT_TABLE)
    inputs = [path, *filter(None, [options.excitations, options.mechanism])]
    check_output(options.fmu, ".fmu", inputs)
    table, orders = _read(options, path)
    constants = fewer = constants_of(table, orders)
    if options.tolerance is not None:
        fewer = fewer_cells(constants, options.tolerance)
    chosen, errors = exported(constants, fewer, in_single=options.single)
    text = f"{errors.text}{_LOAD_RATIOS if orders and orders.forces else ''}"
    files = _files(options, table, chosen, text)
    with new_folder(options.c, ExportError) if options.c else nullcontext():
        check_outputs(list(files), inputs)
        write_files({file: [data] for file, data in files.items()}, ExportError)
    for file in files:
        print(f"Written: {file}")
    print(
        f"Table {table.table_id} of {table.mechanism_name}: {len(chosen.starts)} of "
        f"{len(constants.starts)} cells, {chosen.size} bytes of constants. {text}"
    )
    if chosen.gaps:
        print(chosen.gap_text)
    return 0


def _files(
    options: argparse.Namespace, table: "Table", constants: "Constants", errors: str
) -> dict[Path, bytes]:
    """Return the contents of the files to write."""
    from linkage_vibration.export.c_source import c_files, description_of
    from linkage_vibration.export.fmu import fmu_bytes

    description, contents = description_of(table, errors, options.name), dict[Path, bytes]()
    if options.c is not None:
        _refuse_another_table(options.c / f"{options.name}.h", table.table_id)
        texts = c_files(description, constants)
        contents |= {options.c / name: text.encode() for name, text in texts.items()}
    if options.fmu is not None:
        compiled = not options.source_only
        contents[options.fmu] = fmu_bytes(description, constants, compiled=compiled)
    return contents


def _refuse_another_table(header: Path, table_id: str) -> None:
    """Raise an ExportError if a header is not an export of this table."""
    from linkage_vibration.export.c_source import existing_table
    from linkage_vibration.export.constants import ExportError

    if header.exists():
        other = existing_table(header.read_text(encoding="utf-8", errors="replace"))
        if other != table_id:
            what = f"an export of the table {other}" if other else "another file"
            raise ExportError(
                f"{header} is {what}, and is kept; give another --name or folder, or delete it."
            )


def _read(options: argparse.Namespace, path: Path) -> "tuple[Table, OrderConstants | None]":
    """Return the table, and the excitations of the options with their responses."""
    from linkage_vibration.readers.excitations import read_excitations
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.table.table import load_table

    if options.excitations is None:
        return load_table(path), None
    mechanism = read_mechanism(mechanism_file(options))
    table = load_table(path, mechanism)
    excitations = read_excitations(options.excitations)
    orders = [excitation for excitation in excitations if excitation.terrain is None]
    if len(orders) < len(excitations):
        print("The ground is left out, as an export computes the responses to orders alone.")
    if not orders:
        return table, None
    return table, orders_of(table, mechanism, orders, coarse=options.tolerance is not None)


def orders_of(
    table: "Table",
    mechanism: "Mechanism",
    excitations: "Sequence[Excitation]",
    *,
    coarse: bool = False,
) -> "OrderConstants":
    """Return excitations of a mechanism with the responses to them, as an export contains them.

    Differences of the members of the ensemble have 16 bits, or 8 if they are coarse.
    """
    import numpy as np

    from linkage_vibration.export.constants import OrderConstants, forces_of
    from linkage_vibration.prediction.levels import LevelTable
    from linkage_vibration.prediction.predictor import Predictor
    from linkage_vibration.prediction.severity import DEFAULT_LIMITS, GAP, RANKS

    levels = LevelTable(Predictor(table), mechanism, excitations)
    starts, cubics, t, which = levels.arrays
    i, names = int(which.max()) + 1, [name for name, _ in table.forces if levels.force_places]
    forces, o = None, 1 + len(names)
    ends = np.cumsum([3 * t, 3 * t * o * i, 3 * o * i, i if t else 0])
    at = np.split(np.arange(cubics.shape[2]), ends)  # as `prediction.levels` arranges the values
    above, rest = (part.reshape(-1, o, i) for part in at[1:3])
    if names:
        residues = cubics[:, :, above[:, 1:].reshape(3, -1)]
        others = cubics[:, :, np.append(rest[:, 1:], at[4])]
        components = tuple(names.count(name) for name in levels.force_places)
        borders = np.append(starts, table.alpha3_range[1])
        forces = forces_of(components, borders, residues, others)
    own = np.concatenate([at[0], above[:, 0].ravel(), rest[:, 0].ravel(), at[3]])
    return OrderConstants(
        names=tuple(excitation.name for excitation in excitations),
        sources=tuple(excitation.source.value for excitation in excitations),
        ratios=np.array([excitation.ratio for excitation in excitations]),
        loads=np.array([_force(excitation) for excitation in excitations]),
        inputs=tuple(which.tolist()),
        n_terms=t,
        n_inputs=i,
        starts=starts,
        cubics=cubics[:, :, own],
        highest_frequency=table.band[1],
        warns=tuple(excitation.warns for excitation in excitations),
        limits=(DEFAULT_LIMITS.warning, DEFAULT_LIMITS.note, DEFAULT_LIMITS.near),
        times=(round(1e9 * DEFAULT_LIMITS.dwell), round(1e9 * GAP)),
        ranks=tuple(RANKS.tolist()),
        forces=forces,
        ensemble=_ensemble(table, levels.member_arrays, o, coarse=coarse),
    )


def _ensemble(
    table: "Table", arrays: "tuple[Any, ...]", n_outputs: int, *, coarse: bool
) -> "MemberConstants | None":
    """Return the members whose numbers are possible, if these are as many as the node needs."""
    import numpy as np

    from linkage_vibration.export.constants import MemberConstants
    from linkage_vibration.mechanics.forces import LEAST_REFERENCE
    from linkage_vibration.prediction.levels import KNOWN

    if not arrays:
        return None
    nodes, values, places, *draws = arrays
    possible = np.isfinite(values[:, 1:]).all(axis=(0, 2))
    if possible.mean() < KNOWN:
        return None
    apart = (values[:, 1:] - values[:, :1])[:, possible].swapaxes(1, 2)
    kind = np.int8 if coarse else np.int16
    steps = np.abs(apart).max(axis=2) / np.float32(np.iinfo(kind).max)
    counts = np.round(apart / np.where(steps > 0.0, steps, 1.0)[..., np.newaxis])
    low, high = table.toggles or (0.0, 0.0)
    return MemberConstants(
        n_modes=table.ensemble_poles.shape[-1],
        n_outputs=n_outputs,
        stroke_middle=(low + high) / 2.0,
        stroke_half=(high - low) / 2.0,
        least_share=LEAST_REFERENCE,
        reference=table.reference_force or 0.0,
        nodes=nodes.astype(np.float32),
        places=places.astype(np.uint16),
        nominal=values[:, 0],
        steps=steps,
        values=counts.astype(kind),
        amplitudes=draws[0][possible].astype(np.float32),
        frequencies=draws[1][possible].astype(np.float32),
    )


def _force(excitation: "Excitation") -> tuple[float, float, float, float]:
    """Return the load of an excitation as `OrderConstants.loads` has it."""
    from linkage_vibration.prediction.excitation import LoadKind

    load = excitation.load
    if load is None:
        return math.nan, 1.0, 0.0, 0.0
    soil = float(load.kind is LoadKind.BASE_ACCELERATION)
    return load.amplitude / math.sqrt(2.0), load.speed, load.exponent, soil
