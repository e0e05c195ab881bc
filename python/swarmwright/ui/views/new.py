"""A new experiment: from a template or a run, by a form or as text, checked, and started."""

import json
import subprocess
from contextlib import closing
from dataclasses import asdict
from typing import Any

from starlette.requests import Request

from swarmwright import InputError, templates
from swarmwright.common.errors import engine_errors
from swarmwright.common.yaml import dump
from swarmwright.experiment.broker_address import broker_problem, prefix_problem
from swarmwright.runs.code import is_code_trusted
from swarmwright.servers.broker.watching import watch_broker
from swarmwright.ui.entries import change_text, find_kinds, show_values
from swarmwright.ui.fields import Form, Kinds, describe_form, is_described_elsewhere, parameter_fields
from swarmwright.ui.jobs import run_python
from swarmwright.ui.requests import read_field, read_whole
from swarmwright.ui.sweeps import Plan, plan_sweep, read_path
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window

DESCRIBE = """
import json, sys
from swarmwright import InputError
from swarmwright.simulations import catalogue
try:
    print(json.dumps({"parameters": catalogue.description(sys.argv[1])["parameters"]}))
except InputError as error:
    print(json.dumps({"error": str(error)}))
"""
PARAMETERS_BYTES = 1 << 20
ANNOUNCEMENTS_S = 1.0
"""That a broker has to send what its servers have announced."""
MOST_TITLES = 500
"""Simulations of servers that are suggested."""


def read_experiment(window: Window, request: Request) -> Values:
    """Return a template, or the experiment of a run, as YAML, and whether its code may be executed.

    That of a run is from its store: `experiment.yaml` beside it may name other code.
    """
    if "run" in request.query_params:
        experiment = window.run(request).experiment
        return {"text": dump(experiment.to_mapping()), "is_trusted": is_code_trusted(experiment)}
    name, _, mission = request.query_params.get("template", "minisim").partition(":")
    return {"text": templates.arena(mission) if mission else templates.text(name), "is_trusted": True}


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
    seeds = [read_whole(seed, "seeds") for seed in read_field(values, "seeds", list)]
    return {"jobs": [asdict(job) for job in window.jobs.start(text, read_field(values, "name", str), seeds)]}


def find_form(window: Window, kinds: Kinds) -> Form:
    """Return the form of an experiment, with the parameters of its class if they were described before."""
    parameters: dict[str, Any] = {}
    if is_described_elsewhere(kinds):
        try:
            parameters = json.loads(window.page(("parameters", kinds.simulation)))
        except InputError:  # not yet
            return describe_form(kinds)
    return describe_form(kinds, parameter_fields(parameters) if parameters else None)


def show_form(window: Window, values: dict[str, Any]) -> Values:
    """Return the fields of an experiment and what its text has for each.

    `known` names the form that the page has: its fields are left out of the answer.
    """
    entries, kinds = find_kinds(read_field(values, "text", str))
    form = find_form(window, kinds)
    name = f"{kinds} {sum(len(section.fields) for section in form.sections)}"
    answer: dict[str, Any] = {"form": name, "values": show_values(entries)}
    if values.get("known") != name:
        answer["sections"] = [section.describe() for section in form.sections]
    if is_described_elsewhere(kinds):
        answer["class"] = kinds.simulation
    return answer


def change_field(window: Window, values: dict[str, Any]) -> Values:
    """Return the text of an experiment with what was entered in a field."""
    text, entry = read_field(values, "text", str), read_field(values, "entry", str)
    path = read_path(values.get("path"))
    form = find_form(window, find_kinds(text)[1])
    return {"text": change_text(text, path, entry, form)}


def describe_class(window: Window, values: dict[str, Any]) -> Values:
    """Read the parameters of a simulation that is a class in Python, in a process of its own."""
    name = read_field(values, "simulation", str)
    if not is_described_elsewhere(Kinds(simulation=name)) or "\0" in name:
        raise InputError("simulation: must name a class, such as file.py:Class")
    try:
        described = run_python(DESCRIBE, [name], window.index.folder)
        answer = json.loads((described.stdout.strip().splitlines() or ["{}"])[-1])
    except (subprocess.TimeoutExpired, OSError, ValueError):
        answer = {}
    parameters = answer.get("parameters") if isinstance(answer, dict) else None
    if not isinstance(parameters, dict) or len(json.dumps(parameters)) > PARAMETERS_BYTES:
        raise InputError(str(answer.get("error", "")) or f"{name[:100]}: its parameters cannot be read")
    window.keep_page(("parameters", name), json.dumps(parameters))
    return {"parameters": len(parameters)}


def ask_broker(_window: Window, values: dict[str, Any]) -> Values:
    """Return the titles of the simulations that the servers on a broker offer, and the number of servers."""
    broker, prefix = read_field(values, "broker", str), read_field(values, "prefix", str)
    for name, problem in (("broker", broker_problem(broker)), ("prefix", prefix_problem(prefix))):
        if problem is not None:
            raise InputError(f"{name}: {problem}")
    with engine_errors(), closing(watch_broker(broker, prefix=prefix, every=ANNOUNCEMENTS_S)) as views:
        servers = [server for server in next(views).servers if server.state != "lost"]
    titles = sorted({title for server in servers for title in server.simulations})
    return {"servers": len(servers), "simulations": titles[:MOST_TITLES]}


def read_plan(window: Window, values: dict[str, Any]) -> tuple[str, Plan]:
    """Return the experiment of a sweep, and its variants."""
    text = read_field(values, "text", str)
    form = find_form(window, find_kinds(text)[1])
    return text, plan_sweep(
        text, read_field(values, "vary", list), read_whole(values.get("seeds"), "seeds"), form
    )


def show_plan(window: Window, values: dict[str, Any]) -> Values:
    """Return how many runs a sweep makes, and what is wrong with its entries."""
    _, plan = read_plan(window, values)
    return {"counts": plan.counts, "runs": plan.runs, "errors": plan.errors}


def start_sweep(window: Window, values: dict[str, Any]) -> Values:
    """Put a sweep into the queue, or return what is wrong with it."""
    text, plan = read_plan(window, values)
    if plan.errors:
        raise InputError("\n".join(f"vary: {error}" for error in plan.errors.values()))
    problems = window.jobs.check(text, plan.write)
    if problems:
        return {"problems": problems}
    return {"jobs": [asdict(window.jobs.start_sweep(text, read_field(values, "name", str), plan.write))]}


VIEW = View(
    "new",
    STATIC / "new.js",
    "New",
    is_for_changes=True,
    answers={"templates": list_templates, "experiment": read_experiment},
    asks={"form": show_form, "form_change": change_field, "sweep_plan": show_plan},
    changes={
        "check": check,
        "start": start,
        "sweep": start_sweep,
        "class_parameters": describe_class,
        "broker_simulations": ask_broker,
    },
)
