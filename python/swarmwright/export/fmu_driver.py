"""Execution of FMUs with FMPy."""

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from fmpy.validation import validate_fmu
from numpy.typing import NDArray

from swarmwright.common.errors import RunError
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.export.sequences import Sequences
from swarmwright.simulations.fmu.description import describe
from swarmwright.simulations.fmu.instances import FmuError, Instance, unpack


class Driver:
    """An importer with one instance of an FMU, used in a `with` block.

    Args:
        file: the FMU.

    Raises:
        RunError: the description violates the standard, or the FMU cannot be instantiated.

    """

    def __init__(self, file: Path) -> None:
        problems = validate_fmu(str(file))
        if problems:
            raise RunError(f"verification: FMPy finds fault with {file.name}: {'; '.join(problems)}")
        self._file, self._description = file, describe(file)

    def __enter__(self) -> Self:
        self._folder = TemporaryFolder("fmu")
        try:
            folder = unpack(str(self._file), self._folder.path)
            self.instance = Instance(self._description, folder, "verified", log=None)
        except FmuError as error:
            self._folder.close()
            raise RunError(f"verification: FMPy cannot use {self._file.name}: {error}") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.instance.end()
        self._folder.close()

    def drive(self, sequences: Sequences) -> NDArray[np.float32]:
        """Return the actuators after each step, (steps, actuators), one period per step.

        Raises RunError if the FMU accepts NaN or infinite sensors, or refuses other sensors.
        """
        sensors, actuators = (self._description.get_variables(causality) for causality in ("input", "output"))
        period = self._description.step_size or 1.0
        outputs = np.zeros_like(sequences.actuators)
        time, overflowed = 0.0, False
        for row, (first, accepted) in enumerate(zip(sequences.first, sequences.accepted, strict=True)):
            if first:
                time, overflowed = 0.0, False
                self.instance.begin({}, time, period * len(sequences))
            if overflowed:  # the engine's network is NaN until a reset; the FMU refuses these steps
                outputs[row] = sequences.actuators[row]
                continue
            self.instance.put(sensors, sequences.sensors[row].tolist())
            reason = self._step(time, period)
            time += period if reason is None else 0.0
            if reason is not None and sequences.may_overflow is not None and sequences.may_overflow[row]:
                outputs[row], overflowed = sequences.actuators[row], accepted.item()
                continue
            if (reason is None) is not accepted.item():
                did = f"refused ({reason})" if accepted else "accepted"
                sensed = sequences.sensors[row].tolist()
                raise RunError(f"verification: the FMU {did} the step with the sensors {sensed}")
            outputs[row] = self.instance.numbers(actuators)
        return outputs

    def _step(self, time: float, period: float) -> str | None:
        """Step; return the reason of a refusal."""
        try:
            self.instance.step(time, period)
        except FmuError as error:
            return str(error)
        return None
