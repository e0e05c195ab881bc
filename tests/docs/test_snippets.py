"""Every command and snippet of README, CONTRIBUTING and docs is run, from top to bottom, one folder per page.

Pages that join independent guides (`BY_SECTION`) have one folder for each section of the second level.

The words behind the language of a fenced block, which are not displayed, say how:

- `bash`: run to its end, exit status 0; `bash environment`: its exports hold for the rest of the page;
- `bash background ready="text"`: left running until the page's end; the next block waits for that text;
- `bash shown`: not run, since it installs something;
- `bash make`: targets of the Makefile, checked to be there without being made, for they run these tests;
- `python`: run as a script; any language with `file=NAME`: written to that file;
- `text output`: what the `bash` or `python` block before it has said; `...` stands for anything.

Pages of simulators that take hundreds of megabytes are run where those are installed, by
`make test-simulators`.
Pages that build with `catkin_make` are run where ROS is, by `make test-ros1`, those that start
`swarmwright-gazebo` where Gazebo is, by `make test-gazebo`. The experiments, FREVO's files
and the wrappers for Java and C++ are there as in a clone, and built.
"""

import contextlib
import dataclasses
import importlib.util
import inspect
import itertools
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

import swarmwright
from tests import examples
from tests.cpp import BUILD, build
from tests.enki import ENKI, WHY_NOT
from tests.java import JAR, jar

