"""A new experiment: from a template or a run, checked, and started."""

from dataclasses import asdict
from typing import Any

from starlette.requests import Request

from swarmwright import InputError, templates
from swarmwright.ui.requests import read_field, read_index
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window


def read_experiment(window: Window, request: Request) -> Values:
    """Return a template, or the experiment of a run, as YAML."""
    if "run" in request.query_params:
        file = window.run(request).path / "experiment.yaml"
        try:
            return {"text": file.read_text("utf-8")}
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{file}: cannot be read: {error}") from None
    name, _, mission = request.query_params.get("template", "minisim").partition(":")
    return {"text": templates.arena(mission) if mission else templates.text(name)}


def list_templates(_window: Window, _request: Request) -> Values:
    """Return the names of the templates; those of missions are `arena:MISSION`."""
    missions = [f"arena:{mission}" for mission in templates.missions()]
    return {"names": [*(name for name in templates.names() if name != "arena"), *missions]}


def check(window: Window, values: dict[str, Any]) -> Values:
    """Return what is wrong with an experiment."""
    return {"problems": window.jobs.check(read_field(values, "text", str))}


def start(window: Window, values: dict[str, Any]) -> Values:
    """Put a run of each seed into the queue, or return what is wrong with the experiment."""
    text = read_field(values, "text", str)
    problems = window.jobs.check(text)
    if problems:
        return {"problems": problems}
    seeds = [read_index(seed) for seed in read_field(values, "seeds", list)]
    return {"jobs": [asdict(job) for job in window.jobs.start(text, read_field(values, "name", str), seeds)]}


VIEW = View(
    "new",
    STATIC / "new.js",
    "New",
    is_for_changes=True,
    answers={"templates": list_templates, "experiment": read_experiment},
    changes={"check": check, "start": start},
)
