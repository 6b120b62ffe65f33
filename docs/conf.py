# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of the documentation site, which `make docs` builds without a network.

The source folder of Sphinx is the root of the repository, so that links between Markdown files work
both on the site and where the files are read as they are.
"""

import argparse
import re
from pathlib import Path

import linkage_vibration
from linkage_vibration.cli.main import argument_parser

ROOT = Path(__file__).parents[1]
COMMANDS = ROOT / "docs" / "commands"

project = "linkage_vibration"
author = "The linkage_vibration authors"
copyright = "2026, The linkage_vibration authors (Apache-2.0)"
release = linkage_vibration.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
root_doc = "docs/index"
include_patterns = ["docs/**", "examples/*.md", "benchmark/results/*.md", "*.rst"]
include_patterns += ["CONTRIBUTING.md", "QUALITY_DECLARATION.md", "SECURITY.md"]
include_patterns += ["linkage_vibration_interfaces/QUALITY_DECLARATION.md"]
exclude_patterns = [".*", "build", "install", "log", "**/node_modules"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
templates_path = ["templates"]

myst_heading_anchors = 3
myst_links_external_new_tab = False
suppress_warnings = ["myst.header"]  # a result page may begin below the first level

nitpicky = True
# Types of other packages have no page here; types outside the public API are private.
nitpick_ignore_regex = [("py:.*", r"(?!linkage_vibration\.[A-Za-z_]+$).*")]
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
default_role = "literal"
numpydoc_show_class_members = False

html_theme = "furo"
html_title = "linkage_vibration"
html_additional_pages = {"index": "redirect.html"}
html_copy_source = False


def write_command_pages() -> None:
    """Write one page for each subcommand from its parser, and the list of these pages."""
    COMMANDS.mkdir(exist_ok=True)
    for old in COMMANDS.glob("*.md"):
        old.unlink()
    parser = argument_parser()
    (subparsers,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    for name, subparser in subparsers.choices.items():
        (COMMANDS / f"{name}.md").write_text(command_page(name, subparser))
    links = "".join(f"{name}\n" for name in subparsers.choices)
    (COMMANDS / "index.md").write_text(
        "# Command line\n\nEach subcommand of `linkage-vibration` does one task. Choose one "
        f"to see its arguments.\n\n```{{toctree}}\n:maxdepth: 1\n\n{links}```\n"
    )


def command_page(name: str, parser: argparse.ArgumentParser) -> str:
    """Return the page of one subcommand."""
    formatter = argparse.HelpFormatter(parser.prog, width=88)
    rows = []
    for action in parser._actions:
        names = ", ".join(f"`{option}`" for option in action.option_strings)
        text = formatter._expand_help(action) if action.help else ""
        rows.append(f"| {names or f'`{action.metavar or action.dest}`'} | {escaped(text)} |\n")
    usage = parser.format_usage().removeprefix("usage: ").rstrip()
    pages = [
        f"- [{title[1]}](../{path.name})\n"
        for path in sorted((ROOT / "docs").glob("*.md"))
        if f"linkage-vibration {name}" in (text := path.read_text())
        and (title := re.search(r"^# (.+)$", text, re.MULTILINE))
    ]
    return (
        f"# {name}\n\n{parser.description}\n\n```text\n{usage}\n```\n\n"
        f"| argument | meaning |\n|---|---|\n{''.join(rows)}"
        + (f"\nThese pages use it:\n\n{''.join(pages)}" if pages else "")
    )


def escaped(text: str) -> str:
    """Return text in which Markdown sees no markup."""
    return re.sub(r"([|\\`*_<>\[\]])", r"\\\1", text)


write_command_pages()
