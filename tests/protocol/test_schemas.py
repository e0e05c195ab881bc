"""The schemas: valid, stable to the byte, and nothing that fits a printed one is lost on the fixed one."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

PROTOCOL = Path(__file__).parents[2] / "protocol"
SCHEMAS = sorted((PROTOCOL / "schemas").rglob("*.json"))
# D6.1 requires `simulation` in four messages, and leaves it out of its own examples of them.
CONTRADICTED = {"control", "sensor", "actuator", "fitness"}

Validators = Callable[[str], Draft202012Validator]
Value: TypeAlias = Any  # JSON of whatever shape


def load(path: Path) -> Value:
    return json.loads(path.read_text(encoding="utf-8"))


def example(topic: str) -> Value:
    return load(PROTOCOL / "vectors" / "messages" / f"{topic}.d61.json")


@pytest.mark.parametrize("path", SCHEMAS, ids=lambda path: str(path.relative_to(PROTOCOL)))
def test_schema_is_valid_and_written_canonically(path: Path) -> None:
    schema = load(path)
    Draft202012Validator.check_schema(schema)
    assert schema["$schema"] == Draft202012Validator.META_SCHEMA["$id"]
    name = ":".join(path.relative_to(PROTOCOL / "schemas").parts).removesuffix(".schema.json")
    assert schema["$id"] == f"urn:swarmwright:protocol:{name}"
    assert path.read_text(encoding="utf-8") == json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def properties(schema: Value) -> Iterator[tuple[str, Any]]:
    """Every property that a schema defines, however deep, but for those that it forbids."""
    for key, value in schema.items() if isinstance(schema, dict) else enumerate(schema):
        if key == "properties":
            yield from ((name, one) for name, one in value.items() if one is not False)
        if isinstance(value, dict | list):
            yield from properties(value)


@pytest.mark.parametrize("path", SCHEMAS, ids=lambda path: str(path.relative_to(PROTOCOL)))
def test_every_property_is_described(path: Path) -> None:
    found = list(properties(load(path)))
    assert len(found) >= 2
    assert [key for key, value in found if len(value.get("description", "")) < 10] == []


def test_printed_example_fits_the_fixed_schema(topic: str, validators: Validators) -> None:
    validators(topic).validate(example(topic))


def test_printed_example_against_the_printed_schema(topic: str, validators: Validators) -> None:
    errors = [error.message for error in validators(f"published/{topic}").iter_errors(example(topic))]
    assert errors == (["'simulation' is a required property"] if topic in CONTRADICTED else [])


def required(validator: Draft202012Validator) -> set[str]:
    assert isinstance(validator.schema, Mapping)
    return set(validator.schema["required"])


def test_required_keys_are_the_printed_ones_but_for_simulation(topic: str, validators: Validators) -> None:
    printed = required(validators(f"published/{topic}"))
    if topic in CONTRADICTED:
        printed = printed - {"simulation"} | {"simulation_hash"}
    assert required(validators(topic)) == printed


def instances(schema: dict[str, Any]) -> st.SearchStrategy[Any]:
    """Values of a printed schema, within the ranges that Swarmwright reads."""
    match schema["type"]:
        case "string":
            return st.text(max_size=20)
        case "boolean":
            return st.booleans()
        case "integer":
            return st.integers(0, 2**63 - 1)
        case "number":
            return st.floats(width=32, allow_nan=False, allow_infinity=False) | st.integers(-(10**9), 10**9)
        case "array":
            return st.lists(instances(schema["items"]), min_size=1, max_size=5)
    fields = {key: instances(value) for key, value in schema["properties"].items()}
    texts = {"simulation", "simulation_hash"} if "title" in schema else set()
    fields |= {key: st.text(max_size=20) for key in texts}
    always = {key: fields.pop(key) for key in texts | set(schema["required"])}
    return st.fixed_dictionaries(always, optional=fields)


@given(data=st.data())
def test_what_fits_the_printed_schema_fits_the_fixed_one(data: st.DataObject) -> None:
    path = data.draw(st.sampled_from(sorted((PROTOCOL / "schemas" / "published").iterdir())))
    value = data.draw(instances(load(path)))
    Draft202012Validator(load(path)).validate(value)
    Draft202012Validator(load(PROTOCOL / "schemas" / path.name)).validate(value)


CONTROLLER = {
    "version": 1,
    "kind": "layered",
    "sensors": 4,
    "actuators": 1,
    "hidden": [8],
    "activation": "tanh",
    "output_range": [-1, 1],
    "weights": [0.5] * 49,
}
MESHED = {
    **CONTROLLER,
    "kind": "fully_meshed",
    "hidden": 2,
    "activation": "clamp",
    "iterations": 2,
    "output_range": [0, 1],
}

MACHINE = {
    "version": 1,
    "kind": "mealy_fsm",
    "sensors": 2,
    "actuators": 1,
    "states": 2,
    "thresholds": [[-0.5, 0.5], []],
    "weights": [0.5] * 12,
}

SET = {
    "version": 1,
    "kind": "parameter_set",
    "parameters": [
        {"name": "avoidance", "type": "real"},
        {"name": "hops", "type": "integer"},
        {"name": "strategy", "type": "categorical", "choices": ["a", "b"]},
    ],
    "weights": [0.5, 3, 1],
}


@pytest.mark.parametrize(
    "specification",
    [CONTROLLER, {**CONTROLLER, "hidden": []}, MESHED, {**MESHED, "hidden": 0}, MACHINE, SET],
)
def test_controller_is_accepted(specification: dict[str, Any], validators: Validators) -> None:
    validators("controller").validate(specification)


def test_controllers_of_the_vectors_are_accepted(validators: Validators) -> None:
    file = load(PROTOCOL / "vectors" / "controllers.json")
    vectors = [*file["controllers"], *file["parameter_sets"]]
    for vector in vectors:
        validators("controller").validate(vector["specification"])


@pytest.mark.parametrize(
    ("specification", "change"),
    [
        (CONTROLLER, {"version": 2}),
        (CONTROLLER, {"kind": "perceptron"}),
        (CONTROLLER, {"sensors": 0}),
        (CONTROLLER, {"actuators": 1.5}),
        (CONTROLLER, {"hidden": 8}),
        (CONTROLLER, {"hidden": [0]}),
        (CONTROLLER, {"activation": "softmax"}),
        (CONTROLLER, {"iterations": 2}),
        (CONTROLLER, {"output_range": [-1, 0, 1]}),
        (CONTROLLER, {"output_range": [1]}),
        (CONTROLLER, {"weights": []}),
        (CONTROLLER, {"weights": [float("inf")]}),
        (CONTROLLER, {"weights": [1e39]}),
        (CONTROLLER, {"wieghts": [1]}),
        (MESHED, {"hidden": [2]}),
        (MESHED, {"activation": "linear"}),
        (MESHED, {"iterations": 0}),
        (MACHINE, {"states": 0}),
        (MACHINE, {"thresholds": []}),
        (MACHINE, {"thresholds": [0]}),
        (MACHINE, {"thresholds": [["0"]]}),
        (MACHINE, {"hidden": 2}),
        (SET, {"parameters": []}),
        (SET, {"parameters": [{"name": "avoidance"}]}),
        (SET, {"parameters": [{"name": "seed", "type": "real"}]}),
        (SET, {"parameters": [{"name": "", "type": "real"}]}),
        (SET, {"parameters": [{"name": "a", "type": "categorical"}]}),
        (SET, {"parameters": [{"name": "a", "type": "real", "choices": ["b"]}]}),
        (SET, {"sensors": 4}),
    ],
    ids=lambda value: None if len(value) > 1 else str(value),
)
def test_controller_is_refused(
    specification: dict[str, Any], change: dict[str, Any], validators: Validators
) -> None:
    assert not validators("controller").is_valid({**specification, **change})


@pytest.mark.parametrize("since", ["yesterday", "2026-01-31", "2026-01-31T12:00:00", "2026-13-31T12:00:00Z"])
def test_presence_tells_its_time_by_rfc_3339(since: str, validators: Validators) -> None:
    presence = {
        "version": 1,
        "server": 1,
        "state": "ready",
        "simulations": ["minisim"],
        "capabilities": {"dimensions": 2},
    }
    validators("presence").validate({**presence, "since": "2026-01-31T12:00:00Z"})
    assert not validators("presence").is_valid({**presence, "since": since})
