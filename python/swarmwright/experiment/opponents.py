"""Opponents: controllers of other runs, bundles and files that play a side in matches."""

import hashlib
import json
import re
import stat
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from swarmwright.common.archives import CONTROLLER, EVALUATION, FORMAT, MANIFEST, read_files
from swarmwright.common.arrays import Genomes, shortest
from swarmwright.common.errors import InputError
from swarmwright.common.files import read_bytes
from swarmwright.common.json_text import loads
from swarmwright.common.problems import format_value
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.suggestions import suggest_or_list
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers import REPRESENTATIONS, Representation
from swarmwright.controllers.controller import Controller
from swarmwright.controllers.kinds import describe_controller
from swarmwright.controllers.kinds.team import Team
from swarmwright.controllers.modules.grammar import PYTHON_KIND
from swarmwright.controllers.teams import is_team, parts_of
from swarmwright.experiment.document import LARGEST_SIZE, STORE
from swarmwright.runs.store import StoreReader
from swarmwright.runs.store.folder import find_store

LARGEST_FILE_BYTES = 1 << 26
"""Size limit of a controller's file, in bytes: about five million weights."""
_LONGEST_NAME = 200
"""Largest number of characters of an opponent's name."""
_CANDIDATE = re.compile(r"(.+):(\d{1,18}):(\d{1,18})", re.DOTALL)
"""Format of a candidate of a run: RUN:GENERATION:CANDIDATE."""
_SHOWN_CHARACTERS = 60
"""Maximum characters of a value in a message."""
_ZIP = b"PK\x03\x04"
_EXPECTED = "expected a run folder, RUN:GENERATION:CANDIDATE, a bundle, or a controller in JSON"


@dataclass(frozen=True, eq=False)
class Opponent:
    """A controller that plays a side in matches."""

    name: str
    """Where it comes from, in printable characters."""
    architecture: Mapping[str, Any]
    """Specification without weights."""
    weights: NDArray[np.float32] = field(repr=False)
    """(weights,), finite and read-only."""
    genome: NDArray[np.float32] | None = field(default=None, repr=False)
    """(genes,) of which the weights were made; None if unknown, or if it is the weights."""
    simulation: str = ""
    """Name of the simulation in which it was evolved; empty if unknown."""
    parts: Mapping[str, "Opponent"] = field(default_factory=dict, repr=False)
    """Of a team: the controller of each group of agents, in order; else empty."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of architecture and weights in hexadecimal, without the name."""
        text = json.dumps(self.architecture, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode() + b"\0" + self.weights.astype("<f4").tobytes()).hexdigest()

    @property
    def specification(self) -> dict[str, Any]:
        """The controller with its weights, as plain values."""
        return {**self.architecture, "weights": shortest(self.weights)}

    @property
    def sensors(self) -> int:
        """Number of sensor values of an agent; of a team, the largest."""
        return self._count("sensors")

    @property
    def actuators(self) -> int:
        """Number of actuator values of an agent; of a team, the largest."""
        return self._count("actuators")

    def playing(self, side: str) -> "Opponent":
        """Return the controller with which it plays a side: of a team the part of that name, else itself.

        Raises InputError if it is a team without such a part.
        """
        if not self.parts:
            return self
        if side not in self.parts:
            hint = suggest_or_list(side, self.parts, "it plays")
            raise InputError(f"{self.name}: has no controller for {side}{hint}")
        return self.parts[side]

    @property
    def entry(self) -> dict[str, Any]:
        """Where it comes from, its architecture, its weights, and its genome if that differs, as arrays."""
        values: dict[str, Any] = {"from": self.name, "architecture": dict(self.architecture)}
        numbers = {"weights": self.weights, "genome": self.genome}
        return {**values, **{key: row for key, row in numbers.items() if row is not None}}

    def to_mapping(self) -> dict[str, Any]:
        """Return it as plain values, which `load_opponent` reads."""
        values = {
            key: shortest(value) if isinstance(value, np.ndarray) else value
            for key, value in self.entry.items()
        }
        genomes = {
            name: shortest(part.genome) for name, part in self.parts.items() if part.genome is not None
        }
        if genomes:
            values["genomes"] = genomes
        return {**values, "simulation": self.simulation} if self.simulation else values

    def _count(self, noun: str) -> int:
        if self.parts:
            return max(part._count(noun) for part in self.parts.values())
        return int(self.architecture[noun])


