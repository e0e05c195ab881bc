"""FMUs that FMPy drives, a master of another make."""

from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import byref
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave
from fmpy.logging import addLoggerProxy


@dataclass
class Driven:
    """An instance that FMPy drives."""

    fmu: Any
    version: str
    references: dict[str, int]
    period: float
    said: list[str] = field(default_factory=list)
    """Messages of the FMU."""

    def begin(self, seed: int) -> None:
        if self.version == "2.0":
            self.fmu.setInteger([self.references["seed"]], [seed])
            self.fmu.setupExperiment(startTime=0.0)
        else:
            self.fmu.setUInt64([self.references["seed"]], [seed])
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def text(self, name: str, value: str) -> None:
        self.fmu.setString([self.references[name]], [value])

    def integer(self, name: str, value: int) -> None:
        put = self.fmu.setInteger if self.version == "2.0" else self.fmu.setInt64
        put([self.references[name]], [value])

    def number(self, name: str, value: float) -> None:
        put = self.fmu.setReal if self.version == "2.0" else self.fmu.setFloat64
        put([self.references[name]], [value])

    def singles(self, names: list[str]) -> list[float]:
        get = self.fmu.getReal if self.version == "2.0" else self.fmu.getFloat32
        return list(get([self.references[name] for name in names]))

    def put(self, names: list[str], values: list[float]) -> None:
        put = self.fmu.setReal if self.version == "2.0" else self.fmu.setFloat32
        put([self.references[name] for name in names], values)

    def double(self, name: str) -> float:
        get = self.fmu.getReal if self.version == "2.0" else self.fmu.getFloat64
        return float(get([self.references[name]])[0])

    def flag(self, name: str) -> bool:
        return bool(self.fmu.getBoolean([self.references[name]])[0])

    def step(self, number: int) -> None:
        self.fmu.doStep(currentCommunicationPoint=number * self.period, communicationStepSize=self.period)


@contextmanager
def driving(file: Path) -> Iterator[Driven]:
    """Load an FMU and make an instance of it, which is freed in the end."""
    known = read_model_description(str(file))
    two = known.fmiVersion == "2.0"
    references = {one.name: one.valueReference for one in known.modelVariables}
    said: list[str] = []
    with TemporaryDirectory() as folder:
        fmu = (FMU2Slave if two else FMU3Slave)(
            guid=known.guid,
            unzipDirectory=extract(str(file), folder),
            modelIdentifier=known.coSimulation.modelIdentifier,
            instanceName="world",
        )
        if two:
            callbacks = fmi2CallbackFunctions()
            # The text is the only argument of the format.
            callbacks.logger = fmi2CallbackLoggerTYPE(
                lambda _environment, _name, _status, _category, text: said.append(text.decode())
            )
            addLoggerProxy(byref(callbacks))
            fmu.instantiate(callbacks=callbacks)
        else:
            fmu.instantiate(
                logMessage=lambda _environment, _status, _category, text: said.append(text.decode())
            )
        try:
            yield Driven(fmu, known.fmiVersion, references, float(known.defaultExperiment.stepSize), said)
        finally:
            fmu.freeInstance()
