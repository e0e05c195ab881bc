"""Servers that make the genomes of a generation themselves: one record, whoever makes them."""

import os
import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, optimize
from swarmwright.methods import METHODS
from swarmwright.runs.optimization.ahead import Ahead
from swarmwright.runs.optimization.generation import Generation
from swarmwright.servers.evaluation.base import Controllers
from swarmwright.servers.evaluation.opening import open_backend
from tests.python.records import same_record

SAMPLED: tuple[dict[str, Any], ...] = (
    {"kind": "openai_es", "population": 200, "generations": 4},
    {"kind": "pgpe", "population": 200, "generations": 4},
    {"kind": "snes", "population": 101, "generations": 4},
    {"kind": "snes", "population": 60, "generations": 60, "step": 0.05, "rate": 0.5, "restart": "ipop"},
)


def experiment(method: dict[str, Any], **other: Any) -> Experiment:
    controller = {"kind": "layered", "hidden": [3]}
    values = {"simulation": "minisim", "controller": controller, "method": method, "seed": 4}
    return Experiment.from_mapping({**values, **other})


def without_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Send servers the genomes; the engine, which evolves by itself, sends samples."""
    build = Controllers.from_genomes
    monkeypatch.setattr(
        Controllers, "from_genomes", lambda representation, genomes, _=None: build(representation, genomes)
    )
    monkeypatch.setattr(Ahead, "of", lambda *_, **__: None)


@pytest.mark.slow
@pytest.mark.parametrize("method", SAMPLED, ids=lambda method: f"{method['kind']}-{method['population']}")
def test_records_are_the_same_for_any_number_of_servers(
    method: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = experiment(method, ranking={"kind": "absolute", "episodes": 2})
    here = optimize(made, out=tmp_path / "here", servers="in-process")
    for servers in (1, 2, 8):
        run = optimize(made, out=tmp_path / str(servers), servers=servers)
        same_record(run, here)
    without_samples(monkeypatch)
    same_record(optimize(made, out=tmp_path / "genomes", servers=2), here)


def sent(made: Experiment, sampled: bool) -> int:
    """Bytes that the tool sends for the first generation."""
    method = made.new_method(made.representation(4, 1))
    genomes = method.ask()
    representation = made.representation(4, 1)
    controllers = Controllers.from_genomes(representation, genomes, method.sample if sampled else None)
    assert (controllers.sample is not None) == sampled
    traffic: list[int] = []

    def listen(report: Any) -> None:
        if report["event"] == "status":
            traffic.append(report["traffic"]["sent_bytes"])

    with open_backend(made, servers=2) as backend:
        backend._pool.listen(listen)  # type: ignore[attr-defined] # of servers
        found = backend.evaluate(controllers, [0], lambda *_: None).fitness
    with open_backend(made, servers="in-process") as backend:
        assert backend.evaluate(controllers, [0], lambda *_: None).fitness.tobytes() == found.tobytes()
    return traffic[-1]


@pytest.mark.slow
def test_the_distribution_travels_instead_of_the_genomes() -> None:
    made = experiment({"kind": "openai_es", "population": 4000})
    genomes = 4 * 4000 * made.representation(4, 1).genome_size
    assert sent(made, sampled=False) > genomes
    assert sent(made, sampled=True) < genomes / 5


def test_genes_that_are_not_the_weights_travel_as_weights() -> None:
    options = {"kind": "parameter_set", "parameters": {"avoidance": {"type": "real", "range": [0, 5]}}}
    values = {"simulation": "minisim", "parameters": {"steering": "rule"}, "controller": options}
    made = Experiment.from_mapping({**values, "method": {"kind": "openai_es", "population": 40}})
    representation = made.representation(4, 1)
    method = made.new_method(representation)
    genomes = method.ask()
    assert method.sample is not None
    assert Controllers.from_genomes(representation, genomes, method.sample).sample is None


@pytest.mark.parametrize("kind", ["xnes", "cma_es", "de", "nnga"])
def test_other_methods_have_no_sample(kind: str) -> None:
    made = experiment({"kind": kind})
    method = made.new_method(made.representation(4, 1))
    method.ask()
    assert method.sample is None


def test_a_subclass_that_makes_its_own_genomes_has_no_sample() -> None:
    class Shifted(METHODS.get("openai_es")):  # type: ignore[misc] # a class that is looked up
        def _ask(self) -> Any:
            return super()._ask() + np.float32(1)

    made = experiment({"kind": "openai_es"})
    method = Shifted(made.method, made.representation(4, 1), seed=1)
    method.ask()
    assert method.sample is None


@pytest.mark.slow
def test_a_sample_of_other_genomes_is_refused() -> None:
    made = experiment({"kind": "openai_es", "population": 40})
    representation = made.representation(4, 1)
    method = made.new_method(representation)
    genomes = method.ask()
    controllers = Controllers.from_genomes(representation, genomes[:30], method.sample)
    with (
        open_backend(made, servers=1) as backend,
        pytest.raises(InputError, match=r"40 candidates of .* but there are 30"),
    ):
        backend.evaluate(controllers, [0], lambda *_: None)


@pytest.mark.journey
def test_a_server_killed_in_the_middle_leaves_no_trace_in_the_record(tmp_path: Path) -> None:
    made = experiment({"kind": "openai_es", "population": 20_000, "generations": 60})
    here = optimize(made, out=tmp_path / "here", servers="in-process")
    begun = threading.Event()
    killed: list[int] = []

    def kill() -> None:
        assert begun.wait(30)
        mine = Path("/proc/self/task")
        children = {
            int(child) for task in mine.iterdir() for child in (task / "children").read_text().split()
        }
        servers = [
            child for child in sorted(children) if b"serve" in Path(f"/proc/{child}/cmdline").read_bytes()
        ]
        os.kill(servers[0], signal.SIGKILL)
        killed.append(servers[0])

    def watch(now: Generation) -> None:
        if now.generation == 5:
            begun.set()

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        run: Run = optimize(
            made,
            out=tmp_path / "killed",
            servers=2,
            on_generation=watch,
        )
    finally:
        begun.set()
        killer.join()
    assert killed
    same_record(run, here)
