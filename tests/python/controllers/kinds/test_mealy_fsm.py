"""Mealy machines: tables are looked up as it is said, and stay tables under the genetic operators."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmwright import Controller, Experiment, InputError, _engine
from swarmwright.common.random_numbers import Stream
from swarmwright.controllers.kinds.mealy_fsm import MealyFsm, MealyFsmOptions

SEEDS = st.integers(0, 2**63)
OPTIONS = st.fixed_dictionaries(
    {
        "states": st.integers(1, 5),
        "levels": st.lists(st.integers(1, 4), min_size=3, max_size=3),
        "output_levels": st.sampled_from([0, 2, 3, 5, 101]),
    }
)


def machine(sensors: int = 3, actuators: int = 2, **options: Any) -> MealyFsm:
    return MealyFsm(MealyFsmOptions(**options), sensors=sensors, actuators=actuators)


def values(subject: MealyFsm) -> NDArray[np.float32]:
    count = subject.options.output_levels
    return np.array([2 * k / (count - 1) - 1 for k in range(count)], dtype=np.float32)


def is_table(subject: MealyFsm, genome: NDArray[np.float32]) -> bool:
    """Whether every gene is a state or an output that there is."""
    table = genome.reshape(subject.rows, -1)
    states = np.isin(table[:, 0], np.arange(subject.options.states)).all()
    levels = subject.options.output_levels
    outputs = np.isin(table[:, 1:], values(subject)) if levels else np.abs(table[:, 1:]) <= 1
    return bool(states and outputs.all())


@given(OPTIONS, SEEDS)
def test_every_row_is_found_in_mixed_radix(options: dict[str, Any], seed: int) -> None:
    subject = machine(**options)
    genome = subject.initial(Stream(seed, "x"))
    table = genome.reshape(subject.rows, 3)
    controller = Controller(subject.specification(genome))
    # A reading inside of each interval; -1..1 is cut evenly.
    inside = [[(2 * i + 1) / n - 1 for i in range(n)] for n in options["levels"]]
    symbols = list(itertools.product(*inside))
    assert len(symbols) * subject.options.states == subject.rows == len(table)
    draw = Stream(seed, "y")
    state = 0
    for _ in range(20):
        symbol = draw.integer(len(symbols))
        row = table[state * len(symbols) + symbol]
        assert controller(symbols[symbol]).tolist() == row[1:].tolist()
        state = int(row[0])


def test_sensors_that_are_zero_or_one_and_whole_numbers_are_told_apart() -> None:
    subject = machine(2, 1, states=1, levels=[2, 3], output_levels=0)
    genome = np.array([[0, row / 8] for row in range(6)], dtype=np.float32).ravel()
    controller = Controller(subject.specification(genome))
    found = [float(controller([flag, cells])[0]) * 8 for flag in (0, 1) for cells in (-7, 0, 7)]
    assert found == [0, 1, 2, 3, 4, 5]


def test_thresholds_can_be_given() -> None:
    subject = machine(2, 1, levels=[[-0.5, 0.1, 3], 1])
    assert subject.thresholds == [[-0.5, 0.1, 3.0], []]
    assert subject.rows == 4 * 4
    again = machine(2, 1, **subject.options.model_dump())
    assert again.architecture() == subject.architecture()


@given(OPTIONS, SEEDS, st.floats(0, 2), st.floats(0, 1))
def test_operators_make_tables(
    options: dict[str, Any], seed: int, severity: float, probability: float
) -> None:
    subject = machine(**options)
    mother, father = (subject.initial(Stream(seed, name)) for name in ("mother", "father"))
    mutant = subject.mutate(mother, Stream(seed, "m"), severity=severity, probability=probability)
    child = subject.crossover(mother, father, Stream(seed, "c"))
    for genome in (mother, father, mutant, child):
        assert is_table(subject, genome)
        assert subject.weights(genome).tobytes() == genome.tobytes()


@pytest.mark.parametrize("output_levels", [3, 0])
def test_mutation_changes_the_share_that_it_says(output_levels: int) -> None:
    subject = machine(levels=10, output_levels=output_levels)
    genome = subject.initial(Stream(1, "x"))
    mutant = subject.mutate(genome, Stream(2, "x"), severity=0.5, probability=0.4)
    changed = (mutant != genome).reshape(subject.rows, 3)
    assert changed[:, 0].mean() == pytest.approx(0.2, abs=0.03)
    assert changed[:, 1:].mean() == pytest.approx(0.2 if output_levels else 0.4, abs=0.03)
    if not output_levels:
        assert np.abs(mutant - genome).reshape(subject.rows, 3)[:, 1:].max() <= 0.5 + 1e-6
    # All others are equally likely.
    before, after = (row.reshape(subject.rows, 3)[changed[:, 0], 0] for row in (genome, mutant))
    steps = np.bincount(((after - before) % 4).astype(int), minlength=4)
    assert steps[0] == 0
    assert steps[1:] / steps.sum() == pytest.approx(np.full(3, 1 / 3), abs=0.1)


def test_initial_tables_hold_everything_equally_often() -> None:
    subject = machine(levels=10, output_levels=4)
    table = subject.initial(Stream(1, "x")).reshape(subject.rows, 3)
    for column, choices in ((0, np.arange(4)), (1, values(subject)), (2, values(subject))):
        found = np.array([(table[:, column] == choice).mean() for choice in choices])
        assert found == pytest.approx(np.full(4, 0.25), abs=0.03)


@given(SEEDS)
def test_crossover_takes_a_run_of_whole_rows(seed: int) -> None:
    subject = machine(levels=2)
    mother = np.zeros(subject.genome_size, dtype=np.float32)
    child = subject.crossover(mother, mother + 1, Stream(seed, "x")).reshape(subject.rows, 3)
    assert (child == child[:, :1]).all()
    taken = "".join(str(int(row[0])) for row in child)
    assert taken.strip("0").strip("1") == ""
    assert 1 <= taken.count("1") < subject.rows


def test_the_distance_counts_states_and_measures_outputs() -> None:
    subject = machine(1, 2, states=3, levels=1)
    one = np.array([0, -1, 0.5, 1, 1, 1, 2, 0, 0], dtype=np.float32)
    other = np.array([2, 1, 0, 1, 1, 1, 2, 0, 0], dtype=np.float32)
    assert subject.distance(one, other) == 1 + 1 + 0.25
    assert subject.distances(one, np.stack([one, other])).tolist() == [0, 2.25]


@given(st.lists(st.floats(-(2.0**99), 2.0**99, width=32), min_size=24, max_size=24), st.sampled_from([0, 3]))
def test_any_numbers_are_a_genome(genes: list[float], output_levels: int) -> None:
    subject = machine(2, 1, states=3, levels=2, output_levels=output_levels)
    genome = np.array(genes, dtype=np.float32)
    weights = subject.weights(genome)
    assert is_table(subject, weights)
    table, raw = weights.reshape(-1, 2), genome.reshape(-1, 2)
    assert (table[:, 0] == np.clip(np.floor(raw[:, 0]), 0, 2)).all()
    if not output_levels:
        assert (table[:, 1] == np.clip(raw[:, 1], -1, 1)).all()
    untouched = subject.mutate(genome, Stream(1, "x"), severity=1, probability=0)
    assert untouched.tobytes() == genome.tobytes()


def test_the_engine_takes_tables_as_they_are_in_a_block() -> None:
    subject = machine(4, 1, levels=3)
    genomes = np.stack([subject.initial(Stream(1, "x", 0, index)) for index in range(70)])
    architecture = subject.architecture()
    arguments = ("minisim", {"placement": "random", "numAgents": 3}, architecture, genomes, [0, 1])
    expected, _ = _engine.evaluate(*arguments, level="scalar", threads=1)
    assert len(np.unique(expected)) > 50
    for level in _engine.levels():
        fitness, _ = _engine.evaluate(*arguments, level=level)
        assert fitness.tobytes() == expected.tobytes(), level


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"levels": [2]}, r"controller\.levels: 1 entries for 10 sensors"),
        ({"levels": 5}, r"controller\.levels: 5 x 5 x .* a table of 117187500 numbers .* fewer levels"),
        ({"levels": 0}, r"controller\.levels: must be a number of intervals, 1 to 1000, or a list"),
        ({"levels": [*[2] * 9, [1, 0]]}, r"controller\.levels: an entry must be .*, not \[1, 0\]"),
        ({"levels": True}, r"controller\.levels: must be a number of intervals"),
        ({"output_levels": 1}, r"controller\.output_levels: must be 0 or at least 2"),
        ({"states": 1001}, r"controller\.states: must be at most 1000, not 1001"),
    ],
)
def test_what_makes_no_table_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Experiment.from_mapping(
            {"simulation": "emergency_exit", "controller": {"kind": "mealy_fsm", **options}}
        )


def test_a_file_is_told_the_line(tmp_path: Any) -> None:
    path = tmp_path / "exit.yaml"
    path.write_text("simulation: emergency_exit\ncontroller:\n  kind: mealy_fsm\n  levels: 4\n")
    with pytest.raises(InputError, match=r"exit\.yaml:4: controller\.levels: 4 x 4 x"):
        Experiment.load(path)
