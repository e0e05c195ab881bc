"""Candidates of runs in other simulations: on a server that knows D6.1 alone, in files, in sampled models."""

import csv
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, optimize, post_evaluate, transfer
from swarmwright.analysis.caveats import budgets
from swarmwright.analysis.groups import group
from tests.python.analysis.runs import KnownRun

NOISY: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 3, "numDefenders": 3, "placement": "random", "speedDefenders": 0.5},
    "method": {"kind": "random_search", "population": 20, "generations": 3},
    "ranking": {"episodes": 2},
    "servers": "local",
    "validate": False,
}
FASTER = {"parameters.speedDefenders": (0.8, 0.8)}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    folder = tmp_path_factory.mktemp("runs")
    experiment = Experiment.from_mapping(NOISY)
    return [
        optimize(
            experiment.replace(seed=seed, controller={"hidden": [hidden]}), out=folder / f"{hidden}-{seed}"
        )
        for hidden in (2, 8)
        for seed in (1, 2)
    ]


def test_scores_are_those_of_a_post_evaluation(runs: list[Run], tmp_path: Path) -> None:
    run = runs[0]
    path = tmp_path / "faster.yaml"
    path.write_text("parameters: {speedDefenders: 0.8}\n")
    found = transfer([run], [str(path)], vary=FASTER, candidates=4, seeds=12)
    first, sampled = found.runs
    assert (first.target, sampled.target) == (str(path), "pseudo-reality")
    others = run.experiment.replace(parameters={"speedDefenders": 0.8})
    for candidate, here, there in zip(
        first.candidates, first.source_episodes, first.target_episodes, strict=True
    ):
        which: dict[str, Any] = {"candidate": candidate.candidate, "generation": candidate.generation}
        expected = post_evaluate(run, **which, episodes=12)
        assert here.tolist() == expected.episodes.tolist()
        assert candidate.recorded == expected.recorded
        assert list(found.seeds) == expected.seeds
        assert there.tolist() == post_evaluate(run, **which, episodes=12, experiment=others).episodes.tolist()
    assert sampled.target_episodes.tolist() == first.target_episodes.tolist()  # each of its models is as fast
    lost = first.losses[0]
    pairs = [
        a - b
        for a, b in zip(
            first.source_episodes[0].reshape(-1, 2).mean(1),
            first.target_episodes[0].reshape(-1, 2).mean(1),
            strict=True,
        )
    ]
    assert lost.mean == pytest.approx(np.mean(pairs))
    assert lost.low is not None
    assert lost.high is not None
    assert lost.low < lost.mean < lost.high
    assert first.candidates[0].recorded == run.best.fitness


@pytest.mark.slow
def test_results_do_not_depend_on_the_servers(runs: list[Run]) -> None:
    options: dict[str, Any] = {"vary": {"parameters.speedDefenders": (0.2, 0.9)}, "candidates": 3, "seeds": 4}
    one, other = (transfer(runs[:1], servers=servers, random=2, **options) for servers in ("in-process", 2))
    assert one.to_mapping() == other.to_mapping()
    assert len(one.runs[0].candidates) == 5
    assert [candidate.generation for candidate in one.runs[0].candidates[3:]] == [None, None]
    assert one.runs[0].candidates[3].recorded is None


def test_groups_are_compared(runs: list[Run]) -> None:
    found = transfer(runs, vary=FASTER, candidates=2, seeds=4)
    assert [one.label for one in found.group_losses] == ["hidden [2]", "hidden [8]"]
    for losses, members in zip(found.group_losses, (found.runs[:2], found.runs[2:]), strict=True):
        assert losses.losses.tolist() == [one.losses[0].mean for one in members]
        assert losses.losses == pytest.approx(losses.source_fitness - losses.target_fitness)
    (pair,) = found.pairs
    assert 0 <= pair.difference.p <= pair.p_holm <= 1
    assert any("fewer than 5 runs" in note for note in found.notes)
    text = str(found)
    assert "none, too few runs" in text
    for word in ("hidden [2]", "A12 of the loss", "rank correlation", str(runs[3].path)):
        assert word in text


