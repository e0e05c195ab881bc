"""The drawing board: missions of the arena, read, checked, tried and written."""

import math
import os
import re
import secrets
import stat
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from starlette.requests import Request

from swarmwright import Controller, Episodes, Experiment, InputError, SwarmwrightError, templates
from swarmwright.common import yaml
from swarmwright.common.arguments import simulation_seed
from swarmwright.common.yaml_edits import update_text
from swarmwright.display import Recording
from swarmwright.display.page import format_page
from swarmwright.servers.evaluation.shown import ShownEpisode
from swarmwright.simulations.fitness import ExpressionError, FitnessExpression
from swarmwright.ui.arena_parts import PARTS
from swarmwright.ui.drawable import is_drawable
from swarmwright.ui.index import as_values
from swarmwright.ui.jobs import require_name
from swarmwright.ui.requests import read_field, read_whole
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window

PREFIX = re.compile(r"^parameters\.mission(\.|: )")
LONGEST_TRY_S = 300.0
"""Seconds of an episode that are computed while somebody waits."""
MOST_ROBOTS = 500
MOST_ROBOT_SECONDS = 30_000.0
"""Robots times seconds of an episode that is tried; its record takes about 2 kB for each."""
MOST_METRICS = 100
MISSION_BYTES = 64 << 10
"""Of a mission's text: YAML of 1 MiB takes many seconds to read."""
TOO_LARGE = f"the mission is larger than {MISSION_BYTES >> 10} KiB"
KEY = re.compile(r"^(\w+) *:", re.MULTILINE)
KEYS = {"walls", "start"}
"""Keys by which a file is recognised as a mission."""


def names(folder: Path) -> dict[str, list[str]]:
    """Return the names of built-in missions, and of the mission files in a folder."""
    files = [
        file.name
        for file in sorted(folder.glob("*.yaml"))
        if not file.name.startswith(".") and set(KEY.findall(read_text(file))) >= KEYS
    ]
    return {"built_in": templates.missions(), "files": files}


def read_text(file: Path) -> str:
    """Return the text of a mission's file; empty where it is no file, too large, or cannot be read."""
    try:
        descriptor = os.open(file, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW)
        with os.fdopen(descriptor, "rb") as stream:
            is_file = stat.S_ISREG(os.fstat(descriptor).st_mode)
            content = stream.read(MISSION_BYTES + 1) if is_file else b""
        return content.decode() if len(content) <= MISSION_BYTES else ""
    except (OSError, UnicodeDecodeError):
        return ""


def text_of(folder: Path, name: str) -> str:
    """Return the YAML of a built-in mission, or of a file in the folder."""
    text = read_text(folder / name) if name.endswith(".yaml") and "/" not in name else ""
    return text if set(KEY.findall(text)) >= KEYS else templates.mission(name)


def parse(text: str) -> dict[str, Any]:
    """Return the mission that a text describes. Raises InputError with its line when it is none."""
    if len(text.encode(errors="replace")) > MISSION_BYTES:
        raise InputError(TOO_LARGE)
    source = yaml.parse(text, "mission", MISSION_BYTES)
    if source.problems:
        raise InputError("\n".join(f"mission:{line}: {message}" for _, line, message in source.problems))
    if not isinstance(source.values, dict):
        raise InputError("mission: must be a mapping of keys such as walls, start and fitness")
    values: dict[str, Any] = source.values
    write(values)  # its aliases may make it large
    return values


def write(mission: dict[str, Any]) -> str:
    """Return a mission as YAML. Raises InputError where it is too large."""
    try:
        text = yaml.dump(mission)
    except RecursionError:
        raise InputError("the mission is nested too deeply") from None
    if len(text.encode(errors="replace")) > MISSION_BYTES:
        raise InputError(TOO_LARGE)
    return text


def problems(mission: dict[str, Any], folder: Path) -> list[str]:
    """Return what is wrong with a mission, with the key of each mistake."""
    try:
        experiment(mission, folder)
    except InputError as error:
        return strip_keys(error)
    return []


def strip_keys(error: InputError) -> list[str]:
    """Return the lines of an error, with the keys of a mission's own file."""
    return [PREFIX.sub("", line.strip()) for line in str(error).splitlines() if line.strip()]


def experiment(mission: dict[str, Any], folder: Path, fitness: str | None = None) -> Experiment:
    """Return an experiment with the mission and small random controllers.

    Args:
        mission: as in its file.
        folder: of the mission's file, whose robots may have files of their own beside it.
        fitness: an expression over the metrics, in place of the mission's fitness.

    Raises InputError for mistakes.
    """
    values = {
        "simulation": "arena",
        "parameters": {"mission": with_robot_files(mission, folder)},
        "controller": {"kind": "layered", "hidden": []},
        "servers": "in-process",
    }
    return Experiment.from_mapping(values if fitness is None else {**values, "fitness": fitness})


