"""Finite-state machines as SCXML: `--to scxml`."""

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from swarmwright.controllers import scxml
from swarmwright.controllers.source.text import plain
from swarmwright.export._base import Exporter, Files, export_error, format_facts
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import Subject


class Scxml(Exporter):
    """`PREFIX.scxml`, a state machine whose transitions are the rows of the table."""

    form: ClassVar[str] = "scxml"

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the state machine."""
        if subject.kind != "mealy_fsm":
            raise export_error(subject, self.form, ["mealy_fsm"])
        names = [[channel.name for channel in channels] for channels in (subject.sensors, subject.actuators)]
        lines = format_facts(subject, "").splitlines()
        if subject.conversion:
            channels = [*subject.sensors, *subject.actuators]
            lines += [
                plain(f"{channel.name}: {channel.limits}")
                for channel in channels
                if channel.range is not None
            ]
            lines += subject.conversion
        return {f"{prefix}.scxml": scxml.to_scxml(subject.specification, names[0], names[1], lines)}

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Read the state machine, and run it in the engine."""
        specification = scxml.read(folder / f"{prefix}.scxml").specification()
        return Sequences.compute(specification, sequences.first, sequences.sensors).actuators
