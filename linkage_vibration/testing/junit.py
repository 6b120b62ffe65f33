# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the result of a check as JUnit XML, which CI services show."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from linkage_vibration.errors import printable
from linkage_vibration.testing.bag_checks import Report


def junit_xml(report: Report) -> bytes:
    """Return a report as a test suite with one test case for each limit that was checked."""
    cases: dict[str, list[str]] = {name: [] for name in report.checked}
    for failure in report.failures:
        cases.setdefault(failure.limit, []).append(str(failure))
    return _xml(report.bag, cases, "failure", "limit")


def junit_error(bag: Path, problem: str) -> bytes:
    """Return the error that nothing could be checked as a test suite with one test case."""
    return _xml(bag, {"check": [printable(problem)]}, "error", "error")


def _xml(bag: Path, cases: Mapping[str, Sequence[str]], tag: str, kind: str) -> bytes:
    """Return a file with one suite, whose cases pass or have lines of a failure or an error."""
    failed = str(sum(map(bool, cases.values())))
    counts = {"tests": str(len(cases)), "failures": "0", "errors": "0", f"{tag}s": failed}
    suites = ElementTree.Element("testsuites", counts)
    suite = ElementTree.SubElement(suites, "testsuite", counts, name="linkage-vibration check")
    for name, lines in cases.items():
        case = ElementTree.SubElement(suite, "testcase", classname=str(bag), name=name)
        if lines:
            problem = ElementTree.SubElement(case, tag, message=lines[0], type=kind)
            problem.text = "\n".join(lines)
    ElementTree.indent(suites)
    data: bytes = ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True)
    return data
