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
from swarmwright.simulations.fmu.description import STRUCTURAL, Description, Variable, flat, native

_OK, _WARNING, _DISCARD, _FATAL, _PENDING = 0, 1, 2, 4, 5
_POLL_S = 0.001
"""Between two questions whether a step that an FMU computes in the background is done."""
_REFERENCE = re.compile(r"##|#([ribs])(\d+)#")
"""A variable in a message of FMI 2.0, by type and value reference, or an escaped #; section 2.1.5."""
_REFERRED = {"r": ("Real",), "i": ("Integer", "Enumeration"), "b": ("Boolean",), "s": ("String",)}
_MOST_PLANS = 10_000
"""Lists of variables of which it is remembered how they are set and got; three for each agent."""
_MOST_WARNINGS = 1000
"""Of an instance, that are printed: an FMU may have one in each step."""
_STATUS = {_DISCARD: "that it is not done", 3: "an error", _FATAL: "a fatal error"}


class FmuError(Exception):
    """An episode cannot go on; the text says why."""


_instances: WeakValueDictionary[int, "Instance"] = WeakValueDictionary()
"""Of FMI 2.0, by the number that each gives its FMU as componentEnvironment."""
_numbers = itertools.count(1)


def _take_message(
    environment: int | None, name: bytes | None, status: int, _category: bytes | None, text: bytes | None
) -> None:
    """Pass a message of an FMU of FMI 2.0 to the instance that it is from.

    Some FMUs do not pass componentEnvironment on as they have to, but their name.
    """
    named = (running for running in _instances.values() if running.name.encode() == name)
    instance = _instances.get(environment or 0) or next(named, None)
    if instance is not None:
        instance.take_message(status, text)


_logger = fmi2CallbackLoggerTYPE(_take_message)
"""One for all instances: FMPy's proxy, which formats the variadic arguments, has a single target."""
# The functions of C themselves: they work in each thread of an FMU, also while Python ends.
_allocate_memory = ctypes.cast(calloc, fmi2CallbackAllocateMemoryTYPE)
_free_memory = ctypes.cast(free, fmi2CallbackFreeMemoryTYPE)


def _callbacks(environment: int) -> fmi2CallbackFunctions:
    """Return what FMI 2.0, section 2.1.5, requires of an importer.

    Without stepFinished, which is optional, an FMU is asked whether a step is done.
    """
    made = fmi2CallbackFunctions()
    made.logger = _logger
    made.allocateMemory = _allocate_memory
    made.freeMemory = _free_memory
    made.componentEnvironment = environment
    addLoggerProxy(ctypes.byref(made))
    return made


@dataclass(frozen=True)
class _Plan:
    """How variables are set and got."""

    variables: Sequence[Variable]
    """Held, so that their identity stays theirs."""
    kind: str | None
    """Of all, which are set and got at once; None for several kinds, and for elements of arrays."""
    are_real: bool
    references: list[int]