def test_groups_are_compared_within_a_task(runs: list[Run], tmp_path: Path) -> None:
    """Losses of unlike tasks have unlike units, and pairs between these would weaken Holm's correction."""
    others = [
        optimize(run.experiment.replace(parameters={"numAgents": 4}), out=tmp_path / run.path.name)
        for run in runs
    ]
    found = transfer([*runs, *others], vary=FASTER, candidates=1, seeds=2)
    assert [(one.label, len(one.groups), len(one.pairs)) for one in found.tasks] == [
        ("numAgents 3", 2, 1),
        ("numAgents 4", 2, 1),
    ]
    for pair in found.pairs:
        assert pair.p_holm == pair.difference.p
        assert pair.first.label.split(",")[0] == pair.second.label.split(",")[0]
    text = str(found)
    assert [line for line in text.splitlines() if line.startswith("Task: ")] == [
        "Task: numAgents 3",
        "Task: numAgents 4",
    ]
    assert "groups solve different tasks, and those of one task are tested against each other" in found.notes
    values = found.to_mapping()
    assert [(one["label"], len(one["groups"])) for one in values["tasks"]] == [
        ("numAgents 3", 2),
        ("numAgents 4", 2),
    ]
    assert values["pairs"][0]["interval"] is None
    alone = transfer([*runs, *others[:2]], vary=FASTER, candidates=1, seeds=2)
    assert len(alone.pairs) == 1
    assert any("is the only one of its task and is tested against no other" in one for one in alone.notes)


def test_runs_of_a_group_may_have_other_seeds_of_episodes(runs: list[Run], tmp_path: Path) -> None:
    experiment = runs[0].experiment.replace(seed=5, parameters={"seed": 77})
    other = optimize(experiment, out=tmp_path / "other")
    found = transfer([*runs[:2], other], vary=FASTER, candidates=1, seeds=2)
    assert [len(one.runs) for one in found.groups] == [3]


def test_one_run_shows_its_candidates_and_their_order(runs: list[Run], tmp_path: Path) -> None:
    found = transfer(runs[:1], vary=FASTER, candidates=6, random=12, seeds=4)
    lines = str(found).splitlines()
    assert lines[0].startswith("Mean fitness of 4 episodes with held-out seeds")
    assert "and 3 more; --csv and --json have all" in lines
    assert lines[-1].startswith("Rank correlation of the 18 candidates (Spearman): ")
    correlation = found.runs[0].correlation
    assert correlation is not None
    assert correlation.candidates == 18
    found.export(tmp_path / "all.csv")
    with (tmp_path / "all.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 18 * 4
    assert [float(row["fitness"]) for row in rows] == found.runs[0].source_episodes.ravel().tolist()
    assert [float(row["fitness_in_target"]) for row in rows] == found.runs[0].target_episodes.ravel().tolist()
    assert rows[-1]["generation"] == ""
    with pytest.raises(InputError, match=r"ends with \.csv"):
        found.export(tmp_path / "all.txt")
    figure = found.figure()
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()][1:] == [
        "random controllers", "best of the run", "other candidates of the run", "95 % interval of the mean",
    ]  # fmt: skip
    assert legend.get_texts()[0].get_text().endswith("(1 run)")
    assert figure.get_suptitle() == "1 run: transfer from minisim"
    assert found.plot(tmp_path / "all.svg").read_text().count("<path") > 50


@pytest.mark.slow
def test_another_simulator_on_a_broker(any_broker: str, foreign: Callable[..., Any], tmp_path: Path) -> None:
    """The second simulator is a server that only knows D6.1."""
    experiment = Experiment.from_mapping(
        {
            "simulation": "line", "sensors": 2, "actuators": 1, "requirements": {"dimensions": 1},
            "method": {"kind": "random_search", "population": 6, "generations": 1},
            "controller": {"hidden": [2]}, "validate": False, "timeouts": {"discovery": 3},
        }
    )  # fmt: skip
    path = tmp_path / "long.yaml"
    path.write_text(f"simulation: long line\nrequirements: {{dimensions: 1}}\nbroker: {any_broker}\n")
    other = foreign(any_broker, "long line", steps=9, server=5)
    with foreign(any_broker, "line"), other as there:
        run = optimize(experiment, out=tmp_path / "run", broker=any_broker)
        found = transfer([run], [str(path)], candidates=4, seeds=3, broker=any_broker)
        assert there.episodes == 12
    (one,) = found.runs
    assert np.isfinite(one.target_episodes).all()
    assert (one.target_episodes != one.source_episodes).any()


