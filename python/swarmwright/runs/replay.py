"""Replays of episodes of a run."""

import dataclasses
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from swarmwright.common.arguments import simulation_seed
from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import label_of
from swarmwright.common.untrusted import escape_line
from swarmwright.common.values import flatten
from swarmwright.controllers.controller import Controller
from swarmwright.controllers.kinds import describe_controller
from swarmwright.display import Caption
from swarmwright.experiment.settings import Setting, parse_settings, refuse_seed
from swarmwright.runs.choice import Choice, choose
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.matches import FIRST_SEED, join_champions, sides_of
from swarmwright.servers.evaluation.module_code import is_in_python
from swarmwright.servers.evaluation.shown import ShownEpisode, check_showable
from swarmwright.simulations import catalogue

if TYPE_CHECKING:
    from swarmwright.display import Recording
    from swarmwright.display.pictures import PictureRecording
    from swarmwright.runs.run import Run


_MAX_CHANGES = 6
"""Largest number of changed parameters in a caption."""
_VALUE_CHARACTERS = 40
"""Largest number of characters of their values."""


@dataclass(frozen=True, kw_only=True)
class Replay(ShownEpisode):
    """An episode of a controller in the simulation of a run, possibly with changed parameters."""

    run: "Run"
    choice: Choice | None = None
    """The candidate of the run, None if the controller is not from the run."""
    number: int | None = None
    """Index of the episode; None if the run did not have it."""
    controller_run: "Run | None" = None
    """The run that the controller is a candidate of, if it is another run."""
    match: tuple[int, ...] = ()
    """Generation of the champion of each side, if they are of a competition, in place of a candidate."""
    settings: tuple[str | Setting, ...] = ()
    """Changed parameters and fitness, each `KEY.PATH=VALUE`, or parsed."""

    @classmethod
    def of(
        cls,
        run: "Run",
        *,
        generation: int | None = None,
        candidate: int | None = None,
        controller: Path | None = None,
        match: Sequence[int] = (),
        episode: int | None = None,
        seed: int | None = None,
        simulation: str | type | None = None,
        settings: Iterable[str | Setting] = (),
        broker: str | None = None,
        prefix: str | None = None,
    ) -> Self:
        """Choose the controller and the episode.

        Args:
            run: has the simulation and its parameters.
            generation: as in `Run.evaluation`.
            candidate: as in `Run.evaluation`.
            controller: file or run folder with another controller, in place of a candidate of the run.
            match: generation of the champion of each side of a competition, in place of a candidate.
            episode: index of an episode of the run, by default 0; of a match, as `measure_progress` counts.
            seed: simulation seed, for an episode that is not in the run.
            simulation: a class, or `FILE:Class`, in place of the code that evaluated the candidate.
            settings: changes of parameters and fitness, see `Experiment.load`.
            broker: compute the episode on a server on this broker that sends scenes. By default in this
                process, or if the simulation is not installed, on the run's broker.
            prefix: topic prefix on the broker, in place of the run's.

        Raises:
            InputError: the simulation is not installed and no broker is known, or the candidate, controller
                or episode does not exist.
        """
        settings = list(settings)
        refuse_seed(settings)
        broker = broker or _find_broker(run, simulation)
        joined = join_champions(run, match) if match else None
        chosen = None if controller is not None or match else choose(run, generation, candidate)
        version = max(match) if match else None if chosen is None else chosen.generation
        used = resolve_experiment(run, version, simulation)
        experiment = used.with_settings(
            settings, only=("parameters", "fitness"), reason="only parameters and fitness can be set here"
        )
        if prefix is not None:
            experiment = experiment.replace(prefix=prefix)
        seeds = run.seeds(0) if chosen is None else chosen.seeds
        if match and seed is None:
            seed = _seed_of_match(episode or 0)
        number = None if seed is not None else episode or 0
        if seed is not None:
            simulation_seed("seed", seed)
        if number is not None and not 0 <= number < len(seeds):
            available = "only episode 0" if len(seeds) == 1 else f"episodes 0 to {len(seeds) - 1}"
            raise InputError(
                f"episode {number}: the run has {available}; for another episode specify its seed with "
                "--seed S (in Python: seed=S)"
            )
        if joined is not None:
            replayed = Controller(used.representation().specification(joined))
        elif chosen is not None:
            replayed = Controller(chosen.specification)
        else:
            replayed = Controller.load(controller)  # type: ignore[arg-type] # there is one without the others
        check_showable(broker, replayed)
        return cls(
            run=run,
            controller=replayed,
            choice=chosen,
            source=controller,
            match=tuple(match),
            number=number,
            seed=seeds[number] if number is not None else seed or 0,
            experiment=experiment,
            broker=broker,
            settings=tuple(settings),
        )

    def with_best_of(self, other: "Run") -> Self:
        """Return the same episode with the best candidate of another run.

        Raises InputError when its controllers do not fit the simulation of this one.
        """
        chosen = choose(other)
        controller = Controller(chosen.specification)
        self._check_fits(controller, other)
        return dataclasses.replace(
            self, controller=controller, choice=chosen, source=None, controller_run=other
        )

    def _check_fits(self, controller: Controller, other: "Run") -> None:
        advice = f"; show it alone: swarmwright replay {other.path}"
        if self.broker is not None and is_in_python(controller.specification):
            raise InputError(
                f"{other.path}: behaviours and conditions in Python can only be shown in this process; omit "
                f"the broker{advice}"
            )
        if controller.parameters:  # they steer no agents
            if controller.parameters.keys() != self.controller.parameters.keys():
                raise InputError(
                    f"{other.path}: its controllers have other parameters of {other.experiment.label} than "
                    f"those of {self.run.path}{advice}"
                )
            return
        if self.broker is not None:
            return  # only the servers know the sensors and actuators
        try:
            dataclasses.replace(self, controller=controller).engine_episode()
        except InputError as error:
            raise InputError(
                f"{other.path}: does not fit {self.experiment.label} of {self.run.path}: {error}{advice}"
            ) from error

    @property
    def name(self) -> str:
        """Name on the command line: GENERATION:CANDIDATE, those of a match, or the controller's file."""
        if self.match:
            return ",".join(map(str, self.match))
        if self.choice is None:
            return str(self.source)
        return f"{self.choice.generation}:{self.choice.candidate}"

    @property
    def title(self) -> str:
        """Title with the simulation, the controller and the episode."""
        return f"{self.run.experiment.label}: {self.controller_text}{self._episode_label}"

    @property
    def controller_sentence(self) -> str:
        """Sentence that describes the candidate or controller."""
        number = "" if self.choice is None else f", evaluation {self.choice.number}"
        return f"{self.controller_text[:1].upper()}{self.controller_text[1:]}{number}."

    @property
    def controller_text(self) -> str:
        """Description of the candidate, match or controller."""
        if self.match:
            sides = map(escape_line, sides_of(self.run.experiment))
            return " against ".join(
                f"{side} of generation {generation}"
                for side, generation in zip(sides, self.match, strict=True)
            )
        if self.choice is None:
            return f"controller of {self.source}"
        return f"candidate {self.choice.candidate} of generation {self.choice.generation}"

    @property
    def _episode_label(self) -> str:
        if self.number is None:
            return f", simulation seed {self.seed}"
        return f", episode {self.number} ({self._episodes} in all)" if self._episodes > 1 else ""

    @property
    def _episodes(self) -> int:
        return self.run.experiment.ranking.episodes if self.choice is None else len(self.choice.seeds)

    def outcome(self, fitness: float) -> str:
        """Describe the episode's fitness, and the candidate's if that is something else."""
        side = f" of {escape_line(sides_of(self.run.experiment)[0])}" if self.match else ""
        text = f"Fitness{side} {fitness + 0.0:.6g}"  # no -0
        if self.choice is None:
            return f"{text}."
        if self.number is not None and self._as_recorded:
            recorded = self.choice.episodes[self.number]
            if fitness != recorded and not math.isnan(recorded):
                return (
                    f"{text}, but {recorded + 0.0:.6g} in the run: this simulation is not bit-identical here."
                )
            if not self.choice.aggregation:
                return f"{text}."
        episode = f"in episode {self.number}" if self.number is not None else f"with seed {self.seed}"
        meaning = f" ({self.choice.aggregation})" if self.choice.aggregation else ""
        whole = f"{self.choice.fitness + 0.0:.6g}{meaning}"
        return f"{text} {episode}; recorded fitness of the candidate: {whole}."

    @property
    def _as_recorded(self) -> bool:
        """Whether parameters and fitness are those of the run."""
        present, recorded = self.experiment, self.run.experiment
        return (present.parameters, present.fitness) == (recorded.parameters, recorded.fitness)

    def _list_differences(self) -> Iterator[tuple[str, str]]:
        """Yield differences from the recorded run."""
        present, recorded = self.experiment, self.run.experiment
        changes = list(_list_changes(present.parameters, recorded.parameters, parse_settings(self.settings)))
        if changes:
            more = [f"and {len(changes) - _MAX_CHANGES} more"] if len(changes) > _MAX_CHANGES else []
            yield ("changed parameters", ", ".join([*changes[:_MAX_CHANGES], *more]))
        if present.fitness != recorded.fitness:
            default = "the simulation's"
            yield (
                "changed fitness",
                f"{present.fitness or default} (in the run {recorded.fitness or default})",
            )

    def identity(self) -> dict[str, Any]:
        """Return the controller and the episode as plain values, for `--json`."""
        choice = self.choice
        return {
            "episode": self.number,
            "seed": self.seed,
            "generation": choice.generation if choice else None,
            "candidate": choice.candidate if choice else None,
            "candidate_fitness": choice.fitness if choice else None,
            "controller": str(self.source) if self.source else None,
            **({"match": list(self.match)} if self.match else {}),
        }

    def caption(self, recording: "Recording | PictureRecording | None" = None) -> Caption:
        """Return the title and the facts of the experiment for a picture.

        recording: recording of the episode, with its simulation and fitness.
        """
        experiment = self.run.experiment
        facts = [*self._iter_mission(recording), *self._list_differences()]
        facts.append(("controller", describe_controller(self.controller.specification)))
        facts += [("method", label_of(experiment.method.kind)), ("seed of the run", str(experiment.seed))]
        if self.choice is not None:
            value = f"{self.choice.fitness + 0.0:.6g}"
            episodes = f" ({self.choice.aggregation})" if self.choice.aggregation else ""
            facts.append(("fitness of the candidate", f"{value}{episodes}"))
        if recording is not None and (self.choice is None or recording.fitness != self.choice.fitness):
            facts.append(("fitness of this episode", f"{recording.fitness + 0.0:.6g}"))
        facts.append(("simulation seed", str(self.seed)))
        return Caption(self.title, tuple(facts))