class Instance:
    """One instance.

    Args:
        description: of the FMU.
        folder: where it is unpacked.
        name: of the instance.
        log: where its messages go; None for nowhere.

    Raises:
        FmuError: it cannot be made.

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
        except Exception as error:  # FMPy's own kinds
            raise FmuError(f"the FMU's library cannot be loaded: {error}") from error
        self._is_fresh = False
        self.is_corrupted = False
        """Whether it had a fatal error: FMI forbids to call its FMU any more."""
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
                    logMessage=lambda _environment, status, _category, text: self.take_message(status, text),
                )
        except Exception as error:
            raise FmuError(self._explained("the FMU cannot be instantiated", error)) from error
        self._is_fresh = True

    def take_message(self, status: int, text: bytes | None) -> None:
        """Take a message of the FMU. Logging is on: without, some FMUs do not say why a call fails."""
        if status == _OK or not text:
            return
        said = text.decode(errors="replace").strip()
        said = _REFERENCE.sub(self._referred, said) if self._two else said
        self._last = said or self._last
        if self._messages is None:
            return
        if status == _WARNING:
            self._warnings += 1
            if self._warnings > _MOST_WARNINGS:
                return
        self._messages.write(f"{said}\n")
        if self._warnings == _MOST_WARNINGS and status == _WARNING:
            self._messages.write("other warnings of this FMU are left out\n")

    def _referred(self, found: re.Match[str]) -> str:
        """Return the name of a variable that a message refers to."""
        if found[1] is None:
            return "#"
        kinds, reference = _REFERRED[found[1]], int(found[2])
        known = self._description.variables.values()
        return next(
            (
                variable.name
                for variable in known
                if variable.reference == reference and variable.type in kinds
            ),
            found[0],
        )

    def _explained(self, what: str, error: Exception) -> str:
        self.is_corrupted |= isinstance(error, FMICallException) and error.status == _FATAL
        reason = self._last or str(error)
        if not self._last and isinstance(error, FMICallException):
            reason = f"the FMU reports {_STATUS.get(error.status, error.status)}, and no reason"
        return f"{what}: {reason}"

    def _called(self, what: str, function: Callable[..., Any], *arguments: Any) -> Any:  # noqa: ANN401 - any function
        self._last = ""
        try:
            return function(*arguments)
        except FMICallException as error:
            raise FmuError(self._explained(what, error)) from error

    def _renew(self) -> None:
        """Have an instance that no episode has used.

        A reset does it for FMUs that Swarmwright exported, some of which are connected to servers. In others
        it cannot be relied on: 20-sim's FMUs keep some of their state, AMESim's refuse it.
        """
        if self._fmu.component is not None and self._description.is_exported:
            self._called("reset", self._fmu.reset)
            return
        self._free()
        self._make()

    def _free(self) -> None:
        """End the instance; not after a fatal error, which forbids any further call."""
        if self._fmu.component is not None and not self.is_corrupted:
            (self._fmu.fmi2FreeInstance if self._two else self._fmu.fmi3FreeInstance)(self._fmu.component)
            self._fmu.component = None

    def begin(self, start: Mapping[str, Any], time: float, stop: float) -> None:
        """Start an episode, with these values of variables."""
        if not self._is_fresh:
            self._renew()
        fmu = self._fmu
        self._is_fresh = False
        given = [(self._description.variables[name], value) for name, value in start.items()]
        sizes = [pair for pair in given if pair[0].causality == STRUCTURAL]
        if sizes:  # before other values, whose number may depend on them
            self._called("configuration", fmu.enterConfigurationMode)
            for variable, value in sizes:
                self.set(variable, value)
            self._called("configuration", fmu.exitConfigurationMode)
        for variable, value in given:
            if variable.causality != STRUCTURAL:
                self.set(variable, value)
        times = {"startTime": time, "stopTime": stop, "tolerance": self._description.tolerance}
        if self._two:
            self._called("setup", lambda: fmu.setupExperiment(**times))
            self._called("initialization", fmu.enterInitializationMode)
        else:
            self._called("initialization", lambda: fmu.enterInitializationMode(**times))
        self._called("initialization", fmu.exitInitializationMode)

    def set(self, variable: Variable, value: Any) -> None:  # noqa: ANN401 - a number, boolean or text
        """Set a variable, an array by all its values row by row. Raises FmuError where the FMU refuses it."""
        if variable.is_array:
            self._put_array(variable, flat(value))
            return
        if variable.count > 1:
            self._put_elements([variable], [value])
            return
        value = native(variable, value)
        function = getattr(self._fmu, f"set{self._kind(variable)}")
        self._called(f"{variable.name} = {value}", function, [variable.reference], [value])

    def get(self, variable: Variable) -> float:
        """Return a variable that is a number or boolean."""
        if variable.count > 1:
            return self._array(variable)[variable.index]
        function = getattr(self._fmu, f"get{self._kind(variable)}")
        return float(self._called(variable.name, function, [variable.reference])[0])

    def _array(self, variable: Variable) -> list[float]:
        """Return the whole array of an element."""
        function = getattr(self._fmu, f"get{self._kind(variable)}")
        found = self._called(variable.name, function, [variable.reference], variable.count)
        return [float(numeral) for numeral in found]

    def _put_elements(self, variables: Sequence[Variable], values: Sequence[float]) -> None:
        """Set elements of arrays; others keep their values."""
        arrays: dict[int, tuple[Variable, list[float]]] = {}
        for variable, value in zip(variables, values, strict=True):
            if variable.reference not in arrays:
                arrays[variable.reference] = (variable, self._array(variable))
            arrays[variable.reference][1][variable.index] = value
        for variable, whole in arrays.values():
            self._put_array(variable, whole)

    def _put_array(self, variable: Variable, whole: Sequence[Any]) -> None:
        function = getattr(self._fmu, f"set{self._kind(variable)}")
        values = list(whole) if variable.is_real else [native(variable, number) for number in whole]
        self._called(variable.name, function, [variable.reference], values)

    def put(self, variables: Sequence[Variable], values: Sequence[float]) -> None:
        """Set variables that are numbers or booleans; real ones of one type at once."""
        if not variables:
            return
        plan = self._plan(variables)
        if plan.kind is not None and plan.are_real:
            function = getattr(self._fmu, f"set{plan.kind}")
            self._called("inputs", function, plan.references, list(values))
            return
        arrays = [pair for pair in zip(variables, values, strict=True) if pair[0].count > 1]
        if arrays:
            self._put_elements([array for array, _ in arrays], [value for _, value in arrays])
        for variable, value in zip(variables, values, strict=True):
            if variable.count == 1:
                self.set(variable, value)

    def numbers(self, variables: Sequence[Variable]) -> list[float]:
        """Return variables that are numbers or booleans; those of one type at once."""
        plan = self._plan(variables)
        if plan.kind is not None:
            found = self._called("outputs", getattr(self._fmu, f"get{plan.kind}"), plan.references)
            return [float(numeral) for numeral in found]
        arrays = {variable.reference: self._array(variable) for variable in variables if variable.count > 1}
        return [
            arrays[variable.reference][variable.index] if variable.count > 1 else self.get(variable)
            for variable in variables
        ]

    def _plan(self, variables: Sequence[Variable]) -> "_Plan":
        """Return how variables are set and got, which is looked up in every step."""
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
            if len(self._plans) >= _MOST_PLANS:  # of lists that are made anew for each call
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
            status = error.status if error.status != _PENDING or not self._two else self._finished()
            if status == _DISCARD and self._two and self._has_terminated():
                return True
            if status not in (_OK, _WARNING):
                failed = FMICallException(error.function, status)
                raise FmuError(self._explained(f"the step from {time:g} s", failed)) from error
        if self._two:
            return False
        _, terminates, early, last = done
        if early:
            raise FmuError(f"the step from {time:g} s ended at {last:g} s already")
        return bool(terminates)

    def give_up(self) -> None:
        """End the episode, so that what the FMU has taken for it, such as a simulation server, is free."""
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

    def _finished(self) -> int:
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


def unpacked(file: str, folder: Path) -> Path:
    """Unpack an FMU. Raises FmuError."""
    try:
        with archives.open_archive(Path(file), "an FMU") as archive:
            archive.extractall(folder)
    except InputError as error:
        raise FmuError(f"cannot be unpacked: {error}") from error
    return folder