def test_unequal_budgets_of_groups_are_noted(tmp_path: Path) -> None:
    short = [KnownRun(tmp_path / f"s{seed}", [[1.0] * 4], seed=seed) for seed in (1, 2)]
    long = [
        KnownRun(tmp_path / f"l{seed}", [[1.0] * 8] * 5, seed=seed, method={"population": 8})
        for seed in (1, 2)
    ]
    groups, _ = group([*short, *long])
    assert list(budgets(groups)) == ["budgets are unequal: the runs have 4 to 40 evaluations"]
    groups, _ = group(short)
    assert list(budgets(groups)) == []


def test_the_same_simulation_as_in_evolution_is_noted(runs: list[Run]) -> None:
    found = transfer(runs[:1], ["minisim"], vary=FASTER, candidates=1, seeds=2)
    assert found.runs[0].losses[0].mean == 0
    assert [note.partition(" with")[0] for note in found.notes] == [
        "minisim is what candidates were evolved in,"
    ]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"vary": FASTER, "seeds": 1}, "seeds: must be at least 2, not 1"),
        ({"vary": FASTER, "candidates": 0}, "candidates: must be at least 1, not 0"),
        ({"vary": FASTER, "random": -1}, "random: must be at least 0, not -1"),
        ({}, "nothing to transfer to"),
        ({"to": ["minisin"]}, "^minisin: simulation: unknown simulation 'minisin'; did you mean 'minisim"),
        ({"to": ["emergency_exit"]}, "give a .yaml file"),
        ({"vary": {"parameters.speed": (0, 1)}}, "^vary: parameters.speed=0..1: unknown"),
    ],
)
def test_mistakes_are_found_before_anything_is_evaluated(
    runs: list[Run], arguments: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        transfer(runs[:1], **arguments, on_progress=lambda *_: pytest.fail("evaluates"))


def test_controllers_have_to_fit(runs: list[Run], tmp_path: Path) -> None:
    path = tmp_path / "stadium.yaml"
    path.write_text("simulation: emergency_exit\n")
    with pytest.raises(
        InputError, match="the run's controllers have 4 sensors and 1 actuators, but agents of"
    ):
        transfer(runs[:1], [str(path)])
    with pytest.raises(InputError, match="there are no runs"):
        transfer([], vary=FASTER)


def test_episodes_that_fail_are_left_out(tmp_path: Path) -> None:
    file = tmp_path / "fragile.py"
    file.write_text(
        "from swarmwright import Parameter, Simulation\n\n\n"
        "class Fragile(Simulation):\n"
        "    sensors, actuators = 1, 1\n"
        "    parameters = {'weight': Parameter(1.0)}\n\n"
        "    def reset(self, parameters, seed):\n"
        "        self.weight, self.sum = parameters['weight'], 0.0\n"
        "        if self.weight > 2 and seed % 2:\n"
        "            raise ValueError('too heavy')\n"
        "        self.left = 3\n"
        "        return [[seed % 7 / 7]]\n\n"
        "    def done(self):\n"
        "        return self.left == 0\n\n"
        "    def step(self, actions):\n"
        "        self.left -= 1\n"
        "        self.sum += float(actions[0][0]) / self.weight\n"
        "        return [[0.5]]\n\n"
        "    def fitness(self):\n"
        "        return self.sum\n"
    )
    experiment = Experiment.from_mapping(
        {
            "simulation": f"{file}:Fragile", "servers": "in-process", "controller": {"hidden": [2]},
            "method": {"kind": "random_search", "population": 5, "generations": 1}, "validate": False,
        }
    )  # fmt: skip
    run = optimize(experiment, out=tmp_path / "run")
    found = transfer([run], vary={"parameters.weight": (3.0, 4.0)}, candidates=2, seeds=6)
    (one,) = found.runs
    assert one.failed == 6
    assert np.isnan(one.target_episodes).sum(axis=1).tolist() == [3, 3]
    assert all(math.isfinite(lost.mean) for lost in one.losses)
    (note,) = found.notes
    assert note.startswith(
        "6 episodes failed in pseudo-reality and are left out, so the means are those of the"
    )
