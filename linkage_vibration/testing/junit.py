# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the result of a check as JUnit XML, which CI services show."""

from pathlib import Path
from xml.etree import ElementTree

from linkage_vibration.errors import printable
from linkage_vibration.testing.bag_checks import Report


def junit_xml(report: Report) -> bytes:
    """Return a report as a test suite with one test case for each limit that was checked."""
    failures = {failure.limit: str(failure) for failure in reversed(report.failures)}
    names = [*dict.fromkeys([*report.checked, *failures])]
    suites, suite = _suite(len(names), len(failures), 0)
    for name in names:
        case = ElementTree.SubElement(suite, "testcase", classname=str(report.bag), name=name)
        if name in failures:
            text = "\n".join(str(each) for each in report.failures if each.limit == name)
            failure = ElementTree.SubElement(case, "failure", message=failures[name], type="limit")
            failure.text = text
    return _as_bytes(suites)


def junit_error(bag: Path, problem: str) -> bytes:
    """Return the error that nothing could be checked as a test suite with one test case."""
    suites, suite = _suite(1, 0, 1)
    case = ElementTree.SubElement(suite, "testcase", classname=str(bag), name="check")
    text = printable(problem)
    ElementTree.SubElement(case, "error", message=text, type="error").text = text
    return _as_bytes(suites)


def _suite(
    tests: int, failures: int, errors: int
) -> tuple[ElementTree.Element, ElementTree.Element]:
    """Return the root of a file, and the only suite in it, with their counts."""
    counts = {"tests": str(tests), "failures": str(failures), "errors": str(errors)}
    suites = ElementTree.Element("testsuites", counts)
    counts |= {"name": "linkage-vibration check"}
    return suites, ElementTree.SubElement(suites, "testsuite", counts)


def _as_bytes(suites: ElementTree.Element) -> bytes:
    ElementTree.indent(suites)
    data: bytes = ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True)
    return data
