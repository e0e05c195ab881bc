"""Machines and trees of modules in files, as people write them, as controllers."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from swarmwright.common import modules
from swarmwright.common.errors import InputError
from swarmwright.common.problems import problems_of
from swarmwright.common.yaml import read
from swarmwright.controllers.kinds.modules.representation import Modules, ModulesOptions

_SENSORS, _ACTUATORS = 9, 2  # of the preset e-puck-rm1.2


def specification_of(file: Path) -> dict[str, Any]:
    """Return the specification of the machine, or of the tree, that a YAML file holds.

    Raises InputError, with file and line, when it holds none.
    """
    values = read(file).values
    form = "tree" if isinstance(values, Mapping) and "subtrees" in values else "machine"
    parts = values.get("subtrees" if form == "tree" else "states") if isinstance(values, Mapping) else None
    if not isinstance(parts, list) or not parts:
        raise InputError(
            f"{file}: is not a controller; a YAML file holds a machine of behaviours and conditions, "
            "states: [{behaviour: .., transitions: [..]}], or a tree, "
            "subtrees: [{condition: .., behaviour: ..}]"
        )
    used = [len(part["transitions"]) for part in parts if _has_transitions(part)]
    most = min(max([*used, 1]), modules.MOST_TRANSITIONS) if form == "machine" else None
    states = min(len(parts), modules.MOST_STATES if form == "machine" else modules.MOST_SUBTREES)
    try:
        options = ModulesOptions.model_validate(
            {"form": form, "states": states, "transitions": most, "machine": str(file)}
        )
    except ValidationError as error:
        told = [message for _, message in problems_of(error, ModulesOptions)]
        raise InputError("\n".join(told)) from None
    made = Modules(options, sensors=_SENSORS, actuators=_ACTUATORS)
    assert made.given is not None
    return made.specification(made.given)


def _has_transitions(part: object) -> bool:
    return isinstance(part, Mapping) and isinstance(part.get("transitions"), list)
