# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Packs an export as an FMU for FMI 2.0: description, sources, and a compiled library."""

import hashlib
import io
import os
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

from linkage_vibration.export.c_source import c_sources, common_values, filled, literal
from linkage_vibration.export.constants import NUMBERS, PER_MODE, Export, ExportError
from linkage_vibration.messages.fields import message_constants, message_fields
from linkage_vibration.messages.topics import LEVELS, PREDICTION, RESONANCE
from linkage_vibration.support.version import VERSION

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")
"""How the library of an FMU is compiled."""

_SPEEDS = {
    "engine": "rpm, speed of the engine; 0 at rest, NaN if it is not known",
    "pto": "rpm, speed of the PTO; 0 at rest, NaN if it is not known",
    "ground": "m/s, speed over ground; 0 at rest, NaN if it is not known",
}
_PER_ORDER = (
    "excitation_frequency",
    "margin",
    "relative_margin",
    "velocities",
    "accelerations",
    "amplifications",
)
_TOTALS = "total_velocity", "total_acceleration"
_SIGNED = {"frequency_slopes", "margin", "relative_margin", "damping_ratios"}
_TEXTS = {
    "modelDescription.xml": "modelDescription.xml.in",
    "documentation/index.html": "documentation.html.in",
}
_DATE = (1980, 1, 1, 0, 0, 0)  # of every file in an FMU, so that equal exports have equal bytes
# The folder of a library for Linux by the processor that its ELF header names. FMI 2.0 names only
# those of x86; the others are as in 3.0.
_PLATFORMS = {3: "linux32", 40: "aarch32-linux", 62: "linux64", 183: "aarch64-linux"}


@dataclass(frozen=True)
class _Variable:
    """A variable of the FMU, whose reference is its place; the description begins with the unit."""

    name: str
    causality: str
    description: str
    start: float | None = None
    limits: tuple[float | None, float | None] = (None, None)
    is_integer: bool = False

    def xml(self, reference: int) -> str:
        """Return the element of the variable with a value reference; integers have no unit."""
        kind, variability = "Real", "continuous"
        attributes = {"unit": re.split("[,;]", self.description)[0]}
        if self.is_integer:
            kind, variability, attributes = "Integer", "discrete", {}
        for name, value in zip(("min", "max", "start"), (*self.limits, self.start), strict=True):
            if value is not None:
                attributes[name] = str(int(value) if self.is_integer else float(value))
        about = {
            "name": self.name,
            "valueReference": str(reference),
            "description": self.description,
            "causality": self.causality,
            "variability": "tunable" if self.causality == "parameter" else variability,
        }
        return (
            f"    <ScalarVariable{_attributes(about)}>\n"
            f"      <{kind}{_attributes(attributes)} />\n"
            "    </ScalarVariable>"
        )


def fmu_bytes(export: Export, *, compiled: bool) -> bytes:
    """Return an FMU, with a library for this machine beside its sources if it is compiled."""
    prefix, constants = export.name, export.constants
    reals, integers = _variables(export)
    sources = c_sources(export)
    token = hashlib.sha256(f"{VERSION}{sources}".encode()).hexdigest()[:32]
    values = {
        **common_values(export),
        "settable": str(sum(variable.causality != "output" for variable in reals)),
        "reals": str(len(reals)),
        "integers": str(len(integers)),
        "token": token,
        "start": literal(constants.alpha3_range[0]),
        "turns": str(int(constants.turns)),
    }
    sources["fmi2.c"] = filled("fmu.c.in", values)
    names = [name for name in sources if name.endswith(".c")]
    texts = _texts(export, token, reals + integers, names)
    files = {name: filled(template, texts).encode() for name, template in _TEXTS.items()}
    files["model.png"] = Path(__file__).with_name("templates").joinpath("model.png").read_bytes()
    files |= {f"sources/{name}": text.encode() for name, text in sources.items()}
    if compiled:
        library = _library(sources)
        files[f"binaries/{platform_of(library)}/{prefix}.so"] = library
    return _packed(files)


