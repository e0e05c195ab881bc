"""Natural evolution strategies: their formulas, how fast they are, and new starts."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from swarmwright import Experiment, InputError, evaluate
from swarmwright._engine import utilities
from swarmwright.methods._nes import Nes
from swarmwright.methods.snes import Snes
from swarmwright.methods.xnes import Xnes
from swarmwright.testing._methods import BoundedGenes
from tests.python.methods.functions import Points, evaluations_to, new, rosenbrock, sphere, ten_genes

KINDS = ["snes", "xnes"]


def strategy(kind: str, **options: Any) -> Nes:
    method = new(kind, **options)
    assert isinstance(method, Nes)
    return method


def away(points: Points) -> Points:
    return sphere(points - 1.0)


def ellipsoid(points: Points) -> Points:
    return np.asarray((10.0 ** (6 * np.arange(10) / 9) * (points - 0.3) ** 2).sum(axis=1))


def ten_generations(method: Nes) -> list[tuple[Points, Points]]:
    """The directions and weights of each."""
    seen = []
    for _ in range(10):
        fitness = -away(method.ask().astype(np.float64))
        seen.append((method.search.state("directions").reshape(-1, 10), utilities(fitness)))
        method.tell(fitness)
    return seen


def test_snes_follows_the_formulas_of_the_source() -> None:
    method = strategy("snes", population=12, step=0.4)
    assert isinstance(method, Snes)
    center, deviation = np.zeros(10), np.full(10, 0.4)
    rate = (3 + np.log(10)) / (5 * np.sqrt(10))
    for directions, weights in ten_generations(method):
        center = center + deviation * (weights @ directions)
        deviation = deviation * np.exp(rate / 2 * (weights @ (directions**2 - 1)))
    assert method.center == pytest.approx(3 * center, rel=1e-9)
    assert method.search.state("deviation") == pytest.approx(deviation, rel=1e-9)


def test_xnes_follows_the_formulas_of_the_source() -> None:
    method = strategy("xnes", population=12, step=0.4)
    assert isinstance(method, Xnes)
    center, square = np.zeros(10), 0.4 * np.eye(10)  # the square root of the covariance matrix
    rate = (9 + 3 * np.log(10)) / (5 * 10 * np.sqrt(10))
    for directions, weights in ten_generations(method):
        gradient = sum(
            weight * (np.outer(direction, direction) - np.eye(10))
            for direction, weight in zip(directions, weights, strict=True)
        )
        center = center + square @ (weights @ directions)
        square = square @ expm(rate / 2 * gradient)
    assert method.center == pytest.approx(3 * center, rel=1e-9)
    assert method.search.state("deviation").reshape(10, 10) == pytest.approx(square, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_samples_are_drawn_around_the_center(kind: str) -> None:
    method = strategy(kind, population=4000, step=0.3)
    genomes = method.ask().astype(np.float64)
    assert genomes.mean(axis=0) == pytest.approx(np.zeros(10), abs=0.05)
    assert genomes.std(axis=0) == pytest.approx(np.full(10, 0.9), rel=0.05)  # 0.3 of half the range of +-3


@pytest.mark.parametrize(
    ("kind", "function", "target", "most"),
    [
        ("snes", away, 1e-3, 2_000),
        ("snes", ellipsoid, 1e-3, 4_000),
        ("xnes", away, 1e-3, 6_000),
        ("xnes", ellipsoid, 1e-3, 12_000),
        ("xnes", rosenbrock, 1.0, 10_000),
    ],
)
def test_evaluations_to_a_target(kind: str, function: Any, target: float, most: int) -> None:
    for seed in (1, 2, 3):
        found = evaluations_to(new(kind, seed=seed, generations=1000), function, target)
        assert found is not None
        assert found <= most


@pytest.mark.parametrize("kind", KINDS)
def test_it_solves_minisim_with_its_defaults(kind: str) -> None:
    solved = 0
    for seed in range(1, 11):
        values = {"simulation": "minisim", "method": {"kind": kind}, "seed": seed}
        experiment = Experiment.from_mapping(values)
        method = experiment.new_method(experiment.representation())
        best = -np.inf
        while best < -0.1 and method.evaluations < 2000:
            fitness = evaluate(experiment, method.ask(), servers="in-process")
            best = max(best, float(fitness.max()))
            method.tell(fitness)
        solved += best >= -0.1
    assert solved >= 9


@pytest.mark.parametrize("kind", KINDS)
def test_a_plateau_and_a_failed_generation_change_nothing(kind: str) -> None:
    method = strategy(kind, restart="none")
    before = method.ask()
    method.tell(np.zeros(len(before)))
    method.ask()
    method.tell(np.full(len(before), np.nan))
    assert method.center.tolist() == [0.0] * 10
    assert method.search.state("widest")[0] == pytest.approx(0.2)


@pytest.mark.parametrize("kind", KINDS)
def test_a_plateau_ends_in_a_new_start_with_twice_the_population(kind: str) -> None:
    method = strategy(kind, population=20, generations=200, restart="ipop")
    sizes = []
    while not method.done:
        sizes.append(len(method.ask()))
        method.tell(np.zeros(sizes[-1]))
    assert sizes[:27] == [20] * 26 + [40], "10 + 30 genes / population generations later"
    assert sizes[-1] > 40
    assert method.budget == 200 * 20 <= method.evaluations < method.budget + sizes[-1]
    assert np.abs(method.center).min() > 0, "from a random genome"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("restart", "factor"), [("ipop", 2), ("same", 1)])
def test_one_that_has_converged_starts_again(kind: str, restart: str, factor: int) -> None:
    method = strategy(kind, generations=3000, restart=restart)
    first, center = method.population, method.center
    while not method.done and np.abs(method.center - center).max() < 1.0:
        genomes, center = method.ask(), method.center
        method.tell(-away(genomes.astype(np.float64)))
    assert not method.done
    assert method.population == factor * first
    assert away(genomes.astype(np.float64)).max() < 0.01
    assert method.search.state("widest")[0] == pytest.approx(0.2)


@pytest.mark.parametrize("kind", KINDS)
def test_genes_are_cut_to_their_bounds(kind: str) -> None:
    method = new(kind, subject=BoundedGenes(), step=1.0, restart="none")
    assert isinstance(method, Nes)
    for _ in range(30):
        method.tell(method.ask().sum(axis=1))
    assert method.center[:9].min() >= 0.0
    assert method.center[:9].max() <= 1.0
    genomes = method.ask()[:, :9]
    assert genomes.max() == 1.0
    assert genomes.min() >= 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_it_goes_on_where_fitness_grows_without_end(kind: str) -> None:
    method = strategy(kind, generations=400)
    for _ in range(400):
        genomes = method.ask()
        assert np.isfinite(genomes).all()
        method.tell(genomes.astype(np.float64).sum(axis=1))
    assert method.center.max() > 1e6


def test_xnes_names_what_to_take_for_large_genomes() -> None:
    subject = type(ten_genes())(ten_genes().options_model(hidden=[50]), sensors=9, actuators=1)  # type: ignore[call-arg]
    with pytest.raises(
        InputError, match=r"551 genes are too many for a covariance matrix; above 500, use snes"
    ):
        new("xnes", subject=subject)
    assert new("snes", subject=subject).ask().shape[1] == 551