def load_opponent(
    source: str | PathLike[str] | Mapping[str, Any], folder: str | PathLike[str] = "."
) -> Opponent:
    """Read a controller that is to play a side in matches. Executes no code but plug-ins of trusted runs.

    Args:
        source: a run folder (its best candidate), RUN:GENERATION:CANDIDATE, a bundle or its unpacked folder,
            a file with a controller (JSON, or a machine in YAML), the JSON text of a controller, or plain
            values: a specification, or those of `Opponent.to_mapping`.
        folder: base of relative paths.

    Raises InputError, "origin: reason", if it is none of them, is damaged, or steers no agents; RunError if
    the run has no candidate yet.
    """
    if isinstance(source, Mapping):
        return _read_mapping(source)
    if not isinstance(source, str | PathLike):
        raise InputError(f"opponent: {format_value(source)} found; {_EXPECTED}")
    text = fspath(source)
    if not isinstance(text, str):
        raise InputError(f"opponent: {text!r} is not text; {_EXPECTED}")
    if text.lstrip().startswith("{"):
        return _parse("opponent", text)
    name = _name(text)
    if not text:
        raise InputError(f"opponent: its name is empty; {_EXPECTED}")
    try:
        path = Path(folder) / text
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        candidate = _CANDIDATE.fullmatch(text)
        if candidate is not None:
            return _read_run(Path(folder) / candidate[1], name, int(candidate[2]), int(candidate[3]))
        raise InputError(f"{name}: there is no such file; {_EXPECTED}") from None
    except (OSError, ValueError) as error:  # a name that the system refuses
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{name}: cannot be read: {reason}") from error
    try:
        if stat.S_ISDIR(mode):
            return _read_folder(path, name)
        if not stat.S_ISREG(mode):
            raise InputError(f"{name}: is not a regular file; {_EXPECTED}")
        return _read_bundle(path, name) if is_bundle(path) else _read_file(path, name)
    except OSError as error:
        raise InputError(f"{name}: cannot be read: {error.strerror}") from error


def find_run(source: str, folder: Path) -> Path | None:
    """Return the folder of the run that a source of `load_opponent` is from; None for other sources."""
    candidate = _CANDIDATE.fullmatch(source)
    for name in (source, *([candidate[1]] if candidate else [])):
        try:
            if (folder / name / STORE).is_file():
                return folder / name
        except (OSError, ValueError):  # a name that the system refuses
            continue
    return None


