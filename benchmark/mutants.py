# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures which single changes of rules the tests notice: ``python -m benchmark.mutants``.

cosmic-ray lists the places of a file that it can change, and makes the changes. A random sample of
them is tried, each with the tests of its module alone, which stop at the first failure.
"""

import argparse
import csv
import hashlib
import importlib
import math
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import parso
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names
from parso.tree import BaseNode, NodeOrLeaf
from tqdm import tqdm

from benchmark.report import RESULTS, machine, publish, table

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "linkage_vibration"
LIST = RESULTS / "mutants.csv"
SHARE, LEAST = 0.02, 8  # of the places of a module, and the least number, that are sampled
OVERHEAD, FACTOR = 10.0, 3.0  # s, and times the time of the tests without a change: a timeout
Z = 1.96  # of a 95 % interval

TESTS = {
    "prediction/health.py": ("prediction/test_health.py",),
    "prediction/motion.py": ("prediction/test_motion.py",),
    "prediction/excitation.py": ("prediction/test_excitation.py", "readers/test_excitations.py"),
    "prediction/inputs": ("prediction/test_inputs.py",),
    "prediction/loads.py": ("prediction/test_loads.py", "prediction/test_levels.py"),
    "prediction/predictor.py": ("prediction/test_predictor.py",),
    "prediction/resonance.py": (
        "prediction/test_fast_passes.py",
        "prediction/test_resonance.py",
        "prediction/test_resonance_rate.py",
        "prediction/test_resonance_rules.py",
    ),
    "prediction/levels.py": (
        "prediction/test_level_deviations.py",
        "prediction/test_own_frequency.py",
        "prediction/test_levels.py",
    ),
    "review/findings.py": ("review/test_findings.py",),
    "review/moments.py": ("review/test_moments.py",),
    "studies/calibration.py": ("studies/test_calibration.py",),
    "studies/calibrated_uncertainty.py": ("studies/test_calibration.py",),
    "studies/inclinometer.py": ("studies/test_inclinometer.py",),
    "studies/measurement.py": ("studies/test_measurement.py",),
    "studies/ringdown.py": ("studies/test_ringdown.py",),
    "studies/plan.py": ("studies/test_plan.py",),
    "table/tabulation/tracking.py": ("table/tabulation/test_veering.py",),
    "mechanics/sensitivity.py": (
        "mechanics/test_sensitivity.py",
        "mechanics/test_uncertainty.py",
        "table/tabulation/test_deviations.py",
    ),
    "bags/recorder.py": ("bags/test_recorder.py",),
    "export/constants.py": ("export/test_c.py",),
    "export/evaluation.py": ("export/test_c.py",),
    "export/c_source.py": ("export/test_c.py", "export/test_orders.py"),
    "export/fmu.py": ("export/test_fmu.py",),
}
"""Modules in the package, and their tests."""

_LIBRARIES = ("hypothesis", "numpy", "pytest", "scipy.optimize", "scipy.interpolate", "scipy.stats")
_FAMILIES = {
    "ReplaceBinaryOperator": ("Add", "Sub", "Mul", "Div", "BitOr", "BitAnd"),
    "ReplaceComparisonOperator": ("Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"),
    "ReplaceUnaryOperator": ("USub", "UAdd", "Delete", "Not"),
    "AddNot": (),
    "ReplaceTrueWithFalse": (),
    "ReplaceFalseWithTrue": (),
    "ReplaceAndWithOr": (),
    "ReplaceOrWithAnd": (),
    "ReplaceBreakWithContinue": (),
    "ReplaceContinueWithBreak": (),
    "NumberReplacer": (),
    "ZeroIterationForLoop": (),
}
"""Kinds of changes, and what is replaced by what; the others of cosmic-ray fail at the import."""
_BITS = {"BitOr", "BitAnd"}
_TEXT = {"fstring", "string", "decorator", "assert_stmt", "import_name", "import_from"}
_ALIAS = re.compile(r"_?[A-Z][A-Za-z]*[a-z]\w*$")


@dataclass(frozen=True)
class Mutant:
    """A changed line, and whether a test failed."""

    module: str
    file: str
    line: int
    before: str
    after: str
    outcome: str = ""  # found, not found, or found since: by a test that was written for it
    reason: str = ""  # why it was not found, judged by a reader
    commit: str = ""

    @property
    def key(self) -> tuple[str, str, str]:
        """What is the same after other lines have changed."""
        return self.file, self.before, self.after

    @property
    def is_missed(self) -> bool:
        """Whether a test should find it, and none does."""
        return self.outcome == "not found" and not self.reason.startswith("Equivalent")


def operators() -> Iterator[str]:
    """Return the names of the operators of cosmic-ray that are used."""
    for name in operator_names():
        family, *words = name.removeprefix("core/").split("_")
        if family not in _FAMILIES or not {*words} <= {*_FAMILIES[family], *words[:1]}:
            continue
        bits = {*words} & _BITS
        if not bits or {*words} <= _BITS:
            yield name


def is_rule(node: NodeOrLeaf) -> bool:
    """Return whether a node is code, and no text, annotation, decorator or alias of a type."""
    child, parent = node, node.parent
    while parent is not None:
        if child.type in _TEXT or parent.type == "tfpdef":
            return False
        if parent.type == "annassign" and parent.children[1] is child:
            return False
        if parent.type == "funcdef" and parent.annotation is child:
            return False
        if parent.type == "expr_stmt" and _ALIAS.match(parent.children[0].get_code().strip()):
            return False
        child, parent = parent, parent.parent
    return True


def nodes(node: NodeOrLeaf) -> Iterator[NodeOrLeaf]:
    """Return a node and all below it, in the order in which cosmic-ray visits them."""
    yield node
    if isinstance(node, BaseNode):
        for child in node.children:
            yield from nodes(child)


@dataclass(frozen=True, order=True)
class Place:
    """Where and how a file can be changed."""

    rank: str  # in the sample: a hash of the line and the change, whatever stands around it
    path: Path
    operator: str
    occurrence: int  # of what the operator can change
    line: str


def places(path: Path, seed: int) -> list[Place]:
    """Return each place of a file, with one change that is drawn."""
    source = path.read_text(encoding="utf-8")
    lines, every = source.splitlines(), list(nodes(parso.parse(source)))
    drawn: dict[tuple[str, tuple[int, int]], Place] = {}
    for name in operators():
        operator, occurrence = get_operator(name)(), -1
        for node in every:
            for index, _ in enumerate(operator.mutation_positions(node)):
                occurrence += 1
                row, column = node.start_pos
                line = lines[row - 1].strip()
                text = f"{seed} {path.name} {line} {name} {column} {index}"
                rank = hashlib.sha256(text.encode()).hexdigest()
                key = name.split("_")[0], node.start_pos
                if is_rule(node) and (key not in drawn or rank < drawn[key].rank):
                    drawn[key] = Place(rank, path, name, occurrence, line)
    return list(drawn.values())


def changed(module: str, place: Place) -> tuple[Mutant, str]:
    """Return a change, and the code of the file with it."""
    source = place.path.read_text(encoding="utf-8")
    code = mutate_code(source, get_operator(place.operator)(), place.occurrence)
    assert code is not None
    pairs = enumerate(zip(source.splitlines(), code.splitlines(), strict=False), start=1)
    row, old, new = next((i, old, new) for i, (old, new) in pairs if old != new)
    file = str(place.path.relative_to(ROOT / PACKAGE))
    return Mutant(module, file, row, old.strip(), new.strip()), code


def sample(
    module: str, seed: int, again: set[tuple[str, str, str]]
) -> tuple[list[tuple[Mutant, str]], int]:
    """Return random changes of a module, as many of each file as its share, and of how many.

    If some are to be tried again, these are returned.
    """
    root = ROOT / PACKAGE / module
    files = [root] if root.is_file() else sorted(root.rglob("*.py"))
    known = [sorted(places(path, seed)) for path in files]
    total = sum(map(len, known))
    share = max(LEAST, SHARE * total) / max(total, 1)
    if not again:
        chosen = [place for own in known for place in own[: math.ceil(share * len(own))]]
        return [changed(module, place) for place in chosen], total
    lines = {before for _, before, _ in again}
    pairs = [changed(module, place) for own in known for place in own if place.line in lines]
    return [pair for pair in pairs if pair[0].key in again], total


def _test(folder: Path, tests: Sequence[str]) -> None:
    """Run tests of a copy in this process, which ends with 0 if they pass."""
    os.setsid()
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    os.environ["PYTHONPATH"] = str(folder)
    output = os.open(folder / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    import pytest

    code = pytest.main(["-x", "-q", "-p", "no:cacheprovider", *(f"test/{each}" for each in tests)])
    os._exit(int(code))


def passes(folder: Path, tests: Sequence[str], timeout: float) -> bool:
    """Return whether tests of a copy of the checkout pass within a time, s.

    The process is forked after the libraries were imported, which saves seconds for each change.
    """
    process = multiprocessing.get_context("fork").Process(target=_test, args=(folder, tests))
    process.start()
    process.join(timeout)
    if process.is_alive():
        assert process.pid is not None
        with suppress(ProcessLookupError):
            os.killpg(process.pid, 9)
        process.join()
    return process.exitcode == 0


def measure(
    module: str, seed: int, folder: Path, again: set[tuple[str, str, str]]
) -> Iterator[Mutant]:
    """Try a sample of the changes of a module in a copy of the checkout, or some of them again."""
    tests = [each for each in TESTS[module] if (ROOT / "test" / each).is_file()]
    before = time.monotonic()
    if not passes(folder, tests, 900.0):
        output = (folder / "output.txt").read_text(encoding="utf-8")
        raise SystemExit(f"The tests of {module} fail without a change:\n{output[-2000:]}")
    timeout = OVERHEAD + FACTOR * (time.monotonic() - before)
    chosen, total = sample(module, seed, again)
    commit = _commit()
    for mutant, code in tqdm(chosen, f"{module}, {total} places", mininterval=10.0):
        path = folder / PACKAGE / mutant.file
        original = path.read_text(encoding="utf-8")
        path.write_text(code, encoding="utf-8")
        outcome = "not found" if passes(folder, tests, timeout) else "found"
        path.write_text(original, encoding="utf-8")
        yield replace(mutant, outcome=outcome, commit=commit)


def _compared(mutant: Mutant, earlier: Mutant | None) -> Mutant:
    """Return an outcome with what an earlier run and a reader have said about the same change."""
    if earlier is None:
        return mutant
    since = mutant.outcome == "found" and earlier.outcome != "found"
    outcome = "found since" if since else mutant.outcome
    return replace(mutant, outcome=outcome, reason="" if since else earlier.reason)


def _commit() -> str:
    command = ["git", "rev-parse", "--short", "HEAD"]
    completed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return completed.stdout.strip()


def read_list() -> list[Mutant]:
    """Return the changes of earlier runs."""
    if not LIST.is_file():
        return []
    with LIST.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        return [Mutant(**{**row, "line": int(row["line"])}) for row in rows]  # type: ignore[arg-type]


def write_list(rows: Iterable[Mutant]) -> None:
    """Write the changes, and the reasons that a reader has entered."""
    with LIST.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [column.name for column in fields(Mutant)])
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def wilson(result: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a share, 1.

    Examples
    --------
    >>> low, high = wilson(8, 10)
    >>> print(f"{low:.2f} {high:.2f}")
    0.49 0.94
    """
    share, square = result / total, Z * Z / total
    middle = (share + square / 2.0) / (1.0 + square)
    half = Z * math.sqrt(share * (1.0 - share) / total + square / total / 4.0) / (1.0 + square)
    return max(0.0, middle - half), min(1.0, middle + half)


