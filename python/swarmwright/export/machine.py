"""Machines of modules to read, and to start from: `--to machine`."""

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.core import modules
from swarmwright.core.errors import InputError
from swarmwright.core.yaml import read
from swarmwright.export._base import Exporter, Files, facts
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject


class Machine(Exporter):
    """`PREFIX.yaml`, the machine as an experiment's `controller.machine` has it, and drawings as text.

    `PREFIX.dot` is for Graphviz, `PREFIX.mmd` for Mermaid.
    """

    form: ClassVar[str] = "machine"

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the machine and its drawings."""
        if subject.kind != "modules":
            raise InputError(
                f"controller: one of the kind {subject.kind!r} is no machine of behaviours and conditions; "
                "only modules is"
            )
        states = modules.states_of(subject.specification)
        text = "\n".join(f"# {line}" for line in modules.as_text(states).splitlines())
        return {
            f"{prefix}.yaml": f"{facts(subject, '# ')}\n#\n{text}\n\n{_yaml(states)}",
            f"{prefix}.dot": f"{facts(subject, '// ')}\n{modules.as_diagram(states, 'dot')}\n",
            f"{prefix}.mmd": f"{facts(subject, '%% ')}\n{modules.as_diagram(states, 'mermaid')}\n",
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Read the machine, and run it by the engine."""
        states = modules.states_from(
            read(folder / f"{prefix}.yaml").values, modules.MOST_STATES, modules.MOST_TRANSITIONS
        )
        specification = {
            "version": 1,
            "kind": "modules",
            "sensors": modules.SENSORS,
            "actuators": modules.ACTUATORS,
            "states": len(states),
            "transitions": modules.MOST_TRANSITIONS,
            "weights": modules.weights_of(states, len(states), modules.MOST_TRANSITIONS),
        }
        return Sequences.computed(specification, sequences.first, sequences.sensors).actuators


def _yaml(states: tuple[modules.State, ...]) -> str:
    lines = ["states:"]
    for entry in modules.mapping_of(states)["states"]:
        begin = "  - "
        for key, value in entry.items():
            if key != "transitions":
                lines.append(f"{begin}{key}: {value}")
                begin = "    "
            elif value:
                lines.append("    transitions:")
                lines += [
                    f"      - {{{', '.join(f'{name}: {part}' for name, part in one.items())}}}"
                    for one in value
                ]
    return "\n".join(lines) + "\n"
