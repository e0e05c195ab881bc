"""Runs with several objectives and with quality diversity, from the experiment to their elites."""

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, optimize, repeat, resume
from swarmwright.analysis.sweep import Sweep
from swarmwright.cli._runs import extra_lines
from swarmwright.common.statistics import mean
from swarmwright.methods.map_elites import MapElites
from swarmwright.methods.nsga2 import Nsga2Options
from swarmwright.runs.store import StoreReader
from swarmwright.runs.store.best_of_equals import BestOfEquals
from tests.python.records import same_record

BASE: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 3, "numDefenders": 2, "placement": "random", "maxSteps": 12},
    "ranking": {"episodes": 3},
    "servers": "local",
    "seed": 5,
}
MEASURES = {"steps": {"range": [0, 12], "bins": 6}, "distance": {"range": [0, 30], "bins": 5}}
ARCHIVE = {
    **BASE,
    "method": {"kind": "map_elites", "population": 20, "generations": 8, "measures": MEASURES},
}
OTHERS = [{"kind": "cvt", "cells": 12}, {"kind": "unstructured", "threshold": 0.15}]
NOVELTY = {
    **BASE,
    "method": {
        "kind": "novelty",
        "population": 20,
        "generations": 8,
        "measures": {"arrived": {"range": [0, 3], "bins": 1}, **MEASURES},
    },
}
FRONT = {
    **BASE,
    "fitness": "arrived - caught",
    "method": {
        "kind": "nsga2",
        "population": 12,
        "generations": 8,
        "objectives": {"steps": "minimize", "distance": "minimize"},
    },
}