def with_robot_files(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a mission, or a kind of its robots, with the robots that it names by files beside it."""
    result = dict(values)
    robot, kinds = values.get("robot"), values.get("robots")
    if isinstance(robot, str) and robot.endswith((".yaml", ".yml", ".json")):
        result["robot"] = read_robot(folder, robot)
    if isinstance(kinds, list):
        result["robots"] = [
            with_robot_files(kind, folder) if isinstance(kind, dict) else kind for kind in kinds
        ]
    return result


def read_robot(folder: Path, name: str) -> Any:  # noqa: ANN401 - as the file has it
    """Return the robot of a file below the folder. Raises InputError where there is none."""
    file = folder / name
    try:
        if not file.resolve().is_relative_to(folder.resolve()):
            raise InputError(f"robot: {name[:100]!r} is not below {folder}")
        if file.is_file() and file.stat().st_size <= MISSION_BYTES:
            return yaml.read(file).values
    except InputError:
        raise
    except (OSError, ValueError):
        pass
    raise InputError(
        f"robot: {name[:100]!r} is no file below {folder}, or is larger than {MISSION_BYTES >> 10} KiB"
    )


def describe_start(mission: dict[str, Any], folder: Path, seed: int) -> dict[str, Any]:
    """Return where robots are at the start, and the names of metrics and of what controllers sense and set.

    bodies: [x, y, radius, heading, name of the kind] of each, in metres and radians; none of very many.
    Raises InputError for mistakes.
    """
    drawn = experiment(mission, folder)
    episodes = Episodes(drawn, seeds=[seed])
    bodies = []
    if count_robots(mission) <= MOST_ROBOTS:
        scene = episodes.scene()
        left, lower = scene.origin
        bodies = [
            [body.x + left, body.y + lower, body.radius, body.heading, body.state]
            for body in scene.bodies
            if body.kind == "agent"
        ]
    return {
        "bodies": as_values(bodies),
        "sensors": episodes.sensor_names,
        "actuators": episodes.actuator_names,
        "metrics": list(episodes.metrics),
    }


def count_robots(mission: dict[str, Any]) -> int:
    """Return the number of robots of a mission; 20 where it has none, as the arena's default."""
    robots = mission.get("robots", 20)
    if isinstance(robots, list):
        counts = [kind.get("count", 0) for kind in robots if isinstance(kind, dict)]
        return int(sum(count for count in counts if isinstance(count, int)))
    return int(robots) if isinstance(robots, int | float) and math.isfinite(robots) else 0


def check_size(mission: dict[str, Any]) -> None:
    """Raise InputError for a mission whose episode takes long to compute and to show."""
    seconds, robots = mission.get("duration", 120), count_robots(mission)
    if isinstance(seconds, int | float) and seconds > LONGEST_TRY_S:
        raise InputError(f"duration: at most {LONGEST_TRY_S:g} s can be tried here, not {seconds:g}")
    if robots > MOST_ROBOTS:
        raise InputError(f"robots: at most {MOST_ROBOTS} can be tried here, not {robots}")
    if isinstance(seconds, int | float) and seconds * robots > MOST_ROBOT_SECONDS:
        raise InputError(
            f"duration: with {robots} robots at most {MOST_ROBOT_SECONDS / robots:g} s can be tried here"
        )
    metrics = mission.get("metrics")
    if isinstance(metrics, dict) and len(metrics) > MOST_METRICS:
        raise InputError(f"metrics: at most {MOST_METRICS} can be tried here, not {len(metrics)}")


def try_out(
    mission: dict[str, Any], folder: Path, *, seed: int, run: Path | None = None, fitness: str | None = None
) -> tuple[str, Recording]:
    """Play an episode of a mission; return its page and its record, with all metrics over time.

    Args:
        mission: as in its file.
        folder: of the mission's file.
        seed: of the simulation, and of the random controller.
        run: whose best controller is used; None: a random one.
        fitness: an expression over the metrics, in place of the mission's fitness.

    Raises InputError when the mission has mistakes, is too large to be tried, or the controller does not fit.
    """
    tried = experiment(mission, folder, fitness)
    check_size(mission)
    simulation_seed("seed", seed)
    if run is None:
        genomes = tried.new_method().ask()
        controller = Controller(tried.representation().specification(genomes[seed % len(genomes)]))
        shown = ShownEpisode(experiment=tried, controller=controller, seed=seed)
    else:
        shown = ShownEpisode.from_experiment(tried, run, seed=seed)
        shown = replace(shown, source=Path(run.name))
    recording = shown.recording()
    return format_page([shown.part(recording)], caption=shown.caption(recording)), recording


def save(folder: Path, name: str, text: str, *, over: bool) -> str:
    """Write a mission into the folder; return the name of its file.

    Args:
        folder: of the runs.
        name: of the file, without `.yaml`.
        text: of a mission without mistakes.
        over: write over a mission of this name.

    Raises InputError when the name is none or is taken, or the mission has mistakes.
    """
    require_name(name)
    wrong = problems(parse(text), folder)
    if wrong:
        raise InputError("\n".join(wrong))
    file = folder / f"{name}.yaml"
    if file.exists() and not (over and set(KEY.findall(read_text(file))) >= KEYS):
        raise InputError(f"name: {file} exists already; choose another name")
    new = file.with_name(f".{file.name}.{secrets.token_hex(4)}")
    try:
        new.write_text(text, encoding="utf-8")
        new.rename(file)
    except OSError as error:
        with suppress(OSError):
            new.unlink(missing_ok=True)
        raise InputError(f"name: {file} cannot be written: {error.strerror}") from None
    return file.name


def read_mission(window: Window, request: Request) -> Values:
    """Return the text of a built-in mission, or of one of the folder."""
    return {"text": text_of(window.index.folder, request.query_params.get("name", ""))}


def parse_text(window: Window, values: dict[str, Any]) -> Values:
    """Return the mission that a text describes if the board can show it, and what is wrong with it."""
    try:
        mission = parse(read_field(values, "text", str))
    except InputError as error:
        return {"problems": str(error).splitlines()}
    answer = check(window, mission, values)
    if is_drawable(mission):
        return {"mission": mission, **answer}
    return {**answer, "problems": answer["problems"] or ["the board cannot show this mission"]}


def write_text(window: Window, values: dict[str, Any]) -> Values:
    """Return the text of a mission, with the comments of its former text, and what is wrong with it."""
    mission, former = read_field(values, "mission", dict), read_field(values, "text", str)
    text = write(mission)
    if len(former.encode()) <= MISSION_BYTES:
        text = update_text(former, mission)
    return {"text": text, **check(window, mission, values)}


def check(window: Window, mission: dict[str, Any], values: dict[str, Any]) -> Values:
    """Return what is wrong with a mission; if nothing is, how an episode of the seed begins."""
    folder = window.index.folder
    wrong = problems(mission, folder)
    if wrong:
        return {"problems": wrong, "start": None}
    try:
        return {
            "problems": [],
            "start": describe_start(mission, folder, read_whole(values.get("seed", 0), "seed")),
        }
    except SwarmwrightError as error:
        return {"problems": str(error).splitlines(), "start": None}


def weigh(_window: Window, values: dict[str, Any]) -> Values:
    """Return an expression as a mission has its fitness: `fitness`, None if it is no weighted sum."""
    try:
        expression = FitnessExpression(read_field(values, "text", str))
    except ExpressionError as error:
        raise InputError(f"fitness: {error}") from None
    weights = expression.split_weighted_sum()
    if weights is None or expression.uses_simulation_fitness:
        return {"fitness": None}
    offset, factors = weights
    if not offset and list(factors.values()) == [1]:
        return {"fitness": next(iter(factors))}
    return {"fitness": {"offset": offset, "factors": factors} if offset else {"factors": factors}}


def start_try(window: Window, values: dict[str, Any]) -> Values:
    """Play an episode of a mission; return the name of its page, and fitness and metrics at each step."""
    mission, name = read_field(values, "mission", dict), read_field(values, "run", str)
    page, recording = try_out(
        mission,
        window.index.folder,
        seed=read_whole(values.get("seed"), "seed"),
        run=window.index.path(name) if name else None,
        fitness=read_field(values, "fitness", str) or None,
    )
    page_id = secrets.token_urlsafe(12)
    window.keep_page(page_id, page)
    metrics = recording.trace.metrics if recording.trace else {}
    return {
        "id": page_id,
        "fitness": as_values(recording.fitness_so_far),
        "metrics": {key: as_values(series) for key, series in metrics.items()},
    }


def save_mission(window: Window, values: dict[str, Any]) -> Values:
    """Write a mission into the folder of the runs."""
    text, name = read_field(values, "text", str), read_field(values, "name", str)
    return {"file": save(window.index.folder, name, text, over=values.get("replace") is True)}


VIEW = View(
    "draw",
    STATIC / "draw.js",
    "Draw",
    answers={
        "missions": lambda window, _request: names(window.index.folder),
        "mission": read_mission,
        "mission_parts": lambda _window, _request: PARTS,
    },
    asks={
        "mission_text": write_text,
        "mission_parse": parse_text,
        "mission_fitness": weigh,
        "mission_try": start_try,
    },
    changes={"mission_save": save_mission},
    documents={"try": lambda window, request: window.page(request.query_params.get("id", ""))},
)
