"""Experiments, checked and with all defaults filled in."""

import dataclasses
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, fields
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Never, Self

from swarmwright import _engine
from swarmwright.common.arguments import check_arguments, instance, mapping, path_of, require_list
from swarmwright.common.errors import InputError
from swarmwright.common.files import write_text
from swarmwright.common.html import facts
from swarmwright.common.simulation_names import SimulationName, is_command
from swarmwright.common.values import flatten, hashable, plain_values, read_only
from swarmwright.common.yaml import Source, dump, read
from swarmwright.controllers import REPRESENTATIONS, Representation, RepresentationOptions
from swarmwright.controllers._base import LARGEST_GENOME
from swarmwright.experiment.budget import LIMITS, Budget, sets_limit
from swarmwright.experiment.derived import find_source, steers_agents
from swarmwright.experiment.document import Faults, Requirements, Timeouts, Validate
from swarmwright.experiment.launcher_entries import Entries, to_file_value
from swarmwright.experiment.robots import subject_of
from swarmwright.experiment.settings import (
    ANNOUNCED,
    SIZES,
    Setting,
    apply,
    check_allowed,
    parse_settings,
)
from swarmwright.experiment.start_from import find_start_genomes
from swarmwright.experiment.unavailable import (
    UnavailableOptions,
    UnreadRankingOptions,
    find_copies,
    find_not_installed,
    method_of,
    options_with_code,
    ranking_of,
    require_method,
)
from swarmwright.methods import Method, MethodOptions
from swarmwright.methods.constraints import Limits
from swarmwright.methods.rankings import Ranking, RankingOptions
from swarmwright.methods.rankings.slow_simulation import SlowOptions
from swarmwright.methods.rankings.tournament import TournamentOptions
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import name_of
from swarmwright.simulations.near_names import describe_other_file

if TYPE_CHECKING:
    from swarmwright.runs.store import StoreReader


_ROBOT = "robot"
"""Parameter of the arena that determines sensors and actuators."""


def check_fits(experiment: "Experiment", source: Source) -> None:
    """Check that agents still have the numbers of sensors and actuators of the controllers.

    Args:
        experiment: with these numbers.
        source: source of the experiment with settings; not checked if it sets these numbers.

    Raises InputError that lists robots with matching numbers, if any.
    """
    values = source.values
    simulation, parameters = values.get("simulation"), values.get("parameters", {})
    sizes = {name: getattr(experiment, name) for name in SIZES}
    has_same_sizes = all(values.get(name) == size for name, size in sizes.items())
    if not (has_same_sizes and isinstance(simulation, str) and isinstance(parameters, Mapping)):
        return
    if catalogue.find_built_in(simulation) is None or None in sizes.values() or not steers_agents(experiment):
        return
    announced = find_announced_sizes(simulation, dict(parameters))
    if announced is None or announced == sizes:
        return
    has, needs = (_format_sizes(counts) for counts in (announced, sizes))
    robot = parameters.get(_ROBOT)
    subject = f"the robot {robot}" if isinstance(robot, str) else f"{simulation} with these parameters"
    fitting = [
        name
        for name in _list_robots(simulation)
        if find_announced_sizes(simulation, {**parameters, _ROBOT: name}) == sizes
    ]
    cure = f"; matching robots: {', '.join(fitting)}" if fitting else ""
    raise InputError(f"controller: was evolved for {needs}, but {subject} has {has}{cure}")


def find_announced_sizes(simulation: str, parameters: dict[str, Any]) -> dict[str, int] | None:
    """Return the numbers of sensors and actuators of agents.

    None for simulations of other servers and for invalid parameters.
    """
    if not catalogue.has_description(simulation):
        return None
    try:
        announced = catalogue.description(simulation, parameters)
    except InputError:
        return None
    return {name: announced[name] for name in SIZES}


def _format_sizes(sizes: Mapping[str, int]) -> str:
    return " and ".join(f"{count} {name if count != 1 else name[:-1]}" for name, count in sizes.items())


def _list_robots(simulation: str) -> list[str]:
    """Return the names of robots that a simulation knows."""
    return _engine.robots() if _ROBOT in catalogue.parameter_names(simulation) else []


KEYS_OUTSIDE_RECORD = frozenset(
    {"servers", "broker", "prefix", "mode", "timeouts", "faults", "requirements", "validate"}
)
"""Keys without effect on the record: where and how it is computed, and keys that follow from others."""
_SECTIONS = ("requirements", "controller", "method", "ranking", "validate", "timeouts", "faults")


