"""TPE, whose proposals come from a library."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmwright import Experiment, Generation, InputError, optimize, resume
from swarmwright.controllers import Representation
from swarmwright.controllers.kinds.parameter_set import ParameterSet, ParameterSetOptions
from swarmwright.methods import METHODS
from swarmwright.methods.tpe import Tpe
from tests.python.methods.functions import new, sphere

PARAMETERS = {
    "speed": {"type": "real", "range": [0, 10]},
    "gain": {"type": "real", "range": [0.001, 1000], "scale": "log"},
    "robots": {"type": "integer", "range": [1, 30]},
    "rule": {"type": "categorical", "choices": ["a", "b", "c", "d", "e"]},
}


def parameters() -> Representation:
    options = ParameterSetOptions.model_validate({"parameters": PARAMETERS})
    return ParameterSet(options, sensors=1, actuators=1)


def loss(values: np.ndarray[Any, np.dtype[np.float32]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Least, 0, for speed 3, gain 10, 20 robots and rule d."""
    speed, gain, robots, rule = values.astype(np.float64).T
    return np.asarray(
        (speed / 10 - 0.3) ** 2 + (np.log10(gain) / 6 - 1 / 6) ** 2 + (robots / 30 - 2 / 3) ** 2 + (rule != 3)
    )


def least(kind: str, seed: int) -> float:
    """Least loss in 80 evaluations."""
    subject = parameters()
    method = new(kind, seed=seed, subject=subject, population=10, generations=8)
    losses = []
    while not method.done:
        values = loss(subject.weights(method.ask()))
        losses.append(values.min())
        method.tell(-values)
    return float(min(losses))


def test_it_needs_fewer_evaluations_than_random_search() -> None:
    kinds = ("tpe", "random_search")
    losses = {kind: np.array([least(kind, seed) for seed in range(6)]) for kind in kinds}
    assert np.median(losses["tpe"]) < np.median(losses["random_search"]) / 3


def test_categories_are_proposed_as_such() -> None:
    method = new("tpe", subject=parameters(), population=30, generations=1, startup=1)
    genes = method.ask()[1:, 3]
    method.tell(np.zeros(30))
    assert set(genes.tolist()) <= {np.float32(gene) for gene in (0.1, 0.3, 0.5, 0.7, 0.9)}
    assert len(set(genes.tolist())) > 1


@pytest.mark.parametrize("fitness", [np.nan, 0.0, 1e300])
def test_candidates_that_fail_or_are_alike(fitness: float) -> None:
    method = new("tpe", population=5, generations=4, startup=2)
    while not method.done:
        genomes = method.ask()
        assert np.isfinite(genomes).all()
        assert len({genome.tobytes() for genome in genomes}) == 5
        method.tell(np.full(5, fitness))


def test_recorded_genomes_beyond_the_range_are_told() -> None:
    """A record may have been edited."""
    method = new("tpe", population=3, generations=3, startup=1)
    method.take_recorded(np.full((3, 10), 1e30, dtype=np.float32))
    assert (method.ask() == np.float32(1e30)).all()
    method.tell([1.0, 2.0, 3.0])
    assert np.isfinite(method.ask()).all()


def test_given_controllers_beyond_the_range_are_candidates() -> None:
    method = new("tpe", population=3, generations=3, startup=1)
    start = np.full((2, 10), 40.0, dtype=np.float32)
    method.start_from(start)
    assert method.ask()[:2].tobytes() == start.tobytes()
    method.tell([1.0, 2.0, 3.0])
    assert method.ask().shape == (3, 10)


def test_too_many_genes_are_refused() -> None:
    layered = {"kind": "layered", "hidden": [50]}
    with pytest.raises(
        InputError, match=r"tpe cannot evolve layered: \d+ genes are too many for few evaluations"
    ):
        Experiment.from_mapping({"simulation": "minisim", "controller": layered, "method": {"kind": "tpe"}})


@pytest.mark.parametrize("operation", ["generational", "steady_state"])
@pytest.mark.slow
def test_a_resumed_run_takes_the_proposals_of_its_record(
    operation: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another version of the library may propose others."""
    method = {"kind": "tpe", "population": 10, "generations": 5, "operation": operation, "in_flight": 4}
    experiment = Experiment.from_mapping({"simulation": "minisim", "method": method, "seed": 2})

    def until_three(now: Generation) -> bool:
        return now.generation < 2

    part = optimize(experiment, until_three, servers="in-process", out=tmp_path / "run")
    before = part.record.genomes.copy()

    def propose(self: Tpe, index: int) -> np.ndarray[Any, np.dtype[np.float32]]:
        return np.full(self.representation.genome_size, index / 100, dtype=np.float32)

    monkeypatch.setattr(Tpe, "_propose", propose)
    run = resume(part, servers="in-process")
    assert run.record.genomes[:30].tobytes() == before.tobytes()
    assert (run.record.genomes[40:, 0] == np.arange(40, 50, dtype=np.float32) / 100).all()


def test_without_the_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmwright.methods._base.find_spec", lambda _: None)
    with pytest.raises(InputError, match="tpe needs optuna; run pip install optuna"):
        Experiment.from_mapping({"simulation": "minisim", "method": {"kind": "tpe"}}).new_method(
            Experiment.from_mapping({"simulation": "minisim"}).representation()
        )


def test_the_best_of_a_simple_function() -> None:
    method = new("tpe", population=10, generations=10)
    best = -np.inf
    while not method.done:
        values = -sphere(method.ask().astype(np.float64))
        best = max(best, values.max())
        method.tell(values)
    assert METHODS.get("tpe").libraries == ("optuna",)
    assert best > -30
