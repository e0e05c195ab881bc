"""FMUs driven by FMPy."""

from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from fmpy.validation import validate_fmu
from numpy.typing import NDArray

from swarmwright.common.errors import RunError
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.export.sequences import Sequences
from swarmwright.simulations.fmu.description import described
from swarmwright.simulations.fmu.instances import FmuError, Instance, unpacked


class Driver:
    """A master with one instance of an FMU, for the time of a `with` block.

    Args:
        file: the FMU.

    Raises:
        RunError: the description is not one of the standard, or the FMU cannot be instantiated here.

    """

    def __init__(self, file: Path) -> None:
        problems = validate_fmu(str(file))
        if problems:
            raise RunError(f"verification: FMPy finds fault with {file.name}: {'; '.join(problems)}")
        self._file, self._description = file, described(file)

    def __enter__(self) -> Self:
        self._folder = TemporaryFolder("fmu")
        try:
            folder = unpacked(str(self._file), self._folder.path)
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
        """Return the actuators after each step, (steps, actuators), a period a step.

        Raises RunError where it does a step with a sensor that is NaN or infinite, or does not do another.
        """
        sensors, actuators = (self._description.of_causality(causality) for causality in ("input", "output"))
        period = self._description.step_size or 1.0
        found = np.zeros_like(sequences.actuators)
        time, overflowed = 0.0, False
        for row, (first, accepted) in enumerate(zip(sequences.first, sequences.accepted, strict=True)):
            if first:
                time, overflowed = 0.0, False
                self.instance.begin({}, time, period * len(sequences))
            if overflowed:  # the engine's network is NaN until it is reset; the FMU does not do such a step
                found[row] = sequences.actuators[row]
                continue
            self.instance.put(sensors, sequences.sensors[row].tolist())
            reason = self._step(time, period)
            time += period if reason is None else 0.0
            if reason is not None and sequences.may_overflow is not None and sequences.may_overflow[row]:
                found[row], overflowed = sequences.actuators[row], accepted.item()
                continue
            if (reason is None) is not accepted.item():
                did = f"did not do ({reason})" if accepted else "did"
                sensed = sequences.sensors[row].tolist()
                raise RunError(f"verification: the FMU {did} the step with the sensors {sensed}")
            found[row] = self.instance.numbers(actuators)
        return found

    def _step(self, time: float, period: float) -> str | None:
        """Step; return why that was not done."""
        try:
            self.instance.step(time, period)
        except FmuError as error:
            return str(error)
        return None
