"""Simulations and simulation servers as FMUs for co-simulation: `swarmwright export-fmu`.

Their library is part of the wheel; in a checkout it is compiled on first use, since compiling it takes long
and few users need it.
"""

import json
import logging
import os
import platform
import subprocess
import sys
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from swarmwright.common.errors import InputError, RunError
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.source.text import MARK, check_prefix
from swarmwright.export._base import Files, render
from swarmwright.export.fmu_parts import add_range, add_units, format_xml, token, unit_name, zip_files
from swarmwright.export.simulation_model import Model, Variable

FILE = Path(__file__).parents[1] / "simulations" / "fmu" / "libswarmwright_fmi.so"
"""The library; its source is the crate engine/bindings/fmi."""
_CHECKOUT = Path(__file__).parents[3]
_LINES = 5
"""Lines of the output of a failed build in messages; the last lines name the cause."""
_progress = logging.getLogger("swarmwright.progress")


def read_library() -> bytes:
    """Read the library; compile it first if necessary.

    Raises InputError if it is missing and there is no source, and RunError if the compilation fails.
    """
    try:
        return FILE.read_bytes()
    except FileNotFoundError:
        _build_library()
    return FILE.read_bytes()


def _build_library() -> None:
    """Compile the library as `make` does. Raises InputError and RunError."""
    if not (_CHECKOUT / "engine" / "bindings" / "fmi" / "Cargo.toml").is_file():
        raise InputError(f"{FILE}: the library of FMUs of simulations is missing; reinstall Swarmwright")
    _progress.info("compiling the library of FMUs of simulations, once; this may take a minute")
    # Variables of a `make` that started this process.
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
    try:
        done = subprocess.run(
            ["make", "--no-print-directory", "fmi"],
            cwd=_CHECKOUT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            check=False,
        )
    except FileNotFoundError as error:
        raise RunError(
            f"{FILE}: cannot be compiled: `make` not found; install it, or install Swarmwright from a wheel"
        ) from error
    if done.returncode or not FILE.exists():
        output = "; ".join(escape_line(line) for line in done.stdout.splitlines()[-_LINES:] if line.strip())
        raise RunError(f"{FILE}: cannot be compiled: `make fmi` failed: {output or 'it printed nothing'}")


LIBRARY = FILE
"""The library of FMUs of simulations."""
LICENSES = Path(__file__).parents[1] / "third-party-licenses.txt"
"""Licences of the crates of the library."""
VERSIONS = ("2.0", "3.0")
_MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_FMI2_TYPES = {
    "single": "Real",
    "double": "Real",
    "integer": "Integer",
    "seed": "Integer",
    "flag": "Boolean",
    "text": "String",
}
_FMI3_TYPES = {
    "single": "Float32",
    "double": "Float64",
    "integer": "Int64",
    "seed": "UInt64",
    "flag": "Boolean",
    "text": "String",
}
_STATES = {
    True: "To set a state repeats the steps of the episode up to it.",
    False: "The server is looked for when initialization ends, and is free again after a reset, at the end "
    "and when the instance is freed. States cannot be kept. Fitness and metrics are known when the episode "
    "has ended, and NaN before.",
}
"""Notes on states, by whether the FMU contains the simulation."""


def build_simulation_fmu(title: str, parameters: Mapping[str, Any], *, fmi: str, name: str) -> bytes:
    """Return an FMU of a built-in simulation, the same bytes for the same simulation and library.

    Args:
        title: title of the simulation.
        parameters: values of parameters; others have their defaults.
        fmi: 2.0 or 3.0.
        name: name of the model and its library, a letter, then letters, digits and _.

    Raises InputError for an unknown simulation, invalid parameters, and a missing library.
    """
    return build_model_fmu(Model.from_simulation(title, parameters), fmi=fmi, name=name)


def build_model_fmu(model: Model, *, fmi: str, name: str) -> bytes:
    """Return an FMU of a model, see `build_simulation_fmu`. Raises InputError if the library is missing."""
    check_prefix(name)
    binary = read_library()
    content = json.dumps(model.content(""), sort_keys=True)
    identifier = token(fmi, name, content, binary)
    archive_files: Files = {
        "modelDescription.xml": _description(model, fmi, name, identifier),
        "documentation/index.html": _documentation(model, fmi, name),
        "documentation/licenses/license.txt": _licenses(),
        "resources/model.json": json.dumps(model.content(identifier), indent=1, sort_keys=True),
        _library_path(fmi, name): binary,
    }
    return zip_files(archive_files)


def _licenses() -> bytes:
    """Return the licences of the library in the FMU. Raises InputError if they are missing."""
    try:
        return LICENSES.read_bytes()
    except OSError:
        raise InputError(
            f"{LICENSES}: the licences of the library in the FMU are missing; run `make .venv/.engine`"
        ) from None


def _library_path(fmi: str, name: str) -> str:
    """Return the path of the library in the archive. Raises InputError on other systems than Linux."""
    machine = _MACHINES.get(platform.machine().lower())
    if machine is None or not sys.platform.startswith("linux"):
        raise InputError(
            f"{platform.system()} on {platform.machine()}: FMUs are supported on Linux on x86_64 and aarch64 "
            "only"
        )
    if fmi == "3.0":
        return f"binaries/{machine}-linux/{name}.so"
    # FMI 2.0 names 32 and 64 bits only.
    return f"binaries/linux64/{name}.so"


