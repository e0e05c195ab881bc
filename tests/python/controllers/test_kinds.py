"""The lists of kinds of controller are those of the schema, with which the engine and Java compare theirs."""

import json
from pathlib import Path

import pytest

from swarmwright import _engine
from swarmwright.conformance._extensions import KINDS
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.testing._common import representation

PROTOCOL = Path(__file__).parents[3] / "protocol"
SCHEMA = json.loads((PROTOCOL / "schemas" / "controller.schema.json").read_text(encoding="utf-8"))
OF_SCHEMA = [kind["$ref"].rpartition("/")[2] for kind in SCHEMA["oneOf"]]
TEAM = OF_SCHEMA.pop()
"""Controllers of the other kinds, for groups of agents."""


def test_the_schema_names_every_kind_where_it_describes_them() -> None:
    assert TEAM == "team"
    for kind in [*OF_SCHEMA, TEAM]:
        assert SCHEMA["$defs"][kind]["properties"]["kind"]["const"] == kind
        assert kind in SCHEMA["properties"]["kind"]["description"]


def test_every_kind_has_a_representation_and_is_known_to_the_conformance_kit() -> None:
    assert set(OF_SCHEMA) <= set(REPRESENTATIONS.built_in)
    assert list(KINDS) == OF_SCHEMA


@pytest.mark.parametrize("name", sorted(REPRESENTATIONS.built_in))
def test_every_representation_makes_a_controller_of_the_engine(name: str) -> None:
    architecture = representation(name).architecture()
    assert _engine.genome_size(architecture) > 0
    for one in architecture.get("groups", [{"controller": architecture}]):  # those of a team
        assert one["controller"]["kind"] in OF_SCHEMA
