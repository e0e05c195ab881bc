"""Where candidates are transferred to: another simulation, or models sampled around the run's own."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarmwright.core.errors import InputError
from swarmwright.core.random_numbers import Stream
from swarmwright.core.yaml import dotted_path, read
from swarmwright.experiment.experiment import ELSEWHERE, Experiment
from swarmwright.experiment.ranges import Range, robot_of
from swarmwright.simulations import catalogue

CHANGED = ELSEWHERE - {"validate"} | {"simulation", "parameters", "sensors", "actuators", "fitness"}
"""Keys of an experiment that a file of a target may have."""
_FILES = (".yaml", ".yml")


@dataclass(frozen=True)
class OtherSimulation:
    """A simulation with another name, or what a file changes in the experiment.

    name: of a simulation, as in experiments, or of a file (.yaml) with keys of an experiment.
    """

    name: str

    @property
    def places(self) -> bool:
        """Whether it says itself, in a file, where its episodes are evaluated."""
        values = read(Path(self.name)).values if self.name.endswith(_FILES) else None
        return isinstance(values, Mapping) and not {"servers", "broker"}.isdisjoint(values)

    def experiments(self, experiment: Experiment, count: int) -> list[Experiment]:  # noqa: ARG002 - as targets have it
        """Return the experiment of all episodes. Raises InputError where it cannot be changed like this."""
        changed = self._changed(experiment)
        if changed.sensors is None and not catalogue.is_described(changed.simulation):
            # The controller has these; the server's are compared with them.
            changed = changed.replace(sensors=experiment.sensors, actuators=experiment.actuators)
        return [changed]

    def _changed(self, experiment: Experiment) -> Experiment:
        if self.name.endswith(_FILES):
            return experiment.with_file(
                Path(self.name), only=CHANGED, reason="a target says where candidates are evaluated, not this"
            )
        try:
            return experiment.replace(simulation=self.name)
        except InputError as error:
            raise InputError(
                f"{self.name}: {error}\nTo change parameters as well, name a file (.yaml) with the keys "
                "'simulation' and 'parameters' instead of the simulation"
            ) from error


@dataclass(frozen=True)
class PseudoReality:
    """Models of the run's own simulation, sampled around its parameters, one for each episode.

    After Ligot and Birattari, "Simulation-only experiments to mimic the effects of the reality gap in the
    automatic design of robot swarms", Swarm Intelligence 14, 2020, doi:10.1007/s11721-019-00175-w: what is
    lost from one model to others tells designs that are robust from those that are not, without robots.
    """

    ranges: tuple[Range, ...]
    name: str = "pseudo-reality"
    places = False

    def experiments(self, experiment: Experiment, count: int) -> list[Experiment]:
        """Return an experiment with sampled parameters for each episode; the same for all runs."""
        return [self._sampled(experiment, model) for model in range(count)]

    def _sampled(self, experiment: Experiment, model: int) -> Experiment:
        stream = Stream(0, "pseudo-reality", 0, model)
        shares = stream.unit(len(self.ranges)).tolist()
        settings = [
            f"{dotted_path(one.path)}={one.at(share)!r}"
            for one, share in zip(self.ranges, shares, strict=True)
        ]
        try:
            return self._with_preset(experiment).with_settings(settings)
        except InputError as error:
            raise InputError(str(error).replace("--set ", f"{self.name}, model {model}: ")) from error

    def _with_preset(self, experiment: Experiment) -> Experiment:
        """Return the experiment with a robot whose parts vary as a mapping of its preset.

        A name has no parts that could be set.
        """
        robot = robot_of(experiment)
        varies = any(one.path[1] == "robot" and len(one.path) > 2 for one in self.ranges)
        if not (varies and experiment.simulation == "arena" and isinstance(robot, str)):
            return experiment
        return experiment.replace(parameters={"robot": {"preset": robot}})


Target = OtherSimulation | PseudoReality


def unfit(name: str, there: Experiment, here: Experiment) -> str | None:
    """Return why controllers of `here` do not fit, None where they do or that is not known."""
    sizes = [(one.sensors, one.actuators) for one in (here, there)]
    if not here.steers or None in (*sizes[0], *sizes[1]) or sizes[0] == sizes[1]:
        return None
    own, others = (f"{sensors} sensors and {actuators} actuators" for sensors, actuators in sizes)
    return f"{name}: the run's controllers have {own}, agents of {there.label} have {others}"


def targets_of(to: Iterable[str], ranges: Sequence[Range]) -> list[Target]:
    """Return what candidates are transferred to. Raises InputError for nothing, or the same one twice."""
    names = list(to)
    doubled = next((name for name in names if names.count(name) > 1), None)
    if doubled is not None:
        raise InputError(f"to: {doubled} is named twice")
    found: list[Target] = [OtherSimulation(name) for name in names]
    if ranges:
        found.append(PseudoReality(tuple(ranges)))
    if not found:
        raise InputError("nothing to transfer to: name simulations, or parameters that vary")
    return found
