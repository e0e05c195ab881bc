"""JSON from elsewhere ends in one kind of error, also when it is nested deeply."""

import pytest

from swarmwright.common.json_text import loads


@pytest.mark.parametrize("text", ["[" * 100_000, "[" * 101 + "]" * 101, '{"a":' * 101 + "1" + "}" * 101])
def test_deep_nesting_is_a_value_error(text: str) -> None:
    with pytest.raises(ValueError, match="nested more than 100 deep"):
        loads(text)


def test_what_is_nested_less_is_read() -> None:
    assert loads(b'{"a": [1, {"b": [[], "[{"]}]}') == {"a": [1, {"b": [[], "[{"]}]}
    assert loads("[" * 100 + "]" * 100)
    assert len(loads("[" + ",".join(["[]"] * 5000) + "]")) == 5000
    with pytest.raises(ValueError, match="Expecting value"):
        loads("[1,]")
