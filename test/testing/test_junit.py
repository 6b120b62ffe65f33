# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The JUnit XML of a check has the structure that CI services read."""

from pathlib import Path
from xml.etree import ElementTree

from linkage_vibration.testing.bag_checks import Failure, Report
from linkage_vibration.testing.junit import junit_error, junit_xml

# Of junit-10.xsd, which Jenkins publishes and GitLab and GitHub's actions read: the children of
# each element, and the attributes that it has to have and may have.
SCHEMA = {
    "testsuites": ({"testsuite"}, set(), {"name", "time", "tests", "failures", "errors"}),
    "testsuite": ({"testcase"}, {"name"}, {"tests", "failures", "errors", "time", "timestamp"}),
    "testcase": ({"failure", "error"}, {"name", "classname"}, {"time"}),
    "failure": (set[str](), set(), {"message", "type"}),
    "error": (set[str](), set(), {"message", "type"}),
}


def failure(limit: str, words: str = "it is <too> large & at \x1b") -> Failure:
    """Return a failure with characters that XML does not allow."""
    return Failure(limit, 1_767_225_600 * 10**9, 0.0, 2, words)


def check_element(element: ElementTree.Element) -> None:
    """Compare an element and those below with the schema."""
    children, required, optional = SCHEMA[element.tag]
    assert required <= element.attrib.keys() <= required | optional
    for child in element:
        assert child.tag in children
        check_element(child)


def test_structure() -> None:
    """Each limit is a test case, and the counts are those of the elements."""
    failures = failure("gap"), failure("windows", "first"), failure("windows", "second")
    checked = "windows", "gap", "load_ratio"
    data = junit_xml(Report(Path("drive.mcap"), 10, failures, None, checked))
    assert data.startswith(b"<?xml version='1.0' encoding='utf-8'?>")
    root = ElementTree.fromstring(data)
    assert root.tag == "testsuites"
    check_element(root)
    [suite] = root
    for element in (root, suite):
        assert [element.get(name) for name in ("tests", "failures", "errors")] == ["3", "2", "0"]
    assert [case.get("name") for case in suite] == ["windows", "gap", "load_ratio"]
    assert {case.get("classname") for case in suite} == {"drive.mcap"}
    windows, gap = root.iter("failure")
    assert gap.get("message") == gap.text == str(failures[0])
    assert "it is <too> large & at \\x1b" in str(gap.text)
    assert windows.get("message") == str(failures[1])
    assert windows.text == f"{failures[1]}\n{failures[2]}"


def test_unknown_share_is_a_case() -> None:
    """A share that is not known fails as a case of its own; without failures, there is none."""
    bag = Path("drive.mcap")
    root = ElementTree.fromstring(junit_xml(Report(bag, 1, (failure("known_share"),), None, ())))
    assert [case.get("name") for case in root.iter("testcase")] == ["known_share"]
    passed = ElementTree.fromstring(junit_xml(Report(bag, 1, (), None, ("statuses",))))
    assert passed.get("failures") == "0"
    assert list(passed.iter("failure")) == []


def test_error() -> None:
    """A bag that cannot be read is one test case with an error, and no failure."""
    root = ElementTree.fromstring(junit_error(Path("drive.mcap"), "<drive> is\x1b no bag."))
    check_element(root)
    [suite] = root
    for element in (root, suite):
        assert [element.get(name) for name in ("tests", "failures", "errors")] == ["1", "0", "1"]
    [error] = root.iter("error")
    assert error.text == error.get("message") == "<drive> is\\x1b no bag."
