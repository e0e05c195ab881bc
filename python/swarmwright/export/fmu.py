"""Functional Mock-up Units for co-simulation: `--to fmu` (FMI 2.0) and `--to fmu3` (FMI 3.0)."""

import hashlib
import io
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from swarmwright.common import archives
from swarmwright.common.errors import InputError, RunError
from swarmwright.common.ranges import Range
from swarmwright.common.temporary import TemporaryFolder
from swarmwright.controllers.kinds import kind_of
from swarmwright.controllers.source.text import MARK, check_header, make_identifiers, plain
from swarmwright.export._base import Exporter, Files, file_bytes, format_facts, render
from swarmwright.export.c import LANGUAGE, C
from swarmwright.export.golden import Golden
from swarmwright.export.programs import find_command, run, standard_option
from swarmwright.export.sequences import Sequences
from swarmwright.export.subject import RANDOM, Channel, Subject
from swarmwright.simulations.fmu.description import RANGE

if TYPE_CHECKING:
    from swarmwright.export.fmu_driver import Driver

_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of all entries, for reproducible archives."""
UNITS: dict[str, dict[str, str]] = {
    "m": {"m": "1"}, "s": {"s": "1"}, "rad": {"rad": "1"}, "m/s": {"m": "1", "s": "-1"},
    "rad/s": {"rad": "1", "s": "-1"}, "m/s^2": {"m": "1", "s": "-2"}, "kg": {"kg": "1"}, "Hz": {"s": "-1"},
    "V": {"kg": "1", "m": "2", "s": "-3", "A": "-1"}, "K": {"K": "1"},
    "N": {"kg": "1", "m": "1", "s": "-2"}, "W": {"kg": "1", "m": "2", "s": "-3"},
    "deg": {"rad": "1", "factor": "0.017453292519943295"},
    "m^2": {"m": "2"}, "m^3": {"m": "3"}, "rad/s^2": {"rad": "1", "s": "-2"}, "A": {"A": "1"},
    "Pa": {"kg": "1", "m": "-1", "s": "-2"}, "J": {"kg": "1", "m": "2", "s": "-2"},
    "N.m": {"kg": "1", "m": "2", "s": "-2"}, "Nm": {"kg": "1", "m": "2", "s": "-2"},
    "ohm": {"kg": "1", "m": "2", "s": "-3", "A": "-2"}, "T": {"kg": "1", "s": "-2", "A": "-1"},
    "lx": {"cd": "1", "m": "-2"}, "%": {"factor": "0.01"},
    "min": {"s": "1", "factor": "60.0"}, "h": {"s": "1", "factor": "3600.0"},
    "deg/s": {"rad": "1", "s": "-1", "factor": "0.017453292519943295"},
    "degC": {"K": "1", "offset": "273.15"},
}  # fmt: skip
"""Units in SI base units, spelled in ASCII; other units are only named, as is g, which is either a gram or
9.81 m/s^2."""
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
_PREFIXED = ("m", "s", "V", "A", "N", "W", "Hz", "Pa", "J", "N.m", "ohm", "T", "rad")
"""Units with SI prefixes."""
_NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def unit_name(unit: str) -> str:
    """Return the name of a unit in FMUs: deg for degrees, without line breaks."""
    return " ".join(unit.replace("\N{DEGREE SIGN}", "deg").split())


def start_description(
    fmi: str, name: str, identifier: str, description: str, *, keeps_state: bool = True
) -> tuple[ET.Element, ET.Element]:
    """Build the root of modelDescription.xml, and its first element, CoSimulation.

    keeps_state: whether the state of an instance can be read, written and serialized.
    """
    from swarmwright import __version__  # noqa: PLC0415 - asks the engine

    three = fmi == "3.0"
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": fmi,
            "modelName": name,
            ("instantiationToken" if three else "guid"): identifier,
            "description": description,
            "generationTool": f"Swarmwright {__version__}",
            "variableNamingConvention": "structured",
            **({} if three else {"numberOfEventIndicators": "0"}),
        },
    )
    state, keeps = "FMUState" if three else "FMUstate", str(keeps_state).lower()
    attributes = {
        "modelIdentifier": name,
        f"canGetAndSet{state}": keeps,
        f"canSerialize{state}": keeps,
        "canHandleVariableCommunicationStepSize": "true",
        **({} if three else {"canNotUseMemoryManagementFunctions": "true"}),
    }
    return root, ET.SubElement(root, "CoSimulation", attributes)


def add_units(root: ET.Element, names: Iterable[str]) -> None:
    """Add the definitions of units, in SI base units if known."""
    units = ET.SubElement(root, "UnitDefinitions")
    for name in names:
        unit = ET.SubElement(units, "Unit", name=name)
        if base := _base_unit(name):
            ET.SubElement(unit, "BaseUnit", base)


def _base_unit(name: str) -> dict[str, str]:
    """Return a unit, such as `m/s²` or `kΩ`, in SI base units; empty if unknown."""
    spelled = plain(name)
    if spelled in UNITS:
        return UNITS[spelled]
    factor, rest = _PREFIXES.get(spelled[:1]), spelled[1:]
    if factor is None or rest not in _PREFIXED:
        return {}
    return {**UNITS[rest], "factor": repr(factor * float(UNITS[rest].get("factor", "1")))}


def add_range(variable: ET.Element, range_: Range, fmi: str) -> None:
    """Annotate a variable with the values of -1 and 1, see `simulations.fmu.description`."""
    annotations = ET.SubElement(variable, "Annotations")
    if fmi == "3.0":
        annotation = ET.SubElement(annotations, "Annotation", type=RANGE)
    else:
        annotation = ET.SubElement(annotations, "Tool", name=RANGE)
    about = {"low": repr(range_.low), "high": repr(range_.high)}
    ET.SubElement(annotation, "Range", about | ({"unit": unit} if (unit := unit_name(range_.unit)) else {}))


def name_variables(group: str, names: Iterable[str]) -> list[str]:
    """Return names of variables in FMI's structured convention: `sensors.goal_x` for `goal x`."""
    words = make_identifiers(names, group.rpartition(".")[2].removesuffix("s").upper())
    # A name of the convention does not begin with a digit.
    return [f"{group}.{'_' if name[0].isdigit() else ''}{name.lower()}" for name in words]