def _seed_of_match(episode: int) -> int:
    """Return the seed of an episode of matches that are not in the record."""
    if episode < 0:
        raise InputError(f"episode {episode}: must be at least 0")
    return FIRST_SEED + episode


def name_replays(replays: Iterable[Replay]) -> list[str]:
    """Return labels of episodes shown side by side, with the names of their runs if these differ."""
    replays = list(replays)
    folders = [(replay.controller_run or replay.run).path.resolve() for replay in replays]
    if len(set(folders)) < 2:
        return [replay.name for replay in replays]
    # Folders of the same name need the names of their parents.
    labels = [path.name for path in folders]
    depth = 1
    while len(set(labels)) < len(set(folders)):
        depth += 1
        labels = [str(Path(*path.parts[-depth:])) for path in folders]
    return [
        f"{label} {replay.name}" if replay.choice else replay.name
        for label, replay in zip(labels, replays, strict=True)
    ]


def _list_changes(
    now: Mapping[str, Any], before: Mapping[str, Any], settings: Iterable[Setting]
) -> Iterator[str]:
    """Yield descriptions of changed parameters: settings as they were typed, then all others."""
    listed: set[str] = set()
    # The last setting of a key counts.
    for path, value in {
        setting.path[1:]: setting.value for setting in settings if setting.path[0] == "parameters"
    }.items():
        if not path or _value_at(now, path) == _value_at(before, path):
            continue
        listed.add(path[0])  # setting a part makes the whole a mapping, whose other parts are unchanged
        yield f"{'.'.join(path)} {_shorten(value)}{_format_recorded(_value_at(before, path))}"
    flat_now, flat_before = flatten(now), flatten(before)
    for key in dict.fromkeys([*flat_now, *flat_before]):
        if key == "seed" or key.split(".")[0] in listed:
            continue
        value, recorded = flat_now.get(key, _NONE), flat_before.get(key, _NONE)
        if value != recorded:
            yield f"{key} {_shorten(value)}{_format_recorded(recorded)}"


