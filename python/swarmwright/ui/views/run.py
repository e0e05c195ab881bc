"""The page of a run: its curve with every evaluation, replays, experiment, servers and failures."""

import base64
import contextlib
import json
import re
from collections.abc import Callable, Hashable, Iterator
from dataclasses import asdict
from enum import IntEnum
from itertools import chain, islice
from typing import Any

import numpy as np
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from swarmwright import InputError, Run
from swarmwright.common.untrusted import escape_line
from swarmwright.display.files import FORMATS
from swarmwright.display.page import format_player
from swarmwright.runs.density import evaluation_density, nearest_evaluation
from swarmwright.runs.matches import describe_champions
from swarmwright.runs.page import PackedEpisode, pack_replay
from swarmwright.ui.exports import BUNDLE, ExportShelf, export_code, export_replay, list_exports, make_bundle
from swarmwright.ui.index import MOST_CHARACTERS, as_values, finite
from swarmwright.ui.replays import (
    EPISODES,
    MOST_BODIES,
    MOST_BODIES_OF_RUN,
    Newest,
    check_parameters,
    computing,
    describe_parameters,
    exporting,
    iterate_in_thread,
    limit_replay,
    mean_of,
    read_parameters,
)
from swarmwright.ui.requests import read_field, read_integer, read_number, read_whole
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window

CURVE_POINTS = 1500
MOST_EVENTS = 300
MOST_SERVERS = 500
MOST_REASONS = 50
BEGINNING = 100
"""Steps of an episode that are on the screen while the others are computed."""
MATCH = re.compile(r"[0-9]{1,9}(,[0-9]{1,9}){1,9}")
SEED_BYTES = 8
"""Of the seed before a kept episode."""
newest = Newest()
shelf = ExportShelf()
CURVES = ("best_so_far", "best", "mean", "median", "lower_quartile", "upper_quartile")


class EpisodePart(IntEnum):
    """Kinds of parts of an answer with an episode."""

    BEGINNING = 0
    WHOLE = 1
    REFUSAL = 2
    """A message, instead of the whole."""


def describe(run: Run) -> dict[str, Any]:
    """Return the figures of a run: its curve, best candidate, validation, sessions and experiment."""
    experiment = run.experiment
    best, champions = None, describe_champions(run)
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
        "champions": None if champions is None else escape_line(champions[:MOST_CHARACTERS]),
        "best_words": run.best_words,
        "failed_episodes": run.failed_episodes if run.failed_evaluations else 0,
        "episodes": experiment.ranking.episodes,
        "held_out": describe_held_out(run),
        "sessions": [as_values(asdict(session)) for session in run.sessions],
        "experiment": as_values(experiment.to_mapping()),
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


def read_episode(request: Request) -> dict[str, Any]:
    """Return which episode a request asks for, as options of `Run.replay`."""
    query = request.query_params
    options: dict[str, Any] = {
        name: read_integer(request, name)
        for name in ("generation", "candidate", "episode", "seed")
        if query.get(name)
    }
    if "seed" in options:
        options.pop("episode", None)
    if query.get("match"):
        options["match"] = read_match(query["match"])
    parameters = read_parameters(query.get("parameters", ""))
    return {**options, "parameters": parameters} if parameters else options


def read_match(text: Any) -> list[int]:  # noqa: ANN401 - JSON
    """Return the generations of a match. Raises InputError for anything else than `40,3`."""
    if not isinstance(text, str) or MATCH.fullmatch(text) is None:
        raise InputError(f"match: must be generations such as '40,3', not {str(text)[:50]!r}")
    return [int(generation) for generation in text.split(",")]


def page_key(run: Run, options: dict[str, Any], kind: str) -> Hashable:
    """Return what a page of an episode depends on."""
    best = () if {"generation", "candidate", "match"} & options.keys() else (run.evaluations,)
    return (kind, str(run.path), run.created, json.dumps(options, sort_keys=True), *best)


def send_episode(window: Window, request: Request) -> Response:
    """Return an episode for the player that is open: its beginning, and then the whole.

    Each is preceded by its kind, see `EpisodePart`, and its length, 4 bytes each with the lowest first. The
    seed is in the header X-Seed.
    """
    run, options = window.run(request), read_episode(request)
    key = page_key(run, options, "packed")
    whole = window.find_page(key)
    if isinstance(whole, bytes):
        parts = iter([whole])
    else:
        options["broker"] = window.find_broker(run)
        parts = send_parts(run, options, lambda content: window.keep_page(key, content))
    first = next(parts)  # what is refused is answered with a message
    seed = first[:SEED_BYTES]
    return StreamingResponse(
        (part[SEED_BYTES:] for part in chain([first], parts)),
        media_type="application/octet-stream",
        headers={"X-Seed": str(int.from_bytes(seed, "little"))},
    )