@pytest.fixture(scope="module", params=["archive", "novelty", "front"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    values = {"archive": ARCHIVE, "novelty": NOVELTY, "front": FRONT}[request.param]
    return optimize(Experiment.from_mapping(values), out=tmp_path_factory.mktemp("elites") / request.param)


def means_of(run: Run) -> list[tuple[float, ...]]:
    """Fitness and the metrics of the method, of each evaluation, by the columns of the record."""
    names = list(run.elites.goals)
    episodes = run.experiment.ranking.episodes
    columns = [[run.record[f"{name}_{episode}"] for episode in range(episodes)] for name in names]
    return [
        (float(value), *(mean([float(one[row]) for one in of]) for of in columns))
        for row, value in enumerate(run.record.fitness)
    ]


def test_the_elites_are_those_that_the_record_has(run: Run) -> None:
    rows = means_of(run)
    found = run.elites
    got = {(one.fitness, *one.metrics.values()) for one in found.candidates}
    if found.kind == "archive":
        best: dict[tuple[int, int], tuple[float, ...]] = {}
        for row in rows:
            cell = min(int(row[1] // 2), 5), min(int(row[2] // 6), 4)
            if cell not in best or row[0] > best[cell][0]:
                best[cell] = row
        assert got == set(best.values())
        assert found.coverage == len(best) / 30
        assert found.qd_score(-7.0) == pytest.approx(sum(row[0] + 7 for row in best.values()))
    else:
        costs = [(-row[0], row[1], row[2]) for row in rows]
        kept = {
            row
            for row, cost in zip(rows, costs, strict=True)
            if not any(
                other != cost and all(a <= b for a, b in zip(other, cost, strict=True)) for other in costs
            )
        }
        assert got == kept
        assert found.coverage is found.qd_score() is None
    assert len(found.candidates) == len(got) > 2
    order = [one.fitness for one in found.candidates]
    assert order == sorted(order, reverse=True)
    assert found.values().shape == (len(got), 3)


def test_each_elite_can_be_evaluated_again(run: Run) -> None:
    for one in run.elites.candidates[:3]:
        again = repeat(run, generation=one.generation, candidate=one.candidate)
        assert again.same
        assert mean(again.repeated.tolist()) == one.fitness


@pytest.mark.slow
def test_records_are_the_same_on_servers_and_after_a_break(run: Run, tmp_path: Path) -> None:
    def stops(generation: Any) -> bool:
        return bool(generation.generation < 3)

    other = optimize(run.experiment, stops, servers=2, out=tmp_path / "other")
    assert other.generations == 4
    other = resume(other, generations=run.experiment.method.generations, servers=1)
    same_record(other, run)
    assert other.elites == run.elites


def test_the_figure_of_the_population_is_that_of_the_elites(tmp_path: Path) -> None:
    run = optimize(Experiment.from_mapping(ARCHIVE), out=tmp_path / "run")
    fitness = [one.fitness for one in run.elites.candidates]
    assert run.history[-1].mean == mean(fitness)
    assert run.history[-1].best == max(fitness) == run.best.fitness


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("kind", ["map_elites", "novelty", "nsga2"])
def test_figures(kind: str, count: int, tmp_path: Path) -> None:
    names = ["steps", "distance", "arrived"][:count]
    method: dict[str, Any] = {"kind": kind, "population": 10, "generations": 2}
    if kind != "nsga2":
        method["measures"] = {name: {"range": [0, 20], "bins": 4} for name in names}
    else:
        method["objectives"] = dict.fromkeys(names, "maximize")
    run = optimize(Experiment.from_mapping({**BASE, "method": method}), out=tmp_path / "run")
    figure = run.elites.plot(tmp_path / "elites.png")
    assert (tmp_path / "elites.png").stat().st_size > 5000
    texts = [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())]
    assert sum(text.startswith("fitness") for text in texts) == 1
    for name in names[:2]:
        assert any(text.startswith(name) for text in texts)
    assert any(text.startswith("distance, metres") for text in texts) == (count > 1)
    assert figure.get_suptitle() == f"minisim: {kind} evolves a {run.experiment.controller.kind} controller"
    with pytest.raises(InputError, match=r"unknown suffix of a figure"):
        run.elites.plot(tmp_path / "elites.txt")


def archive_of(archive: dict[str, Any], *names: str) -> dict[str, Any]:
    """An experiment with another archive."""
    measures = {name: {"range": MEASURES.get(name, {"range": [0, 3]})["range"]} for name in names}
    return {**BASE, "method": {**ARCHIVE["method"], "measures": measures, "archive": archive}}


@pytest.mark.parametrize("archive", OTHERS)
def test_elites_of_other_archives_are_those_that_the_method_has(
    archive: dict[str, Any], tmp_path: Path
) -> None:
    experiment = Experiment.from_mapping(archive_of(archive, "steps", "distance"))
    run = optimize(experiment, out=tmp_path / "run")
    rows, elites = means_of(run), run.elites
    method = experiment.new_method(run.experiment.representation())
    for generation in range(run.generations):
        method.ask()
        told = np.array(rows[generation * 20 : generation * 20 + 20])
        method.tell(told[:, 0], metrics=told[:, 1:])
    assert isinstance(method, MapElites)
    numbers = {one.generation * 20 + one.candidate for one in elites.candidates}
    assert numbers == set(method.archive.numbers.tolist())
    assert elites.qd_score(-9.0) == pytest.approx((method.archive.fitness + 9).sum())
    assert elites.coverage == (len(numbers) / 12 if archive["kind"] == "cvt" else None)
    assert elites.plot().axes[0].get_title(loc="left").startswith(f"{len(numbers)} ")
    again = Experiment.from_mapping(run.experiment.to_mapping())
    assert again.method == run.experiment.method


@pytest.mark.parametrize("names", [["steps"], ["steps", "distance", "arrived"]])
@pytest.mark.parametrize("archive", OTHERS)
def test_figures_of_other_archives(archive: dict[str, Any], names: list[str], tmp_path: Path) -> None:
    values = archive_of(archive, *names)
    values["method"] |= {"population": 10, "generations": 2}
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "run")
    axes = run.elites.plot().axes[0]
    assert axes.get_xlabel() == "steps, steps"
    assert axes.get_ylabel().startswith("fitness" if len(names) == 1 else "distance")


@pytest.mark.parametrize("values", [ARCHIVE, FRONT])
def test_a_race_is_refused_whose_metrics_would_have_different_seeds(
    values: dict[str, Any], tmp_path: Path
) -> None:
    raced = {**values, "ranking": {"kind": "race", "episodes": 8}}
    words = r"ranking\.kind: race skips episodes.* \(steps, distance\) .*; use kind: absolute"
    (tmp_path / "raced.yaml").write_text(json.dumps(raced))
    sweep = {"experiment": values, "grid": {"ranking": [values["ranking"], raced["ranking"]]}}
    with pytest.raises(InputError, match=words):
        Experiment.load(tmp_path / "raced.yaml")
    with pytest.raises(InputError, match=words):
        Experiment.from_mapping(raced)
    with pytest.raises(InputError, match=words):
        Sweep.from_mapping(sweep)


@pytest.mark.parametrize("values", [ARCHIVE, FRONT])
@pytest.mark.parametrize("kind", ["multi_fidelity", "transferability"])
def test_estimates_of_a_slow_simulation_are_refused(values: dict[str, Any], kind: str) -> None:
    ranking: dict[str, Any] = {"kind": kind, "slow": {"parameters": {"maxSteps": 9}}}
    if kind == "transferability":
        ranking |= {"descriptor": ["steps"], "threshold": 1.0}
    words = rf"cannot be combined with {kind}, as it would keep .* \(steps, distance\) .*kind: absolute"
    with pytest.raises(InputError, match=words):
        Experiment.from_mapping({**values, "ranking": ranking})


UNSTEADY = """
from swarmwright import Simulation

class Unsteady(Simulation):
    sensors, actuators = 1, 1
    metrics = ("cost", "sometimes")

    def reset(self, parameters, seed):
        self.value, self.seed = None, seed
        return [[0.5]]

    def step(self, actuators):
        self.value = float(actuators[0][0])
        return [[0.5]]

    def done(self):
        return self.value is not None

    def fitness(self):
        return 1.0

    def measure(self):
        cost = float("inf") if self.value > 0.2 and self.seed % 3 else self.value
        return {"cost": cost, "sometimes": float("nan") if self.seed % 3 == 0 else self.value}
"""


@pytest.fixture
def unsteady(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    return unsteady_run("maximize", tmp_path, monkeypatch)


@pytest.fixture
def opposed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """The same, with a front of more than one candidate."""
    return unsteady_run("minimize", tmp_path, monkeypatch)


def unsteady_run(sometimes: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    (tmp_path / "unsteady.py").write_text(UNSTEADY)
    monkeypatch.chdir(tmp_path)
    values = {
        "simulation": "unsteady.py:Unsteady",
        "method": {
            "kind": "nsga2", "population": 20, "generations": 2,
            "objectives": {"cost": "maximize", "sometimes": sometimes},
        },
        "ranking": {"episodes": 3},
        "validate": {"episodes": 6},
        "servers": "in-process",
    }  # fmt: skip
    return optimize(Experiment.from_mapping(values), out=tmp_path / "run")


@pytest.mark.slow
def test_infinite_episodes_make_no_elite_and_missing_ones_are_counted(unsteady: Run, program: Any) -> None:
    infinite = int(
        np.isinf(np.column_stack([unsteady.record[f"cost_{one}"] for one in range(3)])).any(1).sum()
    )
    assert 0 < infinite < 40
    found = unsteady.elites
    assert found.missing == {"cost": infinite}
    assert all(one.metrics["cost"] <= 0.2 for one in found.candidates)
    count = len(found.candidates)
    assert found.partial == {"sometimes": count} != {"sometimes": 0}
    (note,) = (text for text in found.notes if "mean of the others" in text)
    assert note.startswith(f"{count} of the {count} elites have no value of sometimes (nan)")
    assert note in program("runs", "elites", "run").stdout
    assert json.loads(program("runs", "elites", "run", "--json").stdout)["partial"] == found.partial
    evaluated = program("evaluate", "run", "--episodes", "6", "--metrics", "sometimes")
    assert "; 2 of 6 episodes have no finite value" in evaluated.stdout


def test_the_best_of_equal_fitness_is_one_of_the_front(unsteady: Run) -> None:
    first = unsteady.elites.candidates[0]
    place = first.generation, first.candidate
    assert place != (0, 0), "the run's first candidate has the same fitness"
    best = json.loads((unsteady.path / "best.json").read_text())
    assert (best["generation"], best["candidate"]) == place
    assert (unsteady.best.generation, unsteady.best.candidate) == place
    for one in (unsteady.evaluation(), unsteady._store.leading(3)[0]):
        assert (one.generation, one.candidate) == place
    assert unsteady.validation is not None
    assert (unsteady.validation.best.generation, unsteady.validation.best.candidate) == place


def test_of_equal_fitness_the_best_has_the_best_objectives_in_their_order(opposed: Run) -> None:
    front = opposed.elites.candidates  # equal in fitness, as all candidates are, and not in its objectives
    assert len(front) > 1
    best = max(front, key=lambda one: (one.metrics["cost"], -one.metrics["sometimes"]))
    assert (opposed.best.generation, opposed.best.candidate) == (best.generation, best.candidate)
    # What has followed the run agrees with what reads it at its end.
    options = opposed.experiment.method
    assert isinstance(options, Nsga2Options)
    followed = BestOfEquals(options.objectives, opposed.metrics)
    with StoreReader(opposed.path)._generations() as generations:
        numbers = [followed.number(generations, row) for row in generations.rows()]
    assert numbers[0] < 20
    assert numbers[-1] == opposed.evaluation().number


@pytest.mark.slow
def test_an_archive_without_elites_has_its_notes_before_the_error(partial: Any, program: Any) -> None:
    partial(kind="map_elites", population=1, measures={"never": {"range": [0, 1]}})
    result = program("runs", "elites", "run", "--plot", "x.png")
    assert result.returncode == 2
    assert result.stdout.startswith("The archive has elites in 0 of 20 cells")
    assert "1 of 1 candidates have no finite value of never" in result.stdout
    assert "there is no elite to draw" in result.stderr


PARTIAL = """
from swarmwright import Simulation

class Partial(Simulation):
    sensors, actuators = 1, 1
    metrics = ("there", "sometimes", "never")

    def reset(self, parameters, seed):
        self.value = None
        return [[0.5]]

    def step(self, actuators):
        self.value = float(actuators[0][0])
        return [[0.5]]

    def done(self):
        return self.value is not None

    def fitness(self):
        return self.value

    def measure(self):
        return {"there": self.value, "sometimes": self.value if self.value > 0 else float("nan"),
                "never": float("nan")}
"""


@pytest.fixture
def partial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    (tmp_path / "partial.py").write_text(PARTIAL)
    monkeypatch.chdir(tmp_path)

    def run(**method: Any) -> Run:
        values = {
            "simulation": "partial.py:Partial",
            "method": {"population": 30, "generations": 1, **method},
            "servers": "in-process",
        }
        return optimize(Experiment.from_mapping(values), out=tmp_path / "run")

    return run


@pytest.mark.slow
def test_candidates_without_an_objective_are_counted(partial: Any, program: Any) -> None:
    run = partial(kind="nsga2", objectives={"there": "minimize", "sometimes": "minimize"})
    without = int(np.isnan(run.record["sometimes_0"]).sum())
    assert 0 < without < 30
    assert run.elites.missing == {"sometimes": without}
    note = f"{without} of 30 candidates have no finite value of sometimes, and are not in the front."
    assert run.elites.notes == [note]
    assert program("runs", "elites", "run").stdout.splitlines()[-1] == note
    assert note in extra_lines(run)
    refused = program("runs", "elites", "run", "--offset", "1")
    assert refused.returncode == 2
    assert "--offset is for the QD score of an archive" in refused.stderr


@pytest.mark.slow
def test_measures_outside_of_their_range_are_counted(partial: Any, program: Any) -> None:
    run = partial(kind="map_elites", measures={"there": {"range": [0.2, 0.3]}})
    values = run.record["there_0"]
    below, above = int((values < 0.2).sum()), int((values > 0.3).sum())
    assert min(below, above) > 0
    one = run.elites.outside["there"]
    assert one == (below, above, 0.2, 0.3, values.min(), values.max())
    note = (
        f"{below} below and {above} above of 30 candidates are outside the range of there, 0.2 to 0.3, and "
        f"count for its first and last bin; values are {values.min():.6g} to {values.max():.6g}."
    )
    assert run.elites.notes == [note]
    assert program("runs", "elites", "run").stdout.splitlines()[-1] == note
    facts = json.loads(program("runs", "elites", "run", "--json").stdout)
    assert (facts["evaluated"], facts["missing"], facts["outside"]["there"]) == (30, {}, one._asdict())
    assert program("runs", "elites", "run", "--offset", "nan").returncode == 2
    assert program("runs", "elites", "run", "--offset", "inf").returncode == 2
    assert "e+308" not in program("runs", "elites", "--help").stdout


def test_elites_are_short_in_a_session(run: Run) -> None:
    shown = repr(run.elites)
    assert shown.startswith(f"<Elites: {run.elites.kind} of {len(run.elites.candidates)} candidates")
    assert shown.endswith("fitness, steps (measure), distance (measure)>") or "(minimize)" in shown
    assert len(shown) < 110


def test_other_methods_have_no_elites(finished: Run) -> None:
    with pytest.raises(InputError, match=r"has no elites, since nnga has a single objective and no archive"):
        _ = finished.elites


@pytest.mark.parametrize(
    ("method", "message"),
    [
        (
            {"kind": "map_elites"},
            r"x\.yaml:4: method\.measures: is missing; name at least one of the metrics of ",
        ),
        (
            {"kind": "nsga2"},
            r"method\.objectives: is missing; .* of minisim: arrived, caught, distance, steps",
        ),
        (
            {"kind": "nsga2", "objectives": {"step": "minimize"}},
            r"x\.yaml:7: method\.objectives\.step: unknown metric 'step'; did you mean 'steps'\? available: ",
        ),
        (
            {"kind": "nsga2", "objectives": {"steps": "least"}},
            r"method\.objectives\.steps: must be .*minimize",
        ),
        (
            {"kind": "map_elites", "measures": {"steps": {"bins": 3}}},
            r"method\.measures\.steps\.range: is missing",
        ),
        (
            {"kind": "map_elites", "measures": MEASURES, "operation": "steady_state", "reevaluate": 0.1},
            r"method\.operation: steady_state does not support reevaluate: 0\.1; leave one out",
        ),
    ],
)
def test_mistakes_are_found_in_the_file(method: dict[str, Any], message: str, tmp_path: Path) -> None:
    lines = ["simulation: minisim", "# a comment", "ranking: {episodes: 2}", "method:"]
    for key, value in method.items():
        if key == "objectives":
            lines += [f"  {key}:", *(f"    {name}: {goal}" for name, goal in value.items())]
        else:
            lines.append(f"  {key}: {json.dumps(value)}")
    (tmp_path / "x.yaml").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=message):
        Experiment.load(tmp_path / "x.yaml")


def test_a_simulation_without_metrics_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bare.py").write_text(
        "from swarmwright import Simulation\n"
        "class Bare(Simulation):\n"
        "    sensors, actuators = 1, 1\n"
        "    def reset(self, parameters, seed): return [[0.0]]\n"
        "    def step(self, actuators): return [[0.0]]\n"
        "    def done(self): return True\n"
        "    def fitness(self): return 0.0\n"
    )
    (tmp_path / "x.yaml").write_text("simulation: bare.py:Bare\nmethod: {kind: map_elites}\n")
    with pytest.raises(
        InputError,
        match=r"method\.measures: map_elites needs metrics beside the fitness, but bare reports none",
    ):
        Experiment.load(tmp_path / "x.yaml")


def test_reevaluation_is_refused() -> None:
    with pytest.raises(InputError, match=r"ranking\.reevaluate: map_elites has no survivors"):
        Experiment.from_mapping({**ARCHIVE, "ranking": {"episodes": 2, "reevaluate": True}})


@pytest.mark.journey
def test_the_command(program: Any, tmp_path: Path) -> None:
    optimize(Experiment.from_mapping(ARCHIVE), out=tmp_path / "archive")
    found = Run.open(tmp_path / "archive").elites
    result = program("runs", "elites", "archive", "--limit", "2", "--plot", "a.png", "--offset", "-9")
    assert result.returncode == 0, result.stderr
    head, names, first, second, more, picture = result.stdout.splitlines()
    count = len(found.candidates)
    assert head.startswith(f"The archive has elites in {count} of 30 cells (coverage ")
    assert head.endswith(f"QD score {found.qd_score(-9):.6g} (offset -9).")
    assert names.split() == ["generation", "candidate", "fitness", "steps", "distance"]
    assert first.split()[:2] == [str(found.candidates[0].generation), str(found.candidates[0].candidate)]
    assert float(second.split()[2]) == pytest.approx(found.candidates[1].fitness, rel=1e-5)
    assert more == f".. and {count - 2} more: --limit 0 shows all"
    assert picture == "The figure is in a.png"
    assert (tmp_path / "a.png").exists()
    values = json.loads(program("runs", "elites", "archive", "--json").stdout)
    assert (values["kind"], values["cells"], len(values["elites"])) == ("archive", 30, count)
    assert values["elites"][0]["metrics"] == found.candidates[0].metrics
    assert f"  the archive has elites in {count} of 30 cells" in program("runs", "show", "archive").stdout
    shown = json.loads(program("runs", "show", "archive", "--json").stdout)["elites"]
    assert shown == {
        name: value for name, value in values.items() if name not in {"run", "elites", "held_out", "picture"}
    }
    assert np.isfinite(shown["qd_score"])


def test_the_command_that_lists_them_can_be_typed(tmp_path: Path) -> None:
    values = {**ARCHIVE, "method": {**ARCHIVE["method"], "population": 4, "generations": 1}}
    run = optimize(Experiment.from_mapping(values), out=tmp_path / "two words")
    (line,) = extra_lines(run)
    assert shlex.split(line.split("`")[1]) == ["swarmwright", "runs", "elites", str(run.path)]