def report(rows: Sequence[Mutant]) -> list[str]:
    """Return the tables of the page."""
    body = [
        _row(module, [each for each in rows if each.module == module])
        for module in TESTS
        if any(item.module == module for item in rows)
    ]
    body.append(_row("all", rows))
    left = [name for name in TESTS if not any(each.module == name for each in rows)]
    commits = sorted({row.commit for row in rows})
    counts = "module", "tried", "equivalent", "found", "found since", "not found"
    columns = *counts, "share found", "95 %", "now"
    parts = [
        "The table shows how many changes of single rules the tests notice. For each place that "
        "cosmic-ray can change, one change is drawn. At least eight of them, and 2 % or more, are "
        "tried in each module. Texts of messages, annotations of types, decorators and `assert` "
        "are not changed. The share is that of the changes that are not equivalent, with its "
        "Wilson interval. The tests were written without this sample. For changes that they did "
        "not find, tests were added; the columns `found since` and `now` count these, too.",
        table(columns, body),
        f"The changes were tried at the commits {', '.join(commits)}.",
        *([f"Not tried: {', '.join(left)}."] if left else []),
        "## What was not found",
    ]
    missed = [each for each in rows if each.outcome == "not found"]
    for reason in sorted({each.reason for each in missed}):
        own = [each for each in missed if each.reason == reason]
        parts.append(f"{reason or 'Not judged.'} ({len(own)})")
        listing = [
            (f"{each.file}:{each.line}", _code(each.before), _code(each.after)) for each in own
        ]
        parts.append(table(("place", "line", "changed line"), listing))
    return parts


