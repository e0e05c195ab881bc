"""Targets of a transfer: other simulations, or models sampled around the run's simulation."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.random_numbers import Stream
from swarmwright.common.simulation_names import is_python
from swarmwright.common.suggestions import unknown
from swarmwright.common.yaml import Path_, Source, format_path, read
from swarmwright.experiment.derived import steers_agents
from swarmwright.experiment.document import STORE, Validate
from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD, Experiment, with_source
from swarmwright.experiment.ranges import E_PUCKS, Range, ranges_of, require_e_pucks
from swarmwright.methods.rankings.absolute import AbsoluteOptions
from swarmwright.methods.rankings.slow_simulation import SlowOptions
from swarmwright.methods.rankings.transferability import TransferabilityOptions
from swarmwright.simulations import catalogue
from swarmwright.simulations.names import make_absolute
from swarmwright.simulations.user_code.permission import require_named

CHANGED = KEYS_OUTSIDE_RECORD - {"validate"} | {"simulation", "parameters", "sensors", "actuators", "fitness"}
"""Keys that the file of a target may have."""
_CONDITIONS = ("simulation", "parameters", "fitness", "broker", "prefix")
"""Keys that determine an episode or its simulator."""
_FILES = (".yaml", ".yml")
_REASON = "does not belong to a target"
_RULE = (
    "a target may have only keys for the evaluation of candidates, such as simulation, parameters, "
    "fitness and servers; remove others"
)

Entry = str | Mapping[str, Any]
"""A target in an experiment: the name of a simulation, or a `name` and the differing keys."""


@dataclass(frozen=True)
class OtherSimulation:
    """Another simulation, or differing keys of the experiment.

    name: name of a simulation as in experiments, or of a .yaml file with keys of an experiment.
    """

    name: str
    changes: Mapping[str, Any] | None = field(default=None, hash=False)
    """The differing keys, if they are not in a file."""

    @classmethod
    def from_entry(cls, entry: Entry) -> "OtherSimulation":
        """Build the target from an experiment's entry."""
        if isinstance(entry, str):
            return cls(entry)
        changes = {key: value for key, value in entry.items() if key != "name"}
        return cls(str(entry.get("name") or changes.get("simulation") or "other parameters"), changes)

    @property
    def sets_servers(self) -> bool:
        """Whether the simulation sets its own servers or broker."""
        values = self._source().values if self._has_keys else None
        return isinstance(values, Mapping) and not {"servers", "broker"}.isdisjoint(values)

    def make_experiments(self, experiment: Experiment, count: int) -> list[Experiment]:  # noqa: ARG002 - as targets have it
        """Return the changed experiment of all episodes. Raises InputError if the change is invalid."""
        experiment = drop_targets(experiment)
        if self._has_keys:
            changed = with_source(experiment, self._source(), only=CHANGED, reason=_REASON, rule=_RULE)
            return [_with_sizes(changed, experiment)]
        try:
            changed = experiment.replace(simulation=self.name)
        except InputError as error:
            raise InputError(
                f"{self.name}: {error}\nTo change parameters as well, give a .yaml file with the keys "
                "'simulation' and 'parameters' instead of the simulation"
            ) from error
        return [_with_sizes(changed, experiment)]

    def find_code(self, experiment: Experiment) -> str | None:
        """Return the class or command of a different simulation, without importing it."""
        simulation = self._source().values.get("simulation") if self._has_keys else self.name
        if isinstance(simulation, Mapping):  # a command
            simulation = self.make_experiments(experiment, 1)[0].simulation
        return simulation if isinstance(simulation, str) and is_python(simulation) else None

    @property
    def _has_keys(self) -> bool:
        return self.changes is not None or self.name.endswith(_FILES)

    def _source(self) -> Source:
        return read(Path(self.name)) if self.changes is None else Source("", values=dict(self.changes))


@dataclass(frozen=True)
class PseudoReality:
    """Models of the run's simulation, sampled around its parameters, one per episode.

    After Ligot and Birattari, "Simulation-only experiments to mimic the effects of the reality gap in the
    automatic design of robot swarms", Swarm Intelligence 14, 2020, doi:10.1007/s11721-019-00175-w: the loss
    of fitness between models shows which designs are robust, without robots.
    """

    ranges: tuple[Range, ...]
    name: str = "pseudo-reality"
    sets_servers = False

    def make_experiments(self, experiment: Experiment, count: int) -> list[Experiment]:
        """Return an experiment with sampled parameters for each episode, the same for all runs."""
        experiment = drop_targets(experiment)
        return [self._sample(experiment, model) for model in range(count)]

    def _sample(self, experiment: Experiment, model: int) -> Experiment:
        stream = Stream(0, "pseudo-reality", 0, model)
        shares = stream.unit(len(self.ranges)).tolist()
        settings = [
            f"{format_path(interval.path)}={interval.interpolate(share)!r}"
            for interval, share in zip(self.ranges, shares, strict=True)
        ]
        try:
            return experiment.with_settings(settings)
        except InputError as error:
            words = str(error)
            for interval, setting in zip(self.ranges, settings, strict=True):
                words = words.replace(f"--set {setting}", str(interval))
            raise InputError(words.replace("--set ", f"{self.name}, model {model}: ")) from error


