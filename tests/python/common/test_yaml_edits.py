"""Changes of single values in YAML text, which keep everything else."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmwright import InputError, templates
from swarmwright.common import yaml
from swarmwright.common.yaml_edits import remove_value, set_value

COMMENTED = """\
# Head
simulation: minisim    # a title

method:                # evolves
  kind: nnga
  population: 50       # candidates
  # target: 0
ranking: {episodes: 1, aggregate: mean}   # flow
# the end
"""
METHOD = "                # evolves\n  kind: nnga\n  population: 50       # candidates\n"


@pytest.mark.parametrize(
    ("path", "value", "before", "after"),
    [
        (["method", "population"], 1000, "  population: 50       #", "  population: 1000     #"),
        (["simulation"], "a: b", "minisim    #", '"a: b"     #'),
        (["ranking", "episodes"], 10, "{episodes: 1,", "{episodes: 10,"),
        (["ranking", "quantile"], 0.5, "mean}", "mean, quantile: 0.5}"),
        (["method", "target"], -0.1, "# candidates\n", "# candidates\n  target: -0.1\n"),
        (["ranking"], {"kind": "x"}, "{episodes: 1, aggregate: mean} ", "{kind: x}                      "),
        (["validate", "episodes"], 5, "# flow\n", "# flow\n\nvalidate:\n  episodes: 5\n"),
        (["method"], "my", f"method:{METHOD}", "method: my                # evolves\n"),
    ],
)  # fmt: skip
def test_a_value_is_set_and_everything_else_kept(
    path: list[str], value: Any, before: str, after: str
) -> None:
    assert COMMENTED.count(before) == 1
    assert set_value(COMMENTED, path, value) == COMMENTED.replace(before, after)


def test_a_new_key_follows_those_before_it() -> None:
    order = ["simulation", "controller", "method", "ranking"]
    text = set_value(COMMENTED, ["controller", "kind"], "layered", order)
    assert "# a title\n\ncontroller:\n  kind: layered\n\nmethod:" in text


@pytest.mark.parametrize(
    ("path", "gone"),
    [
        (["method", "population"], "  population: 50       # candidates\n"),
        (["ranking", "episodes"], "episodes: 1, "),
        (["ranking", "aggregate"], ", aggregate: mean"),
        (["simulation"], "simulation: minisim    # a title\n"),
        (["method"], f"method:{METHOD}"),
        (["nothing", "there"], ""),
        (["simulation", "there"], ""),
    ],
)
def test_a_key_is_removed_and_everything_else_kept(path: list[str], gone: str) -> None:
    assert remove_value(COMMENTED, path) == COMMENTED.replace(gone, "", 1)


@pytest.mark.parametrize(
    ("text", "path", "value", "result"),
    [
        ("", ["a", "b"], 1, "a:\n  b: 1\n"),
        ("# only a comment", ["a"], 1, "# only a comment\na: 1\n"),
        ("a:\n", ["a", "b"], 1, "a:\n  b: 1\n"),
        ("a:   # why\nc: 2", ["a", "b"], 1, "a:   # why\n  b: 1\nc: 2\n"),
        ("a:\n", ["a"], 1, "a: 1\n"),
        ("a: null\n", ["a", "b"], 1, "a: {b: 1}\n"),
        ("a: false\n", ["a", "b"], 1, "a: {b: 1}\n"),
        ("{}", ["a"], [1], "{a: [1]}\n"),
        ('{"a": 1}', ["b"], 2, '{"a": 1, b: 2}\n'),
        ("{a: 1,}\n", ["b"], 2, "{a: 1, b: 2,}\n"),
        ("a: 1\r\nb: 2\r\n", ["c"], 3, "a: 1\r\nb: 2\r\nc: 3\r\n"),
        ("\ufeffa: 1\n", ["a"], 2, "\ufeffa: 2\n"),
        ("a: |\n  x\n  y\n# c\nb: 1\n", ["a"], "z", "a: z\n# c\nb: 1\n"),
        ("a:   # list\n  - 1\n  - 2\nb: 1\n", ["a"], [3], "a: [3]   # list\nb: 1\n"),
        ("a:\n- x: 1\n", ["b"], 2, "a:\n- x: 1\nb: 2\n"),
        ("a: &x 1\nb: *x\n", ["b"], 2, "a: &x 1\nb: 2\n"),
        ("a: 'it''s'  # q\n", ["a"], "\x00 \u2028 !!python/x", 'a: "\\u0000 \\U00002028 !!python/x"  # q\n'),
        ("---\na: 1\n...\n", ["a"], 2, "---\na: 2\n...\n"),
    ],
)  # fmt: skip
def test_any_style_of_yaml_is_changed(text: str, path: list[str], value: Any, result: str) -> None:
    changed = set_value(text, path, value)
    if "\x00" not in str(value):
        assert changed == result
    here = yaml.parse(changed, "").values
    for key in path:
        here = here[key]
    assert here == value


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ("a: [1\n", ["a"]),
        ("a: 1\na: 2\n", ["a"]),
        ("- 1\n", ["a"]),
        ("5\n", ["a"]),
        ("a: &x {b: 1, d: 2}\nc: *x\n", ["c", "b"]),
        ("a: &x {b: 1, d: 2}\nc: *x\n", ["a", "b"]),
        ("a: !!python/object:os.system {b: 1}\n", ["a", "b"]),
        ("? [1, 2]\n: 1\na: 2\n", ["a"]),
    ],
)
def test_what_cannot_be_changed_is_refused(text: str, path: list[str]) -> None:
    with pytest.raises(InputError):
        set_value(text, path, 7)
    with pytest.raises(InputError):
        remove_value(text, path)


KEYS = st.sampled_from(["a", "b", "c d", "e.f", "true", "", "1", "x: y", "#", "{"])
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=6,
)


@st.composite
def documents(draw: st.DrawFn) -> str:
    """Return mappings in all styles, with comments and blank lines between and beside their keys."""

    def block(depth: int, indent: str) -> str:
        text = ""
        for key in draw(st.lists(KEYS, min_size=1, max_size=4, unique=True)):
            name = yaml.dump_flow(key)
            comment = draw(st.sampled_from(["", "   # c", "  # d: e"]))
            style = draw(st.sampled_from(["flow", "block", "list", "scalar", "empty"]))
            if style == "block" and depth < 3:
                text += f"{indent}{name}:{comment}\n{block(depth + 1, indent + '  ')}"
            elif style == "list":
                text += f"{indent}{name}:{comment}\n{indent}- 1\n{indent}- {{x: 2}}{comment}\n"
            elif style == "scalar":
                text += f"{indent}{name}: |\n{indent}  line\n\n{indent}   # in it\n"
            elif style == "empty":
                text += f"{indent}{name}:{comment}\n"
            else:
                text += f"{indent}{name}: {yaml.dump_flow(draw(PLAIN))}{comment}\n"
            text += draw(st.sampled_from(["", "", "\n", f"{indent}# between\n", "# left\n"]))
        return text

    return block(0, "")


@settings(max_examples=60, deadline=None)
@given(documents(), st.lists(KEYS, min_size=1, max_size=3), PLAIN)
def test_a_random_change_has_its_effect_alone(text: str, path: list[str], value: Any) -> None:
    comments = text.count("# between")
    changed = set_value(text, path, value)
    assert changed.count("# between") >= comments - text.count("- 1") - text.count(":\n")
    removed = remove_value(changed, path)
    here = yaml.parse(removed, "").values
    for key in path[:-1]:
        here = here.get(key, {}) if isinstance(here, dict) else {}
    assert path[-1] not in (here or {})


@pytest.mark.parametrize("name", templates.names())
def test_each_value_of_a_template_can_be_changed(name: str) -> None:
    text = templates.text(name)
    values = yaml.parse(text, name).values
    for section, entries in values.items():
        for key in entries if isinstance(entries, dict) else ():
            changed = set_value(text, [section, key], "changed")
            assert len(changed.splitlines()) == len(text.splitlines())
            assert changed.count("#") == text.count("#")


@pytest.mark.parametrize("text", ["---", "null", "~", "--- # nothing\n", "%YAML 1.2\n---\n"])
def test_a_text_that_is_empty_but_for_marks_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="must be a mapping"):
        set_value(text, ["simulation"], "minisim")
