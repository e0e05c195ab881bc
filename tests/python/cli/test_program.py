import os
import resource
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from swarmwright import __version__
from swarmwright.cli._commands import COMMANDS, SECTIONS
from swarmwright.cli._commands import program as click_program
from swarmwright.common.revision import revision

pytestmark = pytest.mark.slow


def every_command() -> list[tuple[str, ...]]:
    """Names of all commands, those of groups too."""
    names: list[tuple[str, ...]] = [()]
    for name in COMMANDS:
        names.append((name,))
        command: Any = click_program.get_command(None, name)  # type: ignore[arg-type]
        names.extend((name, inner) for inner in getattr(command, "commands", {}))
    return names


@pytest.mark.parametrize("names", every_command(), ids=" ".join)
def test_help_ends_with_an_example_that_is_accepted(program: Any, names: tuple[str, ...]) -> None:
    shown = program(*names, "--help")
    assert shown.returncode == 0
    *_, examples = shown.stdout.partition("Example:\n")
    lines = [
        line.strip() for line in examples.splitlines() if line.strip() and not line.strip().startswith("#")
    ]
    assert lines, "no example"
    for line in lines:
        words = shlex.split(line.split(" > ")[0])
        assert words[0] == "swarmwright"
        command: Any = click_program
        rest = words[1:]
        while hasattr(command, "get_command"):
            command = command.get_command(None, rest.pop(0))
        known = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in rest if word.startswith("-")} <= known


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        (("swarmwright", "opt"), ["optimize"]),
        (("swarmwright", "runs", "el"), ["elites"]),
        (("swarmwright", "optimize", "--mlf"), ["--mlflow"]),
    ],
)
def test_a_shell_completes_commands_and_options(words: tuple[str, ...], completed: list[str]) -> None:
    script = (
        'eval "$(_SWARMWRIGHT_COMPLETE=bash_source swarmwright)"; '
        f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; "
        '_swarmwright_completion swarmwright; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    shown = subprocess.run(
        ["bash", "-c", script], env={**os.environ, "PATH": path}, capture_output=True, text=True, check=True
    )
    assert shown.stdout.split() == completed


def test_the_version_has_the_commit_of_a_checkout(program: Any) -> None:
    shown = program("--version")
    assert (shown.returncode, shown.stderr) == (0, "")
    commit = revision()
    assert shown.stdout == f"swarmwright {__version__}" + (f" (commit {commit})\n" if commit else "\n")


@pytest.mark.parametrize("name", ["optimize", "resume", "sweep", "evaluate", "simulate", "serve", "servers"])
def test_help_names_the_variable_that_a_broker_may_come_from(name: str, program: Any) -> None:
    assert "SWARMWRIGHT_BROKER" in program(name, "--help").stdout


def test_help_is_quick() -> None:
    def seconds() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-P", "-m", "swarmwright", "--help"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, timeout=50)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    # Processor time, for the machine may be busy with something else. It reads hardly anything from the disk.
    assert min(seconds() for _ in range(4)) < 0.3