def send_parts(run: Run, options: dict[str, Any], keep: Callable[[bytes], None]) -> Iterator[bytes]:
    """Yield the parts of an episode as they are sent, after the seed. keep: is called with the whole.

    What is refused after the beginning was sent is the last part.
    """
    is_begun = False

    def pack() -> Iterator[PackedEpisode]:
        return pack_replay(run, beginning=BEGINNING, most_bodies=limit_bodies(options), **options)

    try:
        for packed in iterate_in_thread(pack, limit_replay()):
            kind = EpisodePart.WHOLE if packed.is_whole else EpisodePart.BEGINNING
            part = packed.seed.to_bytes(SEED_BYTES, "little") + frame_part(kind, packed.content)
            if packed.is_whole:
                keep(part)
            yield part
            is_begun = True
    except InputError as error:
        if not is_begun:
            raise
        yield bytes(SEED_BYTES) + frame_part(EpisodePart.REFUSAL, str(error).encode())


def frame_part(kind: EpisodePart, content: bytes) -> bytes:
    """Return a part of an answer, after its kind and its length."""
    return kind.to_bytes(4, "little") + len(content).to_bytes(4, "little") + content


def limit_bodies(options: dict[str, Any]) -> int:
    """Return how many bodies all scenes may have: more with the parameters of the run."""
    return MOST_BODIES if "parameters" in options else MOST_BODIES_OF_RUN


def compare_parameters(window: Window, values: dict[str, Any]) -> Values:
    """Return the mean fitness and metrics with the run's and with other parameters, on the same seeds."""
    run = window.run_of(read_field(values, "run", str))
    if "match" in values:
        raise InputError("means are those of a candidate; of matches there are only replays here")
    parameters = check_parameters(read_field(values, "parameters", dict))
    caller, number = read_field(values, "caller", str)[:100], read_whole(values.get("number"), "number")
    episodes = EPISODES if values.get("episodes") is None else read_whole(values["episodes"], "episodes")
    numbers = read_candidate(values)
    broker = window.find_broker(run)
    newest.ask(caller, number)

    def mean(changes: dict[str, Any]) -> str:
        with computing:
            newest.check(caller, number)
            means = mean_of(
                run,
                changes,
                **numbers,
                episodes=episodes,
                broker=broker,
                check=lambda: newest.check(caller, number),
            )
            return json.dumps(means)

    key = page_key(run, {name: value for name, value in numbers.items() if value is not None}, "mean")
    before = json.loads(window.page((key, episodes), lambda: mean({})))
    after = json.loads(mean(parameters)) if parameters else None
    return {"label": before["label"], "seeds": before["seeds"], "unchanged": before, "changed": after}


def read_candidate(values: dict[str, Any]) -> dict[str, int | None]:
    """Return generation and candidate of a request; None for what it does not name."""
    return {
        name: None if values.get(name) in (None, "") else read_whole(values[name], name)
        for name in ("generation", "candidate")
    }


def export(window: Window, values: dict[str, Any]) -> Values:
    """Make a file of a candidate: code, a bundle, or a replay; return its name, and how to fetch it."""
    run = window.run_of(read_field(values, "run", str))
    numbers, form = read_candidate(values), read_field(values, "to", str)
    match = read_match(values["match"]) if "match" in values else []
    if match and form not in FORMATS:
        raise InputError(
            "a match has controllers of several generations; watch a candidate of the generation to export"
        )
    with exporting:
        if form == BUNDLE:
            exported = make_bundle(run, **numbers)
        elif form in FORMATS:
            options: dict[str, Any] = {
                name: read_whole(values[name], name)
                for name in ("episode", "seed")
                if values.get(name) not in (None, "")
            }
            options |= {name: value for name, value in numbers.items() if value is not None}
            options |= {"match": match} if match else {}
            parameters = check_parameters(values.get("parameters") or {})
            if parameters:
                options["parameters"] = parameters
            with window.figures if form != ".html" else contextlib.nullcontext():
                options |= {"most_bodies": limit_bodies(options), "broker": window.find_broker(run)}
                exported = export_replay(run, form, options, read_speed(values))
        else:
            group = values.get("group")
            if group is not None:
                group = read_field(values, "group", str)
            exported = export_code(run, form, **numbers, group=group, verify=values.get("verify") is True)
    return {
        "id": shelf.put(exported),
        "name": exported.name,
        "bytes": len(exported.content),
        "lines": list(exported.lines),
        "verified": exported.is_verified,
    }


def read_speed(values: dict[str, Any]) -> float:
    """Return the speed of a film. Raises InputError for anything but a number."""
    speed = values.get("speed", 1.0)
    if isinstance(speed, bool) or not isinstance(speed, int | float):
        raise InputError(f"speed: must be a number, not {str(speed)[:50]!r}")
    return float(speed)


def send_export(_window: Window, request: Request) -> Response:
    """Return a finished export."""
    exported = shelf.get(request.query_params.get("id", ""))
    return Response(
        exported.content,
        media_type=exported.media_type,
        headers={
            "Content-Disposition": f'attachment; filename="{exported.name}"',
            "Content-Security-Policy": "sandbox; default-src 'none'",
        },
    )


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
        "episode": send_episode,
        "parameters": lambda window, request: {
            "parameters": describe_parameters(window.run(request)),
            "episodes": EPISODES,
        },
        "exports": lambda window, request: list_exports(window.run(request)),
        "export_file": send_export,
    },
    asks={"what_if": compare_parameters, "export": export},
    documents={"player": lambda _window, _request: format_player()},
)
