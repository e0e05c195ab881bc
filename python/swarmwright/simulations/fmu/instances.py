"""Instances of an FMU in this process, stepped by FMPy."""

import contextlib
import ctypes
import itertools
import re
import sys
import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO
from weakref import WeakValueDictionary

from fmpy import calloc, free
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    fmi2DoStepStatus,
    fmi2Terminated,
)
from fmpy.fmi3 import FMU3Slave
from fmpy.logging import addLoggerProxy

from swarmwright.common import archives
from swarmwright.common.errors import InputError
from swarmwright.simulations.fmu.description import STRUCTURAL, Description, Variable, convert_native, flatten

_OK, _WARNING, _DISCARD, _FATAL, _PENDING = 0, 1, 2, 4, 5
_POLL_S = 0.001
"""Seconds between two checks whether a step that an FMU computes in the background is done."""
_REFERENCE = re.compile(r"##|#([ribs])(\d+)#")
"""A reference to a variable in a message of FMI 2.0, by type and value reference, or an escaped #; section
2.1.5."""
_REFERENCE_TYPES = {"r": ("Real",), "i": ("Integer", "Enumeration"), "b": ("Boolean",), "s": ("String",)}
_MOST_PLANS = 10_000
"""Largest number of cached lists of variables; there are three for each agent."""
_MOST_WARNINGS = 1000
"""Largest number of warnings of an instance that are printed; an FMU may have a warning in each step."""
_STATUS = {_DISCARD: "that it is not done", 3: "an error", _FATAL: "a fatal error"}


class FmuError(Exception):
    """An episode cannot continue, with the reason."""


_instances: WeakValueDictionary[int, "Instance"] = WeakValueDictionary()
"""Instances of FMI 2.0, by the number that is passed to the FMU as componentEnvironment."""
_numbers = itertools.count(1)


def _dispatch_message(
    environment: int | None, name: bytes | None, status: int, _category: bytes | None, text: bytes | None
) -> None:
    """Pass a message of an FMU of FMI 2.0 to its instance.

    Some FMUs violate the standard and do not pass componentEnvironment back, but their name.
    """
    named = (running for running in _instances.values() if running.name.encode() == name)
    instance = _instances.get(environment or 0) or next(named, None)
    if instance is not None:
        instance.log_message(status, text)


_logger = fmi2CallbackLoggerTYPE(_dispatch_message)
"""A single logger for all instances: FMPy's proxy for variadic arguments has a single target."""
# The C functions, which work in every thread of an FMU, even while Python exits.
_allocate_memory = ctypes.cast(calloc, fmi2CallbackAllocateMemoryTYPE)
_free_memory = ctypes.cast(free, fmi2CallbackFreeMemoryTYPE)


def _callbacks(environment: int) -> fmi2CallbackFunctions:
    """Return the callbacks that FMI 2.0, section 2.1.5, requires.

    Without stepFinished, which is optional, the status of a step is polled.
    """
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = _logger
    callbacks.allocateMemory = _allocate_memory
    callbacks.freeMemory = _free_memory
    callbacks.componentEnvironment = environment
    addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


@dataclass(frozen=True)
class _Plan:
    """How a list of variables is set and read."""

    variables: Sequence[Variable]
    """The list itself, kept alive because its identity is the key."""
    kind: str | None
    """Type of all variables, if a single call handles them; None for several types and for array elements."""
    are_real: bool
    references: list[int]


