"""Conditional parameters and forbidden combinations of parameter sets."""

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Experiment, InputError, optimize
from swarmwright.controllers.kinds.parameter_set import ParameterSet, ParameterSetOptions
from swarmwright.controllers.kinds.parameter_set.conditions import Condition, ConditionError, Variable
from swarmwright.methods import METHODS
from swarmwright.testing import check_representation
from tests.python.methods.needed import method_of

VARIABLES = {
    "algorithm": Variable(choices=["as", "mmas", "acs"], is_ordered=False),
    "level": Variable(choices=["low", "medium", "high"]),
    "flag": Variable(is_boolean=True),
    "ants": Variable(),
    "a.b": Variable(),
    "lambda": Variable(),
}
PARAMETERS: dict[str, dict[str, Any]] = {
    "algorithm": {"type": "categorical", "choices": ["as", "mmas", "acs"]},
    "ants": {"type": "integer", "range": [5, 100], "scale": "log", "when": "algorithm != 'as'"},
    "q0": {"type": "real", "range": [0, 1], "digits": 1, "when": "ants > 20 & algorithm == 'acs'"},
    "level": {
        "type": "ordinal",
        "choices": ["low", "medium", "high"],
        "inactive": "medium",
        "when": "q0 > 0.5",
    },
    "walls": {"type": "categorical", "choices": [True, False]},
}
FORBIDDEN = ["algorithm == 'mmas' and walls", "q0 == 0.3 or q0 == 0.4", "level == 'high' and ants <= 50"]


def parameter_set(
    parameters: Mapping[str, Any] = PARAMETERS, forbidden: list[str] = FORBIDDEN
) -> ParameterSet:
    options = ParameterSetOptions.model_validate({"parameters": parameters, "forbidden": forbidden})
    return ParameterSet(options, sensors=0, actuators=0)


def genomes_of(subject: ParameterSet, count: int, seed: int = 0) -> Any:
    return np.random.default_rng(seed).random((count, subject.genome_size)).astype(np.float32)


def holds(text: str, **values: float | None) -> bool:
    """Whether a condition holds; None is inactive."""
    columns = {name: np.array([math.nan if value is None else value]) for name, value in values.items()}
    return bool(Condition(text, VARIABLES).holds(columns)[0])


@pytest.mark.parametrize(
    ("text", "values", "expected"),
    [
        ('algorithm == "mmas"', {"algorithm": 1}, True),
        ('algorithm %in% c("as", "acs")', {"algorithm": 1}, False),
        ("algorithm in ['as', 'mmas']", {"algorithm": 1}, True),
        ("algorithm not in ['as', 'mmas']", {"algorithm": 2}, True),
        ("'acs' == algorithm", {"algorithm": 2}, True),
        ("level >= 'medium'", {"level": 2}, True),
        ("'medium' < level", {"level": 1}, False),
        ("ants > 10 and ants <= 20.5", {"ants": 20}, True),
        ("ants * 2 - 1 == 9", {"ants": 5}, True),
        ("ants == -5 + 10", {"ants": 5}, True),
        ("ants == 1e1L", {"ants": 10}, True),
        ("!ants == 10", {"ants": 10}, False),
        ("not flag", {"flag": 0}, True),
        ("flag == TRUE", {"flag": 1}, True),
        ("flag", {"flag": None}, False),
        ("a.b < 1", {"a.b": 0}, True),
        ("lambda > 1", {"lambda": 2}, True),
        ("`a.b` < 1", {"a.b": 1}, False),
        ("ants in [1, 2, 5]", {"ants": 5}, True),
        # Without a value, as R's NA.
        ("ants > 10", {"ants": None}, False),
        ("!(ants > 10)", {"ants": None}, False),
        ("ants > 10 | flag", {"ants": None, "flag": 1}, True),
        ("ants > 10 & flag", {"ants": None, "flag": 1}, False),
        ("!(ants > 10 & flag)", {"ants": None, "flag": 0}, True),
        ("!(ants %in% c(1, 2))", {"ants": None}, True),
        ("1 / ants > 5", {"ants": 0}, True),
    ],
)
def test_conditions_are_those_of_python_and_of_r(text: str, values: dict[str, Any], expected: bool) -> None:
    assert holds(text, **values) is expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected a parameter or a value in column 1, it ends there"),
        ("ants", "ants is neither true nor false"),
        ("ants > 'many'", "'many' is not a number"),
        ("antz > 1", "there is no parameter 'antz'; did you mean 'ants'"),
        ("algorithm == 'mmass'", "'mmass' is not a choice of algorithm; did you mean 'mmas'"),
        ("algorithm > 'as'", "algorithm has no order"),
        ("algorithm == ants", "algorithm can only be compared with its choices"),
        ("flag == 3", "flag can only be compared with true and false"),
        ("ants > 1 ants", "expected an operator in column 10, not 'ants'"),
        ("(ants > 1", "expected ')' in column 10"),
        ("ants in []", "expected a parameter or a value"),
        ("ants <> 1", "expected a parameter or a value in column 7"),
        ("ants = 1", "unexpected '=' in column 6"),
        ("__import__('os')", "there is no parameter '__import__'"),
        ("ants > 1e999", "too large"),
        ("(" * 500 + "flag" + ")" * 400, "nested too deeply"),
        ("ants > " + "-" * 900 + "1", "nested too deeply"),
        ("flag & " * 300 + "flag", "at most 1000"),
        ("algorithm + 1 > 2", "algorithm is not a number"),
    ],
)
def test_wrong_conditions_are_refused(text: str, words: str) -> None:
    with pytest.raises(ConditionError) as error:
        Condition(text, VARIABLES)
    assert words in str(error.value)


