"""The JSON Schema says what the loader does, and the reference page what the schema says."""

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from swarmwright import Experiment, InputError, templates
from swarmwright.common.yaml import parse
from swarmwright.experiment.reference import format_reference

GOOD: list[dict[str, Any]] = [
    {"simulation": "minisim"},
    {"simulation": "x", "sensors": 1, "actuators": 2, "requirements": {"dimensions": 3, "max_agents": 7}},
    {"simulation": "minisim", "method": {"population": 10}, "controller": {"hidden": []}},
    {"simulation": "minisim", "method": {"kind": "random_search"}, "controller": {"kind": "fully_meshed"}},
    {"simulation": "minisim", "fitness": "arrived - 0.01 * steps"},
    {"simulation": "minisim", "servers": 8, "mode": "stepwise", "timeouts": {"step": 1}, "prefix": "a"},
]
BAD: list[dict[str, Any]] = [
    {},
    {"simulation": 1},
    {"simulation": "minisim", "simulatoin": "minisim"},
    {"simulation": "minisim", "fitness": 3},
    {"simulation": "minisim", "method": {"kind": "nnga", "populaton": 3}},
    {"simulation": "minisim", "method": {"kind": "random_search", "elite": 0.15}},
    {"simulation": "minisim", "controller": {"kind": "fully_meshed", "hidden": [8]}},
    {"simulation": "minisim", "controller": {"kind": "magic"}},
    {"simulation": "minisim", "ranking": {"episodes": 0}},
    {"simulation": "minisim", "servers": 0},
    {"simulation": "minisim", "servers": "many"},
    {"simulation": "minisim", "timeouts": {"step": 0}},
    {"simulation": "minisim", "requirements": {}},
    {"simulation": "minisim", "seed": -1},
]


@pytest.fixture(scope="module")
def validator() -> Draft202012Validator:
    schema = Experiment.json_schema()
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


@pytest.mark.slow
@pytest.mark.parametrize("values", GOOD)
def test_what_loads_is_valid(values: dict[str, Any], validator: Draft202012Validator) -> None:
    validator.validate(values)
    validator.validate(Experiment.from_mapping(values).to_mapping())


@pytest.mark.parametrize("values", BAD)
def test_what_does_not_load_is_not_valid(values: dict[str, Any], validator: Draft202012Validator) -> None:
    assert not validator.is_valid(values)
    with pytest.raises(InputError):
        Experiment.from_mapping(values)


def test_templates_are_valid(validator: Draft202012Validator) -> None:
    for name in templates.names():
        validator.validate(parse(templates.text(name), name).values)


def test_every_key_is_described() -> None:
    def undescribed(node: Any, path: str = "") -> list[str]:
        found = []
        for name, key in node.get("properties", {}).items():
            here = f"{path}.{name}"
            if not (key.get("description") or "$ref" in key or name in {"kind", "launcher"}):
                found.append(here)
            for variant in key.get("oneOf", []):
                found += undescribed(variant, here)
        return found

    schema = Experiment.json_schema()
    assert undescribed(schema) == []
    assert [name for name, one in schema["$defs"].items() if undescribed(one, name)] == []


@pytest.mark.slow
def test_the_schema_is_plain_json() -> None:
    schema = Experiment.json_schema()
    assert json.loads(json.dumps(schema, allow_nan=False)) == schema


def test_the_reference_page_has_common_options_of_methods_once() -> None:
    methods = format_reference().split("\n## method\n")[1].split("\n## ")[0]
    common = methods.split("\n### ")[0]
    assert "Only `cea2d`, `map_elites`, `nnga`, `nsga2`, `nsga3`, `random_search` and `tpe` support" in common
    for name in ("seconds", "target", "operation", "in_flight"):
        assert methods.count(f"\n| `{name}` | ") == common.count(f"\n| `{name}` | ") == 1, name
    for name in ("generations", "evaluations"):
        assert methods.count(f"\n| `{name}` | ") == 2, "racing has other defaults"


def test_the_reference_page_is_up_to_date(root: Path) -> None:
    page = root / "docs" / "reference" / "experiment.md"
    command = "python -m swarmwright.experiment.reference > docs/reference/experiment.md"
    assert page.read_text(encoding="utf-8") == format_reference(), f"run `{command}`"