def _code(line: str) -> str:
    return "`" + line.replace("|", "\\|") + "`"


def _row(name: str, rows: Sequence[Mutant]) -> list[str]:
    result, since = (
        sum(each.outcome == word for each in rows) for word in ("found", "found since")
    )
    same = sum(each.reason.startswith("Equivalent") for each in rows)
    total = max(len(rows) - same, 1)
    low, high = wilson(result, total)
    counts = len(rows), same, result, since, len(rows) - same - result - since
    shares = f"{result / total:.0%}", f"{low:.0%} to {high:.0%}", f"{(result + since) / total:.0%}"
    return [name, *map(str, counts), *shares]


def main() -> None:
    """Try changes of the named modules, all by default, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmark.mutants", description=__doc__)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help=", ".join(TESTS))
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--missed", action="store_true", help="try again what was not found")
    parser.add_argument("--page", action="store_true", help="only write the page again")
    arguments = parser.parse_args()
    rows = read_list()
    earlier = {each.key: each for each in rows}
    for name in _LIBRARIES:
        importlib.import_module(name)
    with tempfile.TemporaryDirectory() as temporary:
        for module in [] if arguments.page else arguments.modules or TESTS:
            own = [each for each in rows if each.module == module]
            again = {each.key for each in own if each.is_missed} if arguments.missed else set()
            if arguments.missed and not again:
                continue
            folder = Path(temporary) / module.replace("/", "_")
            made = (".git", ".venv*", "build", "__pycache__", "*.egg-info", "reproduction")
            shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*made))
            if not again:
                rows = [each for each in rows if each.module != module]
            for mutant in measure(module, arguments.seed, folder, again):
                rows = [each for each in rows if not again or each.key != mutant.key]
                rows.append(_compared(mutant, earlier.get(mutant.key)))
                write_list(rows)
            shutil.rmtree(folder)
    modules = list(TESTS)
    rows.sort(key=lambda first: (modules.index(first.module), first.file, first.line))
    write_list(rows)
    publish("mutants", "Changes that the tests notice", report(rows), machine("cosmic-ray"))


if __name__ == "__main__":
    main()
