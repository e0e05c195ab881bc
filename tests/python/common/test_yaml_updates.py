"""New values in YAML text, which keeps its comments."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import templates
from swarmwright.common.yaml import dump, parse
from swarmwright.common.yaml_edits import update_text

COMMENTED = """\
# Two spots.
title: Chain   # a title
floor:
  # the patches
  patches:
    # the nest
    - {name: nest, radius: 2.0e-1} # west
    - {name: source}
    - {name: third}
metrics:
  chain:   # from nest to source
    kind: chain_reach
    link: 0.3  # metres

# 1 is a chain.
fitness: chain
# the end
"""
VALUES: dict[str, Any] = parse(COMMENTED, "text").values
NEST, SOURCE, THIRD = VALUES["floor"]["patches"]


@pytest.mark.parametrize(
    ("changes", "before", "after"),
    [
        ({}, "", ""),
        ({"title": "a: b"}, "title: Chain   #", 'title: "a: b"  #'),
        ({"floor": {"patches": [{**NEST, "radius": 1e-5}, SOURCE, THIRD]}}, "2.0e-1", "1.0e-05"),
        ({"metrics": {"chain": {"kind": "chain_reach", "link": 1}}}, "link: 0.3 ", "link: 1   "),
        (
            {"floor": {"patches": [NEST, SOURCE, {"name": "new", "at": [0, 1]}, THIRD]}},
            "    - {name: third}",
            "    - {name: new, at: [0, 1]}\n    - {name: third}",
        ),
        ({"floor": {"patches": [NEST, THIRD]}}, "    - {name: source}\n", ""),
        ({"robots": {"a": {"b": "yes"}}}, "# the end\n", '# the end\nrobots:\n  a:\n    b: "yes"\n'),
    ],
)
def test_comments_stay(changes: dict[str, Any], before: str, after: str) -> None:
    text = update_text(COMMENTED, {**VALUES, **changes})
    assert text == COMMENTED.replace(before, after)
    assert parse(text, "text").values == {**VALUES, **changes}


@pytest.mark.parametrize("name", templates.missions())
def test_missions_keep_their_comments(name: str) -> None:
    text = templates.mission(name)
    values = parse(text, "text").values
    assert update_text(text, values) == text
    changed = update_text(text, {**values, "obstacles": [{"center": [0, 0], "size": [1, 2]}], "robots": 3})
    assert [line for line in text.splitlines() if "#" in line and "robots" not in line] == [
        line for line in changed.splitlines() if "#" in line and "robots" not in line
    ]


@pytest.mark.parametrize(
    "text", ["", "a: [", "- 1", "a: &x {b: 1}\nc: *x", "<<: {a: 1}", "a: 1\na: 2", "a: 1\r\nb: 2"]
)
def test_other_texts_give_way(text: str) -> None:
    values = {"a": {"b": 2}, "c": {"b": 1}, "b": [1]}
    assert parse(update_text(text, values), "text").values == values


PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-9, 9)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abc"), inner, max_size=3),
    max_leaves=8,
)


@given(
    old=st.dictionaries(st.sampled_from("abc"), PLAIN, max_size=3),
    new=st.dictionaries(st.sampled_from("abc"), PLAIN, max_size=3),
)
def test_the_values_are_the_new_ones(old: dict[str, Any], new: dict[str, Any]) -> None:
    assert parse(update_text(dump(old), new), "text").values == parse(dump(new), "text").values
