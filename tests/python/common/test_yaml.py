"""Experiment files are YAML 1.2, read without surprises and with line numbers."""

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import InputError
from swarmwright.common.yaml import dump, format_path, parse, read

SCALARS = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text(st.characters(codec="utf-8"))
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.text("abc:#- '", min_size=1, max_size=6), inner, max_size=4)
    ),
    max_leaves=12,
)


@pytest.mark.slow
@given(st.dictionaries(st.text("abcdefgh", min_size=1, max_size=8), VALUES, max_size=5))
def test_what_is_written_is_read_back(values: dict[str, Any]) -> None:
    source = parse(dump(values), "x.yaml")
    assert source.problems == []
    assert (source.values or {}) == values


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("1.5E+3", 1500.0),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        ("12", 12),
        ("-0x1F", -31),
        ("0o17", 15),
        ("0.33", 0.33),
        ("true", True),
        ("~", None),
        ("yes", "yes"),
        ("off", "off"),
        ("2026-01-01", "2026-01-01"),
        ("'50'", "50"),
        ("1.2.3", "1.2.3"),
    ],
)
def test_scalars(text: str, value: object) -> None:
    found = parse(f"key: {text}\n", "x.yaml").values["key"]
    assert found == value
    assert type(found) is type(value)


def test_long_words_are_written_at_once() -> None:
    values = {"simulation": "swarmwright.simulations.mujoco._robots:Quadrotors" + "a" * 200 + "!"}
    assert parse(dump(values), "x.yaml").values == values


def test_lines_of_keys_and_items() -> None:
    source = parse("a: 1\nb:\n  c:\n    - 1\n    - {d: 2,\n       e: 3}\n", "x.yaml")
    assert source.lines[("a",)] == 1
    assert source.lines[("b", "c", 0)] == 4
    assert source.lines[("b", "c", 1, "e")] == 6
    assert source.locate(("b", "c", 1, "e")) == "x.yaml:6: b.c[1].e: "
    # A key that is missing stands where its mapping stands.
    assert source.locate(("b", "missing")) == "x.yaml:2: b.missing: "


def test_all_duplicates_are_found_with_both_lines() -> None:
    source = parse("a: 1\nb: {x: 1, x: 2}\na: 3\n", "x.yaml")
    assert [(path, line) for path, line, _ in source.problems] == [(("b", "x"), 2), (("a",), 3)]
    assert "first in line 1" in source.problems[1][2]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a: [1, 2\nb: 3\n", 2),
        ("a: 'open\n", 2),
        ("a: 1\n\tb: 2\n", 2),
        ("a: b: c\n", 1),
        ("a: @x\n", 1),
    ],
)
def test_what_is_no_yaml_is_said_with_its_line(text: str, line: int) -> None:
    with pytest.raises(InputError, match=rf"^x\.yaml:{line}: is not valid YAML: "):
        parse(text, "x.yaml")


@pytest.mark.parametrize(
    "text",
    [
        "method:\n\tkind: nnga\n",
        "a: 1\n\tb: 2\n",
        "a:\n  b: 1\n  \tc: 2\n",
        "-\t- a\n",
        "-\ta: 1\n",
        "a: text\n\tover two lines\n",
    ],
)
def test_a_tab_is_answered_with_how_to_indent(text: str) -> None:
    line = text.rstrip().count("\n") + 1
    with pytest.raises(InputError, match=rf"^x\.yaml:{line}: .* indent YAML with spaces$"):
        parse(text, "x.yaml")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("seed: 5\t# a tab before this comment\n", {"seed": 5}),
        ("seed:\t5\n\t\n\t# a comment\nepisodes: 3\t\n", {"seed": 5, "episodes": 3}),
        ("a: two\twords\n  \tand more\n", {"a": "two\twords and more"}),
        ("a: |\t# a comment\n  text\n", {"a": "text\n"}),
        ("a:\n  -\t1\n  - [\t2,\n\t3 ]\n", {"a": [1, [2, 3]]}),
        ("\t{a: 1}\n", {"a": 1}),
        ("%YAML 1.3\n---\na: 1\n", {"a": 1}),
        ("%YAML\t1.1 # old\n---\na: yes\n", {"a": "yes"}),
        ("%UNKNOWN directive\n%TAG !e! tag:example.com,2000:\n---\na: 1\n", {"a": 1}),
        ("# nothing\n...\n", None),
        ("...\n---\na: 1\n...\n", {"a": 1}),
        ('{"a":1, "b"\n  : 2, c\n : 3, d: e:f}\n', {"a": 1, "b": 2, "c": 3, "d": "e:f"}),
        ("{a: !!str, !!str b: !!str 1}\n", {"a": "", "b": "1"}),
        ("a: ! 12\n", {"a": "12"}),
        ("a: >\n \n  \n  text\n", {"a": "\n\ntext\n"}),
        ("a: |\n  text", {"a": "text\n"}),
        ("a: |-\n  text", {"a": "text"}),
        ("[&a 1, &a 2, *a]\n", [1, 2, 2]),
        ('a: "\\ud83d\\ude80"\n', {"a": "\U0001f680"}),
    ],
)
def test_what_yaml_1_2_allows_is_read(text: str, value: object, recwarn: pytest.WarningsRecorder) -> None:
    source = parse(text, "x.yaml")
    assert (source.values, source.problems) == (value, [])
    assert not recwarn.list


