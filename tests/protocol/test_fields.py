"""protocol/vectors/fields.json has every field of every schema, and its vectors agree with the schemas."""

import base64
import json
from typing import Any

import msgpack
import pytest

from tests.protocol import fields
from tests.protocol.conftest import PROTOCOL, Validators, vectors
from tests.protocol.test_extension import plain

VECTORS: list[dict[str, Any]] = vectors("fields.json")


def test_the_file_is_made_from_the_schemas() -> None:
    found = (PROTOCOL / "vectors" / "fields.json").read_text(encoding="utf-8")
    assert found == fields.text(), "run: python -m tests.protocol.fields > protocol/vectors/fields.json"


def test_there_is_a_message_for_every_schema() -> None:
    schemas = {path.name.removesuffix(".schema.json") for path in (PROTOCOL / "schemas").glob("*.json")}
    # Parts of evaluate, with vectors of their own.
    assert set(fields.MESSAGES) == schemas - {"controller", "sample"}


@pytest.mark.parametrize("name", fields.MESSAGES)
def test_complete_messages_have_every_field(name: str, validators: Validators) -> None:
    validators(name).validate(fields.decoded(name))
    for path, _ in fields.fields(fields.schema(name)):
        fields.at(fields.MESSAGES[name], path)


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: str(vector["name"]))
def test_a_vector_is_accepted_if_it_fits_its_schema_or_readers_are_lenient(
    vector: dict[str, Any], validators: Validators
) -> None:
    message, field = vector["name"].split(": ")
    value = (
        json.loads(vector["text"])
        if "text" in vector
        else plain(msgpack.unpackb(base64.b64decode(vector["bytes"])))
    )
    path = tuple(int(key) if key.isdigit() else key for key in field.split(" ")[0].split("."))
    fits = validators(message).is_valid(value)
    assert vector["accept"] == (fits or fields.is_lenient(message, path))
