"""What pages and files beside the code repeat of it."""

import re
import tomllib
from pathlib import Path

import click
from ruamel.yaml import YAML

import swarmwright
from swarmwright import _engine
from swarmwright.cli._commands import program
from swarmwright.controllers.modules.grammar import (
    BEHAVIOUR_PARAMETERS,
    BEHAVIOURS,
    CONDITION_PARAMETERS,
    CONDITIONS,
)
from swarmwright.runs.monitoring.prometheus import COUNTS

MOST_WORDS = 118_000
"""In all pages of docs, with snippets."""
MOST_GUIDES = 31
"""Pages in docs/how-to."""


def test_the_page_on_libraries_lists_all_extras(root: Path) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    page = (root / "docs" / "explanation" / "libraries.md").read_text(encoding="utf-8")
    section = page.split("\n## Extras\n")[1].split("\n## ")[0]
    listed = dict(re.findall(r"^\| `(\S+)` \| .* \| (.*) \|$", section, re.MULTILINE))
    assert listed == {
        extra: ", ".join(re.split(r"[<>=\[]", package)[0] for package in packages)
        for extra, packages in project["optional-dependencies"].items()
    }


def test_commands_in_sentences_have_the_options_that_they_name(root: Path) -> None:
    """Snippets are executed; what pages say in between is not."""
    pages = [*root.glob("docs/**/*.md"), *root.glob("*.md")]
    wrong = [
        f"{page.relative_to(root)}: {code}"
        for page in pages
        for code in re.findall(r"`swarmwright ([a-z][^`\"]*)`", page.read_text(encoding="utf-8"))
        for option in re.findall(r"(?<=\s)--[a-z][a-z0-9-]*", code)
        if option not in _options(code.split())
    ]
    assert not wrong


def _options(words: list[str]) -> set[str]:
    """Return the options of the command that the words begin with."""
    command: click.Command = program
    context = click.Context(program)
    for word in words:
        below = command.get_command(context, word) if isinstance(command, click.Group) else None
        if below is None:
            break
        command = below
    return {"--help", *(name for one in command.params for name in (*one.opts, *one.secondary_opts))}


def test_the_citation_names_this_version_and_licence(root: Path) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = YAML(typ="safe", pure=True).load((root / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == swarmwright.__version__
    assert citation["license"] == project["license"]
    assert {"cff-version", "message", "title", "authors"} <= citation.keys(), "what CFF 1.2 requires"


def test_the_page_on_faults_explains_all_incidents(root: Path) -> None:
    page = (root / "docs" / "explanation" / "faults.md").read_text(encoding="utf-8")
    section = page.split("\n## Incidents that a run counts\n")[1].split("\n## ")[0]
    listed = re.findall(r"^\| ([a-z ]+) \| ", section, re.MULTILINE)
    counted = [name.replace("_", " ") for name in COUNTS]
    assert listed[1:] == [*counted, "restarts"], "the first row is the heading; servers are not the pool's"


def test_the_page_on_the_arena_has_a_row_for_each_mission(root: Path) -> None:
    page = (root / "docs" / "reference" / "arena.md").read_text(encoding="utf-8")
    section = page.split("\n## Missions\n")[1].split("\n### ")[0]
    rows = re.findall(r"^\| (`.*?`) \| ", section, re.MULTILINE)
    missions = _engine.missions()
    assert sorted(rows) == sorted(
        ", ".join(f"`{name}`" for name in (one["name"], one["also"]) if name) for one in missions
    )


def test_the_page_on_modules_has_each_behaviour_and_condition_with_its_parameters(root: Path) -> None:
    page = (root / "docs" / "reference" / "modules.md").read_text(encoding="utf-8")
    for title, names in (("Behaviours", BEHAVIOURS), ("Conditions", CONDITIONS)):
        section = page.split(f"\n## {title}\n")[1].split("\n## ")[0]
        rows = dict(re.findall(r"^\| `(\w+)` \| (.*?)\|", section, re.MULTILINE))
        assert tuple(rows) == names
        for name, parameters in rows.items():
            behaviour = BEHAVIOUR_PARAMETERS.get(name)
            expected = CONDITION_PARAMETERS.get(name, (behaviour,) if behaviour else ())
            assert tuple(re.findall(r"`(\w+)`", parameters)) == expected


def test_the_documentation_stays_short(root: Path) -> None:
    """A page that grows should drop what other pages say, or details that no reader looks for."""
    docs = root / "docs"
    pages = [*docs.glob("*.md"), *docs.glob("*/*.md")]
    words = sum(len(_words(page)) for page in pages)
    assert words <= MOST_WORDS, "shorten a page"
    guides = list((docs / "how-to").glob("*.md"))
    assert len(guides) <= MOST_GUIDES, "extend or merge guides instead of adding one"


def _words(page: Path) -> list[str]:
    """Return the words of a page that have a letter or a digit, those of snippets included."""
    return [word for word in page.read_text(encoding="utf-8").split() if re.search("[A-Za-z0-9]", word)]
