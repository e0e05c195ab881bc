"""What is entered in a form: changes of the text, or a message."""

from typing import Any

import pytest

from swarmwright import Experiment, InputError, templates
from swarmwright.common import yaml
from swarmwright.ui.entries import ENTRY_CHARACTERS, change_text, find_kinds, read_entries, show_values
from swarmwright.ui.fields import describe_form

MINISIM = templates.text("minisim")


def change(text: str, path: str, entry: str) -> str:
    return change_text(text, path.split("."), entry, describe_form(find_kinds(text)[1]))


@pytest.mark.parametrize(
    ("path", "entry", "value"),
    [
        ("method.population", "80", 80),
        ("method.population", "8e1", 80),
        ("method.seconds", "1e3", 1000.0),
        ("method.kind", "nnga", "nnga"),
        ("controller.hidden", "16, 8", [16, 8]),
        ("controller.hidden", "[16, 8]", [16, 8]),
        ("ranking.failed", "last", "last"),
        ("ranking.failed", "-5", -5),
        ("faults.backup", "false", False),
        ("validate", "false", False),
        ("validate.vary", "{parameters.speedAgents: [0.5, 2]}", {"parameters.speedAgents": [0.5, 2]}),
        ("servers", "in-process", "in-process"),
        ("servers", "4", 4),
        ("start_from", "[runs/a, {run: runs/b}]", ["runs/a", {"run": "runs/b"}]),
        ("parameters.helloMessage", "a: b\n c # d", "a: b\n c # d"),
        ("parameters.helloMessage", "!!python/object:os.system", "!!python/object:os.system"),
        ("parameters.helloMessage", "<script>alert(1)</script>", "<script>alert(1)</script>"),
        ("parameters.helloMessage", "\u202etxt \x00\x07 *anchor &x", "\u202etxt \x00\x07 *anchor &x"),
        ("parameters.helloMessage", "null", "null"),
        ("parameters.helloMessage", "12", "12"),
        ("parameters.goal", "[1.5, 2]", [1.5, 2]),
        ("parameters.<b>new</b>", "yes please", "yes please"),
    ],
)
def test_an_entry_becomes_the_value_and_comments_stay(path: str, entry: str, value: Any) -> None:
    text = change(MINISIM, path, entry)
    values = yaml.parse(text, "").values
    for key in path.split("."):
        values = values[key]
    assert values == value
    assert type(values) is type(value)
    assert text.count("#") >= MINISIM.count("#")


def test_an_empty_entry_is_the_default() -> None:
    assert change(MINISIM, "method.population", " ") == MINISIM.replace("  population: 50\n", "")
    assert change(MINISIM, "method.seconds", "") == MINISIM


def test_another_kind_keeps_what_a_setting_keeps() -> None:
    text = change(MINISIM, "method.kind", "cma_es")
    assert "# FREVO's genetic algorithm" in text
    expected = Experiment.from_mapping(
        {**yaml.parse(MINISIM, "").values, "method": {"kind": "cma_es", "generations": 20}}
    )
    assert Experiment.from_mapping(yaml.parse(text, "").values) == expected


def test_another_simulation_loses_the_parameters_of_the_former_one() -> None:
    values = yaml.parse(change(MINISIM, "simulation", "arena"), "").values
    assert values["parameters"] == {"stepSize": 250}
    assert yaml.parse(change(MINISIM, "simulation", "aren"), "").values["parameters"]["mapWidth"] == 13


def test_a_launcher_replaces_and_leaves_the_servers() -> None:
    text = change(MINISIM, "servers.launcher", "slurm")
    assert yaml.parse(text, "").values["servers"] == {"launcher": "slurm"}
    text = change(text, "servers.count", "200")
    assert yaml.parse(text, "").values["servers"] == {"launcher": "slurm", "count": 200}
    assert "servers" not in yaml.parse(change(text, "servers.launcher", ""), "").values