@given(st.text(alphabet="antsflgCc()[]!&|=<>+-*/'\"`., 0159einotrd%\n#é", max_size=40))
def test_any_text_is_a_condition_or_refused(text: str) -> None:
    try:
        condition = Condition(text, VARIABLES)
    except ConditionError:
        return
    columns = {name: np.zeros(3) for name in VARIABLES}
    assert condition.holds(columns).shape in ((3,), ())


_ATOMS = st.sampled_from(
    [
        ("ants > 10", lambda v: None if v["ants"] is None else v["ants"] > 10),
        ("flag", lambda v: None if v["flag"] is None else v["flag"] == 1),
        ("algorithm == 'as'", lambda v: None if v["algorithm"] is None else v["algorithm"] == 0),
        ("algorithm %in% c('as', 'acs')", lambda v: v["algorithm"] in (0, 2)),
    ]
)


def _extend(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    def negate(part: Any) -> Any:
        text, value = part
        return f"!({text})", lambda v: None if (r := value(v)) is None else not r

    def join(parts: Any) -> Any:
        (first, one), (second, other), both = parts

        def value(v: Any) -> Any:
            results = one(v), other(v)
            decisive = not both
            if decisive in results:
                return decisive
            return None if None in results else both

        return f"({first}) {'&' if both else '|'} ({second})", value

    return st.one_of(inner.map(negate), st.tuples(inner, inner, st.booleans()).map(join))


@given(st.recursive(_ATOMS, _extend, max_leaves=6))
def test_logic_has_three_values_as_in_r(part: Any) -> None:
    text, value = part
    for ants, flag, algorithm in itertools.product((None, 5, 20), (None, 0, 1), (None, 0, 1, 2)):
        values = {"ants": ants, "flag": flag, "algorithm": algorithm}
        assert holds(text, **values) is (value(values) is True)


def test_it_conforms() -> None:
    check_representation("parameter_set", {"parameters": PARAMETERS, "forbidden": FORBIDDEN})


def test_inactive_parameters_have_a_constant_value() -> None:
    subject = parameter_set(forbidden=[])
    algorithm, ants, q0, level, _ = subject.weights(genomes_of(subject, 5000)).T
    active = algorithm > 0
    assert (ants[~active] == 5).all()
    assert len(np.unique(ants[active])) > 50
    conditional = active & (ants > 20) & (algorithm == 2)
    assert (q0[~conditional] == 0).all()
    assert {*np.unique(q0[conditional])} == {np.float32(tenth / 10) for tenth in range(11)}
    assert (level[~(conditional & (q0 > 0.5))] == 1).all()
    assert {*level[conditional & (q0 > 0.55)]} == {0, 1, 2}


def test_forbidden_combinations_do_not_occur() -> None:
    subject = parameter_set()
    genomes = genomes_of(subject, 20000)
    values, free = subject.weights(genomes), parameter_set(forbidden=[]).weights(genomes)
    algorithm, ants, q0, level, walls = values.T
    assert not ((algorithm == 1) & (walls == 1)).any()
    assert not np.isin(q0, np.array([0.3, 0.4], dtype=np.float32)).any()
    assert not ((level == 2) & (ants <= 50)).any()
    changed = (values != free).any(axis=1)
    assert 0.1 < changed.mean() < 0.5
    # Values beside the conditions stay.
    mmas = changed & (free[:, 0] == 1)
    assert (values[mmas & (algorithm == 1), 1] == free[mmas & (algorithm == 1), 1]).all()
    # All that is allowed is still reached.
    assert {(0, 1), (0, 0), (1, 0), (2, 0), (2, 1)} == {*zip(algorithm.tolist(), walls.tolist(), strict=True)}


def test_values_depend_on_the_genome_alone() -> None:
    subject = parameter_set()
    genomes = genomes_of(subject, 300)
    values = subject.weights(genomes)
    assert (subject.weights(genomes[::-1]) == values[::-1]).all()
    for genome, expected in zip(genomes, values, strict=True):
        assert (subject.weights(genome) == expected).all()
    assert (parameter_set().weights(genomes) == values).all()


def test_a_rare_allowed_combination_is_used_if_none_is_drawn() -> None:
    parameters = {name: {"type": "integer", "range": [0, 999]} for name in ("x", "y")}
    subject = parameter_set(parameters, ["x != y + 1 & !(x < 100)"])
    x, y = subject.weights(genomes_of(subject, 500)).T
    assert ((x < 100) | (x == y + 1)).all()


@pytest.mark.parametrize(
    ("changes", "forbidden", "words"),
    [
        (
            {"ants": {"when": "q0 > 1"}},
            [],
            "parameters.q0.when: conditions depend on .* circle: ants -> q0 -> ants",
        ),
        ({"ants": {"when": "ants > 1"}}, [], "circle: ants -> ants"),
        (
            {"ants": {"when": "algoritm == 'as'"}},
            [],
            "parameters.ants.when: there is no parameter 'algoritm'",
        ),
        ({"ants": {"inactive": 101}}, [], "inactive: must be in the range"),
        ({"ants": {"inactive": 5.5}}, [], "inactive: must be a whole number"),
        ({"level": {"inactive": "lowest"}}, [], "inactive: must be one of the choices"),
        ({}, ["walls > 1"], r"forbidden\[0\]: walls can only be compared"),
        (
            {},
            ["ants > 0 | !(ants > 0) | algorithm == 'as'", "walls | !walls"],
            "random combinations are forbidden",
        ),
        ({"ants": {"when": ""}}, [], "when"),
    ],
)
def test_mistakes_are_reported(changes: dict[str, Any], forbidden: list[str], words: str) -> None:
    parameters = {name: {**PARAMETERS[name], **changes.get(name, {})} for name in PARAMETERS}
    with pytest.raises((InputError, ValueError), match=words):
        parameter_set(parameters, forbidden)


def test_a_long_chain_of_conditions_is_resolved() -> None:
    first = {"x0": {"type": "real", "range": [0, 1]}}
    chain = {
        f"x{number}": {"type": "real", "range": [0, 1], "when": f"x{number - 1} > 0.01"}
        for number in range(1, 3000)
    }
    subject = parameter_set(dict(reversed([*first.items(), *chain.items()])), [])
    (values,) = subject.weights(np.full((1, 3000), 0.5, dtype=np.float32))
    assert (values == 0.5).all()
    (values,) = subject.weights(np.zeros((1, 3000), dtype=np.float32))
    assert (values == 0).all()


RULE: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"steering": "rule", "placement": "random", "numAgents": 3, "numDefenders": 3},
    "controller": {
        "kind": "parameter_set",
        "parameters": {
            "evasion": {"type": "categorical", "choices": ["away", "left", "right"]},
            "avoidance": {"type": "real", "range": [0, 5], "when": "evasion != 'away'"},
            "avoidanceRadius": {"type": "real", "range": [0.5, 8], "scale": "log"},
        },
        "forbidden": ["avoidance < 2 and avoidanceRadius < 2"],
    },
    "ranking": {"episodes": 2},
    "servers": "in-process",
}


@pytest.mark.parametrize("kind", ["de", "nnga", "nsga2", "racing", "cea2d", "random_search"])
def test_every_method_evolves_allowed_values(kind: str, tmp_path: Path) -> None:
    options = {"objectives": {"steps": "minimize"}} if kind == "nsga2" else {}
    method = {"kind": kind, **options, "evaluations": 120}
    experiment = Experiment.from_mapping({**RULE, "method": method})
    run = optimize(experiment, out=tmp_path / "run")
    evasion, avoidance, radius = experiment.representation().weights(run.record.genomes).T
    assert not ((evasion != 0) & (avoidance < 2) & (radius < 2)).any()
    assert (avoidance[evasion == 0] == 0).all()
    assert kind in METHODS.names()
    values = run.best.controller.parameters
    assert values["evasion"] != "away" or values["avoidance"] == 0


@pytest.mark.slow
def test_servers_do_not_matter(tmp_path: Path) -> None:
    experiment = Experiment.from_mapping({**RULE, "method": method_of("de", population=20, generations=5)})
    whole = optimize(experiment, out=tmp_path / "whole")
    for servers in (1, 3):
        assert optimize(experiment, servers=servers, out=tmp_path / str(servers)).digest == whole.digest