def test_help_loads_neither_engine_nor_large_libraries() -> None:
    code = (
        "import sys; from swarmwright.cli import run; run(['--help']);"
        "large = {'numpy', 'matplotlib', 'pydantic', 'rich', 'ruamel.yaml', 'swarmwright._engine'};"
        "print(sorted(large & set(sys.modules)))"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=20
    )
    assert shown.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    ("arguments", "answers"),
    [
        (["optimse"], ["unknown command 'optimse'", "did you mean 'optimize'?"]),
        (["runs", "exprt"], ["unknown command 'exprt'", "did you mean 'export'?"]),
        (["servers", "--brokr", "x"], ["--brokr", "--broker"]),
        (["optimize"], ["Missing argument 'FILE'"]),
        (["optimize", "exprmnt.yaml"], ["'exprmnt.yaml' does not exist", "mean 'experiment.yaml'?\n"]),
        (["optimize", "nowhere/x.yaml"], ["does not exist", "nor does its folder 'nowhere'"]),
        (["optimize", "."], ["'.' is a folder where a file is expected.\n"]),
        (["optimize", "run"], ["expected: name", "run/experiment.yaml", "'swarmwright resume run'"]),
        (["optimize", "experiment.yaml", "--generations", "30"], ["use '--set method.generations=30'"]),
        (["sweep", "experiment.yaml", "--population=9"], ["use '--set method.population=9'"]),
        (["optimize", "experiment.yaml", "--method"], ["use '--set method.kind=VALUE'"]),
        (["replay", ".", "--out", "no/x.gif"], ["--save", "there is no folder 'no'"]),
        (["plot", ".", "--save", "no/x.png"], ["--out", "there is no folder 'no'"]),
        (["optimize", "experiment.yaml", "--servers", "many"], ["'many' is neither a number of servers"]),
        (
            ["optimize", "experiment.yaml", "--servers", "slurm"],
            ["leave --servers out to use the experiment's"],
        ),
        (["optimize", "experiment.yaml", "--servers", "0"], ["0 is not in the range"]),
        (["optimize", "experiment.yaml", "--seed", "x"], ["--seed", "'x' is not a valid integer"]),
        (["resume", "run", "--seconds", "nan"], ["--seconds", "not a finite number"]),
        (["replay", "experiment.yaml"], ["is a file where a folder is expected"]),
        (["resume", "experiment.yaml"], ["name the folder of a run; 'swarmwright optimize experiment.yaml'"]),
        (["export", "run/run.sqlite", "--to", "c"], ["expected: name the folder of the run, run"]),
        (["replay", ".", "--save", "x.avi"], [".mp4 or .png"]),
        (["replay", ".", "--save", "no/x.gif"], ["there is no folder 'no'"]),
        (["replay", ".", "--speed", "0"], ["--speed"]),
        (["simulate", "experiment.yaml", "--visual", "--json"], ["--visual", "--json"]),
        (["servers", "--broker", "localhost"], ["must begin with one of", "mqtt://"]),
        (["servers", "--broker", "mqtt://me:secret@host"], ["SWARMWRIGHT_PASSWORD"]),
        (["servers", "--prefix", "lab/#"], ["--prefix", "'#'"]),
        (["new", "minisym"], ["unknown template 'minisym'", "did you mean 'minisim'?"]),
        (["broker", "--port", "70000"], ["70000 is not in the range"]),
        (["broker", "--host", "0.0.0.0"], ["can be reached from other machines", "--users", "--certificate"]),
        (["broker", "--host", "::"], ["can be reached from other machines"]),
        (["broker", "--host", "no.such.host.invalid"], ["not an address of this machine"]),
        (["broker", "--certificate", "experiment.yaml"], ["--certificate needs --key; add it"]),
        (["serve", "minisim", "--count", "0"], ["--count"]),
        (["runs", "export", ".", "no/x.csv"], ["there is no folder 'no'"]),
        (["optimize", "link.yaml"], ["'link.yaml' is a link to 'nowhere', which does not exist.\n"]),
        (["export", ".", "--to", "c", "--output", ""], ["it is empty; name a folder"]),
        (["export", ".", "--to", "c", "--output", "run"], ["run: is the folder of another run"]),
        (["conformance", "server", "--id", "1", "--junit", "no/x.xml"], ["there is no folder 'no'"]),
        (["conformance", "server", "--id", "1", "--junit", "run"], ["'run' is a folder where a file"]),
    ],
)
def test_mistakes_are_named_with_a_way_out(
    program: Any, tmp_path: Path, arguments: list[str], answers: list[str]
) -> None:
    (tmp_path / "experiment.yaml").write_text("simulation: minisim\n")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.sqlite").touch()
    (tmp_path / "link.yaml").symlink_to("nowhere")
    result = program(*arguments)
    assert result.returncode == 2
    assert not result.stdout
    assert result.stderr.startswith("swarmwright: ")
    for answer in answers:
        assert answer in result.stderr
    assert "--help'" in result.stderr, "where to read on"
    assert "secret" not in result.stderr


def test_a_wrong_broker_of_the_environment_is_named_as_that(program: Any, tmp_path: Path) -> None:
    (tmp_path / "experiment.yaml").write_text("simulation: minisim\n")
    result = program("optimize", "experiment.yaml", env={"SWARMWRIGHT_BROKER": "localhost"})
    assert result.returncode == 2
    assert "'SWARMWRIGHT_BROKER' (environment): the broker's address must begin with" in result.stderr


def test_files_for_another_command_are_known(program: Any, tmp_path: Path) -> None:
    (tmp_path / "experiment.yaml").write_text("simulation: minisim\n")
    (tmp_path / "sweep.yaml").write_text("experiment: experiment.yaml\nseeds: 3\n")
    for command, file, other in (("optimize", "sweep", "sweep"), ("sweep", "experiment", "optimize")):
        result = program(command, f"{file}.yaml")
        assert result.returncode == 2
        assert f"run it with 'swarmwright {other}'" in result.stderr
        assert "unknown key" not in result.stderr


def test_summaries_of_commands_are_whole(program: Any) -> None:
    text = program("--help", env={"COLUMNS": "80"}).stdout
    commands = text[text.index("Start:") : text.index("Example:")]
    assert "..." not in commands
    headings = [line.removesuffix(":") for line in commands.splitlines() if line.endswith(":")]
    assert headings == list(SECTIONS)
    listed = [line.split()[0] for line in commands.splitlines() if line[:2] == "  " and line[2:3].strip()]
    assert listed == list(COMMANDS)


def test_without_arguments_the_help_is_shown(program: Any) -> None:
    result = program()
    assert result.returncode == 2
    assert "Servers:" in result.stderr


def test_a_reader_that_leaves_is_no_error() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        result = subprocess.run(
            [sys.executable, "-P", "-m", "swarmwright", "schema"],
            stdout=writing,
            stderr=subprocess.PIPE,
            text=True,
            timeout=30,
            check=False,
        )
    finally:
        os.close(writing)
    assert result.stderr == ""
    assert result.returncode == 0
