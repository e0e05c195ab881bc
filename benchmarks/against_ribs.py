"""QD score and seconds of `map_elites` against pyribs, with the same initial candidates and archives.

`python -m benchmarks.against_ribs` prints the table of docs/explanation/method-benchmarks.md.
"""

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import Samples
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.methods import METHODS

Points = NDArray[np.float64]
SEEDS = range(1, 6)
EMITTERS, SIZE = 15, 36
SIGMA, ISO, LINE = 0.5, 0.1, 0.2
LEARNING_RATE = 0.01


def linear_projection(points: Points) -> Points:
    """Return the measures of Fontaine et al. 2020: the sums of both halves, of genes clipped to +-5.12."""
    clipped = np.where(np.abs(points) <= 5.12, points, 5.12 / np.where(points == 0, 1, points))
    half = points.shape[1] // 2
    return np.stack([clipped[:, :half].sum(axis=1), clipped[:, half:].sum(axis=1)], axis=1)


def sphere(points: Points) -> tuple[Points, Points]:
    """Return fitness, 0 to 100 for genes within +-5.12, and measures."""
    worst = points.shape[1] * (5.12 + 2.048) ** 2
    return 100 * (1 - ((points - 2.048) ** 2).sum(axis=1) / worst), linear_projection(points)


def rastrigin(points: Points) -> tuple[Points, Points]:
    """Return fitness, 0 to 100 for genes within +-5.12, and measures."""

    def value(shifted: Points) -> Points:
        return np.asarray((shifted**2 - 10 * np.cos(2 * np.pi * shifted) + 10).sum(axis=-1))

    worst = value(np.full(points.shape[1], -5.12 - 2.048))
    return 100 * (1 - value(points - 2.048) / worst), linear_projection(points)


def arm(points: Points) -> tuple[Points, Points]:
    """Return 100 less the variance of a planar arm's angles, and where its end is; links have a length of 1.

    As in pyribs, after Vassiliades and Mouret 2018, with angles that are not limited.
    """
    angles = np.cumsum(points, axis=1)
    ends = np.stack([np.cos(angles).sum(axis=1), np.sin(angles).sum(axis=1)], axis=1)
    return 100 * (1 - points.var(axis=1)), ends


@dataclass(frozen=True)
class Domain:
    """What is illuminated."""

    function: Callable[[Points], tuple[Points, Points]]
    genes: int
    reach: float
    limit: float
    """Largest value of both measures; the smallest is its negative."""


DOMAINS = (
    Domain(sphere, 20, 5.12, 5.12 * 10),
    Domain(rastrigin, 20, 5.12, 5.12 * 10),
    Domain(arm, 12, np.pi, 12.0),
)


