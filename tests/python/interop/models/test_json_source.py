"""JSON with lines."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import InputError
from swarmwright.interop.models.json_source import parse, read

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
)


@pytest.mark.slow
@given(JSON)
def test_it_reads_what_json_reads(value: object) -> None:
    for indent in (None, 2, "\t"):
        assert parse(json.dumps(value, indent=indent), "x").values == value


def test_lines_and_places() -> None:
    source = parse('{\n "a": [1,\n  {"b": 2}]\n}', "x.json")
    assert source.lines[("a", 1, "b")] == 3
    assert source.locate(("a", 1, "b")) == "x.json:3: a[1].b: "


def test_duplicate_keys_are_collected() -> None:
    source = parse('{"a": 1,\n"a": 2}', "x.json")
    assert source.values == {"a": 1}
    assert source.problems == [(("a",), 2, "duplicate key in one object (first in line 1)")]


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("", "x:1: is not valid JSON: the text ends too early"),
        ('{"a":\n}', "x:2: .*'}' found, expected a value"),
        ('{"a": 1,}', "expected a key in quotation marks"),
        ("[1 2]", r"expected ',' or '\]'"),
        ("[1] 2", "unexpected text after the end"),
        ('["a\n"]', "Invalid control character"),
        ("[Infinity]", "Infinity is not a JSON number"),
        ("[1e999]", "too large"),
        ("[" * 200, "nesting is deeper than 100 levels"),
        ("[" + "1" * 2000 + "]", "the number is too long"),
    ],
)
def test_what_is_not_json(text: str, answer: str) -> None:
    with pytest.raises(InputError, match=answer):
        parse(text, "x")


def test_what_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="file not found"):
        read(tmp_path / "x.json")
    (tmp_path / "x.json").write_bytes(b'{"a":\n"\xff"}')
    with pytest.raises(InputError, match=r"x\.json:2: is not UTF-8"):
        read(tmp_path / "x.json")
