from pathlib import Path
from typing import Any

from swarmwright.analysis.groups import differing_keys, group
from swarmwright.analysis.labels import abbreviations, labels_of
from swarmwright.common.values import flatten
from tests.python.analysis.runs import KnownRun

FORMULAS = [
    "arrived - 0.1 * distance - 0.01 * steps",
    "arrived - 0.1 * distance - 0.5 * steps",
    "arrived - 0.1 * distance",
]


def test_long_values_show_the_part_that_differs(tmp_path: Path) -> None:
    assert labels_of([{"fitness": one} for one in FORMULAS]) == [
        "fitness arrived … 0.01 * steps",
        "fitness arrived … 0.5 * steps",
        "fitness arrived - 0.1 * distance",
    ]
    layers = [[20] * 8, [*[20] * 7, 5]]
    groups, _ = group(
        [
            KnownRun(tmp_path / f"layers-{number}", [[1.0]], controller={"kind": "layered", "hidden": hidden})
            for number, hidden in enumerate(layers)
        ]
    )
    assert [one.label for one in groups] == ["hidden [20, 20, … 20]", "hidden [20, 20, … 5]"]


def test_long_values_that_differ_at_once_lose_their_end() -> None:
    assert labels_of([{"fitness": "distance + arrived / steps * 3"}, {"fitness": "arrived"}]) == [
        "fitness distance + arrived / st…",
        "fitness arrived",
    ]


def test_short_forms_of_different_texts_are_different() -> None:
    names = [f"/home/me/experiments/with/long/names/{letter}.yaml" for letter in "abc"]
    assert abbreviations(names)[names[1]] == "/home/me … b.yaml"
    pairs = [f"{'x' * 40} {first} {'y' * 40} {second}" for first in (1, 2) for second in (1, 2)]
    chains = ["a" * length for length in range(20, 900, 7)]
    cyclic = ["ab " * length for length in range(8, 60)]
    for texts in (names, pairs, chains, cyclic):
        assert len(set(abbreviations(texts).values())) == len(texts)


def test_values_of_two_types_that_are_written_alike_are_told_apart() -> None:
    assert labels_of([{"parameters.level": 1}, {"parameters.level": "1"}]) == ["level 1", 'level "1"']
    kinds = [[{"name": "scout", "count": 3, "radius": radius}] for radius in (0.1, 0.2)]
    first, second = labels_of([{"parameters.robots": kind} for kind in kinds])
    assert first != second


def test_mappings_are_named_by_their_keys_or_by_the_values_that_differ() -> None:
    steps = {"steps": {"range": [0, 12], "bins": 6}}
    finer = {"steps": {"range": [0, 12], "bins": 9}}
    both = {**steps, "distance": {"range": [0, 30]}}
    assert labels_of([{"method.measures": one} for one in (steps, both)]) == [
        "measures steps",
        "measures steps, distance",
    ]
    assert labels_of([{"method.measures": one} for one in (steps, finer)]) == [
        "measures steps.bins 6",
        "measures steps.bins 9",
    ]
    assert labels_of([{"method.measures": {}}, {"method.measures": steps}])[0] == "measures {}"


def test_labels_leave_out_what_tells_no_variant_from_others_of_its_kind() -> None:
    evostick = {"method.kind": "evostick", "method.evaluations": 300, "method.population": 20}
    narrow, wide = ({"method.kind": "cma_es", "method.evaluations": 300, "method.step": at} for at in (1, 2))
    assert labels_of([evostick, narrow, wide]) == ["evostick", "cma_es, step 1", "cma_es, step 2"]
    # A value that only some set is told, and so is what others of the kind lack.
    often = {**evostick, "ranking.reevaluate": True}
    assert labels_of([evostick, often]) == [
        "evostick, evaluations 300, population 20",
        "evostick, evaluations 300, population 20, reevaluate true",
    ]
    assert labels_of([narrow, wide, often]) == [
        "cma_es, step 1",
        "cma_es, step 2",
        "evostick, reevaluate true",
    ]
    less = {key: value for key, value in evostick.items() if key != "method.population"}
    assert labels_of([evostick, {**less, "method.elites": 3}]) == ["population 20", "elites 3"]
    assert labels_of([evostick]) == ["evostick, evaluations 300, population 20"]


def test_an_option_is_told_where_others_may_have_its_kind_from_the_file() -> None:
    groups: list[dict[str, Any]] = [
        {"method.kind": "cma_es", "method.step": 0.5},
        {"method.population": 20},
        {"method.population": 50},
    ]
    whole = ["cma_es, step 0.5", "population 20", "population 50"]
    assert labels_of(groups) == whole
    for kind, labels in (("cma_es", whole), ("nnga", ["cma_es", *whole[1:]])):
        assert labels_of(groups, [{"method.kind": kind, **one} for one in groups]) == labels


def test_nested_options_are_those_of_the_method() -> None:
    measures = {"speed": {"range": [0, 1], "bins": 5}}
    elites, others = (
        [
            {"kind": "map_elites", "measures": measures, "evaluations": 9},
            {"kind": "map_elites", "measures": measures, "evaluations": 12},
        ],
        {"kind": "nnga", "population": 4},
    )
    flattened = [flatten({"method": one}) for one in (*elites, others)]
    assert differing_keys(flattened) == [
        ["method.kind", "method.evaluations"],
        ["method.kind", "method.evaluations"],
        ["method.kind"],
    ]
