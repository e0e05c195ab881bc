"""FMUs of controllers, and how tests step them."""

import zipfile
from pathlib import Path
from typing import Any

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from swarmwright.export import EXPORTERS, Exporter
from swarmwright.export.exporting import write
from tests.python.export.specifications import ALL, subject

FORMS = ("fmu", "fmu3")
KEEPS_STATE = "fully_meshed-tanh-6"
"""Its actuators depend on what it sensed before."""


def exporter(form: str) -> Exporter:
    return EXPORTERS.get(form)()


def written(name: str, form: str, folder: Path) -> Path:
    write(exporter(form).files(subject(ALL[name]), "robot"), folder)
    return folder / "robot.fmu"


def instance(file: Path, folder: Path) -> Any:
    """An instance that samples from 0 s on."""
    description = read_model_description(str(file))
    extract(str(file), str(folder))
    make = FMU2Slave if description.fmiVersion == "2.0" else FMU3Slave
    fmu = make(
        guid=description.guid, unzipDirectory=str(folder), modelIdentifier="robot", instanceName="tested"
    )
    fmu.instantiate()
    return fmu


def begin(fmu: Any) -> None:
    if isinstance(fmu, FMU2Slave):
        fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()


def put(fmu: Any, references: list[int], values: Any) -> None:
    (fmu.setReal if isinstance(fmu, FMU2Slave) else fmu.setFloat32)(
        references, [float(one) for one in values]
    )


def got(fmu: Any, references: list[int]) -> list[float]:
    found: list[float] = (fmu.getReal if isinstance(fmu, FMU2Slave) else fmu.getFloat32)(references)
    return found


def parameter(fmu: Any, reference: int, value: int) -> None:
    (fmu.setInteger if isinstance(fmu, FMU2Slave) else fmu.setInt32)([reference], [value])


def zipped(file: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}
