"""The lists of kinds of controller are those of the schema, with which the engine and Java compare theirs."""

import json
from dataclasses import fields
from pathlib import Path

import pytest

import swarmwright
from swarmwright import _engine
from swarmwright.conformance._controller_kinds import KINDS as TRIED_KINDS
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.controllers.kinds import KINDS, Kind, import_part
from swarmwright.testing._common import representation

PACKAGE = Path(swarmwright.__file__).parent
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
    # NEAT's representation makes controllers of two kinds.
    assert {*OF_SCHEMA} - {"growing"} <= set(REPRESENTATIONS.built_in)
    assert list(TRIED_KINDS) == OF_SCHEMA


@pytest.mark.parametrize("name", sorted(REPRESENTATIONS.built_in))
def test_every_representation_makes_a_controller_of_the_engine(name: str) -> None:
    architecture = representation(name).architecture()
    assert _engine.genome_size(architecture) > 0
    for one in architecture.get("groups", [{"controller": architecture}]):  # those of a team
        assert one["controller"]["kind"] in OF_SCHEMA


@pytest.mark.parametrize("name", sorted(KINDS))
def test_every_part_of_a_kind_can_be_imported(name: str) -> None:
    kind = KINDS[name]
    for field in fields(Kind):
        if field.type is str and getattr(kind, field.name):
            assert callable(import_part(getattr(kind, field.name))), field.name


@pytest.mark.parametrize("name", ["evostick", "fully_meshed", "growing", "hebbian", "neat"])
def test_a_kind_is_known_in_the_folders_of_kinds_alone(name: str) -> None:
    """What else needs something of a kind asks its entry of `KINDS`."""
    kinds = PACKAGE / "controllers" / "kinds"
    named = [
        file
        for room in ("common", "controllers", "display", "export", "runs", "servers")
        for file in (PACKAGE / room).rglob("*.py")
        if f'"{name}"' in file.read_text(encoding="utf-8") and not file.is_relative_to(kinds)
    ]
    assert not named
