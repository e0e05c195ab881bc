"""Generations that the engine evolves by itself: the record is that of the ordinary loop."""

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, Run, RunError, optimize, resume
from swarmwright.methods import METHODS
from swarmwright.methods._nes import Nes
from swarmwright.methods.openai_es import OpenaiEs
from swarmwright.methods.search import SearchMethod
from swarmwright.runs.optimization.ahead import Ahead
from swarmwright.runs.optimization.recorder import Recorder
from swarmwright.runs.store import StoreReader
from tests.python.records import same_record

KINDS = [
    name
    for name in METHODS.names()
    if issubclass(METHODS.get(name), SearchMethod) and name != "novelty"  # which scores metrics in Python
]
SHARES: list[dict[str, Any]] = [
    {"population": 1024, "generations": 6},
    {"population": 20, "generations": 30, "islands": 3, "exchange_interval": 2, "exchange": 0.6},
    {"population": 20, "generations": 30, "severity": 0.0},
    {"population": 30, "generations": 20, "partners": 2, "probability": 0.3, "elite": 0.0, "random": 0.25},
    {"population": 30, "generations": 200, "target": -1.0},
    {"population": 30, "generations": 200, "evaluations": 333},
]
RESTARTS: list[dict[str, Any]] = [
    {"kind": "snes", "population": 8, "generations": 200, "step": 0.05, "rate": 0.5, "restart": "same"},
    {"kind": "xnes", "population": 8, "generations": 200, "step": 0.05, "rate": 0.5, "restart": "ipop"},
    {"kind": "cma_es", "population": 8, "generations": 500, "restart": "ipop"},
    {"kind": "cma_es", "population": 8, "generations": 500, "restart": "bipop", "evaluations": 3000},
    {"kind": "sep_cma_es", "population": 8, "generations": 500, "restart": "bipop"},
    {"kind": "pso", "population": 10, "generations": 40, "adaptive": True, "perturb": True},
]


def experiment(method: dict[str, Any], **other: Any) -> Experiment:
    controller = {"kind": "layered", "hidden": [3]}
    values = {"simulation": "minisim", "controller": controller, "method": method, "servers": "local"}
    return Experiment.from_mapping({**values, "seed": 4, **other})