@dataclass(frozen=True, kw_only=True, init=False)
class Experiment:
    """An immutable experiment, including its dictionaries and lists; `replace` makes a changed copy.

    Create it with `Experiment.load(path)` or `Experiment.from_mapping(values)`, which check everything; the
    keys and their meaning are those of the experiment file, see docs/reference/experiment.md.
    """

    simulation: str
    requirements: Requirements
    parameters: dict[str, Any]
    sensors: int | None
    actuators: int | None
    fitness: str | None
    """Fitness of an episode as an expression over metrics; None for the simulation's own."""
    constraints: dict[str, Limits]
    """Limits of metrics; empty for none."""
    start_from: list[dict[str, Any]] | None
    """Controllers to start from, with their weights; None for random ones."""
    controller: RepresentationOptions
    """Options of the representation, such as `LayeredOptions`."""
    populations: dict[str, MethodOptions]
    """Options of the method of each population of a competition, by side; empty for one population."""
    method: MethodOptions
    """Options of the method, such as `CmaEsOptions`."""
    ranking: RankingOptions
    validate: Validate
    mode: Literal["auto", "stepwise", "batched", "offloaded"]
    servers: int | Literal["auto", "local", "in-process"] | Entries
    broker: str | None
    prefix: str
    timeouts: Timeouts
    faults: Faults
    seed: int
    path: Path | None = field(default=None, compare=False)
    """The file from which it was loaded."""

    def __init__(self, *positional: Never, path: Path | None = None, **values: Any) -> None:  # noqa: ANN401 - fields
        """Store checked values of all fields; dictionaries and lists in them become read-only."""
        names = {item.name for item in fields(self)} - {"path"}
        if positional or values.keys() != names:
            raise InputError(
                "create experiments by Experiment.load(path), or by Experiment.from_mapping({..}) with "
                "the keys of an experiment file, such as {'simulation': 'minisim'}"
            )
        for name, value in {**values, "path": path}.items():
            object.__setattr__(self, name, read_only(value))

    def __hash__(self) -> int:
        """Return the same for equal experiments; the path does not count."""
        return hash(tuple(hashable(getattr(self, item.name)) for item in fields(self) if item.compare))

    @classmethod
    def load(cls, path: str | PathLike[str], settings: Iterable[str] = ()) -> Self:
        """Read an experiment file (YAML 1.2).

        Args:
            path: path of the file.
            settings: values that override the file, each as `KEY.PATH=VALUE` like the option `--set`: the
                value is YAML, items of lists are named by their number (`parameters.agents.0`), and null
                resets a key to its default. Another `kind` starts from that kind's defaults; a method of
                another kind keeps the file's target and its limits: generations (not for racing), evaluations
                and seconds. Setting a limit replaces all three limits of the file. Settings apply in order,
                but a `kind` before the options of its section. Relative paths of files in them refer to the
                working directory.

        Raises InputError with every problem of the file and of the settings, a line each: `file.yaml:12:
        method.populaton: unknown key; did you mean 'population'?`.
        """
        file = path_of("path", path, "an experiment file")
        require_list("settings", settings, "settings such as method.generations=50")
        problem = describe_other_file(file) if file.is_file() else None
        if problem is not None:
            raise InputError(problem)
        return cls._check_source(apply(read(file), parse_settings(settings)), file)

    def with_settings(
        self,
        settings: Iterable[str | Setting],
        *,
        only: Collection[str] | None = None,
        reason: str = "",
        ask: bool = True,
    ) -> Self:
        """Return a copy with settings, `KEY.PATH=VALUE` each, as in `load`; in Python, prefer `replace`.

        Args:
            settings: to apply; also those of `parameter_settings`.
            only: the keys that may be set; None for all. If given, limits that are not set stay, as for a run
                that continues.
            reason: why other keys may not be set, the end of a sentence.
            ask: whether the class of a simulation may be imported.

        Raises InputError with all problems, one per line.
        """
        parsed = parse_settings(settings)
        if only is not None:
            check_allowed(parsed, only, reason, self.to_mapping(), ask=ask)
        if not parsed:
            return self
        source = apply(Source("", values=self.to_mapping()), parsed, new_budget=only is None)
        if ask:
            check_fits(self, source)
        changed = self._check_source(source, None, ask=ask, lenient=self._keeps_unavailable(source.values))
        return dataclasses.replace(changed, path=self.path)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any], settings: Iterable[str] = ()) -> Self:
        """Create an experiment from plain values with the keys of the file; `simulation` can also be a class.

        settings: values that override these, as in `load`.

        Raises InputError with every problem.
        """
        require_list("settings", settings, "settings such as method.generations=50")
        return cls._build(values, settings)

    @classmethod
    def _build(
        cls, values: Mapping[str, Any], settings: Iterable[str] = (), *, lenient: Collection[str] = ()
    ) -> Self:
        """Create an experiment from plain values, see `from_mapping`; for `lenient`, see `check`."""
        simulation = mapping("values", values, "{'simulation': 'minisim'}").get("simulation")
        if isinstance(simulation, type):
            values = {**values, "simulation": name_of(simulation)}
        elif hasattr(simulation, "reset"):
            kind = type(simulation).__name__
            raise InputError(f"simulation: is an object of the class {kind}; pass the class {kind} itself")
        source = apply(Source("", values=plain_values(values)), parse_settings(settings))
        return cls._check_source(source, None, lenient=lenient)

    @classmethod
    def _check_source(
        cls,
        source: Source,
        path: Path | None,
        *,
        ask: bool = True,
        folder: Path | None = None,
        lenient: Collection[str] = (),
    ) -> Self:
        from swarmwright.experiment.validation import check  # noqa: PLC0415 - takes long, not for reading attributes

        loaded = cls(**check(source, ask=ask, folder=folder, lenient=lenient), path=path)
        if not (loaded.validate.transfers or isinstance(loaded.ranking, SlowOptions)):
            return loaded
        from swarmwright.experiment.targets import resolve_targets  # noqa: PLC0415 - it imports this module

        return dataclasses.replace(loaded, **resolve_targets(loaded, source, ask=ask))

    def to_mapping(self) -> dict[str, Any]:
        """Return plain values, including all defaults; keys without a value are omitted."""
        result: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name == "path" or value is None:
                continue
            if item.name == "simulation" and is_command(value):
                value = SimulationName.parse(value).definition
                if value.get("fitness", "") == self.fitness:  # comes from the experiment
                    del value["fitness"]
            if item.name == "servers" and isinstance(value, tuple):
                value = to_file_value(value)
            if item.name in ("constraints", "populations"):
                if value:
                    result[item.name] = {name: _dump_named(options) for name, options in value.items()}
                continue
            if item.name in _SECTIONS:
                value = value.model_dump(exclude_none=True)
                if item.name == "method" and self.method.generation_limit is None:
                    del value["generations"]  # no limit
                if "kind" in value:  # first, as it determines the others
                    value = {"kind": value.pop("kind"), **value}
            result[item.name] = plain_values(value)
        return result

    def _repr_html_(self) -> str:
        """Return all keys as a table, for notebooks."""
        name = f" of {self.path}" if self.path is not None else ""
        values = flatten(self.to_mapping())
        return facts(
            f"Experiment{name}: {self.label}", [(key, shorten(value)) for key, value in values.items()]
        )

    @check_arguments
    def save(self, path: str | PathLike[str]) -> None:
        """Write the experiment as a file that loads to an equal one, every default written out.

        Raises InputError when the file cannot be written.
        """
        write_text(path, dump(self.to_mapping()))

    def replace(self, **changes: Any) -> Self:  # noqa: ANN401 - keys of the experiment
        """Return a copy with changed keys, checked like a file.

        Mappings are merged: `replace(method={"generations": 5})` keeps the other options of the method,
        unless another `kind` is given, which starts from that kind's defaults. A limit that is given
        (generations, evaluations or seconds) takes the place of all three: `replace(method={"evaluations":
        2000})` has no limit of generations. None takes a key back to its default: `replace(broker=None,
        parameters={"agents": None})`. Numbers of sensors and actuators that a simulation announces follow
        its parameters, unless the file of the experiment gives them.

        Raises InputError with every problem, a line each.
        """
        values = self.to_mapping()
        changes = {name: plain_values(change) for name, change in changes.items()}
        same_simulation = changes.get("simulation", self.simulation) == self.simulation
        if not same_simulation:
            for name in ANNOUNCED:
                values.pop(name, None)
        for name, change in changes.items():
            old = values.get(name)
            if isinstance(old, dict) and isinstance(change, Mapping):
                if name == "method" and sets_limit(change):
                    old = {key: value for key, value in old.items() if key not in LIMITS}
                starts_anew = "kind" in change and change["kind"] != old.get("kind")
                merged = dict(change) if starts_anew else {**old, **change}
                dropped = {key for key, value in change.items() if value is None}
                values[name] = {key: value for key, value in merged.items() if key not in dropped}
            elif change is None:
                values.pop(name, None)
            else:
                values[name] = change.model_dump() if hasattr(change, "model_dump") else change
        parameters = values.get("parameters")
        if same_simulation and isinstance(parameters, Mapping) and parameters != self.parameters:
            announced = find_announced_sizes(self.simulation, dict(parameters)) or {}
            for name, size in announced.items():
                # Read the file only if necessary.
                if name not in changes and values.get(name) != size and find_source(self, name) is None:
                    values.pop(name, None)
        changed = self._build(values, lenient=self._keeps_unavailable(values))
        return dataclasses.replace(changed, path=self.path)

    @staticmethod
    def json_schema() -> dict[str, Any]:
        """Return the JSON Schema (2020-12) of experiment files, for editors.

        It knows the installed plug-ins.
        """
        from swarmwright.experiment.schema import experiment_schema  # noqa: PLC0415 - takes long, not for reading attributes

        return experiment_schema()

    @property
    def genome_size(self) -> int:
        """Number of genes.

        Raises InputError when sensors and actuators are not known before a server is asked.
        """
        return self.representation().genome_size

    def _keeps_unavailable(self, values: Mapping[str, Any]) -> set[str]:
        """Return the unavailable sections of a run's experiment that changed values keep.

        That is a method that is not installed, or a method or ranking in a file that was not imported.
        """
        names = set()
        for name, options in (("method", self.method), ("ranking", self.ranking)):
            section = values.get(name)
            unknown = isinstance(options, UnavailableOptions | UnreadRankingOptions)
            if unknown and isinstance(section, Mapping) and section.get("kind") == options.kind:
                names.add(name)
        return names

    @property
    def label(self) -> str:
        """Name of the simulation in figures and folders: its title or class."""
        return SimulationName.parse(self.simulation).label

    @property
    def subject(self) -> str:
        """Name of the simulation in titles of figures: its label and the title of its mission, if any."""
        return subject_of(self.simulation, self.label, self.parameters)

    @property
    def generations(self) -> int:
        """Maximum number of generations of the run."""
        return int(self.method.generations)

    @property
    def budget(self) -> Budget:
        """Limits of the run: generations, evaluations and seconds."""
        return Budget.from_options(self.method)

    @check_arguments
    def representation(self, sensors: int | None = None, actuators: int | None = None) -> Representation:
        """Return the representation of genomes.

        Args:
            sensors: sensor values of an agent, at least 1; default: the experiment's.
            actuators: actuator values of an agent, at least 1; default: the experiment's.

        Raises:
            InputError: they are not known, or a genome would have more than 1,000,000 genes.
        """
        sensors = self.sensors if sensors is None else sensors
        actuators = self.actuators if actuators is None else actuators
        if not steers_agents(self):
            sensors, actuators = sensors or 0, actuators or 0
        if sensors is None or actuators is None:
            missing = "sensors" if sensors is None else "actuators"
            raise InputError(
                f"{missing}: unknown, as {self.simulation!r} is not built in; set 'sensors' and "
                "'actuators' in the experiment, or use a server that announces them"
            )
        component = REPRESENTATIONS.get(self.controller.kind)
        representation = component(self.controller, sensors=sensors, actuators=actuators)
        if representation.genome_size > LARGEST_GENOME:
            raise InputError(
                f"controller: {representation.genome_size} genes exceed the limit of {LARGEST_GENOME}; "
                "use fewer hidden nodes"
            )
        return representation

    def new_method(self, representation: Representation | None = None) -> Method:
        """Return the method in its initial state, with which to call `ask` and `tell`.

        representation: representation of the genomes; default: the experiment's, as `representation()` makes
        it.

        Raises InputError when the method cannot evolve the representation or start from the given
        controllers, or when the experiment is that of a run whose method is not installed here.
        """
        require_method(self.method, None if self.path is None else self.path.parent)
        if representation is None:
            representation = self.representation()
        if isinstance(self.ranking, TournamentOptions):
            from swarmwright.experiment.competition import new_competition  # noqa: PLC0415 - it imports this module

            return new_competition(self, representation)
        options = options_with_code("method", self.method)
        method = method_of(options)(options, representation, seed=self.seed)
        start = find_start_genomes(self, representation)
        if start is not None:
            try:
                method.start_from(start)
            except InputError as error:
                raise InputError(f"start_from: {error}") from error
        return method

    def new_ranking(self) -> Ranking:
        """Return the ranking.

        Raises InputError when it is a plug-in that cannot be imported any more, or is not trusted.
        """
        options = options_with_code("ranking", self.ranking)
        return ranking_of(options)(options)

    @property
    def first_seed(self) -> int:
        """Simulation seed of episode 0.

        `parameters.seed`, default 0. Raises InputError when it is not an integer from 0 to 2**62.
        """
        seed = self.parameters.get("seed", 0)
        # The seeds of other episodes follow, below 2**63.
        if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed <= 2**62:
            raise InputError(f"parameters.seed: must be an integer from 0 to 2**62, not {seed!r}")
        return seed