def token(*parts: str | bytes) -> str:
    """Return an identifier of the content of the archive, in the form of a GUID."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part.encode() if isinstance(part, str) else part)
    text = digest.hexdigest()[:32]
    return f"{{{text[:8]}-{text[8:12]}-{text[12:16]}-{text[16:20]}-{text[20:]}}}"


def zip_files(files: Files, *, compressed: bool = True) -> bytes:
    """Return an archive; the mark of Swarmwright is uncompressed at its beginning.

    compressed: if False, the bytes do not depend on the version of zlib.
    """
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, content in files.items():
            info = zipfile.ZipInfo(name, _DATE)
            stored = name.endswith(".xml") or not compressed
            info.compress_type = zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
            info.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, file_bytes(content))
    return data.getvalue()


def format_xml(root: ET.Element, comment: str = "") -> str:
    """Return a document with a comment before its root. Characters that XML forbids are replaced."""
    ET.indent(root)
    begin = f"<!-- {comment} -->\n" if comment else ""
    text = _NOT_IN_XML.sub("\N{REPLACEMENT CHARACTER}", ET.tostring(root, encoding="unicode"))
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{begin}{text}\n'


_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "mingw": ("windows", ".dll")}
_MACHINES = """\
#if defined __x86_64__ && __SIZEOF_POINTER__ == 8
machine: x86_64
#elif defined __i386__
machine: x86
#elif defined __aarch64__ && __SIZEOF_POINTER__ == 8
machine: aarch64
#elif defined __riscv && __riscv_xlen == 64
machine: riscv64
#endif
"""
"""Preprocessor code that prints the machine; options such as -m32 affect it, but not -dumpmachine."""
_TIME_OUT_S = 120
_LARGEST_FILE_BYTES = 1 << 26
"""Largest file in an FMU; Swarmwright writes kilobytes, and libraries of some hundred kilobytes."""
_SOURCES, _BINARIES = "sources/", "binaries/"


def compile_library(prefix: str, sources: Mapping[str, bytes], fmi: str) -> tuple[str, bytes]:
    """Return the path of the shared library in the archive, and the library.

    Raises InputError without a C compiler, or if FMI has no name for its target, RunError when the
    compilation fails.
    """
    compiler = find_command(
        "CC", ("cc", "gcc", "clang"), "apt install gcc", needed_by="the library of an FMU"
    )
    machine, system, ending = _platform(compiler)
    with TemporaryFolder("fmu") as folder:
        for name, data in sources.items():
            (folder / name).write_bytes(data)
        standard = standard_option(compiler, LANGUAGE.standard)
        options = [*standard, "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off"]
        file = f"{prefix}{ending}"
        words = [*options, "-DSWARMWRIGHT_CONTRACT_OFF", "-o", file, f"{prefix}.c", f"{prefix}_fmu.c"]
        run([*compiler, *words], folder, "the C compiler", during="the FMU's library")
        binary = (folder / file).read_bytes()
    if fmi == "3.0":
        return f"{_BINARIES}{machine}-{system}/{file}", binary
    bits = "32" if machine == "x86" else "64"
    return f"{_BINARIES}{'win' if system == 'windows' else system}{bits}/{file}", binary


def add_library(file: Path, prefix: str, fmi: str) -> None:
    """Compile the sources of an FMU without a library, and add the library to the archive.

    Raises the errors of `compile_library`, and InputError if the FMU, which may be from a bundle, is damaged
    or too large.
    """
    with archives.open_archive(file, "an FMU") as archive:
        inside: Files = {
            name: archives.read_entry(archive, file, name, _LARGEST_FILE_BYTES) for name in archive.namelist()
        }
    if any(name.startswith(_BINARIES) for name in inside):
        return
    sources = {
        name.removeprefix(_SOURCES): data
        for name, data in inside.items()
        if name.startswith(_SOURCES) and isinstance(data, bytes)
    }
    path, binary = compile_library(prefix, sources, fmi)
    file.write_bytes(zip_files({**inside, path: binary}))


def _platform(compiler: list[str]) -> tuple[str, str, str]:
    """Return the names of machine and system in FMI 3.0, and the suffix of libraries."""
    triple = _compiler_output([*compiler, "-dumpmachine"]).strip()
    preprocessed = _compiler_output([*compiler, "-E", "-P", "-x", "c", "-"], _MACHINES)
    machine = re.search(r"^machine: (\w+)$", preprocessed, re.MULTILINE)
    system = next((names for word, names in _SYSTEMS.items() if word in triple), None)
    if machine is None or system is None:
        raise InputError(
            f"{' '.join(compiler)}: compiles for {triple or 'an unknown machine'}, which FMI does not "
            "support; set another compiler with CC"
        )
    return machine[1], *system


def _compiler_output(words: list[str], text: str = "") -> str:
    """Return the output of a compiler about itself."""
    try:
        return subprocess.run(
            words,
            input=text,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=_TIME_OUT_S,
            check=False,
        ).stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(f"{' '.join(words)}: cannot query the target of the compiler: {error}") from None


_SEED_ROW = "<tr><td>seed</td><td></td><td>{}</td></tr>"
_FIRST_SENSOR = 2
"""First value reference of sensors: 0 is the time, 1 the period; actuators follow the sensors."""


class Fmu(Exporter):
    """`PREFIX.fmu`, a Functional Mock-up Unit for co-simulation, and a self-test that runs it with FMPy.

    Inputs `sensors.NAME`, outputs `actuators.NAME`, and the parameter `period`, in seconds. It contains the
    C source and a shared library for the target of the C compiler (CC). An instance is one agent.
    FMI: Functional Mock-up Interface for Model Exchange and Co-Simulation 2.0.4, chapter 4.
    """

    form: ClassVar[str] = "fmu"
    compiled: ClassVar[bool] = True
    fmi: ClassVar[str] = "2.0"

    def __init__(self, *, with_library: bool = True) -> None:
        self._with_library = with_library

    def portable(self) -> "Fmu":
        """Return the exporter of FMUs with C source only."""
        return type(self)(with_library=False)

    def files(self, subject: Subject, prefix: str) -> Files:
        """Return the FMU and its self-test. Raises InputError also without a C compiler."""
        check_header(prefix)
        if not subject.steers:
            raise InputError(
                "controller: a parameter set has no inputs and outputs for an FMU; export it to c, cpp, "
                "python or micropython"
            )
        archive_files = self._archive_files(subject, prefix)
        return {
            f"{prefix}.fmu": zip_files(archive_files, compressed=self._with_library),
            f"{prefix}_fmu_test.py": render(
                "fmu_test.txt",
                {
                    "p": prefix,
                    "facts": format_facts(subject, "    "),
                    **Golden.from_subject(subject).values(),
                    "period": repr(_period(subject)),
                    **_TEST[self.fmi],
                },
            ),
        }

    def run(self, folder: Path, prefix: str, sequences: Sequences) -> NDArray[np.float32]:
        """Run the FMU with FMPy, which also validates its description against the standard's schema.

        An FMU without a library gets one first.
        """
        with _driver(folder / f"{prefix}.fmu", prefix, self.fmi) as driver:
            return driver.drive(sequences)

    def self_test(self, folder: Path, prefix: str) -> str:
        """Run `PREFIX_fmu_test.py`; an FMU without a library gets one first."""
        add_library(folder / f"{prefix}.fmu", prefix, self.fmi)
        name = f"{prefix}_fmu_test.py"
        output = run([sys.executable, name], folder, f"the self-test {name}")
        if output.strip() != b"ok":
            raise RunError(f"verification: the self-test {name} printed {output!r}, expected ok")
        return name

    def _archive_files(self, subject: Subject, prefix: str) -> Files:
        """Return the content of the archive."""
        written = C().files(subject, prefix)
        sources = {name: file_bytes(written[name]) for name in (f"{prefix}.h", f"{prefix}.c")}
        variables, random = _Variables(subject), random_sensor(subject)
        values = {
            "p": prefix,
            "facts": format_facts(subject),
            "version": self.fmi,
            "sensors": str(len(subject.sensors)),
            "actuators": str(len(subject.actuators)),
            "sensor_names": "\n".join(f'    "{name}",' for name in variables.sensors),
            "period": repr(_period(subject)),
            "otherwise": f"{variables.sensors[random]} is not from 0 to 1"
            if subject.checks_random and random is not None
            else "a node overflows, sensors are too large",
            **source_parts(subject, variables.sensors, self.fmi),
        }
        wrapper = render("fmu_source.txt", {**values, "token": "@token@"})
        wrapper += render(f"fmu_fmi{self.fmi[0]}.txt", values)
        identifier = token(self.fmi, *sources.values(), wrapper.encode())
        sources[f"{prefix}_fmu.c"] = wrapper.replace("@token@", identifier).encode()
        archive_files: Files = {
            "modelDescription.xml": self._description(subject, prefix, identifier, variables),
            "documentation/index.html": _documentation(subject, prefix, variables, self.fmi),
            **{f"sources/{name}": data for name, data in sources.items()},
        }
        if self._with_library:
            path, binary = compile_library(prefix, sources, self.fmi)
            archive_files[path] = binary
        if self.fmi == "3.0":
            archive_files["sources/buildDescription.xml"] = _build_description(prefix)
        return archive_files

    def _description(self, subject: Subject, prefix: str, token: str, variables: "_Variables") -> str:
        """Return modelDescription.xml."""
        from swarmwright import __version__  # noqa: PLC0415 - asks the engine

        three = self.fmi == "3.0"
        root, simulation = start_description(self.fmi, prefix, token, _describe_subject(subject) or prefix)
        if not three:
            files = ET.SubElement(simulation, "SourceFiles")
            for name in (f"{prefix}.c", f"{prefix}_fmu.c"):
                ET.SubElement(files, "File", name=name)
        add_units(root, variables.units)
        categories = ET.SubElement(root, "LogCategories")
        for name in ("logStatusWarning", "logStatusDiscard", "logStatusError"):
            ET.SubElement(categories, "Category", name=name)
        ET.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(_period(subject)))
        listed = ET.SubElement(root, "ModelVariables")
        (variables.add_fmi3 if three else variables.add_fmi2)(listed, subject)
        structure = ET.SubElement(root, "ModelStructure")
        first = _FIRST_SENSOR + len(variables.sensors)
        outputs = structure if three else ET.SubElement(structure, "Outputs")
        for index in range(len(variables.actuators)):
            # In FMI 2.0 the index of the variable, from 1, without the time. Outputs change in steps only and
            # do not depend directly on inputs.
            entry = {"valueReference" if three else "index": str(first + index), "dependencies": ""}
            ET.SubElement(outputs, "Output" if three else "Unknown", entry)
        return format_xml(root, comment=f"{MARK} {__version__}; changes here are lost.")


class Fmu3(Fmu):
    """An FMU for FMI 3.0: sensors and actuators have 32 bits as in the simulation.

    FMI: Functional Mock-up Interface Specification 3.0.1, chapter 4.
    """

    form: ClassVar[str] = "fmu3"
    fmi: ClassVar[str] = "3.0"


_TEST = {
    "2.0": {
        "driver": "fmi2", "slave": "FMU2Slave", "setup": "controller.setupExperiment()", "set": "setReal",
        "get": "getReal",
    },
    "3.0": {"driver": "fmi3", "slave": "FMU3Slave", "setup": "", "set": "setFloat32", "get": "getFloat32"},
}  # fmt: skip


class _Variables:
    """Names of variables, and their elements in a description."""

    def __init__(self, subject: Subject) -> None:
        self.sensors = name_variables("sensors", [sensor.name for sensor in subject.sensors])
        self.actuators = name_variables("actuators", [actuator.name for actuator in subject.actuators])
        channels = [*subject.sensors, *subject.actuators]
        units = [
            unit
            for channel in channels
            for unit in (channel.unit, channel.range.unit if channel.range else "")
        ]
        self.units = sorted({"s", *filter(None, map(unit_name, units))})
        index = random_sensor(subject)
        self.random = None if index is None else self.sensors[index]
        """The name of the random sensor; None without one."""

    def _add_seed(self, listed: ET.Element, fmi: str) -> None:
        if self.random is not None:
            add_seed(listed, _FIRST_SENSOR + len(self.sensors) + len(self.actuators), self.random, fmi)

    def _bounds(self, name: str, causality: str) -> dict[str, str]:
        """Return the limits of a variable; measured sensors may exceed their range."""
        if name == self.random:
            return {"min": "0", "max": "1"}
        return {"min": "-1", "max": "1"} if causality == "output" else {}

    def _channels(self, subject: Subject) -> list[tuple[str, Channel, str]]:
        return [
            *((name, sensor, "input") for name, sensor in zip(self.sensors, subject.sensors, strict=True)),
            *(
                (name, actuator, "output")
                for name, actuator in zip(self.actuators, subject.actuators, strict=True)
            ),
        ]

    def add_fmi2(self, listed: ET.Element, subject: Subject) -> None:
        """Add the variables of FMI 2.0; value references are their indices, from 1."""
        period = {"name": "period", "valueReference": "1", "causality": "parameter", "variability": "fixed"}
        element = ET.SubElement(
            listed, "ScalarVariable", {**period, "description": _describe_period(subject)}
        )
        ET.SubElement(element, "Real", unit="s", start=repr(_period(subject)))
        for index, (name, channel, causality) in enumerate(self._channels(subject)):
            about = {"name": name, "valueReference": str(_FIRST_SENSOR + index), "causality": causality}
            if causality == "output":
                about |= {"variability": "discrete", "initial": "exact"}
            else:
                about |= {"variability": "discrete"}
            element = ET.SubElement(
                listed, "ScalarVariable", {**about, "description": _describe_channel(channel)}
            )
            ET.SubElement(element, "Real", {**_unit(channel), **self._bounds(name, causality), "start": "0"})
            if channel.range is not None:
                add_range(element, channel.range, "2.0")
        self._add_seed(listed, "2.0")

    def add_fmi3(self, listed: ET.Element, subject: Subject) -> None:
        """Add the variables of FMI 3.0."""
        time = {"name": "time", "valueReference": "0", "causality": "independent"}
        ET.SubElement(listed, "Float64", {**time, "variability": "continuous", "unit": "s"})
        period = {"name": "period", "valueReference": "1", "causality": "parameter", "variability": "fixed"}
        start = {"unit": "s", "start": repr(_period(subject))}
        ET.SubElement(listed, "Float64", {**period, "description": _describe_period(subject), **start})
        for index, (name, channel, causality) in enumerate(self._channels(subject)):
            about = {"name": name, "valueReference": str(_FIRST_SENSOR + index), "causality": causality}
            about |= {"variability": "discrete", "description": _describe_channel(channel)}
            if causality == "output":
                about["initial"] = "exact"
            about |= {**_unit(channel), **self._bounds(name, causality), "start": "0"}
            element = ET.SubElement(listed, "Float32", about)
            if channel.range is not None:
                add_range(element, channel.range, "3.0")
        self._add_seed(listed, "3.0")


def _describe_period(subject: Subject) -> str:
    """Describe the parameter `period`."""
    text = "Time from one control step to the next, above 0"
    if subject.step_size:
        return text
    return f"{text}; a guess, since the simulation's steps have no known duration in physical time"


def _unit(channel: Channel) -> dict[str, str]:
    """Return the unit attribute of a variable."""
    unit = unit_name(channel.unit)
    return {"unit": unit} if unit else {}


def _describe_subject(subject: Subject) -> str:
    entries = [f"{name}: {text}" for name, text in subject.facts]
    return "; ".join([*entries, " ".join(subject.conversion)] if subject.conversion else entries)


def _describe_channel(channel: Channel) -> str:
    return f"{channel.name}, {channel.limits}"


def _period(subject: Subject) -> float:
    """Return the seconds of a control step, as in an FMU of the simulation; 1 if unknown."""
    return subject.step_size or subject.shown_seconds or 1.0


def _build_description(prefix: str) -> str:
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=prefix)
    files = ET.SubElement(build, "SourceFileSet", language="C11", compilerOptions="-ffp-contract=off")
    for name in (f"{prefix}.c", f"{prefix}_fmu.c"):
        ET.SubElement(files, "SourceFile", name=name)
    ET.SubElement(files, "PreprocessorDefinition", name="SWARMWRIGHT_CONTRACT_OFF")
    return format_xml(root)


def _documentation(subject: Subject, prefix: str, variables: _Variables, fmi: str) -> str:
    rows = "\n".join(
        f"<tr><td>{escape(name)}</td><td>{escape(channel.unit)}</td><td>{escape(_describe_channel(channel))}</td></tr>"
        for name, channel in zip(
            [*variables.sensors, *variables.actuators], [*subject.sensors, *subject.actuators], strict=True
        )
    )
    origin = "\n".join(
        f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in subject.facts
    )
    return render(
        "fmu_documentation.txt",
        {
            "p": escape(prefix),
            "fmi": fmi,
            "rows": rows,
            "origin": origin,
            "period": repr(_period(subject)),
            "conversion": f"<p>{'<br>'.join(subject.conversion)}</p>" if subject.conversion else "",
            "seed": ""
            if variables.random is None
            else _SEED_ROW.format(escape(describe_seed(variables.random))),
        },
    )


def _driver(file: Path, prefix: str, fmi: str) -> "Driver":
    from importlib.util import find_spec  # noqa: PLC0415 - beside its use

    if find_spec("fmpy") is None:
        raise InputError("verification of an FMU needs FMPy: pip install 'swarmwright[fmi]'")
    from swarmwright.export.fmu_driver import Driver  # noqa: PLC0415 - needs FMPy

    add_library(file, prefix, fmi)
    return Driver(file)


_STATE = """\
    int32_t seed;       /* 0: the master sets the random number */
    uint64_t generator; /* its state */
    int repeated;       /* successive samples with the same number of the master, counted up to CONSTANT */
    float before;       /* that random number */"""
_INTEGERS = {"2.0": "Integer", "3.0": "Int32"}


def random_sensor(subject: Subject) -> int | None:
    """Return the index of the random sensor, a number from 0 to 1; None without one."""
    sensor = kind_of(subject.specification).random_sensor
    if sensor is not None:  # if it is not checked, the simulation uses it differently
        return sensor if subject.checks_random else None
    matches = (
        index
        for index, channel in enumerate(subject.sensors)
        if channel.name == RANDOM and channel.range is None
    )
    return next(matches, None)


def source_parts(subject: Subject, sensors: Sequence[str], fmi: str) -> dict[str, str]:
    """Return replacements in the source of an FMU; sensors: names of its inputs."""
    index = random_sensor(subject)
    if index is None:
        nothing = dict.fromkeys(("random_state", "random_functions", "random_draw", "random_check"), "")
        return {**nothing, "integers": f"NO_VARIABLES({_INTEGERS[fmi]})"}
    values = {"random": str(index), "random_name": sensors[index]}
    return {
        "random_state": _STATE,
        "random_functions": render("fmu_random.txt", values).rstrip(),
        "random_draw": "        draw(next);",
        "random_check": "    status = check_random(instance, state, next);",
        "integers": render(f"fmu_fmi{fmi[0]}_seed.txt", values).rstrip(),
    }


def describe_seed(sensor: str) -> str:
    """Describe the parameter `seed`; sensor: the name of the input."""
    return (
        f"0: each step takes {sensor}; above 0: the FMU draws this number itself, from this seed, of which "
        "each robot needs another one"
    )


def add_seed(listed: ET.Element, reference: int, sensor: str, fmi: str) -> None:
    """Add the parameter `seed` to the variables; sensor: the name of the input."""
    about = {
        "name": "seed",
        "valueReference": str(reference),
        "causality": "parameter",
        "variability": "fixed",
        "description": describe_seed(sensor),
    }
    value = {"min": "0", "start": "0"}
    if fmi == "3.0":
        ET.SubElement(listed, "Int32", {**about, **value})
    else:
        ET.SubElement(ET.SubElement(listed, "ScalarVariable", about), "Integer", value)
