# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every code block of the documentation runs where its page is installed as the page says."""

import ast
import doctest
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from linkage_vibration.cli.main import argument_parser
from linkage_vibration.demo.domain import reserve_domain
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.prediction.excitation import excitations_from_mapping
from linkage_vibration.prediction.settings import Parameters, with_values
from linkage_vibration.readers.implements import read_implements
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.testing.limits import read_limits
from test.support.can_bus import EPOCH, synthetic_hitch, write_candump
from test.support.environments import make_environment

ROOT = Path(__file__).resolve().parents[1]
PAGES = [Path("README.md"), Path("CONTRIBUTING.md"), Path("examples/README.md")]
PAGES += sorted(path.relative_to(ROOT) for path in (ROOT / "docs").glob("*.md"))
LANGUAGES = {"console", "python", "yaml", "text", "{eval-rst}", "{toctree}"}
NODE = "linkage_vibration_node"

# How the lines begin that do not run here, and why.
NOT_RUN = {
    "pip install": "this is how the environment was made",
    "apt-get": "the test does not change the machine",
    "colcon": "the ROS 2 wheels do not contain it",
    "rosdep": "the test does not change the machine",
    "launch_test": "the ROS 2 wheels do not contain it",
    "ros2": "the ROS 2 wheels do not contain it",
    "linkage-vibration play": "test/ros/test_bag_player.py runs it",
    "make bench": "a benchmark takes minutes or hours",
    "make demo": "test/demo plays it",
    "make docs": "test_the_site_can_be_built builds it",
    "make nightly": "it takes an hour or more",
    "make test": "it runs this test",
    "pre-commit": "make test runs the same checks",
    "bloom": "releases are made by hand",
    "git": "releases are made by hand",
    "nice -n 19 python -m benchmark.mutants": "it takes hours",
    "python -m build": "releases are made by hand",
    "sed": "releases are made by hand",
    "twine": "releases are made by hand",
}
# Pages whose commands take long, or are those of README.md with other options. Those of the last
# eight are run by test/cli, test/studies, test/export and test/ros/test_services.py, too.
SLOW = {"docs/measure_your_hitch.md", "docs/reproduction.md", "docs/table.md"}
SLOW |= {"docs/command_line.md", "docs/excitation.md", "docs/uncertainty.md", "docs/sweeps.md"}
SLOW |= {"docs/review.md", "docs/export.md", "docs/services.md", "docs/your_own_hitch.md"}
# Pages whose commands print what the blocks of text below them show.
PRINTED = {"docs/measure_your_hitch.md", "docs/reproduction.md"}


@dataclass(frozen=True)
class Block:
    """A code block: its language, its text, and the line on which it begins."""

    language: str
    text: str
    line: int


