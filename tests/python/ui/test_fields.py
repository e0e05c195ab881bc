"""The fields of an experiment's form."""

import json

import pytest

from swarmwright.experiment.document import DEFAULT_KINDS
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.simulations import catalogue
from swarmwright.ui.fields import MAPPINGS, Field, Form, Kinds, describe_form


def paths(form: Form) -> set[str]:
    return {".".join(field.path) for section in form.sections for field in section.fields}


def test_the_defaults_have_all_sections() -> None:
    form = describe_form(Kinds.of({"simulation": "minisim"}))
    assert [section.title for section in form.sections] == [
        "Simulation", "Controller", "Method", "Budget", "Ranking", "Validation", "Servers", "Time limits",
        "Failures",
    ]  # fmt: skip
    assert {
        "simulation", "parameters.mapWidth", "parameters.seed", "fitness",
        "controller.kind", "controller.hidden",
        "method.population", "method.generations", "ranking.episodes", "validate.episodes", "servers",
        "timeouts.step", "faults.audit", "seed", "requirements.dimensions",
    } <= paths(form)  # fmt: skip


@pytest.mark.parametrize("title", catalogue.titles())
def test_every_parameter_of_a_simulation_has_its_field(title: str) -> None:
    names = {f"parameters.{name}" for name in catalogue.parameter_names(title)}
    assert names <= paths(describe_form(Kinds(simulation=title)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("section", "kind"),
    [(section, kind) for section in DEFAULT_KINDS for kind in REGISTRIES[section].names()],
)
def test_every_option_of_a_kind_has_its_field(section: str, kind: str) -> None:
    form = describe_form(Kinds.of({"simulation": "minisim", section: {"kind": kind}}))
    options = set(REGISTRIES[section].get(kind).options_model.model_fields)
    assert options <= {path.split(".")[1] for path in paths(form) if path.startswith(f"{section}.")}
    json.dumps([part.describe() for part in form.sections], allow_nan=False)


def test_alternative_mappings_have_one_field() -> None:
    form = describe_form(Kinds.of({"simulation": "minisim", "method": {"kind": "novelty"}}))
    assert form.field(("method", "archive")).takes == ("mapping",)
    assert "method.archive.probability" not in paths(form)
    assert "method.species.survival" in paths(form)


@pytest.mark.parametrize("key", MAPPINGS)
def test_a_simulation_as_a_mapping_has_its_keys(key: str) -> None:
    form = describe_form(Kinds.of({"simulation": {key: "x"}}))
    assert f"simulation.{key}" in paths(form)
    assert "simulation" not in paths(form)


def test_a_launcher_has_its_options() -> None:
    form = describe_form(Kinds.of({"simulation": "arena", "servers": {"launcher": "slurm"}}))
    assert {"servers.launcher", "servers.count", "servers.partition"} <= paths(form)
    assert "servers" not in paths(form)


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("method.population", {"takes": ("integer",), "low": 2, "default": "50", "range": "2 to 10,000,000"}),
        ("method.kind", {"takes": (), "is_choice": True, "default": "nnga"}),
        ("method.seconds", {"takes": ("number",), "default": "", "low": 0}),
        ("controller.hidden", {"takes": ("list",), "default": "[8]"}),
        ("ranking.failed", {"takes": ("number",), "choices": ("last", "stop")}),
        ("validate.episodes", {"takes": ("integer",), "choices": ("auto",)}),
        ("faults.backup", {"takes": ("boolean",), "default": "true"}),
        ("simulation", {"takes": ("text",), "is_required": True}),
        ("parameters.unknown", {"takes": ("any",)}),
    ],
)
def test_alternatives_become_what_can_be_entered(path: str, expected: dict[str, object]) -> None:
    field = describe_form(Kinds(simulation="minisim")).field(path.split("."))
    assert {name: getattr(field, name) for name in expected} == expected


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"simulation": 5, "method": [1], "controller": {"kind": 3}, "servers": {"launcher": ["x"]}},
        {"simulation": "x" * 100_000, "ranking": {"kind": "<b>"}, "method": "file.py:Method"},
        {"simulation": "no_such.py:Class", "method": {"kind": "no_such.py:Class"}},
    ],
)
def test_mistakes_leave_a_form(values: dict[str, object]) -> None:
    form = describe_form(Kinds.of(values))
    assert "method.kind" in paths(form)
    assert form.field(["method", "kind"]).is_kind
    assert form.field(["nothing"]) == Field(("nothing",), ("any",))


def test_a_limit_of_zero_is_sent() -> None:
    sections = [section.describe() for section in describe_form(Kinds(simulation="minisim")).sections]
    fields = {tuple(field["path"]): field for section in sections for field in section["fields"]}
    assert fields["seed",]["low"] == 0