def as_experiment(source: Experiment | Mapping[str, Any] | str | PathLike[str]) -> Experiment:
    """Return an experiment from an object, a file or a mapping. Raises InputError as `Experiment.load`."""
    if isinstance(source, str | PathLike):
        return Experiment.load(source)
    if isinstance(source, Mapping):
        return Experiment.from_mapping(source)
    instance("experiment", source, Experiment, "Experiment.load(file) or Experiment.from_mapping({..})")
    return source


def build_recorded_experiment(values: Mapping[str, Any], folder: Path | None = None) -> Experiment:
    """Build the experiment of a run from plain values, without importing code.

    folder: folder of the run, the base of relative paths.
    """
    return Experiment._check_source(Source("", values=dict(values)), None, ask=False, folder=folder)


def load_stored_experiment(store: "StoreReader", values: Mapping[str, Any] | None = None) -> Experiment:
    """Load the experiment from a run's store. Raises InputError if it cannot be used here.

    values: values of the experiment, if already read from the store.
    """
    folder = store.file.parent
    try:
        experiment = build_recorded_experiment(store.experiment() if values is None else values, folder)
    except InputError as error:
        used = store.experiment() if values is None else values
        copied = "".join(
            f"; the run used the module {module}, of which {path} is a copy: install its package"
            for module, path in find_copies(folder, find_not_installed(used))
        )
        raise InputError(
            f"{folder}: the experiment in {store.file.name} cannot be used: {error}{copied}"
        ) from error
    return dataclasses.replace(experiment, path=folder / "experiment.yaml")


