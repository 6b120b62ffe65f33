# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Packs an export as an FMU for FMI 2.0: description, sources, and a compiled library."""

import hashlib
import io
import os
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from linkage_vibration.export.c_source import (
    SOURCES,
    Description,
    c_files,
    filled,
    literal,
)
from linkage_vibration.export.constants import Constants, ExportError
from linkage_vibration.messages.fields import message_constants, message_fields
from linkage_vibration.messages.topics import PREDICTION, RESONANCE
from linkage_vibration.support.version import VERSION

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared")
"""How the library of an FMU is compiled."""

_SPEED_UNITS = {"engine": "rpm", "pto": "rpm", "ground": "m/s"}
# The base units of each unit that the fields of the messages have.
_UNITS: dict[str, dict[str, str]] = {
    "1": {},
    "s": {"s": "1"},
    "rad": {"rad": "1"},
    "Hz": {"s": "-1"},
    "Hz/rad": {"s": "-1", "rad": "-1"},
    "m/N": {"kg": "-1", "s": "2"},
    "m/s": {"m": "1", "s": "-1"},
    "m/s^2": {"m": "1", "s": "-2"},
    "rpm": {"rad": "1", "s": "-1", "factor": "0.10471975511965977"},
}
_SIGNED = {"frequency_slopes", "margin", "relative_margin", "damping_ratios"}
_DATE = (1980, 1, 1, 0, 0, 0)  # of every file in an FMU, so that equal exports have equal bytes
_SYSTEMS = {
    "Linux": ("linux", ".so"),
    "Darwin": ("darwin", ".dylib"),
    "Windows": ("windows", ".dll"),
}
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
_PLATFORMS = {
    "x86_64-linux": "linux64",
    "x86_64-darwin": "darwin64",
    "x86_64-windows": "win64",
}


@dataclass(frozen=True)
class _Variable:
    """A variable of the FMU; its value reference is its place in the list."""

    name: str
    causality: str
    unit: str
    description: str
    start: float | None = None
    limits: tuple[float | None, float | None] = (None, None)
    is_integer: bool = False

    @property
    def variability(self) -> str:
        if self.causality == "parameter":
            return "tunable"
        return "discrete" if self.is_integer else "continuous"


def fmu_bytes(description: Description, constants: Constants, *, compiled: bool) -> bytes:
    """Return an FMU, with a library for this machine beside its sources if it is compiled.

    Raises
    ------
    ExportError
        If a library is wanted and there is no C compiler, or if it fails.
    """
    prefix = description.prefix
    reals, integers = _variables(description, constants)
    sources = dict(list(c_files(description, constants).items())[:2])
    token = hashlib.sha256(f"{VERSION}{sources}".encode()).hexdigest()[:32]
    values = {
        "prefix": prefix,
        "PREFIX": prefix.upper(),
        "settable": str(sum(variable.causality != "output" for variable in reals)),
        "reals": str(len(reals)),
        "integers": str(len(integers)),
        "token": token,
        "start": literal(constants.alpha3_range[0]),
    }
    sources["fmi2.c"] = filled("fmu.c.in", values)
    names = [name for name in sources if name.endswith(".c")]
    tree = _model_description(description, token, reals + integers, names)
    files = {"modelDescription.xml": _text(tree)}
    files |= {f"sources/{name}": text.encode() for name, text in sources.items()}
    if compiled:
        folder, suffix = _platform()
        files[f"binaries/{folder}/{prefix}{suffix}"] = _library(sources)
    return _packed(files)


def _variables(
    description: Description, constants: Constants
) -> tuple[list[_Variable], list[_Variable]]:
    """Return the real variables and the integer ones, in the order of the template."""
    low, high = constants.alpha3_range
    limits = (None, None) if constants.turns else (low, high)
    comments = {field.name: field for field in message_fields(PREDICTION)}
    angle = comments["crank_angle"]
    reals = [
        _Variable("time", "independent", "s", "s, time of the simulation"),
        _Variable("crank_angle", "input", angle.unit, angle.comment, low, limits),
        _Variable(
            "crank_angle_stddev",
            "parameter",
            "rad",
            "rad, standard deviation of crank_angle; 0 if it is exact",
            0.0,
            (0.0, None),
        ),
    ]
    orders = constants.orders
    if orders is not None:
        reals += [
            _Variable(f"{source}_speed", "input", _SPEED_UNITS[source], _speed_text(source), 0.0)
            for source in SOURCES
        ]
    labels = description.mode_labels
    reals += _outputs(PREDICTION, _PER_MODE, labels) + _outputs(PREDICTION, _SINGLE)
    statuses = message_constants(PREDICTION)
    text = ", ".join(f"{value} {name}" for name, value in statuses.items())
    ends = float(min(statuses.values())), float(max(statuses.values()))
    integers = [_Variable("status", "output", "1", f"1, {text}", None, ends, True)]
    if orders is not None:
        reals += _outputs(RESONANCE, _PER_ORDER, orders.names) + _outputs(RESONANCE, _TOTALS)
        text = "1, mode that is nearest to the excitation, from 1; 0 if it is not known"
        integers += [
            _Variable(
                f"nearest_mode[{i}]",
                "output",
                "1",
                f"{text}; {name}",
                None,
                (0.0, float(constants.n_modes)),
                True,
            )
            for i, name in enumerate(orders.names, 1)
        ]
    return reals, integers


_PER_MODE = (
    "natural_frequencies",
    "frequency_stddev",
    "damping_ratios",
    "damping_ratio_stddev",
    "frequency_slopes",
)
_SINGLE = "frf_peak_frequency", "frf_peak_magnitude", "interpolation_error"
_PER_ORDER = (
    "excitation_frequency",
    "margin",
    "relative_margin",
    "velocities",
    "accelerations",
    "amplifications",
)
_TOTALS = "total_velocity", "total_acceleration"


