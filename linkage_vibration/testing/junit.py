# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the result of a check as JUnit XML, which CI services show."""

from xml.etree import ElementTree

from linkage_vibration.testing.bag_checks import Report


def junit_xml(report: Report) -> bytes:
    """Return a report as a test suite with one test case for each limit that was checked."""
    failures = {failure.limit: str(failure) for failure in reversed(report.failures)}
    names = [*dict.fromkeys([*report.checked, *failures])]
    counts = {"tests": str(len(names)), "failures": str(len(failures)), "errors": "0"}
    suites = ElementTree.Element("testsuites", counts)
    counts |= {"name": "linkage-vibration check"}
    suite = ElementTree.SubElement(suites, "testsuite", counts)
    for name in names:
        case = ElementTree.SubElement(suite, "testcase", classname=str(report.bag), name=name)
        if name in failures:
            text = "\n".join(str(each) for each in report.failures if each.limit == name)
            failure = ElementTree.SubElement(case, "failure", message=failures[name], type="limit")
            failure.text = text
    ElementTree.indent(suites)
    data: bytes = ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True)
    return data
