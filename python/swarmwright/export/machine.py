"""Machines and trees of modules to read, and to start from: `--to machine`."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.errors import InputError
from swarmwright.common.yaml import read
from swarmwright.controllers.kinds.modules.automode import text_of
from swarmwright.controllers.modules import grammar, machine_mappings, machine_texts
from swarmwright.controllers.modules.registered import module
from swarmwright.export._base import Exporter, Files, facts
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject

_EDITABLE = "it can be edited and evaluated, or evolution start from it"


class Machine(Exporter):
    """`PREFIX.yaml`, the machine as an experiment's `controller.machine` has it, and drawings as text.

    `PREFIX.dot` is for Graphviz, `PREFIX.mmd` for Mermaid, `PREFIX.automode` what AutoMoDe's programs are
    called with; there is none for a machine with modules that they lack.
    """

    form: ClassVar[str] = "machine"

    _known: grammar.Catalogue | None = None
    """Modules of what was written."""

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the machine and its drawings."""
        if not grammar.is_modules(subject.specification):
            raise InputError(
                f"controller: one of the kind {subject.kind!r} is not a machine of behaviours and "
                "conditions; only the kind modules is"
            )
        specification = subject.specification
        self._known = grammar.Catalogue.of(specification)
        states = grammar.states_of(specification)
        text = "\n".join(f"# {line}" for line in machine_texts.controller_text(specification).splitlines())
        content = _tree_yaml(states) if grammar.is_tree(specification) else _yaml(states)
        dot, mermaid = (
            machine_texts.controller_diagram(specification, language) for language in ("dot", "mermaid")
        )
        command = text_of(states, tree=grammar.is_tree(specification))
        return {
            **({f"{prefix}.automode": f"{command}\n"} if command else {}),
            f"{prefix}.yaml": f"{facts(subject, '# ', _EDITABLE)}\n#\n{text}\n\n{content}",
            f"{prefix}.dot": f"{facts(subject, '// ')}\n{dot}\n",
            f"{prefix}.mmd": f"{facts(subject, '%% ')}\n{mermaid}\n",
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Read the machine, and run it by the engine, or in Python where that has modules of it."""
        values = read(folder / f"{prefix}.yaml").values
        tree = "subtrees" in values
        most = 1 if tree else grammar.MOST_TRANSITIONS
        catalogue = _catalogue(values) if self._known is None else self._known
        if tree:
            states = machine_mappings.subtrees_from(values, grammar.MOST_SUBTREES, catalogue)
        else:
            states = machine_mappings.states_from(values, grammar.MOST_STATES, most, catalogue)
        own: dict[str, Any] = {"kind": grammar.KIND}
        if catalogue.in_python:
            own = {
                "kind": grammar.PYTHON_KIND,
                "behaviours": [behaviour.as_mapping() for behaviour in catalogue.behaviours],
                "conditions": [condition.as_mapping() for condition in catalogue.conditions],
            }
        specification = {
            "version": 1,
            **own,
            "form": "tree" if tree else "machine",
            "sensors": grammar.SENSORS,
            "actuators": grammar.ACTUATORS,
            "states": len(states),
            "transitions": most,
            "weights": grammar.weights_of(states, len(states), most, catalogue),
        }
        return Sequences.computed(
            specification, sequences.first, sequences.sensors, sequences.accepted
        ).actuators


def _catalogue(machine: dict[str, Any]) -> grammar.Catalogue:
    """Return the engine's modules, and those in Python that a machine names."""
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
    for entry in machine_mappings.mapping_of(states)["states"]:
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
