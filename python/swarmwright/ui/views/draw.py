"""The drawing board: missions of the arena, read, checked, tried and written."""

import secrets
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from starlette.requests import Request

from swarmwright import Controller, Episodes, Experiment, InputError, Run, templates
from swarmwright.common import yaml
from swarmwright.ui.index import as_values
from swarmwright.ui.jobs import EXPERIMENT_BYTES, NAME
from swarmwright.ui.requests import read_field, read_index
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window

PREFIX = "parameters.mission."
LONGEST_TRY_S = 300.0
"""Seconds of an episode that are computed while somebody waits."""
MOST_ROBOTS = 500


def names(folder: Path) -> dict[str, list[str]]:
    """Return the names of built-in missions, and of the mission files in a folder."""
    files = []
    for file in sorted(folder.glob("*.yaml")):
        if not file.name.startswith(".") and file.is_file() and file.stat().st_size <= EXPERIMENT_BYTES:
            try:
                values = yaml.read(file).values
            except InputError:
                continue
            if isinstance(values, dict) and "walls" in values and "start" in values:
                files.append(file.name)
    return {"built_in": templates.missions(), "files": files}


def text_of(folder: Path, name: str) -> str:
    """Return the YAML of a built-in mission, or of a file in the folder."""
    if name in names(folder)["files"]:
        return (folder / name).read_text("utf-8")
    return templates.mission(name)


def parse(text: str) -> dict[str, Any]:
    """Return the mission that a text describes. Raises InputError with its line when it is none."""
    if len(text) > EXPERIMENT_BYTES:
        raise InputError("the mission is larger than 1 MiB")
    source = yaml.parse(text, "mission")
    if source.problems:
        raise InputError("\n".join(f"mission:{line}: {message}" for _, line, message in source.problems))
    if not isinstance(source.values, dict):
        raise InputError("mission: must be a mapping of keys such as walls, start and fitness")
    values: dict[str, Any] = source.values
    return values


def problems(mission: dict[str, Any]) -> list[str]:
    """Return what is wrong with a mission, with the key of each mistake."""
    try:
        experiment(mission)
    except InputError as error:
        return [line.strip().replace(PREFIX, "") for line in str(error).splitlines() if line.strip()]
    return []


def experiment(mission: dict[str, Any]) -> Experiment:
    """Return an experiment with the mission and small random controllers. Raises InputError for mistakes."""
    return Experiment.from_mapping(
        {
            "simulation": "arena",
            "parameters": {"mission": mission},
            "controller": {"kind": "evostick"},
            "servers": "in-process",
        }
    )


def try_out(mission: dict[str, Any], seed: int, controller: Controller | None = None) -> str:
    """Return an episode of a mission as a page, with a controller or a random one.

    Raises InputError when the mission has mistakes, is too large to be tried, or the controller does not fit.
    """
    tried = experiment(mission)
    for key, most in (("duration", LONGEST_TRY_S), ("robots", MOST_ROBOTS)):
        value = mission.get(key)
        if isinstance(value, int | float) and value > most:
            raise InputError(f"{key}: at most {most:g} can be tried here, not {value:g}")
    if controller is None:
        genomes = tried.new_method().ask()
        controller = Controller(tried.representation().specification(genomes[seed % len(genomes)]))
    episodes = Episodes(tried, seeds=[seed], watch=True)
    episodes.run(controller)
    with TemporaryDirectory() as folder:
        page = Path(folder) / "episode.html"
        episodes.save(page)
        return page.read_text("utf-8")


def save(folder: Path, name: str, mission: dict[str, Any], *, replace: bool) -> str:
    """Write a mission into the folder; return the name of its file.

    Args:
        folder: of the runs.
        name: of the file, without `.yaml`.
        mission: without mistakes.
        replace: write over a mission of this name.

    Raises InputError when the name is none or is taken, or the mission has mistakes.
    """
    if NAME.fullmatch(name) is None:
        raise InputError(
            f"name: {name[:100]!r}: use letters, digits, '_', '-' and '.', at most 100, and no '.' first"
        )
    wrong = problems(mission)
    if wrong:
        raise InputError("\n".join(wrong))
    file = folder / f"{name}.yaml"
    if file.exists() and (not replace or file.name not in names(folder)["files"]):
        raise InputError(f"name: {file} exists already; choose another name")
    new = file.with_name(f".{file.name}.{secrets.token_hex(4)}")
    try:
        new.write_text(yaml.dump(mission), encoding="utf-8")
        new.rename(file)
    except OSError as error:
        raise InputError(f"name: {file} cannot be written: {error.strerror}") from None
    return file.name


def read_mission(window: Window, request: Request) -> Values:
    """Return a built-in mission, or one of the folder."""
    text = text_of(window.index.folder, request.query_params.get("name", ""))
    return {"mission": as_values(parse(text))}


def parse_text(_window: Window, values: dict[str, Any]) -> Values:
    """Return the mission that a text describes, and what is wrong with it."""
    try:
        mission = parse(read_field(values, "text", str))
    except InputError as error:
        return {"problems": str(error).splitlines()}
    return {"mission": as_values(mission), "problems": problems(mission)}


def write_text(_window: Window, values: dict[str, Any]) -> Values:
    """Return the text of a mission, and what is wrong with it."""
    mission = read_field(values, "mission", dict)
    return {"text": yaml.dump(mission), "problems": problems(mission)}


def start_try(window: Window, values: dict[str, Any]) -> Values:
    """Play an episode of a mission; return the name of its page."""
    mission, name = read_field(values, "mission", dict), read_field(values, "run", str)
    controller = Run(window.index.path(name)).best.controller if name else None
    page = try_out(mission, read_index(values.get("seed")), controller)
    page_id = secrets.token_urlsafe(12)
    window.keep_page(page_id, page)
    return {"id": page_id}


def save_mission(window: Window, values: dict[str, Any]) -> Values:
    """Write a mission into the folder of the runs."""
    mission, name = read_field(values, "mission", dict), read_field(values, "name", str)
    return {"file": save(window.index.folder, name, mission, replace=values.get("replace") is True)}


VIEW = View(
    "draw",
    STATIC / "draw.js",
    "Draw",
    answers={
        "missions": lambda window, _request: names(window.index.folder),
        "mission": read_mission,
    },
    asks={"mission_text": write_text, "mission_parse": parse_text, "mission_try": start_try},
    changes={"mission_save": save_mission},
    documents={"try": lambda window, request: window.page(request.query_params.get("id", ""))},
)