def test_keys_of_one_pair_in_a_list() -> None:
    assert parse('["a":1, b: 2, ?c, :d]\n', "x.yaml").values == [{"a": 1}, {"b": 2}, "?c", ":d"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("%YAML 2.0\n---\na: 1\n", "1: .*%YAML 2.0: only YAML 1.2 is supported"),
        ("%YAML\n---\na: 1\n", "1: .*expected a version after %YAML, such as %YAML 1.2"),
        ("%YAML 1.2 1.2\n---\na: 1\n", "1: .*expected a version"),
        ("%TAG !e!\n---\na: 1\n", "1: .*expected a handle and a prefix"),
        ("% \n---\na: 1\n", "1: .*expected the name of a directive"),
        ("a: 1\nb: 'x'#no comment\n", "2: .*a comment needs a space"),
        ("a: [-]\n", "1: .*cannot start any token"),
        ("a: !<x y\n", "1: .*expected a tag, such as !<tag"),
        ("a: !x{} y\n", "1: .*expected a space after a tag, but found '{'"),
        ("a: |0\n  b\n", "1: .*the indentation, 1 to 9, but found '0'"),
        ("a: | b\n", "1: .*the text begins in the next"),
        ("a: |\n    \n  b\n", "3: .*blank lines before this one have more spaces"),
        ('a: "\\UFFFFFFFF"\n', "1: .*expected the number of a character"),
        ('a: "\\U00110000"\n', "1: .*expected the number of a character"),
    ],
)
def test_what_yaml_1_2_does_not_allow_is_said(text: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"^x\.yaml:{words}"):
        parse(text, "x.yaml")


@pytest.mark.parametrize(
    ("number", "words"),
    [
        ("0x" + "F" * 5000, "more than 1000 characters"),
        ("0b" + "1" * 5000, "more than 1000 characters"),
        ("9" * 5000, "more than 1000 characters"),
        ("1e999", "1e999 is too large for a number"),
    ],
)
def test_numbers_that_are_too_large_are_problems(number: str, words: str) -> None:
    source = parse(f"# a seed\nseed: {number}\n", "x.yaml")
    ((path, line, message),) = source.problems
    assert (path, line, source.values) == (("seed",), 2, {"seed": None})
    assert words in message
    assert len(message) < 100


@pytest.mark.parametrize("text", ['"\\ud83d": 1\n', 'a: "x\\ude00"\n'])
def test_half_a_character_is_a_problem(text: str) -> None:
    ((_, line, message),) = parse(text, "x.yaml").problems
    assert line == 1
    assert "half of a character" in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "simulation: gymnasium: CartPole-v1\n",
            "remove the space, as in gymnasium:CartPole-v1, put text",
        ),
        (
            "method:\n  kind: nnga\n population: 5\n",
            "keys of a mapping, .* must begin in the same column$",
        ),
    ],
)
def test_what_a_person_can_do_about_it_is_said(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse(text, "x.yaml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [*a]\n", "alias"),
        ("a: !!python/object/apply:os.system [ls]\n", "tag"),
        ("a: !foo bar\n", "tag"),
        ("? [1, 2]\n: 3\n", "key"),
    ],
)
def test_what_has_no_meaning_here_is_a_problem(text: str, words: str) -> None:
    source = parse(text, "x.yaml")
    assert any(words in message for _, _, message in source.problems)


def test_aliases_are_copies() -> None:
    assert parse("a: &x [1]\nb: *x\n", "x.yaml").values == {"a": [1], "b": [1]}


@pytest.mark.slow
def test_a_bomb_of_aliases_is_refused() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    with pytest.raises(InputError, match="more than 1000000 values"):
        parse("\n".join(lines), "x.yaml")


@pytest.mark.parametrize("text", ["[" * 5000, "a: " + "[" * 200 + "]" * 200])
def test_deep_nesting_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"nested too deeply|is not valid YAML"):
        parse(text, "x.yaml")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml: there is no such file"):
        read(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="is a folder"):
        read(tmp_path)
    (tmp_path / "binary.yaml").write_bytes(b"simulation: \xff\xfe")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read(tmp_path / "binary.yaml")


def test_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    (tmp_path / "windows.yaml").write_bytes(b"\xef\xbb\xbfsimulation: minisim\r\nseed: 3\r\n")
    assert read(tmp_path / "windows.yaml").values == {"simulation": "minisim", "seed": 3}


def test_dotted_paths() -> None:
    assert format_path(("a", "b", 0, "c")) == "a.b[0].c"
    assert format_path(()) == ""


def test_a_character_that_yaml_does_not_take_is_told_in_one_line() -> None:
    with pytest.raises(InputError) as caught:
        parse("a: 1\nb: x\0y\n", "x.yaml")
    assert str(caught.value) == "x.yaml:2: is not valid YAML: the character U+0000 is not allowed"


def test_utf16_and_a_second_document_are_named(tmp_path: Path) -> None:
    path = tmp_path / "e.yaml"
    path.write_bytes("simulation: minisim\n".encode("utf-16"))
    with pytest.raises(InputError, match=r"e\.yaml: is UTF-16 text; save it as UTF-8$"):
        read(path)
    with pytest.raises(InputError, match=r"^e:2: a second document begins here; only one is supported$"):
        parse("a: 1\n---\nb: 2\n", "e")