def check_again(experiment: Experiment) -> Experiment:
    """Check an experiment again, as its code may have been edited, and return it.

    Raises InputError with all problems.
    """
    loaded = Experiment._check_source(Source("", values=experiment.to_mapping()), None)
    return dataclasses.replace(loaded, path=experiment.path)


def with_source(
    experiment: Experiment,
    source: Source,
    *,
    only: Collection[str],
    reason: str,
    rule: str,
    ask: bool = True,
) -> Experiment:
    """Return a copy of an experiment with the keys of a file, or of a part of it.

    Parameters are merged with those of the experiment, unless the file has another simulation.

    Args:
        experiment: to copy.
        source: source of the file, for the lines in messages.
        only: the allowed keys.
        reason: why another key is not allowed, the end of a sentence.
        rule: which keys are allowed, a sentence that is reported once.
        ask: whether the class of a simulation may be imported.

    Raises InputError with all problems, one per line.
    """
    if not isinstance(source.values, Mapping):
        raise InputError(
            f"{source.locate(())}expected a mapping with keys of an experiment such as 'simulation'"
        )
    refused = [key for key in source.values if key not in only]
    if refused:
        lines = [f"{source.locate((key,))}{reason}" for key in refused]
        raise InputError("\n".join(lines) + (f"; {rule}" if len(lines) == 1 else f"\n{rule}"))
    values = experiment.to_mapping()
    if source.values.get("simulation", experiment.simulation) != experiment.simulation:
        for name in (*ANNOUNCED, "parameters"):
            values.pop(name, None)
    for key, value in source.values.items():
        both = key == "parameters" and isinstance(value, Mapping)
        values[key] = {**values.get(key, {}), **value} if both else value
    merged = dataclasses.replace(source, values=values)
    return Experiment._check_source(merged, None, ask=ask, lenient=experiment._keeps_unavailable(values))


def _dump_named(options: Limits | MethodOptions) -> dict[str, Any]:
    """Return the limits of a metric, or the section of a population."""
    if isinstance(options, Limits):
        return options.model_dump(exclude_none=True)
    return {"method": _dump(options)}


def _dump(options: MethodOptions) -> dict[str, Any]:
    """Return the options of a population's method without limits, `kind` first."""
    values = options.model_dump(exclude_none=True, exclude={"generations"})
    result: dict[str, Any] = plain_values({"kind": values.pop("kind"), **values})
    return result


def shorten(value: object) -> str:
    """Shorten a value to a line of text."""
    text = str(value)
    return text if len(text) <= 100 else f"{text[:99]}…"
