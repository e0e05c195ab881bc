"""Commands and importers of other packages, and of our own rooms that reach the command line like them."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest

from swarmwright.cli import run
from swarmwright.cli._commands import ANNOUNCED, program
from swarmwright.experiment.importing import IMPORTERS

FINE = '''
"""A command and an importer of another package."""
import click
from swarmwright.experiment.importing import Imported, Importer

@click.command("hello")
def command():
    """Say hello."""
    click.echo("hello")

@click.command("fails")
def fails():
    raise KeyError("secret")

class Words(Importer):
    words = "a list of words"

    def recognises(self, files):
        return files[0].suffix == ".words"

    def load(self, files, options):
        return Imported("simulation: minisim\\n", None, ("a word is left out",))

class Broken(Importer):
    words = "nothing"

    def recognises(self, files):
        raise ZeroDivisionError("no words")

    def load(self, files, options):
        raise NotImplementedError
'''


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder that packages can be installed into."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    for cached in (program, IMPORTERS):
        vars(cached).pop("_entry_points", None)
    yield folder
    for cached in (program, IMPORTERS):
        vars(cached).pop("_entry_points", None)
    for name in [name for name in sys.modules if name.startswith("plugin_")]:
        del sys.modules[name]


def install(folder: Path, name: str, code: str, entry_points: str) -> None:
    """Lay out an installed package: a module and its metadata."""
    (folder / f"{name}.py").write_text(code)
    information = folder / f"{name}-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(entry_points)


def test_a_command_of_another_package(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install(site, "plugin_fine", FINE, "[swarmwright.commands]\nhello = plugin_fine:command\n")
    assert run(["--help"]) == 0
    assert "Other packages:\n  hello        Added by the package plugin_fine." in capsys.readouterr().out
    assert "plugin_fine" not in sys.modules
    assert run(["hello"]) == 0
    assert capsys.readouterr().out == "hello\n"
    assert run(["helo"]) == 2
    assert "did you mean 'hello'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("code", "value", "said"),
    [
        ("raise RuntimeError('out\\nof order')", "x", "cannot be imported: RuntimeError('out\\nof order')"),
        ("import sys; sys.exit(3)", "x", "cannot be imported: SystemExit(3)"),
        ("", "x", "cannot be imported: AttributeError("),
        ("x = 1", "x", "is not a click.Command"),
    ],
)
def test_a_broken_command(
    code: str, value: str, said: str, site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(site, "plugin_broken", code, f"[swarmwright.commands]\nbroken = plugin_broken:{value}\n")
    assert run(["broken"]) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith(
        f"swarmwright: command 'broken' (plugin_broken:{value}, announced by the package plugin_broken) "
        + said
    )
    assert complaint.count("\n") == 1
    assert run(["--help"]) == 0
    assert run(["schema"]) == 0  # others go on


def test_an_error_of_another_package(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install(site, "plugin_fine", FINE, "[swarmwright.commands]\nfails = plugin_fine:fails\n")
    assert run(["fails"]) == 1
    assert capsys.readouterr().err == (
        "swarmwright: command 'fails' (plugin_fine:fails, announced by the package plugin_fine): "
        "KeyError: 'secret'\n"
    )


def test_names_that_are_taken(site: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install(site, "plugin_one", FINE, "[swarmwright.commands]\nhello = plugin_one:command\n")
    install(
        site,
        "plugin_two",
        FINE,
        "[swarmwright.commands]\nhello = plugin_two:command\nschema = plugin_two:command\n",
    )
    assert run(["hello"]) == 2
    assert "announced twice, as plugin_one:command by plugin_one and plugin_two" in capsys.readouterr().err
    assert run(["schema"]) == 0
    assert "hello" not in capsys.readouterr().out


def test_an_importer_of_another_package(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(
        site,
        "plugin_fine",
        FINE,
        "[swarmwright.importers]\na_broken = plugin_fine:Broken\nb_missing = plugin_fine:Missing\n"
        "words = plugin_fine:Words\n",
    )
    file = tmp_path / "some.words"
    file.write_text("a b c")
    assert run(["import", str(file), "-o", str(tmp_path / "made.yaml")]) == 0
    assert (tmp_path / "made.yaml").read_text() == "simulation: minisim\n"
    said = capsys.readouterr().err
    assert "importer 'b_missing' (plugin_fine:Missing, announced by the package plugin_fine)" in said
    assert "Broken.recognises: ZeroDivisionError: no words" in said
    assert "a word is left out" in said


def test_values_cannot_be_written_into_files_of_every_importer(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(site, "plugin_fine", FINE, "[swarmwright.importers]\nwords = plugin_fine:Words\n")
    file = tmp_path / "some.words"
    file.write_text("a b c")
    (tmp_path / "run").mkdir()
    arguments = ["export", str(tmp_path / "run"), "--model", str(file), "--output", str(tmp_path / "out")]
    assert run(arguments) == 2
    assert "a list of words cannot hold the values of a candidate" in capsys.readouterr().err


@pytest.mark.parametrize("name", ANNOUNCED)
def test_our_commands_have_the_lines_of_the_help(name: str) -> None:
    command: Any = program.get_command(click.Context(program), name)
    assert command.get_short_help_str(100) == ANNOUNCED[name]


@pytest.mark.slow
def test_help_loads_no_room_that_is_announced() -> None:
    code = (
        "import sys; from swarmwright.cli import run; run(['--help']); "
        "print([x for x in sys.modules if x.startswith(('swarmwright.conformance', 'swarmwright.interop'))])"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=50
    )
    assert shown.stdout.splitlines()[-1] == "[]"