_NONE = object()
"""Stands for a parameter that is not set."""


def _value_at(values: Any, path: Iterable[str]) -> Any:  # noqa: ANN401 - any value of a file
    """Return a parameter, or a part of it."""
    for part in path:
        if isinstance(values, Mapping):
            values = values.get(part, _NONE)
        elif isinstance(values, list) and part.isdecimal() and int(part) < len(values):
            values = values[int(part)]
        else:
            return _NONE
    return values


def _shorten(value: Any) -> str:  # noqa: ANN401 - any value of a file
    if value is _NONE:
        return "not set"
    text = value if isinstance(value, str) else json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= _VALUE_CHARACTERS else f"{text[: _VALUE_CHARACTERS - 1]}…"


def _format_recorded(value: Any) -> str:  # noqa: ANN401 - any value of a file
    """Describe the recorded value of a parameter; empty if the run did not set it."""
    return "" if value is _NONE else f" (in the run {_shorten(value)})"


def _find_broker(run: "Run", simulation: str | type | None) -> str | None:
    """Return the broker for a simulation that is not installed; None for an installed simulation.

    simulation: in place of the run's.
    """
    title, broker = simulation or run.experiment.simulation, run.experiment.broker
    if isinstance(title, type) or catalogue.is_local(title):
        return None
    if broker is not None:
        return broker
    raise InputError(
        f"{run.path}: the simulation '{title}' is not built in; specify the broker of a server that offers "
        f"it with scenes (--broker URL), or its class or environment (--simulation NAME), or let a server "
        f"draw it: swarmwright simulate {run.path / 'experiment.yaml'} --controller {run.path} --visual "
        "--broker URL"
    )
