"""The vectors of controllers say what decision 002 says, as read by an implementation of its own."""

import json
from collections import Counter
from typing import Any

import jsonschema
import numpy as np
import pytest

import swarmwright
from tests.protocol.cases import drawn, lines
from tests.protocol.conftest import PROTOCOL, vectors
from tests.protocol.controllers import FUNCTIONS, Controller, merged

Json = dict[str, Any]
VECTORS: Json = vectors("controllers.json")
TEXT = (PROTOCOL / "vectors" / "controllers.json").read_text(encoding="utf-8")


def number(hexadecimal: str, bits: str) -> np.float32:
    """The binary32 that a hexadecimal float and a bit pattern both say."""
    value: np.float32 = np.array([int(bits, 16)], dtype=np.uint32).view(np.float32)[0]
    assert float.fromhex(hexadecimal) == value
    return value


def numbers(step: Json, name: str) -> list[np.float32]:
    return [number(*pair) for pair in zip(step[f"{name}s"], step[f"{name}_bits"], strict=True)]


def bits(value: np.float32) -> int:
    return int(np.array([value], dtype=np.float32).view(np.uint32)[0])


@pytest.mark.parametrize("name", VECTORS["functions"])
def test_functions(name: str) -> None:
    assert len(VECTORS["functions"][name]) >= 200
    for x, x_bits, y, y_bits in VECTORS["functions"][name]:
        assert bits(FUNCTIONS[name](number(x, x_bits))) == bits(number(y, y_bits)), f"{name}({x})"


@pytest.mark.parametrize("case", VECTORS["controllers"], ids=lambda case: case["name"])
def test_controllers(case: Json) -> None:
    controller = Controller(case["specification"])
    with np.errstate(over="ignore", invalid="ignore"):
        for step in case["steps"]:
            if step["reset"]:
                controller.reset()
            found = controller.step(numbers(step, "sensor"))
            assert list(map(bits, found)) == list(map(bits, numbers(step, "actuator")))


@pytest.mark.parametrize("case", VECTORS["controllers"], ids=lambda case: case["name"])
def test_the_file_is_what_the_program_writes(case: Json) -> None:
    steps = [(step["reset"], numbers(step, "sensor")) for step in case["steps"]]
    assert lines(case["name"], case["specification"], steps) in TEXT


def test_the_program_draws_two_episodes() -> None:
    specification = VECTORS["controllers"][0]["specification"]
    case = json.loads(lines("new", specification, drawn(specification["sensors"])))
    assert [step["reset"] for step in case["steps"]] == [True, False, False, False] * 2
    sensors = [tuple(step["sensors"]) for step in case["steps"]]
    assert len(set(sensors)) == len(sensors)


@pytest.mark.parametrize("case", VECTORS["parameter_sets"], ids=lambda case: case["name"])
def test_parameter_sets(case: Json) -> None:
    found = merged(case["parameters"], case["specification"])
    assert found == case["merged"]
    kinds = {name: type(value) for name, value in found.items()}
    assert kinds == {name: type(value) for name, value in case["merged"].items()}


def test_every_kind_of_the_schema_has_vectors() -> None:
    cases = [*VECTORS["controllers"], *VECTORS["parameter_sets"]]
    counts = Counter(case["specification"]["kind"] for case in cases)
    schema = json.loads((PROTOCOL / "schemas" / "controller.schema.json").read_text(encoding="utf-8"))
    kinds = {kind["$ref"].rpartition("/")[2] for kind in schema["oneOf"]}
    assert counts.keys() == kinds - {"team"}  # whose agents have controllers of the other kinds
    assert min(counts.values()) >= 5, counts


def test_teams_are_as_the_schema_says() -> None:
    schema = json.loads((PROTOCOL / "schemas" / "controller.schema.json").read_text(encoding="utf-8"))
    network: Json = {"version": 1, "kind": "evostick", "sensors": 3, "actuators": 2}
    groups: list[Json] = [
        {"name": "leaders", "agents": 2, "controller": network},
        {"name": "others", "agents": None, "controller": network},
    ]
    team = swarmwright.Controller({"version": 1, "kind": "team", "groups": groups, "weights": [0.5] * 16})
    written = json.loads(team.json)
    assert [group["name"] for group in written["groups"]] == ["leaders", "others"]
    jsonschema.validate(written, schema)
    for wrong in ({**written, "groups": []}, {**written, "groups": [{**groups[0], "controller": written}]}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, schema)