def blocks_of(page: Path) -> list[Block]:
    """Return the code blocks of a page."""
    text = (ROOT / page).read_text()
    matches = re.finditer(r"^```(\S*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return [Block(m[1], m[2], text.count("\n", 0, m.start()) + 1) for m in matches]


def commands_of(page: Path) -> list[str]:
    """Return the command lines of a page."""
    return [line for block in blocks_of(page) for line in commands_in(block)]


def commands_in(block: Block) -> list[str]:
    """Return the command lines of a block, without comments and with continued lines joined."""
    text = block.text if block.language == "console" else ""
    lines = text.replace("\\\n", " ").splitlines()
    return [line.partition("    #")[0].strip() for line in lines if line.strip()]


def installed_by(page: Path) -> frozenset[str]:
    """Return what the `pip install` lines of a page install."""
    actual = {"linkage_vibration"}
    for line in re.findall(r"pip install ([^`\n]*)", (ROOT / page).read_text()):
        for word in shlex.split(line):
            if not word.startswith("-") and "'" not in word:
                ours = re.fullmatch(r"\.(\[.*\])?", word)
                actual.add(f"linkage_vibration{ours[1] or ''}" if ours else word.removeprefix("./"))
    if any("def test_" in block.text for block in blocks_of(page)):
        actual.add("pytest")
    return frozenset(actual)


@pytest.fixture(scope="module")
def environment_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], dict[str, str]]:
    """Return a function that makes the environment of a page, or returns one that is the same."""
    folder = tmp_path_factory.mktemp("wheel")
    unwanted = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "install", "log")
    shutil.copytree(ROOT, folder / "source", ignore=unwanted)
    command: list[Any] = [sys.executable, "-m", "pip", "wheel", "-qq", "--no-deps", "-w", folder]
    subprocess.run([*command, folder / "source"], check=True)
    (wheel,) = folder.glob("*.whl")
    made: dict[frozenset[str], dict[str, str]] = {}

    def environment(page: Path) -> dict[str, str]:
        requirements = installed_by(page)
        if requirements not in made:
            place = tmp_path_factory.mktemp("environment")
            try:
                made[requirements] = make_environment(place, wheel, requirements)
            except LookupError as error:
                pytest.skip(str(error))
            made[requirements]["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
            made[requirements]["ROS_DOMAIN_ID"] = str(reserve_domain())
        return made[requirements]

    return environment


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the files that the pages mention."""
    drive = ROOT / "config" / "drives" / "hitch_duty_cycle.mcap"
    for name in ("config", "examples", "benchmark"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "bags").mkdir()
    for name in ("drive.mcap", "bags/headland.mcap"):
        shutil.copy(drive, tmp_path / name)
    cut = drive.read_bytes()[: drive.stat().st_size // 2]
    times = [EPOCH + k * 10**8 for k in range(100)]
    write_candump(tmp_path / "bus.log", synthetic_hitch(times, [100 + k for k in range(100)]))
    (tmp_path / "linkage_vibration_000017_20260712-141503.mcap").write_bytes(cut)
    shutil.copy(ROOT / "config" / "three_point_linkage.yaml", tmp_path / "my_linkage.yaml")
    return tmp_path


def run(command: list[Any], folder: Path, environment: dict[str, str]) -> str:
    """Run a command of a page, and return what it printed; fail with all of it."""
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def compare_printed(page: Path, printed: dict[str, str]) -> None:
    """Compare each text of a page with what the commands above it printed, line by line.

    The lines stand in the order of the output; a line of three dots stands for others. What is
    not run here prints nothing.
    """
    output: list[str] = []
    for block in blocks_of(page):
        if block.language == "console":
            output = "".join(printed.get(line, "") for line in commands_in(block)).splitlines()
        elif block.language == "text":
            for line in block.text.splitlines():
                assert line in ["...", *output], f"{page}:{block.line}: {line}"
                output = output[output.index(line) + 1 :] if line in output else output


@contextmanager
def running_node(folder: Path, environment: dict[str, str]) -> Iterator[None]:
    """Keep the node running; it has to end with exit code 0."""
    output = folder / "node.txt"
    with output.open("wb") as file:
        process = subprocess.Popen(
            [NODE], cwd=folder, env=environment, stdout=file, stderr=subprocess.STDOUT
        )
    try:
        # Python handles no signal in its first moments, so the node has to be at work first.
        while "Predicting for joint" not in output.read_text():
            assert process.poll() is None, output.read_text()
            time.sleep(0.1)
        yield
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(120.0) == 0, output.read_text()


def pages(*, slow: bool) -> list[Any]:
    """Return the pages that have something to run, as parameters."""
    marks = [pytest.mark.nightly] if slow else []
    chosen = [page for page in PAGES if (str(page) in SLOW) == slow and blocks_of(page)]
    return [pytest.param(page, id=str(page), marks=marks) for page in chosen]


@pytest.mark.parametrize("page", [*pages(slow=False), *pages(slow=True)])
def test_blocks_run(
    page: Path, environment_of: Callable[[Path], dict[str, str]], folder: Path
) -> None:
    """The commands of a page run in their order, then its scripts; pytest collects its doctests."""
    commands = [line for line in commands_of(page) if not line.startswith(tuple(NOT_RUN))]
    plain = [b.text for b in blocks_of(page) if b.language == "python" and ">>>" not in b.text]
    if not commands and not plain:
        return  # none of its blocks runs here
    environment, printed = environment_of(page), dict[str, str]()
    python = Path(environment["VIRTUAL_ENV"]) / "bin" / "python"
    with ExitStack() as stack:
        for line in commands:
            if line == NODE:
                stack.enter_context(running_node(folder, environment))
            else:
                printed[line] = run(shlex.split(line), folder, environment)
        if str(page) in PRINTED:
            compare_printed(page, printed)
        tests = [text for text in plain if "def test_" in text]
        if tests:
            (folder / "test_page.py").write_text("".join(tests))
            run([python, "-m", "pytest", "-q", "test_page.py"], folder, environment)
        if len(plain) > len(tests):
            (folder / "page.py").write_text("".join(t for t in plain if t not in tests))
            run([python, "page.py"], folder, environment)


def test_commands_are_understood() -> None:
    """The parser knows the options of all commands, also on pages whose commands take long."""
    lines = [shlex.split(line) for page in PAGES for line in commands_of(page)]
    commands = [words[1:] for words in lines if words[0] == "linkage-vibration"]
    assert len(commands) > 30
    for words in commands:
        argument_parser().parse_args(words)


def test_texts_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line that no command above it printed, or in another order, is found."""
    texts = [Block("console", "a\nb\n", 1), Block("text", "1\n...\n3\n", 4)]
    monkeypatch.setitem(globals(), "blocks_of", lambda page: texts)
    compare_printed(Path("page"), {"a": "1\n2\n", "b": "3\n"})
    for printed in ({"a": "3\n", "b": "1\n"}, {"a": "1\n", "b": "4\n"}):
        with pytest.raises(AssertionError, match="page:4: 3"):
            compare_printed(Path("page"), printed)


def read_part(block: dict[str, Any]) -> None:
    """Read a mechanism with the links, or the base, of a block."""
    mechanism = yaml.safe_load((ROOT / "config" / "four_bar.yaml").read_text())
    if "springs" in block:  # one of them holds the crank
        del mechanism["links"]["crank"]["clamped"]
    for key, value in block.items():
        mechanism[key] = {**mechanism.get(key, {}), **value}
    mechanism_from_mapping(mechanism)


def read_uncertainty(block: dict[str, Any]) -> None:
    """Read the shipped linkage with the uncertain numbers of a block."""
    mechanism = yaml.safe_load((ROOT / "config" / "three_point_linkage.yaml").read_text())
    mechanism_from_mapping(mechanism | block)


def read_implement_file(block: dict[str, Any]) -> None:
    """Read a file of implements for the shipped linkage."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        yaml.safe_dump(block, file)
        file.flush()
        read_implements(file.name, read_mechanism())


def read_inputs(block: dict[str, Any]) -> None:
    """Read the parameters of a block."""
    with_values(Parameters(), block["linkage_vibration"]["ros__parameters"])


def read_check(block: dict[str, Any]) -> None:
    """Read limits; test/cli/test_check.py runs the examples for CI."""
    if not block.keys() & {"jobs", "check"}:
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            yaml.safe_dump(block, file)
            file.flush()
            read_limits(Path(file.name))


READERS = {
    "docs/can.md": read_inputs,
    "docs/excitation.md": excitations_from_mapping,
    "docs/mechanisms.md": read_part,
    "docs/services.md": read_implement_file,
    "docs/start_the_node.md": read_inputs,
    "docs/review.md": read_check,
    "docs/uncertainty.md": read_uncertainty,
}


@pytest.mark.parametrize(("page", "read"), READERS.items())
def test_yaml_is_accepted(page: str, read: Callable[[Any], object]) -> None:
    """The reader of the file that a block shows accepts it."""
    for block in blocks_of(Path(page)):
        if block.language == "yaml":
            read(yaml.safe_load(block.text))


def test_every_block_is_tested() -> None:
    """Each block has a language, and YAML stands only on the pages of the test above."""
    for page in PAGES:
        for block in blocks_of(page):
            where = f"{page}:{block.line}"
            assert block.language in LANGUAGES, where
            if block.language == "yaml":
                assert str(page) in READERS, where


def test_blocks_import_what_they_use() -> None:
    """A block that a reader copies imports the names that other blocks of its page import."""
    for page in PAGES:
        blocks = [block for block in blocks_of(page) if block.language == "python"]
        actual = [(block, *names_of(block.text)) for block in blocks]
        of_page = {name for _, imported, _ in actual for name in imported} | {"lv", "np"}
        for block, imported, used in actual:
            assert not (used - imported) & of_page, f"{page}:{block.line}"


def names_of(code: str) -> tuple[set[str], set[str]]:
    """Return the names that a block of code, or of a doctest, imports and uses."""
    if ">>>" in code:
        code = "".join(e.source for e in doctest.DocTestParser().get_examples(code))
    nodes = list(ast.walk(ast.parse(code)))
    aliases = [a for n in nodes if isinstance(n, ast.Import | ast.ImportFrom) for a in n.names]
    imported = {(alias.asname or alias.name).partition(".")[0] for alias in aliases}
    return imported, {node.id for node in nodes if isinstance(node, ast.Name)}


FIGURE = re.compile(r"(?<![\w.-])\d+(?:,\d{3})*(?:\.\d+)?(?:e-?\d+)?(?![\w-])")
CITED = re.compile(r"\]\((?:\.\./)?((?:benchmark/results/\w+|docs/validation)\.md)")


def is_on_page(figure: str, numbers: list[float]) -> bool:
    """Return whether a number of a page, or a percentage of it, is rounded to a figure."""
    digits = f".{len(figure.partition('e')[0].replace('.', '')) - 1}e"
    if "e" not in figure:
        digits = f".{len(figure.partition('.')[2])}f"
    wanted = format(float(figure.replace(",", "")), digits)
    return any(format(factor * each, digits) == wanted for each in numbers for factor in (1, 100))


@pytest.mark.parametrize(
    ("figure", "numbers", "expected"),
    [
        ("8", [7.6], True),
        ("8", [7.4], False),
        ("0.54", [0.536], True),
        ("0.54", [0.546], False),
        ("4.2e-5", [4.23e-5], True),
        ("4.2e-5", [4.26e-5], False),
        ("96", [0.9561], True),
        ("17,306", [17306.0], True),
    ],
)
def test_figures_are_rounded(figure: str, numbers: list[float], expected: bool) -> None:
    """A figure has the digits that its page rounds to."""
    assert is_on_page(figure, numbers) == expected


def test_quoted_figures_are_those_of_their_pages() -> None:
    """Each figure of a sentence, or a row, that cites a page of results is on that page."""
    compared = 0
    for page in [*PAGES, Path("QUALITY_DECLARATION.md")]:
        text = re.sub(r"^```.*?^```$", "", (ROOT / page).read_text(), flags=re.M | re.S)
        for part in re.split(r"\n\n|\n(?=[|-])|(?<=[.:])\s(?=[A-Z[])", text):
            if cited := CITED.findall(part):
                plain = re.sub(r"\]\([^)]*\)|`[^`]*`|\d{4}-\d\d-\d\d", " ", part)
                pages = " ".join((ROOT / each).read_text() for each in cited)
                numbers = [float(each.replace(",", "")) for each in FIGURE.findall(pages)]
                for figure in FIGURE.findall(plain):
                    assert is_on_page(figure, numbers), f"{page}: {figure} in {part}"
                    compared += 1
    assert compared > 40


def test_the_tests_that_are_named_exist() -> None:
    """Every test that a page names as evidence exists, in the file that it names."""
    code = {path.relative_to(ROOT): path.read_text() for path in (ROOT / "test").rglob("*.py")}
    for page in [*PAGES, Path("benchmark/results/stability.md")]:
        text = (ROOT / page).read_text()
        for file in re.findall(r"`(test/[\w/]+\.py)", text):
            assert Path(file) in code, f"{page}: {file}"
        for name in re.findall(r"(?:`|::)(test_\w+)`", text):
            assert any(f"def {name}(" in body for body in code.values()), f"{page}: {name}"


@pytest.mark.nightly(alone="`make docs` does the same")
def test_the_site_can_be_built(tmp_path: Path) -> None:
    """Sphinx reads the site without a warning: every link leads to a page or a name of the API."""
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "dummy"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run([*command, "-c", "docs", ".", tmp_path], ROOT, environment)
