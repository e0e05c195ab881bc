"""Machines and trees of modules in readable form: `--to machine`."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.yaml import read
from swarmwright.controllers.kinds.modules.automode import format_command_line
from swarmwright.controllers.modules import grammar, machine_mappings, machine_texts
from swarmwright.controllers.modules.registered import module
from swarmwright.export._base import Exporter, Files, format_facts
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

_EDITABLE = "it can be edited and evaluated, or evolution start from it"


class Machine(Exporter):
    """`PREFIX.yaml`, the machine in the form of an experiment's `controller.machine`, and diagrams as text.

    `PREFIX.dot` is for Graphviz, `PREFIX.mmd` for Mermaid, `PREFIX.automode` the command line of AutoMoDe's
    programs, unless they lack a module.
    """

    form: ClassVar[str] = "machine"

    _catalogue: grammar.Catalogue | None = None
    """Modules of the exported machine."""

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the machine and its diagrams."""
        if not grammar.is_modules(subject.specification):
            raise InputError(
                f"controller: the kind {subject.kind!r} is not a machine of behaviours and conditions; only "
                "the kind modules can be exported to this format"
            )
        specification = subject.specification
        self._catalogue = grammar.Catalogue.from_specification(specification)
        states = grammar.states_of(specification)
        text = "\n".join(f"# {line}" for line in machine_texts.controller_text(specification).splitlines())
        content = _tree_yaml(states) if grammar.is_tree(specification) else _yaml(states)
        dot, mermaid = (
            machine_texts.controller_diagram(specification, language) for language in ("dot", "mermaid")
        )
        command = format_command_line(states, tree=grammar.is_tree(specification))
        return {
            **({f"{prefix}.automode": f"{command}\n"} if command else {}),
            f"{prefix}.yaml": f"{format_facts(subject, '# ', _EDITABLE)}\n#\n{text}\n\n{content}",
            f"{prefix}.dot": f"{format_facts(subject, '// ')}\n{dot}\n",
            f"{prefix}.mmd": f"{format_facts(subject, '%% ')}\n{mermaid}\n",
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Read the machine, and run it in the engine, or in Python if it has modules in Python."""
        values = read(folder / f"{prefix}.yaml").values
        tree = "subtrees" in values
        most = 1 if tree else grammar.MOST_TRANSITIONS
        catalogue = _build_catalogue(values) if self._catalogue is None else self._catalogue
        if tree:
            states = machine_mappings.parse_subtrees(values, grammar.MOST_SUBTREES, catalogue)
        else:
            states = machine_mappings.parse_states(values, grammar.MOST_STATES, most, catalogue)
        kind_fields: dict[str, Any] = {"kind": grammar.KIND}
        if catalogue.in_python:
            kind_fields = {
                "kind": grammar.PYTHON_KIND,
                "behaviours": [behaviour.as_mapping() for behaviour in catalogue.behaviours],
                "conditions": [condition.as_mapping() for condition in catalogue.conditions],
            }
        specification = {
            "version": 1,
            **kind_fields,
            "form": "tree" if tree else "machine",
            "sensors": grammar.SENSORS,
            "actuators": grammar.ACTUATORS,
            "states": len(states),
            "transitions": most,
            "weights": grammar.weights_of(states, len(states), most, catalogue),
        }
        return Sequences.compute(
            specification, sequences.first, sequences.sensors, sequences.accepted
        ).actuators


def _build_catalogue(machine: dict[str, Any]) -> grammar.Catalogue:
    """Return the engine's modules, and the Python modules of a machine."""
    entries = machine.get("subtrees") or machine["states"]
    transitions = [transition for entry in entries for transition in entry.get("transitions", [])]
    behaviours = [entry["behaviour"] for entry in entries]
    conditions = [part["condition"] for part in (*entries, *transitions) if "condition" in part]
    return grammar.Catalogue(
        tuple(module("behaviour", name) for name in dict.fromkeys([*grammar.BEHAVIOURS, *behaviours])),
        tuple(module("condition", name) for name in dict.fromkeys([*grammar.CONDITIONS, *conditions])),
    )


def _tree_yaml(subtrees: tuple[grammar.State, ...]) -> str:
    rows = (
        f"  - {{{', '.join(f'{name}: {part}' for name, part in entry.items())}}}"
        for entry in machine_mappings.tree_mapping_of(subtrees)["subtrees"]
    )
    return "\n".join(["subtrees:", *rows]) + "\n"


def _yaml(states: tuple[grammar.State, ...]) -> str:
    lines = ["states:"]
    for entry in machine_mappings.machine_mapping_of(states)["states"]:
        begin = "  - "
        for key, value in entry.items():
            if key != "transitions":
                lines.append(f"{begin}{key}: {value}")
                begin = "    "
            elif value:
                lines.append("    transitions:")
                lines += [
                    f"      - {{{', '.join(f'{name}: {part}' for name, part in mapping.items())}}}"
                    for mapping in value
                ]
    return "\n".join(lines) + "\n"
