import json
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright.common.untrusted import escape_json, escape_line, escape_lines

# Much of what is drawn is what must not pass.
text = st.text(
    st.one_of(st.characters(), st.sampled_from("\n\r\t\x1b\x7f\x9b\u2028\u2029\u202e\u2066\u200f"))
)


def is_safe(shown: str) -> bool:
    return not any(
        unicodedata.category(one) in {"Cc", "Zl", "Zp"} or unicodedata.bidirectional(one) in DIRECTIONS
        for one in shown
    )


DIRECTIONS = {"LRE", "RLE", "PDF", "LRO", "RLO", "LRI", "RLI", "FSI", "PDI"}


@given(text=text)
def test_a_line_is_one_line_and_steers_nothing(text: str) -> None:
    shown = escape_line(text)
    assert is_safe(shown)
    assert shown.splitlines() in ([], [shown])
    assert escape_line(shown) == shown, "once is enough"
    assert "".join(one for one in text if escape_line(one) == one) == "".join(
        one for one in text if is_safe(one) and one not in "\u061c\u200e\u200f"
    ), "what is harmless is left as it is"


@given(text=text)
def test_lines_are_those_of_the_text(text: str) -> None:
    shown = escape_lines(text)
    assert len(shown) == text.removesuffix("\n").count("\n") + 1
    assert is_safe("".join(shown).replace("\t", ""))


@pytest.mark.slow
@given(value=st.recursive(text, lambda inner: st.lists(inner) | st.dictionaries(text, inner)))
def test_json_stays_the_same_json(value: object) -> None:
    for ascii_only in (False, True):
        shown = escape_json(json.dumps(value, ensure_ascii=ascii_only))
        assert is_safe(shown)
        assert json.loads(shown) == value


def test_what_it_looks_like() -> None:
    assert escape_line("a\nb\r\t\x1b[2J\x9b \u202e \u2028 é 😀") == r"a\nb\r\t\x1b[2J\x9b \u202e \u2028 é 😀"
    assert escape_lines("a\tb\n\x1b\n") == ["a\tb", r"\x1b"]
    assert escape_json('"\x9b\u202e\x7f"') == r'"\u009b\u202e\u007f"'
