# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Write a table as C source or as an FMU, where there is no Python.

With --excitations, the export also compares orders with natural frequencies, and computes the
response to each order where its amplitude and the FRFs of the table are known.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from linkage_vibration.cli.arguments import mechanism_of_table

if TYPE_CHECKING:
    from linkage_vibration.export.constants import Export


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add("table", nargs="?", type=Path, help="table to export (default: the shipped one)")
    text = "folder for a header and a source file in C99; it is created if it is missing"
    add("--c", type=Path, metavar="DIR", help=text)
    text = "FMU to write, for co-simulation and model exchange by FMI 2.0"
    add("--fmu", type=Path, metavar="FILE", help=text)
    text = "leave out the compiled library of the FMU; an importer compiles its sources"
    add("--source-only", action="store_true", help=text)
    text = "how the names of files and of everything in C begin (default: %(default)s)"
    add("--name", default="linkage_vibration", help=text)
    text = "YAML file of excitations, for margins and responses by order"
    add("--excitations", type=Path, metavar="FILE", help=text)
    text = "mechanism of the table, for responses (default: the file beside it, or a shipped one)"
    add("--mechanism", type=Path, metavar="FILE", help=text)


def run(options: argparse.Namespace) -> int:
    """Write the files and print how large they are; return the exit code."""
    from linkage_vibration.export.constants import ExportError
    from linkage_vibration.support.atomic_files import (
        check_output,
        check_outputs,
        make_folder,
        write_files,
    )
    from linkage_vibration.support.resources import DEFAULT_TABLE, config_file

    if options.c is None and options.fmu is None:
        raise ExportError("Nothing is written; give --c DIR for C, or --fmu FILE for an FMU.")
    path = options.table or config_file(DEFAULT_TABLE)
    inputs = [path, *filter(None, [options.excitations, options.mechanism])]
    check_output(options.fmu, ".fmu", inputs)
    export = _export(options, path)
    constants, table = export.constants, export.table
    files = _files(options, export)
    if options.c:
        make_folder(options.c, ExportError)
    check_outputs(list(files), inputs)
    write_files({file: [data] for file, data in files.items()}, ExportError)
    for file in files:
        print(f"Written: {file}")
    size = f"{len(constants.starts)} cells, {constants.size} bytes of constants"
    print(f"Table {table.table_id} of {table.mechanism_name}: {size}. {export.accuracy}")
    if constants.gaps:
        print(constants.gap_text)
    return 0


def _files(options: argparse.Namespace, export: "Export") -> dict[Path, bytes]:
    """Return the contents of the files to write; another export is not replaced."""
    from linkage_vibration.export.c_source import c_sources, existing_table
    from linkage_vibration.export.constants import ExportError
    from linkage_vibration.export.fmu import fmu_bytes

    contents = dict[Path, bytes]()
    if options.c is not None:
        header = options.c / f"{options.name}.h"
        if header.exists():
            other = existing_table(header.read_text(encoding="utf-8", errors="replace"))
            if other != export.table.table_id:
                what = f"an export of the table {other}" if other else "another file"
                problem = f"{header} is {what}, and is kept"
                raise ExportError(f"{problem}; give another --name or folder, or delete it.")
        contents |= {options.c / name: text.encode() for name, text in c_sources(export).items()}
    if options.fmu is not None:
        contents[options.fmu] = fmu_bytes(export, compiled=not options.source_only)
    return contents


def _export(options: argparse.Namespace, path: Path) -> "Export":
    """Return the table and the excitations of the options, as they are exported."""
    from linkage_vibration.export.constants import export_of
    from linkage_vibration.readers.excitations import read_excitations
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.table.table import load_table

    mechanism, orders = None, []
    if options.excitations is not None:
        mechanism = read_mechanism(options.mechanism or mechanism_of_table(path))
        excitations = read_excitations(options.excitations)
        orders = [excitation for excitation in excitations if excitation.terrain is None]
        if len(orders) < len(excitations):
            print("The ground is left out, as an export computes the responses to orders alone.")
    return export_of(load_table(path, mechanism), mechanism, orders, name=options.name)
