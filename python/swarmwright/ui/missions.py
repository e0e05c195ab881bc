"""Missions of the arena for the drawing board: read, checked, tried and written."""

import secrets
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from swarmwright import Controller, Episodes, Experiment, InputError, templates
from swarmwright.common import yaml
from swarmwright.ui.jobs import EXPERIMENT_BYTES, NAME

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