def _description(model: Model, fmi: str, name: str, identifier: str) -> str:
    """Return modelDescription.xml."""
    from swarmwright import __version__  # noqa: PLC0415 - asks the engine

    three = fmi == "3.0"
    variables = list(model.variables())
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": fmi,
            "modelName": name,
            ("instantiationToken" if three else "guid"): identifier,
            "description": _describe_model(model),
            "generationTool": f"Swarmwright {__version__}",
            "variableNamingConvention": "structured",
            **({} if three else {"numberOfEventIndicators": "0"}),
        },
    )
    state = "FMUState" if three else "FMUstate"
    keeps = "true" if model.dimensions is None else "false"
    attributes = {
        "modelIdentifier": name,
        f"canGetAndSet{state}": keeps,
        f"canSerialize{state}": keeps,
        "canHandleVariableCommunicationStepSize": "true",
        **({} if three else {"canNotUseMemoryManagementFunctions": "true"}),
    }
    ET.SubElement(root, "CoSimulation", attributes)
    scales = [
        unit_name(variable.stands_for.unit) for variable in variables if variable.stands_for is not None
    ]
    add_units(root, sorted({"s", *filter(None, (*scales, *(variable.unit for variable in variables)))}))
    categories = ET.SubElement(root, "LogCategories")
    for category in ("logStatusDiscard", "logStatusError"):
        ET.SubElement(categories, "Category", name=category)
    times = {"startTime": "0", "stepSize": repr(model.period)}
    if model.duration is not None:
        times["stopTime"] = repr(model.duration)
    ET.SubElement(root, "DefaultExperiment", times)
    listed = ET.SubElement(root, "ModelVariables")
    if three:
        entry = {"name": "time", "valueReference": "0", "causality": "independent"}
        ET.SubElement(listed, "Float64", {**entry, "variability": "continuous", "unit": "s"})
    for variable in variables:
        (_add_fmi3_variable if three else _add_fmi2_variable)(listed, variable)
    _add_structure(ET.SubElement(root, "ModelStructure"), variables, three=three)
    return format_xml(root, comment=f"{MARK} {__version__}; changes here are lost.")


def _describe_model(model: Model) -> str:
    if model.dimensions is None:
        return f"The simulation {model.title} of Swarmwright"
    return f"The simulation {model.title} on a simulation server, reached through an MQTT broker"


def _variable_attributes(variable: Variable) -> dict[str, str]:
    attributes = {
        "name": variable.name,
        "valueReference": str(variable.reference),
        "causality": variable.causality,
    }
    attributes |= {"variability": "fixed" if variable.causality == "parameter" else "discrete"}
    if variable.causality == "output":
        attributes["initial"] = "calculated"
    return {**attributes, "description": variable.description}


def _limits(variable: Variable) -> dict[str, str]:
    attributes = {"unit": variable.unit} if variable.unit else {}
    limits = zip(("min", "max"), variable.range, strict=True)
    return attributes | {name: repr(value) for name, value in limits if value is not None}


def _start(value: float | bool | str) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _add_fmi2_variable(listed: ET.Element, variable: Variable) -> None:
    element = ET.SubElement(listed, "ScalarVariable", _variable_attributes(variable))
    start = {} if variable.start is None else {"start": _start(variable.start)}
    ET.SubElement(element, _FMI2_TYPES[variable.kind], {**_limits(variable), **start})
    if variable.stands_for is not None:
        add_range(element, variable.stands_for, "2.0")


def _add_fmi3_variable(listed: ET.Element, variable: Variable) -> None:
    kind = _FMI3_TYPES[variable.kind]
    if kind == "String":
        element = ET.SubElement(listed, kind, _variable_attributes(variable))
        ET.SubElement(element, "Start", value=str(variable.start))
        return
    start = {} if variable.start is None else {"start": _start(variable.start)}
    element = ET.SubElement(listed, kind, {**_variable_attributes(variable), **_limits(variable), **start})
    if variable.stands_for is not None:
        add_range(element, variable.stands_for, "3.0")


def _add_structure(structure: ET.Element, variables: list[Variable], *, three: bool) -> None:
    """Add outputs, all of which are also initial unknowns."""
    outputs = [
        (index, variable) for index, variable in enumerate(variables) if variable.causality == "output"
    ]
    for group, element in (("Outputs", "Output"), ("InitialUnknowns", "InitialUnknown")):
        parent = structure if three else ET.SubElement(structure, group)
        for index, output in outputs:
            if three:
                ET.SubElement(parent, element, valueReference=str(output.reference))
            else:  # index of the variable, from 1
                ET.SubElement(parent, "Unknown", index=str(index + 1))


def _documentation(model: Model, fmi: str, name: str) -> str:
    rows = "\n".join(
        f"<tr><td>{escape(variable.name)}</td><td>{variable.causality}</td><td>{escape(variable.unit)}</td>"
        f"<td>{escape(variable.description)}</td></tr>"
        for variable in model.variables()
        if not variable.name.startswith("agent[") or variable.name.startswith("agent[1]")
    )
    values = {
        "p": escape(name), "fmi": fmi, "title": escape(model.title), "rows": rows,
        "agents": str(model.agents), "period": repr(model.period),
        "about": _describe_model(model), "states": _STATES[model.dimensions is None],
    }  # fmt: skip
    return render("fmu_simulation.txt", values)