@dataclass(frozen=True)
class Case:
    """A domain, an archive and a variation."""

    domain: Domain
    archive: str
    variation: str
    generations: int = 500

    def __str__(self) -> str:
        """Name it."""
        return f"{self.domain.function.__name__}, {self.archive}, {self.variation}"

    @property
    def representation(self) -> Representation:
        """Genes that begin within the domain."""
        layered = REPRESENTATIONS.get("layered")
        options = {"hidden": [], "weight_range": self.domain.reach, "bias_range": self.domain.reach}
        return layered(
            layered.options_model.model_validate(options), sensors=self.domain.genes - 1, actuators=1
        )

    def method(self, seed: int) -> Any:
        """Return ours."""
        limit = self.domain.limit
        bins = {"bins": 100} if self.archive == "grid" else {}
        component = METHODS.get("map_elites")
        options: dict[str, Any] = {
            "population": EMITTERS * SIZE,
            "generations": self.generations,
            "measures": {name: {"range": [-limit, limit], **bins} for name in ("x", "y")},
            "archive": {"kind": "cvt", "cells": 1000} if self.archive == "cvt" else {"kind": "grid"},
            "variation": self.variation,
            "emitters": EMITTERS,
            "step": ISO / self.domain.reach / 2,
            "line": LINE,
            "sigma": SIGMA / self.domain.reach,
            "learning_rate": LEARNING_RATE,
        }
        if self.variation == "cma_mae":
            options["threshold_min"] = 0.0
        return component(component.options_model.model_validate(options), self.representation, seed=seed)

    def ours(self, seed: int) -> tuple[float, float]:
        """Return the QD score and the seconds of all but the evaluations."""
        method, seconds = self.method(seed), 0.0
        while not method.done:
            start = time.perf_counter()
            points = method.ask().astype(np.float64)
            seconds += time.perf_counter() - start
            fitness, measures = self.domain.function(points)
            start = time.perf_counter()
            method.tell(fitness, metrics=measures)
            seconds += time.perf_counter() - start
        return float(method.archive.fitness.sum()), seconds

    def theirs(self, seed: int) -> tuple[float, float]:
        """Return those of pyribs, which begins with the same candidates."""
        first = self.method(seed).ask().astype(np.float64)
        archive, best, scheduler = self._ribs(seed, first)
        seconds = 0.0
        for generation in range(self.generations):
            start = time.perf_counter()
            points = first if generation == 0 else scheduler.ask()
            seconds += time.perf_counter() - start
            fitness, measures = self.domain.function(points)
            start = time.perf_counter()
            if generation == 0:
                archive.add(points, fitness, measures)
                if best is not archive:
                    best.add(points, fitness, measures)
            else:
                scheduler.tell(fitness, measures)
            seconds += time.perf_counter() - start
        return float(best.stats.qd_score), seconds

    def _ribs(self, seed: int, first: Points) -> tuple[Any, Any, Any]:
        """Return its archive, that of the best, and its scheduler."""
        from ribs.archives import CVTArchive, GridArchive
        from ribs.emitters import EvolutionStrategyEmitter, IsoLineEmitter
        from ribs.schedulers import Scheduler

        ranges = [(-self.domain.limit, self.domain.limit)] * 2
        new = partial(GridArchive, dims=(100, 100))
        if self.archive == "cvt":
            new = partial(CVTArchive, centroids=self.method(seed).options.cells.centroids)
        new = partial(new, solution_dim=self.domain.genes, ranges=ranges, seed=seed)
        annealed = self.variation == "cma_mae"
        archive = new(learning_rate=LEARNING_RATE, threshold_min=0.0) if annealed else new()
        best = new() if annealed else archive
        emitters: list[Any]
        if self.variation == "line":
            line = partial(IsoLineEmitter, iso_sigma=ISO, line_sigma=LINE, x0=np.zeros(self.domain.genes))
            emitters = [line(archive, batch_size=EMITTERS * SIZE, seed=seed)]
        else:
            kinds = (
                {"ranker": "imp", "selection_rule": "mu", "restart_rule": "basic"}
                if annealed
                else {"ranker": "2imp", "selection_rule": "filter", "restart_rule": "no_improvement"}
            )
            emitters = [
                EvolutionStrategyEmitter(
                    archive, x0=start, sigma0=SIGMA, batch_size=SIZE, seed=100 * seed + number, **kinds
                )
                for number, start in enumerate(first[:EMITTERS])
            ]
        return archive, best, Scheduler(archive, emitters, result_archive=best if annealed else None)


CASES = tuple(
    Case(domain, archive, variation)
    for domain in DOMAINS
    for archive, variation in (("grid", "line"), ("cvt", "line"), ("grid", "cma_me"), ("grid", "cma_mae"))
)


def warm_up() -> None:
    """Let pyribs compile what it needs."""
    for variation in ("line", "cma_me"):
        Case(DOMAINS[0], "grid", variation, generations=3).theirs(1)


class RibsSuite:
    """Each case once a repetition, with its number as seed."""

    def __init__(self, cases: tuple[Case, ...] = CASES) -> None:
        warm_up()
        self._seed = 0
        self._samples: dict[Case, list[Samples]] = {}
        for case in cases:
            scores = Samples(f"pyribs: {case}", "QD score")
            seconds = Samples(f"pyribs: {case}, without evaluations", "s")
            self._samples[case] = [
                scores,
                Samples(f"map_elites: {case}", "QD score", scores, ">= 0.98"),
                seconds,
                Samples(f"map_elites: {case}, without evaluations", "s", seconds, "<= 0.5"),
            ]

    def repeat(self) -> None:
        """Take one sample of everything."""
        self._seed += 1
        for case, (scores, our_scores, seconds, our_seconds) in self._samples.items():
            for measured, score, duration in (
                (case.theirs(self._seed), scores, seconds),
                (case.ours(self._seed), our_scores, our_seconds),
            ):
                score.add(measured[0])
                duration.add(measured[1])

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""
        return [one for samples in self._samples.values() for one in samples]

    def close(self) -> None:
        """Nothing is left open."""


def rows() -> Iterator[str]:
    """Yield the lines of the table, in Markdown: medians over the seeds."""
    warm_up()
    yield "| domain, archive, variation | Swarmwright: QD score | seconds | pyribs: QD score | seconds |"
    yield "|---|---|---|---|---|"
    for case in CASES:
        figures = []
        for run in (case.ours, case.theirs):
            scores, seconds = zip(*map(run, SEEDS), strict=True)
            figures += [f"{statistics.median(scores):,.0f}", f"{statistics.median(seconds):.2g}"]
        yield f"| {case} | {' | '.join(figures)} |"


if __name__ == "__main__":
    for line in rows():
        print(line, flush=True)