def _speed_text(source: str) -> str:
    what = {"engine": "of the engine", "pto": "of the PTO", "ground": "over ground"}[source]
    return f"{_SPEED_UNITS[source]}, speed {what}; 0 if it is not known"


def _outputs(kind: str, names: Sequence[str], labels: Sequence[str] = ()) -> list[_Variable]:
    """Return outputs with the units and descriptions of the fields of a message.

    The labels name what the elements of each field belong to.
    """
    fields = {field.name: field for field in message_fields(kind)}
    variables = []
    for name in names:
        unit, text = "Hz/rad", "Hz/rad, change of the natural frequencies with crank_angle"
        if name in fields:
            unit, text = fields[name].unit, fields[name].comment
        limits = (None, None) if name in _SIGNED else (0.0, None)
        for i, label in enumerate(labels or [""], 1):
            full_name, what = (f"{name}[{i}]", f"{text}; {label}") if labels else (name, text)
            variables.append(_Variable(full_name, "output", unit, what, None, limits))
    return variables


def _model_description(
    description: Description, token: str, variables: Sequence[_Variable], sources: Sequence[str]
) -> ElementTree.Element:
    root = ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0",
            "guid": token,
            "numberOfEventIndicators": "0",
            **_common(description),
        },
    )
    for interface, more in _INTERFACES.items():
        attributes = {"modelIdentifier": description.prefix, **more}
        attributes["canNotUseMemoryManagementFunctions"] = "true"
        element = ElementTree.SubElement(root, interface, attributes)
        files = ElementTree.SubElement(element, "SourceFiles")
        for name in sources:
            ElementTree.SubElement(files, "File", name=name)
    _add_units(root)
    listed = ElementTree.SubElement(root, "ModelVariables")
    outputs = []
    for reference, variable in enumerate(variables):
        if variable.causality == "independent":
            continue
        scalar = ElementTree.SubElement(listed, "ScalarVariable", _attributes(variable, reference))
        kind = "Integer" if variable.is_integer else "Real"
        ElementTree.SubElement(scalar, kind, _type_attributes(variable))
        if variable.causality == "output":
            outputs.append(len(listed))
    structure = ElementTree.SubElement(root, "ModelStructure")
    for part in ("Outputs", "InitialUnknowns"):
        unknowns = ElementTree.SubElement(structure, part)
        for index in outputs:
            ElementTree.SubElement(unknowns, "Unknown", index=str(index))
    return root


_INTERFACES = {
    "ModelExchange": {},
    "CoSimulation": {"canHandleVariableCommunicationStepSize": "true"},
}


def _common(description: Description) -> dict[str, str]:
    return {
        "modelName": _printable(description.mechanism_name),
        "description": f"Predicted vibration, by table {description.table_id}. "
        + _printable(description.errors),
        "version": VERSION,
        "generationTool": f"linkage_vibration {VERSION}",
        "variableNamingConvention": "structured",
    }


def _attributes(variable: _Variable, reference: int) -> dict[str, str]:
    return {
        "name": variable.name,
        "valueReference": str(reference),
        "description": _printable(variable.description),
        "causality": variable.causality,
        "variability": variable.variability,
    }


def _type_attributes(variable: _Variable) -> dict[str, str]:
    """Return unit, limits and start of a variable; integers have no unit."""
    attributes = {} if variable.is_integer else {"unit": variable.unit}
    pairs = zip(("min", "max", "start"), (*variable.limits, variable.start), strict=True)
    for name, value in pairs:
        if value is not None:
            attributes[name] = str(int(value)) if variable.is_integer else repr(float(value))
    return attributes


def _add_units(root: ElementTree.Element) -> None:
    """Add the units, and what an importer simulates unless it is asked for something else."""
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name, base in _UNITS.items():
        unit = ElementTree.SubElement(units, "Unit", name=name)
        ElementTree.SubElement(unit, "BaseUnit", base)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize="0.01")


def _printable(text: str) -> str:
    """Return a text without characters that XML does not allow."""
    return "".join(c if c.isprintable() else "?" for c in text)


def _text(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _platform() -> tuple[str, str]:
    """Return the folder of a library for this machine, and its suffix."""
    machine = platform.machine().lower()
    system, suffix = _SYSTEMS.get(platform.system(), (platform.system().lower(), ".so"))
    name = f"{_MACHINES.get(machine, machine)}-{system}"
    return _PLATFORMS.get(name, name), suffix


def _library(sources: Mapping[str, str]) -> bytes:
    """Compile the sources for this machine."""
    compiler = os.environ.get("CC") or next(filter(None, map(shutil.which, ("cc", "gcc"))), None)
    if compiler is None:
        raise ExportError(
            "No C compiler was found to build the FMU for this machine; install one "
            "(apt-get install gcc), or give --source-only."
        )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="utf-8")
        units = [file for file in sources if file.endswith(".c")]
        command = [*compiler.split(), *FLAGS, "-o", "library", *units, "-lm"]
        try:
            subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
        except OSError as error:
            raise ExportError(f"{compiler} cannot be run ({error.strerror}); set CC.") from None
        except subprocess.CalledProcessError as error:
            last = (error.stderr.strip().splitlines() or ["it printed nothing"])[-1]
            raise ExportError(
                f"{compiler} cannot build the FMU ({last}); set CC to another compiler, or give "
                "--source-only."
            ) from None
        return (folder / "library").read_bytes()


def _packed(files: Mapping[str, bytes]) -> bytes:
    """Return files as a ZIP archive, which has the same bytes whenever it is made."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            info = zipfile.ZipInfo(name, _DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
    return buffer.getvalue()
