"""Parameter sets: what genes stand for, and how they vary."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Controller, InputError
from swarmwright.common.arrays import shortest
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.kinds.parameter_set import ParameterSet, ParameterSetOptions, _power
from swarmwright.testing import check_representation

SEEDS = st.integers(0, 2**63)
ONE_OF_EACH: dict[str, dict[str, Any]] = {
    "avoidance": {"type": "real", "range": [0, 5]},
    "gain": {"type": "real", "range": [0.001, 10], "scale": "log"},
    "hops": {"type": "integer", "range": [1, 10]},
    "size": {"type": "integer", "range": [1, 1000], "scale": "log"},
    "strategy": {"type": "categorical", "choices": ["wait", "go", "ask"]},
}
OF_NUMBERS: dict[str, dict[str, Any]] = {
    "gear": {"type": "categorical", "choices": [1, 2, 4]},
    "share": {"type": "categorical", "choices": [0.1, 1]},
    "walls": {"type": "categorical", "choices": [True, False]},
}


def parameter_set(parameters: dict[str, dict[str, Any]]) -> ParameterSet:
    return ParameterSet(
        ParameterSetOptions.model_validate({"parameters": parameters}), sensors=4, actuators=1
    )


def decoded(parameter: dict[str, Any], *genes: float) -> list[float]:
    subject = parameter_set({"x": parameter})
    return shortest(subject.weights(np.array(genes, dtype=np.float32)[:, np.newaxis]).ravel())


@pytest.mark.parametrize(
    "parameters",
    [ONE_OF_EACH, OF_NUMBERS, *({name: one} for name, one in ONE_OF_EACH.items())],
    ids="-".join,
)
def test_it_conforms(parameters: dict[str, Any]) -> None:
    check_representation("parameter_set", {"parameters": parameters})


def test_genes_become_values() -> None:
    assert decoded({"type": "real", "range": [-1, 3]}, 0, 0.25, 0.5, 1) == [-1, 0, 1, 3]
    assert decoded({"type": "real", "range": [0.1, 0.3]}, 0, 1) == [0.1, 0.3]
    magnitudes = {"type": "real", "range": [0.01, 100], "scale": "log"}
    assert decoded(magnitudes, 0, 0.25, 0.5, 1) == [0.01, 0.1, 1, 100]
    assert decoded({"type": "integer", "range": [1, 4]}, 0, 0.24, 0.25, 0.5, 0.75, 1) == [1, 1, 2, 3, 4, 4]
    # 1 is as wide as 2 and 3 together, and as 4 to 7.
    assert decoded({"type": "integer", "range": [1, 7], "scale": "log"}, 0, 0.33, 0.34, 0.66, 0.67, 1) == [
        1, 1, 2, 3, 4, 7,
    ]  # fmt: skip
    assert decoded({"type": "categorical", "choices": ["a", "b"]}, 0, 0.49, 0.5, 1) == [0, 0, 1, 1]
    assert decoded({"type": "real", "range": [0, 1]}, -3, 7) == [0, 1]
    # Of choices that are no texts, the value is the weight.
    assert decoded({"type": "categorical", "choices": [4, 1, 16]}, 0, 0.34, 0.67, 1) == [4, 1, 16, 16]
    assert decoded({"type": "categorical", "choices": [0.1, -3]}, 0, 1) == [0.1, -3]
    assert decoded({"type": "categorical", "choices": [True, False]}, 0, 1) == [1, 0]


@given(st.integers(-(2**24), 2**24 - 1), st.integers(1, 2**10), st.floats(0, 1, width=32))
def test_integers_are_exact_and_within_their_range(low: int, count: int, gene: float) -> None:
    high = min(low + count, 2**24)
    (value,) = decoded({"type": "integer", "range": [low, high]}, gene)
    assert value == int(value)
    assert low <= value <= high


@given(st.floats(-126, 126), st.floats(0, 1, width=32))
def test_powers_are_right_to_the_last_bits(logarithm: float, gene: float) -> None:
    (found,) = _power(np.array([gene], dtype=np.float64), logarithm)
    expected = 2.0 ** float(Fraction(gene * logarithm))
    assert math.isclose(found, expected, rel_tol=4e-16)


def test_the_specification_says_what_the_simulation_gets() -> None:
    subject = parameter_set(ONE_OF_EACH)
    specification = subject.specification(np.array([0.5, 0.5, 0.5, 0.5, 0.5], dtype=np.float32))
    assert specification == {
        "version": 1,
        "kind": "parameter_set",
        "parameters": [
            {"name": "avoidance", "type": "real"},
            {"name": "gain", "type": "real"},
            {"name": "hops", "type": "integer"},
            {"name": "size", "type": "integer"},
            {"name": "strategy", "type": "categorical", "choices": ["wait", "go", "ask"]},
        ],
        "weights": [2.5, 0.1, 6, 31, 1],
    }
    controller = Controller(specification)
    assert controller.parameters == {"avoidance": 2.5, "gain": 0.1, "hops": 6, "size": 31, "strategy": "go"}
    assert (controller.sensors, controller.actuators) == (0, 0)
    assert "'hops': 6" in repr(controller)
    with pytest.raises(InputError, match="a parameter set steers no agents"):
        controller([0, 0, 0, 0])


def test_choices_that_are_no_texts_are_sent_as_numbers() -> None:
    subject = parameter_set(OF_NUMBERS)
    specification = subject.specification(np.array([0.9, 0.1, 0.1], dtype=np.float32))
    assert [one["type"] for one in specification["parameters"]] == ["integer", "real", "integer"]
    assert Controller(specification).parameters == {"gear": 4, "share": 0.1, "walls": 1}


@given(SEEDS, st.floats(0, 3), st.floats(0, 1))
def test_operators_stay_within_bounds(seed: int, severity: float, probability: float) -> None:
    subject = parameter_set(ONE_OF_EACH)
    mother, father = (subject.initial(Stream(seed, name)) for name in ("mother", "father"))
    mutant = subject.mutate(mother, Stream(seed, "m"), severity=severity, probability=probability)
    child = subject.crossover(mother, father, Stream(seed, "c"))
    for genome in (mother, father, mutant, child):
        assert ((genome >= 0) & (genome <= 1)).all()
    # Numbers move at most by the severity; reflection only shortens the way.
    assert (np.abs(mutant - mother)[:4] <= severity + 1e-6).all()
    from_father = child == father
    assert (from_father | (child == mother)).all()
    assert 1 <= from_father.sum() <= 4


def test_categories_change_as_often_as_it_says_to_all_others() -> None:
    names = [f"p{index}" for index in range(3000)]
    subject = parameter_set({name: {"type": "categorical", "choices": ["a", "b", "c"]} for name in names})
    genome = subject.initial(Stream(1, "x"))
    before = subject.weights(genome[np.newaxis])[0]
    mutant = subject.mutate(genome, Stream(2, "x"), severity=0.5, probability=0.6)
    steps = (subject.weights(mutant[np.newaxis])[0] - before) % 3
    shares = np.bincount(steps.astype(int), minlength=3) / 3000
    assert shares == pytest.approx([0.7, 0.15, 0.15], abs=0.03)


def test_distances_are_those_of_genes_and_categories() -> None:
    subject = parameter_set(ONE_OF_EACH)
    one = np.array([0, 0.5, 0, 1, 0.1], dtype=np.float32)
    other = np.array([0.5, 0.25, 0, 0, 0.2], dtype=np.float32)
    assert subject.distance(one, other) == 0.5 + 0.25 + 1
    other[4] = 0.9
    assert subject.distance(one, other) == 0.5 + 0.25 + 1 + 1


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        (
            {"type": "real", "range": [1, 1]},
            r"x\.range: must contain at least two values, but 1 and 1 are the same number; put",
        ),
        (
            {"type": "real", "range": [1.0, 1.00000001]},
            r"x\.range: must contain at least two values, but 1\.0 and 1\.00000001 are the same 32-bit",
        ),
        (
            {"type": "real", "range": [5, -1.5]},
            r"x\.range: must be \[lowest, highest\], but 5 is above -1\.5; write \[-1\.5, 5\]$",
        ),
        (
            {"type": "integer", "range": [3, 2]},
            r"x\.range: must be \[lowest, highest\], but 3 is above 2; write \[2, 3\]$",
        ),
        (
            {"type": "real", "range": [0, True]},
            r"x\.range: must be \[lowest, highest\], two numbers, not \[0, True\]$",
        ),
        ({"type": "real", "range": [1]}, r"x\.range: must be \[lowest, highest\]"),
        (
            {"type": "real", "range": [0, 1e39]},
            r"x\.range: 1e\+39 is outside -3\.40282e\+38 to 3\.40282e\+38, the range of 32-bit floats$",
        ),
        ({"type": "real"}, r"x\.range: is missing"),
        (
            {"type": "real", "range": [0, 1], "scale": "log"},
            r"x\.scale: log needs a range above 0, not",
        ),
        ({"type": "real", "range": [0, 1], "scale": "root"}, r"x\.scale: must be one of linear, log"),
        ({"type": "real", "range": [0, 1], "rang": 1}, r"x\.rang: unknown key"),
        (
            {"type": "integer", "range": [0, 1.5]},
            r"x\.range: must be .*, two whole numbers within \+-1677",
        ),
        (
            {"type": "integer", "range": [-(2**25), 0]},
            r"x\.range: -33554432 is outside -16777216 to 16777216, where every whole number is a",
        ),
        (
            {"type": "categorical", "choices": ["a"]},
            r"x\.choices: must be a list of at least two",
        ),
        (
            {"type": "categorical", "choices": ["a", "a"]},
            r"x\.choices: must be a list of at least two",
        ),
        (
            {"type": "categorical", "choices": ["a", 1]},
            r"x\.choices: must be a list of at least two different strings, numbers or booleans, not \['a'",
        ),
        ({"type": "categorical", "choices": [1, True]}, r"x\.choices: must be a list of at least two"),
        ({"type": "categorical", "choices": [1, 1.0]}, r"x\.choices: must be a list of at least two"),
        (
            {"type": "categorical", "choices": [0.5, 0.123456789]},
            r"x\.choices: 0\.123456789 is sent as the 32-bit float 0\.12345679; write that",
        ),
        (
            {"type": "categorical", "choices": [1, 2**25]},
            r"x\.choices: 33554432 is outside -1\.67772e\+07 to 1\.67772e\+07",
        ),
        (
            {"type": "reel", "range": [0, 1]},
            r"x: type must be one of real, integer, cate.* mean 'real'",
        ),
        ({"range": [0, 1]}, r"x: type is missing"),
        (7, r"x: must be a mapping"),
    ],
)
def test_what_is_no_parameter_is_refused(parameter: Any, words: str) -> None:
    from swarmwright import Experiment

    values = {"simulation": "other", "controller": {"kind": "parameter_set", "parameters": {"x": parameter}}}
    with pytest.raises(InputError, match=r"controller\.parameters\." + words):
        Experiment.from_mapping(values)


@pytest.mark.parametrize("name", ["seed", "server", "simulation_hash"])
def test_reserved_names_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"'{name}' cannot be evolved"):
        parameter_set({name: ONE_OF_EACH["hops"]})