class Instance:
    """An instance of an FMU.

    Args:
        description: description of the FMU.
        folder: folder of the unpacked FMU.
        name: name of the instance.
        log: stream for its messages; None discards them.

    Raises:
        FmuError: the instance cannot be created.
    """

    def __init__(
        self, description: Description, folder: Path, name: str, log: TextIO | None = sys.stderr
    ) -> None:
        self._description = description
        self._two = description.version == "2.0"
        self.name, self._number = name, next(_numbers)
        _instances[self._number] = self
        self._last, self._messages, self._warnings = "", log, 0
        self._plans: dict[int, _Plan] = {}
        arguments = {
            "guid": description.token,
            "unzipDirectory": str(folder),
            "instanceName": name,
        }
        try:
            self._fmu = self._library(arguments)
        except Exception as error:  # FMPy raises various exceptions
            raise FmuError(f"the FMU's library cannot be loaded: {error}") from error
        self._is_fresh = False
        self.is_corrupted = False
        """Whether the instance had a fatal error, after which FMI forbids further calls."""
        self._make()

    def _library(self, arguments: dict[str, str]) -> Any:  # noqa: ANN401 - FMPy has no types
        """Load the library."""
        arguments["modelIdentifier"] = self._description.identifier
        return FMU2Slave(**arguments) if self._two else FMU3Slave(**arguments)

    def _make(self) -> None:
        try:
            if self._two:
                self._fmu.instantiate(callbacks=_callbacks(self._number), loggingOn=True)
            else:
                self._fmu.instantiate(
                    loggingOn=True,
                    logMessage=lambda _environment, status, _category, text: self.log_message(status, text),
                )
        except Exception as error:
            raise FmuError(self._describe_error("the FMU cannot be instantiated", error)) from error
        self._is_fresh = True

    def log_message(self, status: int, text: bytes | None) -> None:
        """Log a message of the FMU. Logging is always on, as some FMUs report reasons only in messages."""
        if status == _OK or not text:
            return
        message = text.decode(errors="replace").strip()
        message = _REFERENCE.sub(self._resolve_reference, message) if self._two else message
        self._last = message or self._last
        if self._messages is None:
            return
        if status == _WARNING:
            self._warnings += 1
            if self._warnings > _MOST_WARNINGS:
                return
        self._messages.write(f"{message}\n")
        if self._warnings == _MOST_WARNINGS and status == _WARNING:
            self._messages.write("further warnings of this FMU are omitted\n")

    def _resolve_reference(self, match: re.Match[str]) -> str:
        """Return the name of a variable that a message refers to."""
        if match[1] is None:
            return "#"
        kinds, reference = _REFERENCE_TYPES[match[1]], int(match[2])
        variables = self._description.variables.values()
        return next(
            (
                variable.name
                for variable in variables
                if variable.reference == reference and variable.type in kinds
            ),
            match[0],
        )

    def _describe_error(self, action: str, error: Exception) -> str:
        self.is_corrupted |= isinstance(error, FMICallException) and error.status == _FATAL
        reason = self._last or str(error)
        if not self._last and isinstance(error, FMICallException):
            reason = f"the FMU reports {_STATUS.get(error.status, error.status)} without a reason"
        return f"{action}: {reason}"

    def _call(self, action: str, function: Callable[..., Any], *arguments: Any) -> Any:  # noqa: ANN401 - any function
        self._last = ""
        try:
            return function(*arguments)
        except FMICallException as error:
            raise FmuError(self._describe_error(action, error)) from error

    def _renew(self) -> None:
        """Replace the instance by a fresh one.

        FMUs that Swarmwright exported are reset instead, as some are connected to servers. Resets of other
        FMUs are not reliable: 20-sim's keep some of their state, AMESim's refuse to reset.
        """
        if self._fmu.component is not None and self._description.is_exported:
            self._call("reset", self._fmu.reset)
            return
        self._free()
        self._make()

    def _free(self) -> None:
        """Free the instance, unless a fatal error forbids further calls."""
        if self._fmu.component is not None and not self.is_corrupted:
            (self._fmu.fmi2FreeInstance if self._two else self._fmu.fmi3FreeInstance)(self._fmu.component)
            self._fmu.component = None

    def begin(self, start: Mapping[str, Any], time: float, stop: float) -> None:
        """Start an episode, with these values of variables."""
        if not self._is_fresh:
            self._renew()
        fmu = self._fmu
        self._is_fresh = False
        values = [(self._description.variables[name], value) for name, value in start.items()]
        sizes = [pair for pair in values if pair[0].causality == STRUCTURAL]
        if sizes:  # before other values, whose shapes may depend on them
            self._call("configuration", fmu.enterConfigurationMode)
            for variable, value in sizes:
                self.set(variable, value)
            self._call("configuration", fmu.exitConfigurationMode)
        for variable, value in values:
            if variable.causality != STRUCTURAL:
                self.set(variable, value)
        times = {"startTime": time, "stopTime": stop, "tolerance": self._description.tolerance}
        if self._two:
            self._call("setup", lambda: fmu.setupExperiment(**times))
            self._call("initialization", fmu.enterInitializationMode)
        else:
            self._call("initialization", lambda: fmu.enterInitializationMode(**times))
        self._call("initialization", fmu.exitInitializationMode)

    def set(self, variable: Variable, value: Any) -> None:  # noqa: ANN401 - a number, boolean or text
        """Set a variable; an array by its values, row by row. Raises FmuError if the FMU refuses it."""
        if variable.is_array:
            self._put_array(variable, flatten(value))
            return
        if variable.count > 1:
            self._put_elements([variable], [value])
            return
        value = convert_native(variable, value)
        function = getattr(self._fmu, f"set{self._kind(variable)}")
        self._call(f"{variable.name} = {value}", function, [variable.reference], [value])

    def get(self, variable: Variable) -> float:
        """Return the value of a variable that is a number or boolean."""
        if variable.count > 1:
            return self._array(variable)[variable.index]
        function = getattr(self._fmu, f"get{self._kind(variable)}")
        return float(self._call(variable.name, function, [variable.reference])[0])

    def _array(self, variable: Variable) -> list[float]:
        """Return the whole array that an element belongs to."""
        function = getattr(self._fmu, f"get{self._kind(variable)}")
        values = self._call(variable.name, function, [variable.reference], variable.count)
        return [float(numeral) for numeral in values]

    def _put_elements(self, variables: Sequence[Variable], values: Sequence[float]) -> None:
        """Set elements of arrays; other elements keep their values."""
        arrays: dict[int, tuple[Variable, list[float]]] = {}
        for variable, value in zip(variables, values, strict=True):
            if variable.reference not in arrays:
                arrays[variable.reference] = (variable, self._array(variable))
            arrays[variable.reference][1][variable.index] = value
        for variable, whole in arrays.values():
            self._put_array(variable, whole)

    def _put_array(self, variable: Variable, whole: Sequence[Any]) -> None:
        function = getattr(self._fmu, f"set{self._kind(variable)}")
        values = list(whole) if variable.is_real else [convert_native(variable, number) for number in whole]
        self._call(variable.name, function, [variable.reference], values)

    def put(self, variables: Sequence[Variable], values: Sequence[float]) -> None:
        """Set variables that are numbers or booleans; real numbers of the same type in a single call."""
        if not variables:
            return
        plan = self._plan(variables)
        if plan.kind is not None and plan.are_real:
            function = getattr(self._fmu, f"set{plan.kind}")
            self._call("inputs", function, plan.references, list(values))
            return
        arrays = [pair for pair in zip(variables, values, strict=True) if pair[0].count > 1]
        if arrays:
            self._put_elements([array for array, _ in arrays], [value for _, value in arrays])
        for variable, value in zip(variables, values, strict=True):
            if variable.count == 1:
                self.set(variable, value)

    def numbers(self, variables: Sequence[Variable]) -> list[float]:
        """Return variables that are numbers or booleans; those of the same type in a single call."""
        plan = self._plan(variables)
        if plan.kind is not None:
            values = self._call("outputs", getattr(self._fmu, f"get{plan.kind}"), plan.references)
            return [float(numeral) for numeral in values]
        arrays = {variable.reference: self._array(variable) for variable in variables if variable.count > 1}
        return [
            arrays[variable.reference][variable.index] if variable.count > 1 else self.get(variable)
            for variable in variables
        ]

    def _plan(self, variables: Sequence[Variable]) -> "_Plan":
        """Return how variables are set and read; cached, as it is needed in every step."""
        plan = self._plans.get(id(variables))
        if plan is None or plan.variables is not variables:
            kinds = {self._kind(variable) for variable in variables}
            at_once = len(kinds) == 1 and all(variable.count == 1 for variable in variables)
            plan = _Plan(
                variables,
                kinds.pop() if at_once else None,
                all(variable.is_real for variable in variables),
                [variable.reference for variable in variables],
            )
            if len(self._plans) >= _MOST_PLANS:  # lists that were created for a single call
                self._plans.clear()
            self._plans[id(variables)] = plan
        return plan

    def _kind(self, variable: Variable) -> str:
        if variable.type == "Enumeration":
            return "Integer" if self._two else "Int64"
        return variable.type

    def step(self, time: float, size: float) -> bool:
        """Advance by one step; return whether the FMU ends the simulation."""
        self._last = ""
        try:
            done = self._fmu.doStep(currentCommunicationPoint=time, communicationStepSize=size)
        except FMICallException as error:
            status = error.status if error.status != _PENDING or not self._two else self._wait_for_step()
            if status == _DISCARD and self._two and self._has_terminated():
                return True
            if status not in (_OK, _WARNING):
                failed = FMICallException(error.function, status)
                raise FmuError(self._describe_error(f"the step from {time:g} s", failed)) from error
        if self._two:
            return False
        _, terminates, early, last = done
        if early:
            raise FmuError(f"the step from {time:g} s ended early, at {last:g} s")
        return bool(terminates)

    def give_up(self) -> None:
        """End the episode, to release the FMU's resources, such as a simulation server."""
        if self._is_fresh or self.is_corrupted:
            return
        if self._description.is_exported:
            with contextlib.suppress(FMICallException):
                self._fmu.reset()
                self._is_fresh = True
        else:
            self._free()

    def end(self) -> None:
        """Free the instance and its library."""
        self._free()
        self._fmu.freeLibrary()

    def _wait_for_step(self) -> int:
        """Wait for a step that the FMU computes in the background; return its status."""
        try:
            while (status := self._fmu.getStatus(fmi2DoStepStatus)) == _PENDING:
                clock.sleep(_POLL_S)
        except FMICallException as error:
            return int(error.status)
        return int(status)

    def _has_terminated(self) -> bool:
        value = ctypes.c_int(0)
        try:
            self._fmu.fmi2GetBooleanStatus(self._fmu.component, fmi2Terminated, ctypes.byref(value))
        except FMICallException:
            return False
        return bool(value.value)


def unpack(file: str, folder: Path) -> Path:
    """Unpack an FMU. Raises FmuError."""
    try:
        with archives.open_archive(Path(file), "an FMU") as archive:
            archive.extractall(folder)
    except InputError as error:
        raise FmuError(f"cannot be unpacked: {error}") from error
    return folder