Target = OtherSimulation | PseudoReality


def targets_of(to: Iterable[Entry], ranges: Sequence[Range]) -> list[Target]:
    """Build the targets of a transfer. Raises InputError without any, or for duplicates."""
    targets: list[Target] = [OtherSimulation.from_entry(entry) for entry in to]
    names = [target.name for target in targets]
    doubled = next((name for name in names if names.count(name) > 1), None)
    if doubled is not None:
        raise InputError(f"to: {doubled} is given twice")
    if ranges:
        targets.append(PseudoReality(tuple(ranges)))
    if not targets:
        raise InputError("nothing to transfer to; give simulations or parameters to vary")
    return targets


def targets_at_end(experiment: Experiment) -> list[Target]:
    """Return the targets for the best candidates at the end of a run. Raises InputError."""
    options = experiment.validate
    return targets_of(options.to, _ranges(experiment)) if options.transfers else []


def slow_of(experiment: Experiment) -> OtherSimulation | None:
    """Return the slow simulation of an experiment's ranking; None for other rankings."""
    ranking = experiment.ranking
    return OtherSimulation.from_entry(ranking.slow) if isinstance(ranking, SlowOptions) else None


def _ranges(experiment: Experiment) -> list[Range]:
    options = experiment.validate
    if options.pseudo_reality:
        require_e_pucks(experiment)
    # Messages already begin with the key.
    vary = ranges_of(options.vary, prefix="")
    return [*(E_PUCKS if options.pseudo_reality else ()), *vary]


def explain_mismatch(name: str, target: Experiment, experiment: Experiment) -> str | None:
    """Return why controllers of `here` do not match `there`; None if they match or it is unknown."""
    sizes = [(experiment.sensors, experiment.actuators) for experiment in (experiment, target)]
    if not steers_agents(experiment) or None in (*sizes[0], *sizes[1]) or sizes[0] == sizes[1]:
        return None
    sizes_text, target_sizes_text = (
        f"{sensors} sensors and {actuators} actuators" for sensors, actuators in sizes
    )
    return (
        f"{name}: the run's controllers have {sizes_text}, but agents of {target.label} have "
        f"{target_sizes_text}"
    )


def is_same(first_experiment: Experiment, second_experiment: Experiment) -> bool:
    """Whether two experiments have the same simulation, parameters, fitness and broker."""
    first, second = first_experiment.to_mapping(), second_experiment.to_mapping()
    return all(first.get(key) == second.get(key) for key in _CONDITIONS)


def drop_targets(experiment: Experiment) -> Experiment:
    """Return an experiment without its other simulations."""
    ranking = experiment.ranking
    if isinstance(ranking, SlowOptions):
        ranking = AbsoluteOptions(episodes=ranking.episodes, seeds=ranking.seeds, failed=ranking.failed)
    return dataclasses.replace(experiment, validate=Validate(), ranking=ranking)


def _with_sizes(changed: Experiment, experiment: Experiment) -> Experiment:
    """Add the controllers' sizes, for comparison with servers, if those of the target are unknown."""
    if changed.sensors is not None or catalogue.has_description(changed.simulation):
        return changed
    return dataclasses.replace(changed, sensors=experiment.sensors, actuators=experiment.actuators)


def resolve_targets(experiment: Experiment, source: Source, *, ask: bool) -> dict[str, Any]:
    """Return the sections with other simulations, with files replaced by their contents.

    Args:
        experiment: checked except for its targets.
        source: source of the experiment.
        ask: whether classes of simulations may be imported, to compare their sensors.

    Raises InputError with all problems, one per line.
    """
    changed: dict[str, Any] = {}
    entries, problems = [], []
    if isinstance(experiment.ranking, SlowOptions):
        try:
            entry = _resolve_target(experiment, experiment.ranking.slow, source, ("ranking", "slow"), ask=ask)
            changed["ranking"] = experiment.ranking.model_copy(update={"slow": entry})
            if ask and isinstance(experiment.ranking, TransferabilityOptions):
                changed["ranking"] = _fill_in_descriptor(experiment, changed["ranking"], source)
        except InputError as error:
            problems.append(str(error))
    for index, entry in enumerate(experiment.validate.to):
        try:
            entries.append(_resolve_target(experiment, entry, source, ("validate", "to", index), ask=ask))
        except InputError as error:
            problems.append(str(error))
    changed["validate"] = experiment.validate.model_copy(update={"to": entries})
    if ask and not problems:
        problems += _range_problems(experiment, source)
        names = [OtherSimulation.from_entry(entry).name for entry in entries]
        doubled = [name for index, name in enumerate(names) if name in names[:index]]
        problems += [f"{source.locate(('validate', 'to'))}{name} is given twice" for name in doubled[:1]]
    if problems:
        raise InputError("\n".join(problems))
    return changed