WRONG = [
    ("method.population", "many", "must be a whole number, not 'many'"),
    ("method.population", "nan", "must be a whole number"),
    ("method.population", ".nan", "must be a finite number"),
    ("method.population", "-.inf", "must be a finite number"),
    ("method.population", "1e999", "too large for a number"),
    ("method.population", "9" * 1200, "more than 1000 characters"),
    ("method.population", "9" * (ENTRY_CHARACTERS + 1), "must have at most 20,000 characters"),
    ("method.population", "[1, 2]", "must be a whole number"),
    ("method.population", "{a: 1}", "must be a whole number"),
    ("method.population", "true", "must be a whole number"),
    ("method.population", "5\nservers: 9", "must be a whole number|is not valid YAML"),
    ("method.population", "a: b\n c", "must be a whole number"),
    ("method.population", "*alias", "must be a whole number"),
    ("method.population", "&x 5", "must be a whole number"),
    ("method.population", "!!python/object/apply:os.system ['id']", "must be a whole number"),
    ("method.population", "5 # comment\nseed: 3", "must be a whole number|is not valid YAML"),
    ("method.population", "<img src=x onerror=alert(1)>", "must be a whole number"),
    ("method.population", "\x00", "must be a whole number"),
    ("method.population", "5\x00", "is not valid YAML|must be a whole number"),
    ("method.kind", "no_such", "must be one of"),
    ("method.kind", "file.py:Class", "must be one of"),
    ("controller.kind", "<script>", "must be one of"),
    ("ranking.kind", "{kind: race}", "must be one of"),
    ("faults.backup", "maybe", "must be true or false"),
    ("ranking.failed", "never", "must be last or stop or a number"),
    ("controller.hidden", "[8", "is not valid YAML"),
    ("controller.hidden", "{a: 1}", "must be a list"),
    ("controller.hidden", "8]\nmethod: [1", "is not valid YAML"),
    ("validate.vary", "[1, 2]", "must be a mapping"),
    ("validate.vary", "{a: !!python/x 1}", "has no meaning here"),
    ("parameters.goal", "!!python/object:os.system x", "has no meaning here"),
    ("parameters.goal", "{a: 1, a: 2}", "duplicate key"),
    ("parameters.goal", "[" * 200 + "]" * 200, "nested too deeply"),
    ("parameters.goal", "1\n---\n2", "only one is supported"),
]  # fmt: skip


@pytest.mark.parametrize(("path", "entry", "message"), WRONG)
def test_a_wrong_entry_is_told_and_changes_nothing(path: str, entry: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        change(MINISIM, path, entry)
    assert len(str(error.value)) < 1000
    assert "entry:" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("method: [1\n", "text:2: is not valid YAML"),
        ("- 1\n", "must be a mapping"),
        ("a: 1\na: 2\n", "text:2: duplicate key"),
        ("a: !!python/x 1\n", "has no meaning here"),
        (f"a: {'x' * 70_000}\n", "more than 64 KiB"),
    ],
)
def test_a_text_that_cannot_be_read_is_told(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        find_kinds(text)


@pytest.mark.parametrize(
    ("path", "entry", "values"),
    [
        ("method.population", "10, 20, 5e1", [10, 20, 50]),
        ("method.population", "[10, 20]", [10, 20]),
        ("method.kind", "nnga, cma_es", ["nnga", "cma_es"]),
        ("controller.hidden", "[8], [16, 8]", [[8], [16, 8]]),
        ("ranking.failed", "last, -1", ["last", -1]),
        ("faults.backup", "true, false", [True, False]),
        ("parameters.helloMessage", "a b, '1', 2", ["a b", "1", "2"]),
        (
            "parameters.helloMessage",
            "007, yes, 2020-01-01, 1e3, a:b",
            ["007", "yes", "2020-01-01", "1e3", "a:b"],
        ),
        (
            "parameters.helloMessage",
            """"a, b", 'c: d', it's, http://u:1, "\\"", '~'""",
            ["a, b", "c: d", "it's", "http://u:1", '"', "~"],
        ),
        ("parameters.goal", "[1, 2], [3, 4]", [[1, 2], [3, 4]]),
        ("parameters.goal", "[[1, 2]]", [[1, 2]]),
        ("parameters.unknown", "'5', 5, 'a: b', {a: 1}", ["5", 5, "a: b", {"a": 1}]),
    ],
)
def test_values_of_a_sweep_are_listed(path: str, entry: str, values: list[Any]) -> None:
    assert read_entries(entry, describe_form(find_kinds(MINISIM)[1]).field(path.split("."))) == values


@pytest.mark.parametrize(
    ("path", "entry", "message"),
    [
        ("method.population", "", "must list values"),
        ("method.population", "1, x", "must be a whole number, not 'x'"),
        ("method.population", "1, [2]", "must be a whole number"),
        ("method.population", "1, .nan", "must be a finite number"),
        ("method.population", "1, 1", "1 is listed twice"),
        ("method.population", "1]\nseeds: [2", "is not valid YAML"),
        ("method.population", ", ".join(map(str, range(1001))), "at most 1,000 values"),
        ("method.population", "!!python/x 1", "has no meaning here"),
        ("method.kind", "nnga, none", "must be one of"),
    ],
)
def test_wrong_values_of_a_sweep_are_told(path: str, entry: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_entries(entry, describe_form(find_kinds(MINISIM)[1]).field(path.split(".")))


def test_values_are_shown_as_text() -> None:
    shown = show_values({"a": 2**63, "b": {"c": [1, "x: y"]}, "d": None, "e": float("nan"), "f": "<b>"})[
        "keys"
    ]
    assert shown["a"] == {"text": "9223372036854775808"}
    assert shown["b"]["keys"]["c"] == {"text": '[1, "x: y"]'}
    assert show_values("a, b") == {"text": "a, b", "yaml": '"a, b"'}
    assert [shown[key]["text"] for key in "def"] == ["", ".nan", "<b>"]
