"""protocol/vectors/samples.json is what a separate implementation makes, and its messages fit the schemas."""

import base64
from typing import Any

import msgpack
import pytest

from tests.protocol import samples
from tests.protocol.conftest import PROTOCOL, Validators, vectors
from tests.protocol.test_extension import plain

VECTORS: list[dict[str, Any]] = vectors("samples.json")


def test_the_file_is_what_the_separate_implementation_makes() -> None:
    found = (PROTOCOL / "vectors" / "samples.json").read_text(encoding="utf-8")
    assert found == samples.text(), "run: python -m tests.protocol.samples > protocol/vectors/samples.json"


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: str(vector["name"]))
def test_messages_fit_their_schemas(vector: dict[str, Any], validators: Validators) -> None:
    message = plain(msgpack.unpackb(base64.b64decode(vector["bytes"])))
    validators("evaluate").validate(message)
    validators("sample").validate(message["sample"])


@pytest.mark.parametrize(
    "change",
    [{"seed": -1}, {"count": 1.5}, {"mirrored": 1}, {"center": [0.5]}, {"purpose": None}, {"first": "0"}],
    ids=lambda change: next(iter(change)),
)
def test_a_field_of_another_type_does_not_fit(change: dict[str, Any], validators: Validators) -> None:
    sample = dict(plain(samples.SAMPLE))
    validators("sample").validate(sample)
    assert not validators("sample").is_valid(sample | change)
    for name in change:
        del sample[name]
        assert not validators("sample").is_valid(sample)
