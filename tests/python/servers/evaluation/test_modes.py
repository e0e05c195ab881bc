"""One record, however it is computed: stepwise, batched, offloaded, in this process, by one or many."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, Run, RunError, _engine, evaluate, optimize
from swarmwright._engine import InputError
from swarmwright.common.random_numbers import Stream
from swarmwright.simulations import catalogue
from tests.python.records import same_record

MODES = ("stepwise", "batched", "offloaded")
EXPERIMENTS: dict[str, dict[str, Any]] = {
    "minisim": {
        "simulation": "minisim",
        "parameters": {"placement": "random", "numAgents": 3, "numDefenders": 2},
        "controller": {"kind": "layered", "hidden": [5]},
    },
    "emergency_exit": {
        "simulation": "emergency_exit",
        "parameters": {"width": 8, "height": 8, "numAgents": 4, "numBlockades": 3, "steps": 8},
        "controller": {"kind": "fully_meshed", "hidden": 2},
    },
    "machine": {
        "simulation": "minisim",
        "parameters": {"placement": "random", "numAgents": 3, "numDefenders": 2},
        "controller": {"kind": "mealy_fsm", "levels": [3, 3, 2, 2]},
    },
}


def experiment(name: str, **changes: Any) -> Experiment:
    return Experiment.from_mapping(
        {
            **EXPERIMENTS[name],
            "method": {"population": 12, "generations": 2},
            "ranking": {"episodes": 3},
            **changes,
        }
    )


@pytest.fixture(scope="module", params=EXPERIMENTS)
def expected(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Run]:
    """Name of the experiment, and the run that all others must equal."""
    folder = tmp_path_factory.mktemp(request.param) / "run"
    return request.param, optimize(experiment(request.param), servers="local", out=folder)


@pytest.mark.journey
@pytest.mark.parametrize("servers", [1, 2, 8])
@pytest.mark.parametrize("mode", MODES)
def test_the_record_is_the_same_bytes(
    mode: str, servers: int, expected: tuple[str, Run], tmp_path: Path
) -> None:
    title, local = expected
    run = optimize(experiment(title, mode=mode), servers=servers, out=tmp_path / "run")
    same_record(run, local)
    entries = [vars(attempt) for attempt in run.attempts()]
    assert {entry["mode"] for entry in entries} == {mode}
    # Where a server is slow, another one may have had the same.
    assert sum(entry["candidates"] * entry["episodes"] for entry in entries) >= run.evaluations * 3
    assert all((entry["steps"] is not None) == (mode != "offloaded") for entry in entries)


@pytest.mark.slow
def test_of_each_server_the_fastest_way_is_used(tmp_path: Path) -> None:
    run = optimize(experiment("minisim"), servers=2, out=tmp_path / "run")
    assert {attempt.mode for attempt in run.attempts()} == {"offloaded"}


@pytest.mark.parametrize("name", EXPERIMENTS)
@pytest.mark.parametrize("level", ["auto", *_engine.levels()])
@pytest.mark.parametrize("threads", [0, 1, 3])
def test_instruction_sets_and_threads_change_nothing(name: str, level: str, threads: int) -> None:
    one = experiment(name)
    representation = one.representation()
    genomes = np.stack([representation.initial(Stream(1, "test", 0, index)) for index in range(101)])
    arguments = (one.simulation, one.parameters, representation.architecture())
    seeds = [4, 5, 9]
    metrics = list(catalogue.description(one.simulation)["metrics"])
    found, values = _engine.evaluate(
        *arguments, genomes, seeds, metrics=metrics, level=level, threads=threads
    )
    assert found.shape == (101, 3)
    assert values.shape == (101, 3, len(metrics))
    expected = _engine.evaluate(*arguments, genomes, seeds, metrics=metrics, level="scalar", threads=1)
    assert (found.tobytes(), values.tobytes()) == tuple(part.tobytes() for part in expected)
    # What is asked for besides changes no fitness; candidates and episodes do not touch each other.
    alone, nothing = _engine.evaluate(*arguments, genomes, seeds, level=level, threads=threads)
    assert (alone.tobytes(), nothing.shape) == (found.tobytes(), (101, 3, 0))
    one_only = (genomes[70:71].copy(), seeds[1:2])
    single, _ = _engine.evaluate(*arguments, *one_only, level=level, threads=threads)
    assert single[0, 0] == found[70, 1]


def test_wrong_ways_are_refused() -> None:
    one = experiment("minisim")
    representation = one.representation()
    architecture = representation.architecture()
    genomes = np.zeros((2, representation.genome_size), dtype=np.float32)
    assert _engine.levels()[0] == "scalar"
    mistakes: list[tuple[dict[str, Any], str]] = [
        ({"level": "mmx"}, 'level: "mmx" is not available on this processor; expected one of auto, scalar'),
        ({"genomes": genomes[:, 1:]}, f"genomes: have {representation.genome_size - 1} weights each"),
        ({"genomes": np.full_like(genomes, np.nan)}, r"genomes\[0\]\[0\] is NaN or infinite"),
        ({"seeds": []}, "seeds: expected at least one"),
        ({"architecture": {}}, "controller.version"),
        ({"title": "minisym"}, "unknown simulation 'minisym'"),
        ({"parameters": {"maxSteps": -1}}, "maxSteps"),
        (
            {"metrics": ["stpes"]},
            '"stpes" is not a metric of minisim; it has arrived, caught, steps, distance',
        ),
    ]
    for arguments, words in mistakes:
        given: dict[str, Any] = {
            "title": "minisim",
            "parameters": {},
            "architecture": architecture,
            "genomes": genomes,
            "seeds": [0],
        }
        with pytest.raises(InputError, match=words):
            _engine.evaluate(**{**given, **arguments})


def test_progress_and_interruption_in_this_process() -> None:
    one = experiment("minisim", parameters={"maxSteps": 100_000, "numDefenders": 0, "speedAgents": 0})
    seen: list[tuple[int, int, str]] = []

    def stop(done: int, total: int, waiting_for: str) -> None:
        seen.append((done, total, waiting_for))
        raise KeyboardInterrupt

    genomes = np.zeros((20_000, one.genome_size), dtype=np.float32)
    with pytest.raises(KeyboardInterrupt):
        evaluate(one, genomes, servers="local", on_progress=stop)
    assert len(seen) == 1
    assert 0 < seen[0][0] < seen[0][1] == 60_000


@pytest.mark.slow
def test_a_seed_only_server_is_stepped_and_unfit_for_any_other_mode(
    foreign: Callable[..., Any], any_broker: str, tmp_path: Path
) -> None:
    line = Experiment.from_mapping(
        {
            "simulation": "line",
            "requirements": {"dimensions": 1},
            "sensors": 2,
            "actuators": 1,
            "method": {"population": 6, "generations": 1},
        }
    )
    with foreign(any_broker, "line") as plain:
        run = optimize(line, broker=any_broker, out=tmp_path / "run")
        assert plain.episodes == 6 + 6, "each evaluation is audited"
        assert {attempt.mode for attempt in run.attempts()} == {"stepwise"}
        for mode in ("batched", "offloaded"):
            named = line.replace(mode=mode, timeouts={"discovery": 0.5})
            with pytest.raises(RunError, match=f"server 77: does not offer mode {mode}"):
                optimize(named, broker=any_broker, out=tmp_path / "other")
