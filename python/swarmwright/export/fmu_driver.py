"""FMUs driven by FMPy."""

import ctypes
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave
from fmpy.logging import addLoggerProxy
from fmpy.validation import validate_fmu
from numpy.typing import NDArray

from swarmwright.core.errors import RunError
from swarmwright.export.sequences import Sequences

_DISCARD = 2
"""What an FMU returns that did not do a step."""


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
        self._description = read_model_description(str(file))
        self._file = file
        self.told: list[str] = []
        """What the FMU told its master."""

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="swarmwright-fmu-")
        try:
            self._fmu = self._instantiated()
        except BaseException:
            self._folder.cleanup()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._fmu.freeInstance()
        self._folder.cleanup()

    def _instantiated(self) -> Any:  # noqa: ANN401 - FMPy has no types
        description = self._description
        extract(str(self._file), self._folder.name)
        arguments = {
            "guid": description.guid,
            "unzipDirectory": self._folder.name,
            "modelIdentifier": description.coSimulation.modelIdentifier,
            "instanceName": "verified",
        }
        self._two = description.fmiVersion == "2.0"
        try:
            fmu = FMU2Slave(**arguments) if self._two else FMU3Slave(**arguments)
            if self._two:
                fmu.instantiate(callbacks=self._callbacks())
            else:
                fmu.instantiate(logMessage=lambda _environment, _status, _category, text: self._note(text))
        except Exception as error:  # FMPy's own kinds
            raise RunError(f"verification: FMPy cannot use {self._file.name}: {error}") from error
        return fmu

    def _callbacks(self) -> Any:  # noqa: ANN401 - FMPy has no types
        def log(_environment: Any, _name: Any, _status: Any, _category: Any, text: bytes) -> None:  # noqa: ANN401 - of ctypes
            self._note(text)

        made = fmi2CallbackFunctions()
        made.logger = fmi2CallbackLoggerTYPE(log)
        addLoggerProxy(ctypes.byref(made))
        return made

    def _note(self, text: bytes) -> None:
        self.told[:] = [*self.told[-9:], text.decode(errors="replace")]

    def drive(self, sequences: Sequences) -> NDArray[np.float32]:
        """Return the actuators after each step, (steps, actuators), a period a step.

        Raises RunError where it does a step with a sensor that is NaN or infinite, or does not do another.
        """
        sensors, actuators = (self._references(one) for one in ("input", "output"))
        given = np.ascontiguousarray(sequences.sensors, np.float64 if self._two else np.float32)
        found = np.zeros_like(sequences.actuators, given.dtype)
        fmu = self._fmu
        put, get = (
            (fmu.fmi2SetReal, fmu.fmi2GetReal) if self._two else (fmu.fmi3SetFloat32, fmu.fmi3GetFloat32)
        )
        number = ctypes.c_double if self._two else ctypes.c_float
        into, out = (number * given.shape[1])(), (number * found.shape[1])()
        # FMI 3.0 asks for the number of values, too.
        sizes: list[tuple[int, ...]] = [(), ()] if self._two else [(len(into),), (len(out),)]
        component = fmu.component
        period = float(self._description.defaultExperiment.stepSize)
        time = 0.0
        for row, (first, accepted) in enumerate(zip(sequences.first, sequences.accepted, strict=True)):
            if first:
                self._begin(anew=row > 0)
                time = 0.0
            into[:] = given[row].tolist()
            put(component, sensors, len(into), into, *sizes[0])
            if self._stepped(time, period) is not accepted.item():
                did = "did" if not accepted else f"did not do ({'; '.join(self.told[-1:])})"
                raise RunError(f"verification: the FMU {did} the step with the sensors {given[row].tolist()}")
            time += period if accepted else 0.0
            get(component, actuators, len(out), out, *sizes[1])
            found[row] = out
        return np.ascontiguousarray(found, np.float32)

    def _references(self, causality: str) -> Any:  # noqa: ANN401 - an array of ctypes
        found = [one.valueReference for one in self._description.modelVariables if one.causality == causality]
        return (ctypes.c_uint * len(found))(*found)

    def _begin(self, *, anew: bool) -> None:
        if anew:
            self._fmu.reset()
        if self._two:
            self._fmu.setupExperiment()
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    def _stepped(self, time: float, period: float) -> bool:
        try:
            self._fmu.doStep(currentCommunicationPoint=time, communicationStepSize=period)
        except FMICallException as error:
            if error.status == _DISCARD:
                return False
            raise RunError(f"verification: the FMU failed: {'; '.join(self.told[-1:]) or error}") from error
        return True