def ordinary(made: Experiment, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A run in which Python asks and tells."""
    with monkeypatch.context() as patch:
        patch.setattr(Ahead, "of", classmethod(lambda *_, **__: None))
        return optimize(made, out=folder)


@pytest.fixture(autouse=True)
def used(monkeypatch: pytest.MonkeyPatch) -> list[Ahead]:
    """Those that were made; at the end of each test none of their threads is left."""
    made: list[Ahead] = []
    begin = Ahead.of.__func__  # type: ignore[attr-defined] # of the class method

    def noted(kind: type[Ahead], *arguments: Any, **options: Any) -> Ahead | None:
        found: Ahead | None = begin(kind, *arguments, **options)
        if found is not None:
            made.append(found)
        return found

    monkeypatch.setattr(Ahead, "of", classmethod(noted))
    return made


def in_two_parts(made: Experiment, folder: Path, generations: int) -> Run:
    """A run that a callback ends and that goes on."""
    part = optimize(made, lambda now: now.generation + 1 < generations, out=folder)
    assert (part.state, part.generations) == ("stopped", generations)
    return resume(part)


@pytest.mark.parametrize("kind", KINDS)
def test_every_method_has_the_same_record(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, used: list[Ahead]
) -> None:
    controller = {"controller": {"kind": "neat"}} if kind == "neat" else {}
    made = experiment({"kind": kind, "population": 20, "generations": 30}, **controller)
    whole = ordinary(made, tmp_path / "whole", monkeypatch)
    assert not used
    run = optimize(made, out=tmp_path / "run")
    assert len(used) == 1
    same_record(run, whole)
    assert run.digest == whole.digest
    assert [vars(row) for row in run.history] == [vars(row) for row in whole.history]
    assert run.best == whole.best
    assert run.sessions[0].outcome == "done"
    same_record(in_two_parts(made, tmp_path / "parts", 11), whole)
    assert len(used) == 3


@pytest.mark.parametrize("controller", [{"kind": "layered"}, {"kind": "fully_meshed", "hidden": 1}], ids=str)
@pytest.mark.parametrize("method", SHARES, ids=str)
def test_members_that_stay_are_the_same(
    method: dict[str, Any],
    controller: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    used: list[Ahead],
) -> None:
    made = experiment({"kind": "nnga", **method}, controller=controller)
    whole = ordinary(made, tmp_path / "whole", monkeypatch)
    same_record(optimize(made, out=tmp_path / "run"), whole)
    assert len(used) == 1
    for at in {1, whole.generations // 2} - {0, whole.generations}:
        same_record(in_two_parts(made, tmp_path / f"at-{at}", at), whole)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_servers_give_the_same_record(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, used: list[Ahead]
) -> None:
    controller = {"controller": {"kind": "neat"}} if kind == "neat" else {}
    made = experiment({"kind": kind, "population": 20, "generations": 30}, **controller)
    whole = ordinary(made, tmp_path / "whole", monkeypatch)
    run = optimize(made, out=tmp_path / "run", servers=2)
    assert len(used) == 1
    same_record(run, whole)
    assert run.digest == whole.digest
    attempts = list(run.attempts())
    assert [one.generation for one in attempts] == sorted(one.generation for one in attempts)
    for generation, row in enumerate(run.history):
        done = sum(one.candidates for one in attempts if one.generation == generation and not one.error)
        before = run.history[generation - 1].evaluations if generation else 0
        assert done >= row.evaluations - before > 0


@pytest.mark.journey
def test_a_run_on_servers_ends_and_goes_on_as_one_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, used: list[Ahead]
) -> None:
    method = {"kind": "openai_es", "population": 20, "generations": 500, "evaluations": 700}
    made = experiment(method)
    whole = ordinary(made, tmp_path / "whole", monkeypatch)
    assert whole.generations == 35
    part = optimize(made, lambda now: now.generation + 1 < 3, out=tmp_path / "run", servers=2)
    assert (part.state, part.generations) == ("stopped", 3)

    def interrupting(*_: object) -> None:
        raise KeyboardInterrupt

    again = resume(part, on_progress=interrupting, servers=2)
    assert again.interrupted
    assert 3 <= again.generations < whole.generations
    run = resume(again, servers=2)
    assert len(used) == 3
    same_record(run, whole)
    assert StoreReader(run.path).find_end_reason() == StoreReader(whole.path).find_end_reason()


@pytest.mark.slow
def test_what_follows_a_run_has_the_same_servers(tmp_path: Path, used: list[Ahead]) -> None:
    made = experiment(
        {"kind": "snes", "population": 10, "generations": 5},
        parameters={"placement": "random"},
        ranking={"episodes": 2, "seeds": "new"},
        validate={"episodes": 12},
    )
    run = optimize(made, out=tmp_path / "run", servers=1)
    assert len(used) == 1
    assert run.unseen is not None
    assert len(run.unseen.episodes) == 12


@pytest.mark.slow
@pytest.mark.parametrize("method", RESTARTS, ids=str)
def test_new_starts_are_the_same(
    method: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = experiment(method)
    whole = ordinary(made, tmp_path / "whole", monkeypatch)
    same_record(optimize(made, out=tmp_path / "run"), whole)
    for at in (1, whole.generations // 2, whole.generations - 1):
        same_record(in_two_parts(made, tmp_path / f"at-{at}", at), whole)


@pytest.mark.parametrize("seeds", ["same", "new"])
@pytest.mark.parametrize("aggregate", ["mean", "sum", "median", "worst", "quantile", "cvar"])
def test_several_episodes_are_ranked_the_same(
    aggregate: str, seeds: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = experiment(
        {"kind": "openai_es", "population": 12, "generations": 8},
        parameters={"placement": "random", "seed": 5},
        ranking={"kind": "absolute", "episodes": 4, "seeds": seeds, "aggregate": aggregate, "level": 0.4},
    )
    whole = ordinary(made, tmp_path / "whole", monkeypatch)
    same_record(optimize(made, out=tmp_path / "run"), whole)


@pytest.mark.parametrize(
    "ends", [{"target": -3.0}, {"evaluations": 250}, {"evaluations": 5}, {"evaluations": 240}], ids=str
)
def test_it_ends_where_the_ordinary_loop_ends(
    ends: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = experiment({"kind": "openai_es", "population": 20, "generations": 500, **ends})
    whole = ordinary(made, tmp_path / "whole", monkeypatch)
    run = optimize(made, out=tmp_path / "run")
    assert 0 < run.generations < 500
    same_record(run, whole)
    facts = [StoreReader(one.path).find_end_reason() for one in (run, whole)]
    assert facts[0] == facts[1]
    if whole.generations > 2:
        same_record(in_two_parts(made, tmp_path / "parts", 2), whole)


def test_a_budget_of_time_ends_it_and_its_generations_are_the_first(tmp_path: Path) -> None:
    made = experiment({"kind": "snes", "population": 20, "seconds": 0.3})
    run = optimize(made, out=tmp_path / "run")
    assert run.state == "done"
    more = experiment({"kind": "snes", "population": 20, "generations": run.generations})
    same_record(run, optimize(more, out=tmp_path / "more"))


def test_an_interrupt_keeps_what_was_finished(tmp_path: Path) -> None:
    made = experiment({"kind": "pgpe", "population": 40, "generations": 400})
    whole = optimize(made, out=tmp_path / "whole")
    calls = 0

    def interrupting(*_: object) -> None:
        nonlocal calls
        calls += 1
        if calls in {1, 40, 200}:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):  # nothing was finished
        optimize(made, on_progress=interrupting, out=tmp_path / "run")
    run = optimize(made, on_progress=interrupting, out=tmp_path / "run")
    assert run.interrupted
    assert 0 < run.generations < 400
    before = run.generations
    run = resume(run, on_progress=interrupting)
    assert run.interrupted
    assert before < run.generations < 400
    same_record(resume(run), whole)


def test_an_interrupt_in_a_long_generation_ends_it_soon(tmp_path: Path) -> None:
    made = experiment(
        {"kind": "openai_es", "population": 20_000, "generations": 3},
        ranking={"episodes": 2000, "seeds": "new"},
        parameters={"placement": "random"},
    )
    seen = []

    def interrupting(done: int, total: int, waiting_for: str) -> None:
        seen.append((done, total, waiting_for))
        if len(seen) == 3:
            raise KeyboardInterrupt

    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        optimize(made, on_progress=interrupting, out=tmp_path / "run")
    assert time.monotonic() - started < 10
    assert {(total, waiting) for _, total, waiting in seen} == {(40_000_000, "")}
    counts = [done for done, _, _ in seen]
    assert counts == sorted(counts)
    assert counts[0] < counts[-1] < 40_000_000
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("method", [{"kind": "cma_es"}, {"kind": "snes", "evaluations": 10_000}], ids=str)
def test_what_has_ended_is_written_while_the_next_generation_is_evaluated(
    method: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the next one is waited for to see whether it fits."""
    calls = 0

    def counted(_: Recorder) -> None:
        nonlocal calls
        calls += 1

    monkeypatch.setattr(Recorder, "use_idle_time", counted)
    monkeypatch.setattr(Ahead, "is_ready", property(lambda self: self._next is not None))
    run = optimize(experiment({"population": 20, "generations": 10, **method}), out=tmp_path / "run")
    assert (run.generations, calls) == (10, 10)


def test_no_thread_is_left_behind(tmp_path: Path) -> None:
    def threads() -> set[str]:
        return {(task / "comm").read_text().strip() for task in Path("/proc/self/task").iterdir()}

    made = experiment({"kind": "snes", "population": 20, "generations": 100_000})
    optimize(made, lambda now: now.generation < 3, out=tmp_path / "run")
    assert "generations" not in threads()
    assert threading.active_count() < 10


def test_an_error_of_a_new_start_is_told_and_what_was_finished_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = experiment({"kind": "snes", "population": 8, "generations": 300, "step": 0.05, "rate": 0.5})
    whole = optimize(made, out=tmp_path / "whole")

    def broken(_: Nes, generation: int) -> Any:
        raise RunError(f"no start after generation {generation}")

    with monkeypatch.context() as patch:
        patch.setattr(Nes, "_new_start", broken)
        with pytest.raises(RunError, match=r"no start after generation \d+; the results of \d+ generations"):
            optimize(made, out=tmp_path / "run")
    run = Run.open(tmp_path / "run")
    assert 0 < run.generations < 300
    assert run.record.genomes.tobytes() == whole.record.genomes[: run.evaluations].tobytes()
    same_record(resume(run), whole)


def test_a_method_changed_by_a_subclass_is_asked_and_told_in_python(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, used: list[Ahead]
) -> None:
    class Elsewhere(OpenaiEs):
        def _tell(self, genomes: Any, fitness: Any) -> None:
            super()._tell(genomes, np.zeros_like(fitness))

    monkeypatch.setitem(METHODS._loaded, "openai_es", Elsewhere)
    made = experiment({"kind": "openai_es", "population": 8, "generations": 3, "decay": 0.0})
    run = optimize(made, out=tmp_path / "run")
    assert not used
    genomes = run.record.genomes.reshape(3, 4, 2, -1)
    assert np.allclose(genomes.sum(axis=2), 0, atol=1e-6), "a plateau moves nothing"


@pytest.mark.slow
@pytest.mark.parametrize(
    "other",
    [
        {"fitness": "fitness"},
        {"ranking": {"kind": "absolute", "episodes": 2, "reevaluate": True}, "method": {"kind": "pso"}},
        {"method": {"kind": "nnga"}, "controller": {"kind": "mealy_fsm", "states": 2}},
        {"method": {"kind": "cea2d", "width": 3, "height": 3}},
        {"servers": 1, "fitness": "fitness"},
    ],
    ids=str,
)
def test_where_python_has_a_part_it_is_the_ordinary_loop(
    other: dict[str, Any], tmp_path: Path, used: list[Ahead]
) -> None:
    method = {"kind": "de", "population": 10, "generations": 3, **other.get("method", {})}
    if method["kind"] == "cea2d":
        del method["population"]
    other = {name: value for name, value in other.items() if name != "method"}
    run = optimize(experiment(method, **other), out=tmp_path / "run")
    assert run.state == "done"
    assert not used


@pytest.mark.slow
def test_an_interrupt_before_there_is_something_to_close_ends_the_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when Ctrl-C comes after the thread has begun and before the loop knows of it."""
    made = experiment({"kind": "nnga", "population": 6, "generations": 1000}, servers=1, validate=False)
    begin, lost = Ahead.of.__func__, []  # type: ignore[attr-defined] # of the class method

    def interrupted(kind: type[Ahead], *arguments: Any, **options: Any) -> None:
        lost.append(begin(kind, *arguments, **options))  # a traceback keeps it as well
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Ahead, "of", classmethod(interrupted))
        run = optimize(made, out=tmp_path / "run")
    assert run.interrupted
    assert lost[0] is not None
    assert 0 < run.generations < 1000
