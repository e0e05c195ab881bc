"""The page of a run: its curve with every evaluation, replays, experiment, servers and failures."""

import base64
from dataclasses import asdict
from itertools import islice
from typing import Any

import numpy as np
from starlette.requests import Request

from swarmwright import InputError, Run
from swarmwright.runs.density import evaluation_density, nearest_evaluation
from swarmwright.ui.index import as_values, finite
from swarmwright.ui.requests import read_integer, read_number
from swarmwright.ui.views._base import STATIC, View
from swarmwright.ui.window import Window

CURVE_POINTS = 1500
MOST_EVENTS = 300
MOST_SERVERS = 500
MOST_REASONS = 50
CURVES = ("best_so_far", "best", "mean", "median", "lower_quartile", "upper_quartile")


def describe(run: Run) -> dict[str, Any]:
    """Return the figures of a run: its curve, best candidate, validation, sessions and experiment."""
    experiment = run.experiment
    best = None
    if run.history:
        leading = run.best
        best = {
            "fitness": finite(leading.fitness),
            "generation": leading.generation,
            "candidate": leading.candidate,
        }
    return {
        "curve": curve(run),
        "best": best,
        "best_words": run.best_words,
        "ended": run.ended,
        "failed_episodes": run.failed_episodes if run.failed_evaluations else 0,
        "episodes": experiment.ranking.episodes,
        "first_seed": experiment.first_seed,
        "held_out": describe_held_out(run),
        "sessions": [as_values(asdict(session)) for session in run.sessions],
        "experiment": as_values(experiment.to_mapping()),
        "metrics": run.metrics,
    }


def curve(run: Run) -> dict[str, list[Any]]:
    """Return the columns of the learning curve, at most `CURVE_POINTS` generations of it."""
    history = run.history
    if len(history) > CURVE_POINTS:
        history = [history[round(position)] for position in np.linspace(0, len(history) - 1, CURVE_POINTS)]
    columns: dict[str, list[Any]] = {
        "evaluations": [summary.evaluations for summary in history],
        "generation": [summary.generation for summary in history],
    }
    for name in CURVES:
        columns[name] = [finite(getattr(summary, name)) for summary in history]
    return columns


def describe_held_out(run: Run) -> dict[str, Any] | None:
    """Return the best candidate's fitness on held-out seeds; None where it was not evaluated there."""
    unseen = run.unseen
    if unseen is None:
        return None
    fitness = unseen.fitness
    return {
        "mean": finite(fitness.mean),
        "low": finite(fitness.low),
        "high": finite(fitness.high),
        "episodes": len(unseen.episodes),
        "failed": unseen.failed,
        "generation": unseen.generation,
        "candidate": unseen.candidate,
        "is_reportable": unseen.is_reportable,
    }


def density(run: Run, columns: int, rows: int) -> dict[str, Any]:
    """Return all evaluations as a grid: a byte for each cell, 0 for none, larger for more."""
    grid = evaluation_density(run, columns, rows)
    shades = np.zeros(grid.counts.shape, np.uint8)
    if grid.counts.any():
        logarithm = np.log1p(grid.counts)
        shades = np.ceil(255 * logarithm / logarithm.max()).astype(np.uint8)
    return {
        "columns": columns,
        "rows": rows,
        "cells": base64.b64encode(shades.tobytes()).decode(),
        "evaluations": grid.evaluations,
        "lowest": grid.lowest,
        "highest": grid.highest,
        "failed": grid.failed,
    }


def nearest(run: Run, number: float, fitness: float, width: float, height: float) -> dict[str, Any]:
    """Return the evaluation next to a point of the grid."""
    if not all(map(np.isfinite, (number, fitness, width, height))):
        raise InputError("number, fitness, width, height: must be finite")
    evaluation = nearest_evaluation(run, number, fitness, width, height)
    return {
        "number": evaluation.number,
        "generation": evaluation.generation,
        "candidate": evaluation.candidate,
        "fitness": finite(evaluation.fitness),
        "episodes": as_values(evaluation.episodes),
        "seeds": evaluation.seeds,
        "genome": as_values(evaluation.genome[:200]),
        "genes": len(evaluation.genome),
        "metrics": {
            name: as_values(evaluation.metrics[:, column]) for column, name in enumerate(run.metrics)
        },
    }


def journal(run: Run) -> dict[str, Any]:
    """Return the warnings of a run, what its servers did, and why evaluations failed."""
    return {
        "events": [as_values(asdict(event)) for event in islice(run.events(), MOST_EVENTS)],
        "servers": [as_values(share._asdict()) for share in run.servers()[:MOST_SERVERS]],
        "failures": [
            {"reason": failure.reason, "attempts": failure.attempts}
            for failure in run.failures()[:MOST_REASONS]
        ],
    }


def replay(window: Window, request: Request) -> str:
    """Return the page of an episode of a candidate."""
    run = window.run(request)
    options: dict[str, Any] = {
        name: read_integer(request, name)
        for name in ("generation", "candidate", "episode", "seed")
        if name in request.query_params
    }
    best = () if {"generation", "candidate"} & options.keys() else (run.evaluations,)
    return window.page((str(run.path), *sorted(options.items()), *best), lambda: run.replay(**options).html)


def request_nearest(window: Window, request: Request) -> dict[str, Any]:
    """Return the evaluation that is nearest to a point of the grid."""
    point = [read_number(request, name) for name in ("number", "fitness", "width", "height")]
    return nearest(window.run(request), *point)


VIEW = View(
    "run",
    STATIC / "run.js",
    answers={
        "run": lambda window, request: describe(window.run(request)),
        "density": lambda window, request: density(
            window.run(request), read_integer(request, "columns"), read_integer(request, "rows")
        ),
        "nearest": request_nearest,
        "journal": lambda window, request: journal(window.run(request)),
    },
    documents={"replay": replay},
)