def _fill_in_descriptor(
    experiment: Experiment, options: TransferabilityOptions, source: Source
) -> TransferabilityOptions:
    """Fill in the metrics that describe behaviour. Raises InputError with the position."""
    if not catalogue.has_description(experiment.simulation):
        return options
    metrics = list(catalogue.description(experiment.simulation, experiment.parameters)["metrics"])
    for index, name in enumerate(options.descriptor):
        if name not in metrics:
            position = source.locate(("ranking", "descriptor", index))
            raise InputError(f"{position}{unknown('metric', name, metrics)}")
    return options.model_copy(update={"descriptor": options.descriptor or metrics})


def _range_problems(experiment: Experiment, source: Source) -> list[str]:
    """Return the problems of sampling models, with the position."""
    key = "pseudo_reality" if experiment.validate.pseudo_reality else "vary"
    try:
        ranges = _ranges(experiment)
        key = "vary" if experiment.validate.vary else key
        if ranges:
            PseudoReality(tuple(ranges)).make_experiments(drop_targets(experiment), 1)
    except InputError as error:
        return [f"{source.locate(('validate', key))}{error}"]
    return []


def _resolve_target(experiment: Experiment, entry: Entry, source: Source, path: Path_, *, ask: bool) -> Entry:
    """Return a complete target. Raises InputError with the position."""
    folder = Path(source.name).parent if source.name and not source.is_option(path) else Path()
    if ask and (folder / STORE).exists():
        _require_trusted(entry, folder)
    if isinstance(entry, Mapping):
        if not ask:
            return entry  # as stored in a run
        keys = {key: value for key, value in entry.items() if key != "name"}
        name, position = OtherSimulation.from_entry(entry).name, source.locate(path)
        return _build_target(experiment, name, _part(source, path, keys), position)
    if entry.endswith(_FILES):
        try:
            file = read(folder / entry)
        except InputError as error:
            raise InputError(f"{source.locate(path)}{error}") from error
        return _build_target(experiment, entry, file, source.locate(path), ask=ask)
    if entry.endswith((".fmu", ".ssp")):
        keys = {"simulation": entry, "parameters": dict(experiment.parameters)}
        file = Source("", keys) if source.is_option(path) else _part(source, path, keys)
        return _build_target(experiment, entry, file, source.locate(path), ask=ask)
    if is_python(entry):
        entry = make_absolute(entry, folder)
    if ask:
        target = OtherSimulation(entry)
        try:
            (target_experiment,) = target.make_experiments(experiment, 1)
        except InputError as error:
            raise InputError(f"{source.locate(path)}{error}") from error
        _require_fit(entry, target_experiment, experiment, source.locate(path))
    return entry


def _require_trusted(entry: Entry, run: Path) -> None:
    """Raise InputError for an untrusted class that a run folder names as a target."""
    simulation = entry if isinstance(entry, str) else entry.get("simulation")
    if isinstance(simulation, str) and is_python(simulation):
        require_named(make_absolute(simulation, run))


def _part(source: Source, path: Path_, values: Mapping[str, Any]) -> Source:
    """Return the values at a path as a separate source with the lines of the file."""
    if (
        path not in source.lines and path[:-1] in source.lines and path[-1] == 0
    ):  # a single target needs no list
        path = path[:-1]
    lines = {
        line_path[len(path) :]: line
        for line_path, line in source.lines.items()
        if line_path[: len(path)] == path
    }
    return Source(source.name, dict(values), lines, above=path)


def _build_target(
    experiment: Experiment, name: str, file: Source, position: str, *, ask: bool = True
) -> dict[str, Any]:
    """Return a target with its changed keys after checks."""
    changed = with_source(drop_targets(experiment), file, only=CHANGED, reason=_REASON, rule=_RULE, ask=ask)
    _require_fit(name, _with_sizes(changed, experiment), experiment, position)
    values = changed.to_mapping()
    keys = {key: values[key] for key in file.values if key in values}
    if isinstance(file.values.get("parameters"), Mapping):
        keys["parameters"] = {key: values["parameters"][key] for key in file.values["parameters"]}
    return {"name": name, **keys}


def _require_fit(name: str, target: Experiment, experiment: Experiment, position: str) -> None:
    problem = explain_mismatch(name, target, experiment)
    if problem is not None:
        raise InputError(f"{position}{problem}")