def is_bundle(path: Path) -> bool:
    """Return whether a path is an archive, or a folder with the manifest of a bundle."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            return (path / MANIFEST).is_file()
        if not stat.S_ISREG(mode):
            return False
        with path.open("rb") as file:
            return file.read(len(_ZIP)) == _ZIP
    except (OSError, ValueError):
        return False


def read_bundled_experiment(path: Path) -> dict[str, Any] | None:
    """Return what a bundle says of the competition in which its controller was evolved; None for nothing.

    It is untrusted: only the simulation, its parameters, the fitness of the sides, and whether there are
    several populations are returned, as an experiment.
    """
    try:
        recorded = loads(read_files(path)[EVALUATION])["experiment"]
        sides = recorded["ranking"]["sides"]
        if not isinstance(recorded["simulation"], str) or not isinstance(sides, dict):
            return None
        return {
            "simulation": recorded["simulation"],
            "parameters": recorded["parameters"],
            "ranking": {"kind": "tournament", "sides": sides},
            "populations": {str(side): {} for side in recorded.get("populations", {})},
        }
    except (InputError, ValueError, KeyError, TypeError, AttributeError):  # no bundle of a competition
        return None


def check_fits(
    opponent: Opponent, sensors: int, actuators: int, simulation: str = "", *, titles: tuple[str, ...] = ()
) -> None:
    """Raise InputError unless an opponent can control agents of a simulation.

    Args:
        opponent: the controller; of a team, the part for this side (`Opponent.playing`).
        sensors: number of sensor values of an agent.
        actuators: number of actuator values of an agent.
        simulation: name of the simulation; empty if it does not matter.
        titles: other names of it.
    """
    if simulation and opponent.simulation:
        names = {_plain(name) for name in (simulation, *titles)}
        if _plain(opponent.simulation) not in names:
            raise InputError(
                f"{opponent.name}: was evolved in {_label(opponent.simulation)}, not in "
                f"{_label(simulation)}; if both are the same, use the controller's file alone (best.json)"
            )
    if (opponent.sensors, opponent.actuators) != (sensors, actuators):
        raise InputError(
            f"{opponent.name}: has {opponent.sensors} sensors and {opponent.actuators} actuators, but the "
            f"agents have {sensors} and {actuators}"
        )


def _label(simulation: str) -> str:
    return _name(SimulationName.parse(simulation).label)


def _plain(simulation: str) -> str:
    return _label(simulation).partition("?")[0].casefold()


def _name(text: str) -> str:
    """Return a name as a printable line."""
    line = escape_line(text.encode("utf-8", "backslashreplace").decode())
    return line if len(line) <= _LONGEST_NAME else f"{line[: _LONGEST_NAME - 3]}..."


def _read_folder(path: Path, name: str) -> Opponent:
    if (path / STORE).is_file():
        return _read_run(path, name, None, None)
    if is_bundle(path):
        return _read_bundle(path, name)
    raise InputError(f"{name}: is neither a run folder ({STORE} is missing) nor an unpacked bundle")


def _read_run(path: Path, name: str, generation: int | None, candidate: int | None) -> Opponent:
    try:
        store = StoreReader(find_store(path))
        values = store.experiment()
        evaluation = store.evaluation(candidate, generation)
        representation = _build_representation(name, values)
    except InputError as error:
        raise InputError(_shorten(escape_line(str(error)))) from error
    genomes = {}
    if isinstance(representation, Team):
        first = 0
        for part_name, part in representation.parts.items():
            genomes[part_name] = evaluation.genome[first : first + part.genome_size]
            first += part.genome_size
    simulation = values.get("simulation")
    return _build(
        name,
        representation.specification(evaluation.genome),
        evaluation.genome,
        simulation if isinstance(simulation, str) else "",
        genomes,
    )


def _build_representation(name: str, values: Mapping[str, Any]) -> Representation:
    """Return the representation of a run's genomes without importing code. Raises InputError.

    values: the run's experiment.
    """
    section = values.get("controller")
    sizes = [values.get(noun) or 0 for noun in ("sensors", "actuators")]
    if not isinstance(section, Mapping) or not all(size in range(LARGEST_SIZE + 1) for size in sizes):
        raise InputError(f"{name}: the experiment in {STORE} is damaged")
    component = REPRESENTATIONS.get(str(section.get("kind")))
    try:
        options = component.options_model.model_validate(section, context={"ask": False})
    except ValidationError as error:
        raise InputError(f"{name}: its controllers were made by another version of Swarmwright") from error
    if getattr(options, "in_python", False):
        raise _error_of_code(name)
    return component(options, sensors=sizes[0], actuators=sizes[1])


def _read_bundle(path: Path, name: str) -> Opponent:
    files = read_files(path)
    try:
        manifest = loads(files[MANIFEST])
        form = manifest["format"]
        if form != FORMAT:
            raise InputError(f"{name}: has the format {format_value(form)}; this version reads {FORMAT}")
        data = files[CONTROLLER]
        stated = manifest["files"][CONTROLLER]["sha256"]
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{name}: is not a valid bundle: its manifest names no {CONTROLLER}") from error
    if hashlib.sha256(data).hexdigest() != stated:
        raise InputError(f"{name}: {CONTROLLER} was changed after the bundle was written")
    if len(data) > LARGEST_FILE_BYTES:
        raise InputError(f"{name}: {CONTROLLER} is larger than {LARGEST_FILE_BYTES >> 20} MiB")
    simulation = ""
    try:
        recorded = loads(files[EVALUATION])["experiment"]["simulation"]
        simulation = recorded if isinstance(recorded, str) else ""
    except (ValueError, KeyError, TypeError):  # it is not needed
        pass
    return _parse(name, data, simulation)


def _read_file(path: Path, name: str) -> Opponent:
    if path.suffix.lower() in {".yaml", ".yml"}:
        try:
            return _build(name, Controller.load(path).specification)
        except InputError as error:
            raise InputError(_shorten(escape_line(str(error)))) from error
    try:
        data = read_bytes(path, LARGEST_FILE_BYTES)
    except InputError as error:
        raise InputError(escape_line(str(error))) from error
    return _parse(name, data)


def _parse(name: str, text: str | bytes, simulation: str = "") -> Opponent:
    try:
        values = loads(text)
    except ValueError as error:
        raise InputError(f"{name}: is not valid JSON: {escape_line(str(error))}") from error
    if not isinstance(values, dict):
        raise InputError(f"{name}: {escape_line(format_value(values))} found; {_EXPECTED}")
    inner = values.get("controller")
    if isinstance(inner, dict):  # best.json of a run
        return _build(name, inner, values.get("genome"), simulation)
    return _build(name, values, simulation=simulation)


def _read_mapping(values: Mapping[str, Any]) -> Opponent:
    origin, simulation = values.get("from", "opponent"), values.get("simulation", "")
    name = _name(origin) if isinstance(origin, str) else "opponent"
    architecture = values.get("architecture")
    if architecture is None:
        return _build(name, values)
    if not isinstance(architecture, Mapping):
        raise InputError(f"{name}: architecture: {format_value(architecture)} found, expected a mapping")
    specification = {**architecture, "weights": values.get("weights")}
    genomes = values.get("genomes")
    return _build(
        name,
        specification,
        values.get("genome"),
        simulation if isinstance(simulation, str) else "",
        genomes if isinstance(genomes, Mapping) else None,
    )


def _build(
    name: str,
    specification: Mapping[str, Any],
    genome: Any = None,  # noqa: ANN401 - whatever a file says
    simulation: str = "",
    genomes: Mapping[str, Any] | None = None,
) -> Opponent:
    """Check a controller and build the opponent; genomes: of the parts of a team. Raises InputError."""
    kind = specification.get("kind")
    if kind == PYTHON_KIND:
        raise _error_of_code(name)
    try:
        controller = Controller(specification)
    except InputError as error:
        raise InputError(f"{name}: {_shorten(escape_line(str(error)))}") from error
    if not controller.sensors:
        raise InputError(f"{name}: is a parameter set, which steers no agents")
    values = controller.specification
    weights = _numbers(name, "weights", values.pop("weights"))
    genes = None if genome is None else _numbers(name, "genome", genome)
    if genes is not None and genes.tobytes() == weights.tobytes():
        genes = None
    parts = {
        part: _build(f"{name}, {_name(part)}", each, (genomes or {}).get(part), simulation)
        for part, each in (parts_of(specification) if is_team(specification) else {}).items()
    }
    return Opponent(name, values, weights, genes, simulation, parts)


def _error_of_code(name: str) -> InputError:
    return InputError(
        f"{name}: has behaviours or conditions in Python, which cannot be part of a match; use a controller "
        "without code"
    )


def _numbers(name: str, noun: str, values: Any) -> NDArray[np.float32]:  # noqa: ANN401 - whatever a file says
    """Return numbers as a read-only row. Raises InputError if they are not finite numbers."""
    try:
        with np.errstate(over="ignore"):
            row = np.array(values, dtype=np.float32)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: {noun}: are not numbers") from error
    if row.ndim != 1 or not np.isfinite(row).all():
        raise InputError(f"{name}: {noun}: are not a list of finite numbers")
    row.setflags(write=False)
    return row


def _shorten(message: str) -> str:
    longest = 500
    return message if len(message) <= longest else f"{message[: longest - 3]}..."


def genomes_of(entries: Sequence[Mapping[str, Any]], representation: Representation) -> Genomes:
    """Return the genomes of controllers, (controllers, genome_size).

    Args:
        entries: as `Opponent.to_mapping`.
        representation: of the genomes.

    Raises InputError if a controller's architecture does not match the representation.
    """
    required = json.loads(json.dumps(representation.architecture()))
    rows = []
    for entry in entries:
        name = entry.get("from", "controller")
        architecture = entry["architecture"]
        differing = list(_iter_differences(architecture, required))
        if differing:
            adopted = representation.adopt(architecture, _numbers(name, "weights", entry["weights"]))
            if adopted is not None:
                rows.append(adopted)
                continue
            options = type(representation.options).model_fields
            raise InputError(
                f"{name} is {describe_controller(architecture)}, but controllers of this experiment are "
                f"{describe_controller(required)}; they differ in "
                + ", ".join(_describe_difference(key, architecture, required, options) for key in differing)
            )
        try:
            genome = np.array(entry.get("genome", entry["weights"]), dtype=np.float32)
        except (ValueError, TypeError) as error:
            raise InputError(f"{name}: its weights are not numbers") from error
        if genome.shape != (representation.genome_size,):
            raise InputError(
                f"{name}: has {genome.size} genes; the controllers of this experiment have "
                f"{representation.genome_size}"
            )
        if not np.isfinite(genome).all():
            raise InputError(f"{name}: has a gene that is not finite")
        weights = representation.weights(genome[np.newaxis])[0]
        if weights.tobytes() != np.array(entry["weights"], dtype=np.float32).tobytes():
            if "genome" not in entry:
                raise InputError(
                    f"{name}: has the values of a controller of the kind {architecture['kind']}, but not its "
                    "genome; use the folder of its run, or its best.json"
                )
            raise InputError(
                f"{name}: its genome and values do not match in this experiment, because options of the "
                "controller, such as ranges, have changed, or the file was edited"
            )
        rows.append(genome)
    return np.stack(rows)


def _iter_differences(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[str]:
    for key in dict.fromkeys([*second, *first]):
        if _make_comparable(first.get(key)) != _make_comparable(second.get(key)):
            yield str(key)


def _describe_difference(
    key: str, first: Mapping[str, Any], second: Mapping[str, Any], options: Container[str]
) -> str:
    """Describe a difference: `output_range ([-2, 2], here [-1, 1]; set controller.output_range)`."""
    values = [
        format_value(each[key], _SHOWN_CHARACTERS + 1) if key in each else "none" for each in (first, second)
    ]
    if key == "groups" or max(map(len, values)) > _SHOWN_CHARACTERS:
        return key
    advice = f"; set controller.{key}" if key in options and key in first else ""
    return f"{key} ({values[0]}, here {values[1]}{advice})"


def _make_comparable(value: Any) -> Any:  # noqa: ANN401 - any value of a specification
    """Return a value without the numbers of agents in groups of a team."""
    if not isinstance(value, list):
        return value
    return [
        {key: inner for key, inner in group.items() if key != "agents"} if isinstance(group, dict) else group
        for group in value
    ]