ROOT = Path(__file__).parents[2]
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")), *DOCS]
SHOWN_ONLY = {"text", "mermaid", "json", "console"}
SOURCES = {"javascript", "go"}
"""Shown as they stand in a file of the repository, which `tests/conformance/test_examples.py` compares."""
RUN = {"bash", "python", "yaml"}
FENCE = re.compile(r"^```(\S*)[ ]*(.*?)\n(.*?)^```[ ]*$", re.MULTILINE | re.DOTALL)
SIMULATORS = {
    "simulations.ns3": "cppyy",
    "simulations.sumo": "libsumo",
    "experiments/pybullet/": "pybullet",
    "experiments/irsim/": "irsim",
}
"""What a page says that needs a simulator of `make test-simulators`, and the simulator's module."""
BY_SECTION = {
    f"docs/how-to/{name}.md"
    for name in (
        "fmus", "install", "java-and-cpp", "migrate", "objectives", "operations", "peers", "plug-ins", "ros",
        "simulators",
    )
}  # fmt: skip
PORTS = re.compile(r"\b(1883|8883|8884|9001|11311)\b")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, what is written behind it, its text, the line where it begins."""

    language: str
    directives: dict[str, str]
    text: str
    line: int


@dataclass(frozen=True)
class Section:
    """What is run in one folder: a page, or a section of it."""

    name: str
    text: str
    line: int
    """The line of the page before the first one."""

    def blocks(self) -> list[Block]:
        """Return all fenced blocks."""
        blocks = []
        for match in FENCE.finditer(self.text):
            words = [word.partition("=") for word in shlex.split(match[2])]
            directives = {key: value for key, _, value in words}
            line = self.line + self.text.count("\n", 0, match.start()) + 1
            blocks.append(Block(match[1], directives, match[3], line))
        return blocks

    def is_runnable(self) -> bool:
        """Return whether there is anything to run."""
        return any(block.language in RUN or "file" in block.directives for block in self.blocks())


def sections(page: Path) -> Iterator[Section]:
    """Yield what is run of a page."""
    name = str(page.relative_to(ROOT))
    source = page.read_text(encoding="utf-8")
    if name not in BY_SECTION:
        yield Section(name, source, 0)
        return
    code = [match.span() for match in FENCE.finditer(source)]
    heads = [
        match
        for match in re.finditer(r"^## (.+)$", source, re.MULTILINE)
        if not any(start < match.start() < end for start, end in code)
    ]
    yield Section(name, source[: heads[0].start()], 0)
    for head, end in itertools.zip_longest(heads, [head.start() for head in heads[1:]]):
        line = source.count("\n", 0, head.start())
        yield Section(f"{name}#{slug(head[1])}", source[head.start() : end], line)


def slug(heading: str) -> str:
    """Return the anchor of a heading."""
    return re.sub(r"[^\w]+", "-", heading.lower()).strip("-")


def free_ports(text: str, ports: dict[str, str]) -> str:
    """The text with well-known ports replaced by free ones, the same on the whole page, and loopback only."""
    from socket import socket

    def replace(match: re.Match[str]) -> str:
        if match[0] not in ports:
            with socket() as probe:
                probe.bind(("127.0.0.1", 0))
                ports[match[0]] = str(probe.getsockname()[1])
        return ports[match[0]]

    return PORTS.sub(replace, text).replace("0.0.0.0", "127.0.0.1")


@contextmanager
def background(
    text: str, ready: str, folder: Path, environment: dict[str, str], where: str
) -> Iterator[None]:
    """Run a command beside the test from when it says `ready` until the block ends."""
    process = subprocess.Popen(
        ["bash", "-euo", "pipefail", "-c", f"exec {text.strip()}"],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
    )
    said: list[str] = []
    heard = threading.Event()

    def listen() -> None:
        assert process.stdout is not None
        for line in process.stdout:
            said.append(line)
            if ready in line:
                heard.set()
        heard.set()

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    try:
        heard.wait(30)
        assert any(ready in line for line in said), f"{where}: never said {ready!r}, but:\n{''.join(said)}"
        yield
        assert process.poll() is None, f"{where}: ended too early:\n{''.join(said)}"
    finally:
        process.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(15)
        process.kill()
        process.wait()
        listener.join(5)
        if process.stdout:
            process.stdout.close()


def run(command: list[str], folder: Path, environment: dict[str, str], where: str) -> str:
    """Run to the end; the output."""
    result = subprocess.run(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True,
        encoding="utf-8", timeout=150, check=False,
    )  # fmt: skip
    assert result.returncode == 0, (
        f"{where}: exit status {result.returncode}\n{result.stdout}\n{result.stderr}"
    )
    assert "Traceback" not in result.stderr, f"{where}:\n{result.stderr}"
    return result.stdout


def _missing(page: str) -> str | None:
    """Why a page cannot be run on this machine."""
    if "simulations.enki" in page and not ENKI.is_file():
        return WHY_NOT
    if "catkin_make" in page and not os.environ.get("SWARMWRIGHT_ROS1"):
        return "make test-ros1 runs this page"
    if "swarmwright-gazebo --broker" in page and not os.environ.get("SWARMWRIGHT_GAZEBO"):
        return "make test-gazebo runs this page"
    for words, module in SIMULATORS.items():
        if words in page and importlib.util.find_spec(module) is None:
            return f"{module} is not installed; make test-simulators runs this page"
    return None


@pytest.mark.timeout(450)
@pytest.mark.parametrize(
    "section",
    [section for page in PAGES for section in sections(page) if section.is_runnable()],
    ids=lambda section: section.name,
)
def test_every_snippet_of_the_page_works(section: Section, tmp_path: Path) -> None:
    if why_not := _missing(section.text):
        pytest.skip(why_not)
    programs = [str(Path(sys.executable).parent), os.environ["PATH"], "/usr/sbin"]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("SWARMWRIGHT_")}
    environment["PATH"] = os.pathsep.join(programs)
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):  # `--open` shall not open a browser
        environment.pop(display, None)
    environment["PYTHONUNBUFFERED"] = "1"  # as on a terminal: roslaunch says at once what it starts
    if gazebo := os.environ.get("SWARMWRIGHT_GAZEBO"):
        environment["SWARMWRIGHT_GAZEBO"] = gazebo
    for name in ("experiments", "protocol", "tests", "wrappers"):
        (tmp_path / name).symlink_to(ROOT / name)
    _build(section.text)
    ports: dict[str, str] = {}
    said = ""
    with ExitStack() as stack:
        for block in section.blocks():
            where = f"{section.name}:{block.line}"
            text = free_ports(block.text, ports)
            if "file" in block.directives:
                if block.directives["file"] == "mosquitto.conf" and os.getuid() == 0:
                    text += "user root\n"
                (tmp_path / block.directives["file"]).write_text(text, encoding="utf-8")
            elif block.language == "python":
                said = run([sys.executable, "-W", "error", "-c", text], tmp_path, environment, where)
            elif block.language == "bash":
                said = _bash(block, text, stack, tmp_path, environment, where)
            elif "output" in block.directives:
                pattern = re.escape(text.strip()).replace(re.escape("..."), ".*")
                assert re.fullmatch(pattern, said.strip(), re.DOTALL), f"{where}: it said\n{said}"
            else:
                assert block.language in SHOWN_ONLY | SOURCES, (
                    f"{where}: nothing tests a block of {block.language!r}"
                )


def _build(page: str) -> None:
    """Build or fetch what a page speaks of."""
    for words, make in (
        (JAR.name, jar),
        (str(BUILD.relative_to(ROOT)), build),
        ("protocol/generate.mjs", examples.contract),
        ("line_server.mjs", examples.commands),
    ):
        if words in page:
            make()


def _bash(
    block: Block, text: str, stack: ExitStack, folder: Path, environment: dict[str, str], where: str
) -> str:
    """Run a block as its directives say; what it said."""
    if "shown" in block.directives:
        return ""
    if "make" in block.directives:
        for line in text.splitlines():
            if line.startswith("make "):
                run(["make", "-n", *shlex.split(line, comments=True)[1:]], ROOT, environment, where)
    elif "background" in block.directives:
        _let_root_read(folder)
        stack.enter_context(background(text, block.directives["ready"], folder, environment, where))
    elif "environment" in block.directives:
        shown = run(["bash", "-ec", f"{text}\nenv -0 | head -c -1"], folder, environment, where)
        for pair in shown.split("\0"):
            name, _, value = pair.partition("=")
            environment[name] = value
    else:
        return run(["bash", "-euo", "pipefail", "-c", text], folder, environment, where)
    return ""


def _let_root_read(folder: Path) -> None:
    """Mosquitto started as root becomes another user, who cannot read this folder."""
    for file in folder.glob("*/mosquitto.conf") if os.getuid() == 0 else ():
        if "user root" not in file.read_text(encoding="utf-8"):
            with file.open("a", encoding="utf-8") as configuration:
                configuration.write("user root\n")


def test_every_page_is_in_an_index() -> None:
    indices = [page for page in DOCS if page.name == "index.md"]
    linked = {
        (index.parent / target).resolve()
        for index in indices
        for target in re.findall(r"\]\(([^)#]+)\)", index.read_text(encoding="utf-8"))
    }
    assert {*DOCS} - linked == {ROOT / "docs" / "index.md"}


def test_links_between_pages_lead_somewhere() -> None:
    links = re.compile(r"\]\(([^)#\s]+)[^)]*\)")
    broken = [
        f"{page.relative_to(ROOT)}: {target}"
        for page in PAGES
        for target in links.findall(FENCE.sub("", page.read_text(encoding="utf-8")))
        if "://" not in target and not (page.parent / target).exists()
    ]
    assert not broken


def test_the_page_of_the_python_library_has_every_public_name() -> None:
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    table = page[page.index("| name | purpose |") : page.index("## Experiment")]
    public = {name for name in swarmwright.__all__ if not name.startswith("__")}
    assert {name for name in public if not re.search(rf"`{name}`", table)} == set()


def _attributes(cls: type) -> tuple[set[str], set[str]]:
    """Return the public attributes of a class, and which of them are keys of an experiment file."""
    fields = {one.name for one in dataclasses.fields(cls)} if dataclasses.is_dataclass(cls) else set()
    keys = fields - {"path"} if cls is swarmwright.Experiment else set()
    return {name for name in {*dir(cls), *fields} if not name.startswith("_")}, keys


@pytest.mark.parametrize(
    ("classes", "section"),
    [
        ((swarmwright.Experiment,), "Experiment"),
        ((swarmwright.Run,), "Run"),
        (
            (swarmwright.PostEvaluation, swarmwright.ControllerEvaluation, swarmwright.Validation),
            "post_evaluate",
        ),
        ((swarmwright.BundleVerification,), "export_bundle"),
        ((swarmwright.Controller,), "Controller"),
        ((swarmwright.Episodes,), "Episodes"),
        ((swarmwright.LearningCurve,), "learning_curve"),
        ((swarmwright.Transfer,), "transfer"),
        ((swarmwright.Comparison,), "compare"),
        ((swarmwright.ControllerComparison,), "compare_controllers"),
        ((swarmwright.SweepResult,), "sweep"),
        ((swarmwright.Generation,), "optimize"),
    ],
)
def test_the_page_of_the_python_library_has_every_public_attribute(
    classes: tuple[type, ...], section: str
) -> None:
    """What completion and `help` show is documented, and what is documented is there."""
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    text = page.split(f"\n## {section}\n")[1].split("\n## ")[0]
    of = [_attributes(cls) for cls in classes]
    named = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`\n]+)`", FENCE.sub("", text)))))
    assert [public - keys - named for public, keys in of] == [set() for _ in classes]
    cells = re.findall(r"^\| (`[^|]+) \|", FENCE.sub("", text), re.MULTILINE)
    listed = {name for cell in cells for name in re.findall(r"`(?:\w+\.)?(\w+)", cell)} - {"print"}
    assigned = {name for cls in classes for name in re.findall(r"self\.(\w+)", inspect.getsource(cls))}
    assert listed <= assigned.union(*(public for public, _ in of))


@pytest.mark.parametrize(
    "error",
    [swarmwright.SwarmwrightError, swarmwright.InputError, swarmwright.RunError, swarmwright.SimulationError],
)
def test_errors_have_no_attributes_beside_those_of_the_page(error: type) -> None:
    own = {name for name in dir(error) if not name.startswith("_")} - set(dir(Exception))
    assert own <= {"exit_status"}