def _variables(export: Export) -> tuple[list[_Variable], list[_Variable]]:
    """Return the real variables and the integer ones, in the order of the template."""
    constants, labels = export.constants, export.mode_labels
    low, high = constants.alpha3_range
    limits = (None, None) if constants.turns else (low, high)
    angle = next(field for field in message_fields(PREDICTION) if field.name == "crank_angle")
    spread = "rad, standard deviation of crank_angle; 0 if it is exact"
    reals = [
        _Variable("time", "independent", "s, time of the simulation"),
        _Variable("crank_angle", "input", angle.comment, low, limits),
        _Variable("crank_angle_stddev", "parameter", spread, 0.0, (0.0, None)),
    ]
    orders = constants.orders
    if orders is not None:
        reals += [_Variable(f"{s}_speed", "input", _SPEEDS[s], 0.0) for s in _SPEEDS]
    reals += _outputs(PER_MODE, labels)
    reals += _outputs(NUMBERS[len(PER_MODE) :])
    statuses = message_constants(PREDICTION)
    text = "1, " + ", ".join(f"{value} {name}" for name, value in statuses.items())
    ends = float(min(statuses.values())), float(max(statuses.values()))
    integers = [_Variable("status", "output", text, None, ends, is_integer=True)]
    if orders is not None:
        names = [excitation.name for excitation in orders.excitations]
        reals += _outputs(_PER_ORDER, names) + _outputs(_TOTALS)
        reals += _outputs(["load_ratios"], names)
        reals += _outputs(["total_load_ratio"])
        text = "1, mode that is nearest to the excitation, from 1; 0 if it is not known"
        ends = 0.0, float(constants.n_modes)
        for i, name in enumerate(names, 1):
            about = f"nearest_mode[{i}]", "output", f"{text}; {name}"
            integers.append(_Variable(*about, None, ends, is_integer=True))
    return reals, integers


def _outputs(names: Sequence[str], labels: Sequence[str] = ()) -> list[_Variable]:
    """Return outputs that fields of messages describe; labels name what elements belong to."""
    kinds = PREDICTION, RESONANCE, LEVELS
    comments = {field.name: field.comment for kind in kinds for field in message_fields(kind)}
    comments["frequency_slopes"] = "Hz/rad, change of the natural frequencies with crank_angle"
    comments["margin"] = "Hz, excitation_frequency - natural_frequency"
    comments["relative_margin"] = "1, margin / natural_frequency"
    variables = []
    for name in names:
        text, limits = comments[name], (None, None) if name in _SIGNED else (0.0, None)
        parts = [(f"{name}[{i}]", f"{text}; {label}") for i, label in enumerate(labels, 1)]
        for each, about in parts or [(name, text)]:
            variables.append(_Variable(each, "output", about, None, limits))
    return variables


def platform_of(library: bytes) -> str:
    """Return the folder of a compiled library in an FMU, as its ELF header says."""
    processor = int.from_bytes(library[18:20], "little") if library[:4] == b"\x7fELF" else 0
    if processor not in _PLATFORMS:
        raise ExportError(
            "The compiler made a library that is not for Linux on an x86 or Arm processor "
            f"(ELF {processor}); set CC to another compiler, or give --source-only."
        )
    return _PLATFORMS[processor]


def _texts(
    export: Export, token: str, variables: Sequence[_Variable], sources: Sequence[str]
) -> dict[str, str]:
    """Return what stands for each name in the templates of the descriptions."""
    listed = [pair for pair in enumerate(variables) if pair[1].causality != "independent"]
    outputs = [i for i, (_, variable) in enumerate(listed, 1) if variable.causality == "output"]
    about = f"Predicted vibration, by table {export.table.table_id}. {export.accuracy}"
    about = f"{about} {export.table.unknown_deviations}".rstrip()
    return {
        "name": _escaped(export.table.mechanism_name),
        "about": _escaped(about),
        "prefix": export.name,
        "token": token,
        "version": VERSION,
        "files": "\n".join(f'      <File name="{name}" />' for name in sources),
        "variables": "\n".join(variable.xml(reference) for reference, variable in listed),
        "unknowns": "\n".join(f'      <Unknown index="{i}" />' for i in outputs),
        "indicators": str(sum(variable.is_integer for variable in variables)),
    }


def _attributes(values: Mapping[str, str]) -> str:
    return "".join(f' {name}="{_escaped(value)}"' for name, value in values.items())


def _escaped(text: str) -> str:
    """Return a text for an attribute, without characters that XML does not allow."""
    return escape("".join(c if c.isprintable() else "?" for c in text), {'"': "&quot;"})


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
