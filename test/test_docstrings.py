# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The public API documents its arguments and the errors that it raises, in numpydoc."""

import ast
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

import linkage_vibration as lv

PACKAGE = Path(lv.__file__).parent
Function = ast.FunctionDef | ast.AsyncFunctionDef


def public_functions(body: Sequence[ast.stmt], prefix: str = "") -> Iterator[tuple[str, Function]]:
    """Yield each public function and method of a module with its name."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node.body, f"{node.name}.")
        elif isinstance(node, Function) and not node.name.startswith("_"):
            yield f"{prefix}{node.name}", node


def argument_names(function: Function, *, is_method: bool) -> list[str]:
    """Return the names of the arguments, without `self` and `cls`."""
    arguments = function.args
    actual = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    actual += [each for each in (arguments.vararg, arguments.kwarg) if each is not None]
    names = [argument.arg for argument in actual]
    return names[1:] if is_method and names[:1] in (["self"], ["cls"]) else names


def raised_errors(function: Function) -> set[str]:
    """Return the names of the errors that the body raises itself."""
    errors: set[str] = set()
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, Function | ast.Lambda | ast.ClassDef):
            continue  # raised elsewhere, when it is called
        if isinstance(node, ast.Raise) and node.exc is not None:
            error = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
            name = error.attr if isinstance(error, ast.Attribute) else getattr(error, "id", "")
            errors |= {name} if name[:1].isupper() else set()
        waiting.extend(ast.iter_child_nodes(node))
    return errors


def section(docstring: str, title: str) -> str:
    """Return the text of a numpydoc section, or nothing."""
    match = re.search(rf"^{title}\n-+\n(.*?)(?=^\w+\n-+$|\Z)", docstring, re.MULTILINE | re.DOTALL)
    return match.group(1) if match else ""


def documents(text: str, name: str) -> bool:
    """Return whether an entry of a section is about a name, alone or in a list of names."""
    return re.search(rf"^[\w*, ]*\b{name}\b[\w*, ]*( :|$)", text, re.MULTILINE) is not None


def missing(path: Path, public: str) -> Iterator[str]:
    """Yield what the docstrings of a public function, or of a class and its methods, lack."""
    definitions = [
        node
        for node in ast.parse(path.read_text()).body
        if isinstance(node, Function | ast.ClassDef) and node.name == public
    ]
    assert definitions
    for name, function in public_functions(definitions):
        if any("overload" in ast.unparse(decorator) for decorator in function.decorator_list):
            continue
        docstring = ast.get_docstring(function) or ""
        arguments = argument_names(function, is_method="." in name)
        entries = {"Parameters": arguments if len(arguments) > 1 else []}
        entries["Raises"] = sorted(raised_errors(function))
        if not docstring:
            yield f"{name} has no docstring"
        for title, names in entries.items():
            lacking = [each for each in names if not documents(section(docstring, title), each)]
            if lacking:
                yield f"{name}: the section {title} lacks {', '.join(lacking)}"


@pytest.mark.parametrize("name", lv.__all__)
def test_docstrings_are_complete(name: str) -> None:
    """Each function with two or more arguments names them all, and each error that it raises."""
    path = PACKAGE.parent / f"{lv._HOMES[name].replace('.', '/')}.py"
    assert list(missing(path, name)) == []


def test_other_docstrings_have_three_lines() -> None:
    """What is not public has one to three lines of text, and perhaps an example."""
    public = set(re.findall(r"\w+", (PACKAGE.parent / "docs" / "api.md").read_text()))
    longer = [
        f"{path.relative_to(PACKAGE)}: {name}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for name, text in private_docstrings(ast.parse(path.read_text()), public)
        if len([line for line in text.split(">>>")[0].splitlines() if line.strip()]) > 3
    ]
    assert longer == []


def private_docstrings(
    tree: ast.AST, public: set[str], owner: str = ""
) -> Iterator[tuple[str, str]]:
    """Yield the names and docstrings of functions and classes that are not in the manual."""
    for node in ast.iter_child_nodes(tree):
        if not isinstance(node, Function | ast.ClassDef):
            yield from private_docstrings(node, public, owner)
            continue
        is_method = bool(owner) and not isinstance(node, ast.ClassDef)
        listed = owner in public and node.name[0] != "_" if is_method else node.name in public
        if not listed:
            yield node.name, ast.get_docstring(node) or ""
        yield from private_docstrings(
            node, public, node.name if isinstance(node, ast.ClassDef) else owner
        )
