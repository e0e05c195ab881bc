"""Episodes of runs, played again."""

import dataclasses
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from swarmwright.common.arguments import simulation_seed
from swarmwright.common.errors import InputError
from swarmwright.common.simulation_names import label_of
from swarmwright.common.values import flatten
from swarmwright.controllers.controller import Controller
from swarmwright.controllers.kinds import words_of
from swarmwright.display import Caption
from swarmwright.experiment.settings import Setting, parse_settings, refuse_seed
from swarmwright.runs.choice import Choice, choose
from swarmwright.runs.code import used_for
from swarmwright.servers.evaluation.module_code import is_in_python
from swarmwright.servers.evaluation.shown import ShownEpisode, check_showable
from swarmwright.simulations import catalogue

if TYPE_CHECKING:
    from swarmwright.display import Recording
    from swarmwright.display.pictures import PictureRecording
    from swarmwright.experiment.experiment import Experiment
    from swarmwright.runs.run import Run


_MOST_CHANGED = 6
"""Changed parameters that a page lists."""
_VALUE_CHARACTERS = 40
"""Characters of a value there."""


@dataclass(frozen=True, kw_only=True)
class Replay(ShownEpisode):
    """One episode of one controller, in the simulation of a run, whose parameters may be set to others."""

    run: "Run"
    choice: Choice | None = None
    """The candidate of the run that the controller is; None when it comes from elsewhere."""
    number: int | None = None
    """Index of the episode; None for one that the run did not have."""
    other: "Run | None" = None
    """The run that the controller is a candidate of, where that is another one."""
    settings: tuple[str, ...] = ()
    """What is set of the parameters and fitness of the run, `KEY.PATH=VALUE` each."""

    @classmethod
    def of(
        cls,
        run: "Run",
        *,
        generation: int | None = None,
        candidate: int | None = None,
        controller: Path | None = None,
        episode: int | None = None,
        seed: int | None = None,
        simulation: str | type | None = None,
        settings: Iterable[str] = (),
        broker: str | None = None,
        prefix: str | None = None,
    ) -> Self:
        """Choose what is played.

        Args:
            run: whose simulation and parameters.
            generation: as in `Run.evaluation`.
            candidate: as in `Run.evaluation`.
            controller: file or run folder with another controller, instead of a candidate of the run.
            episode: one of the run's, default 0.
            seed: of the simulation, for an episode that the run did not have.
            simulation: a class, or `FILE:Class`, instead of the code with which the candidate was evaluated.
            settings: other values of parameters and fitness than the run's, see `Experiment.load`.
            broker: a server on it computes the episode and sends its scenes. Default: this process does, or,
                where the simulation is not here, servers on the run's broker.
            prefix: of topics on the broker, instead of the run's.

        Raises:
            InputError: the simulation is not here and no broker is known, or there is no such candidate,
                controller or episode.
        """
        settings = list(settings)
        refuse_seed(settings)
        broker = broker or _broker_of(run, simulation)
        chosen = None if controller is not None else choose(run, generation, candidate)
        used = used_for(run, None if chosen is None else chosen.generation, simulation)
        experiment = used.with_settings(
            settings, only=("parameters", "fitness"), reason="only parameters and fitness can be set here"
        )
        if prefix is not None:
            experiment = experiment.replace(prefix=prefix)
        seeds = run.seeds(0) if chosen is None else chosen.seeds
        number = None if seed is not None else episode or 0
        if seed is not None:
            simulation_seed("seed", seed)
        if number is not None and not 0 <= number < len(seeds):
            has = "one episode, 0" if len(seeds) == 1 else f"{len(seeds)} episodes, 0 to {len(seeds) - 1}"
            raise InputError(
                f"episode {number}: the run evaluated {has}; name the seed of another one, --seed S "
                "(in Python, seed=S)"
            )
        played = Controller.load(controller) if controller is not None else Controller(chosen.specification)  # type: ignore[union-attr] # one of the two is there
        check_showable(broker, played)
        return cls(
            run=run,
            controller=played,
            choice=chosen,
            source=controller,
            number=number,
            seed=seeds[number] if number is not None else seed or 0,
            experiment=experiment,
            broker=broker,
            settings=tuple(settings),
        )

    def beside(self, other: "Run") -> Self:
        """Return the same episode with the best candidate of another run.

        Raises InputError when its controllers do not fit the simulation of this one.
        """
        chosen = choose(other)
        controller = Controller(chosen.specification)
        self._check_fits(controller, other)
        return dataclasses.replace(self, controller=controller, choice=chosen, source=None, other=other)

    def _check_fits(self, controller: Controller, other: "Run") -> None:
        here = f"{self.experiment.label} as {self.run.path} has it"
        advice = f"; show it alone: swarmwright replay {other.path}"
        if self.broker is not None and is_in_python(controller.specification):
            raise InputError(
                f"{other.path}: behaviours and conditions in Python are shown in this process alone; leave "
                f"the broker out{advice}"
            )
        if controller.parameters:  # they steer no agents
            if controller.parameters.keys() != self.controller.parameters.keys():
                raise InputError(
                    f"{other.path}: its controllers are parameters of {other.experiment.label}, others than "
                    f"those of {self.run.path}{advice}"
                )
            return
        if self.broker is not None:
            return  # what the simulation has there, its servers know
        try:
            dataclasses.replace(self, controller=controller).engine_episode()
        except InputError as error:
            raise InputError(f"{other.path}: does not fit {here}: {error}{advice}") from error

    @property
    def name(self) -> str:
        """What is played, as the command line names it: GENERATION:CANDIDATE, or the controller's file."""
        if self.choice is None:
            return str(self.source)
        return f"{self.choice.generation}:{self.choice.candidate}"

    @property
    def title(self) -> str:
        """What is played, in a line."""
        return f"{self.run.experiment.label}: {self.whose}{self._which}"

    @property
    def who(self) -> str:
        """Which candidate or controller it is, in a sentence."""
        number = "" if self.choice is None else f", evaluation {self.choice.number}"
        return f"{self.whose[:1].upper()}{self.whose[1:]}{number}."

    @property
    def whose(self) -> str:
        """Which candidate or controller it is, in words."""
        if self.choice is None:
            return f"controller of {self.source}"
        return f"candidate {self.choice.candidate} of generation {self.choice.generation}"

    @property
    def _which(self) -> str:
        if self.number is None:
            return f", simulation seed {self.seed}"
        return f", episode {self.number} ({self._episodes} in all)" if self._episodes > 1 else ""

    @property
    def _episodes(self) -> int:
        return self.run.experiment.ranking.episodes if self.choice is None else len(self.choice.seeds)

    def outcome(self, fitness: float) -> str:
        """Return the episode's fitness in words, beside the candidate's when that is another thing."""
        said = f"Fitness {fitness + 0.0:.6g}"  # no -0
        if self.choice is None:
            return f"{said}."
        if self.number is not None and self._as_recorded:
            recorded = self.choice.episodes[self.number]
            if fitness != recorded and not math.isnan(recorded):
                was = f"in the run it was {recorded + 0.0:.6g}"
                return f"{said}; {was}: this simulation is not bit-identical here."
            if not self.choice.made_of:
                return f"{said}."
        where = f"in episode {self.number}" if self.number is not None else f"with seed {self.seed}"
        meaning = f" ({self.choice.made_of})" if self.choice.made_of else ""
        whole = f"{self.choice.fitness + 0.0:.6g}{meaning}"
        return f"{said} {where}; recorded fitness of the candidate: {whole}."

    @property
    def _as_recorded(self) -> bool:
        """Whether parameters and fitness are those of the run."""
        mine, runs = self.experiment, self.run.experiment
        return (mine.parameters, mine.fitness) == (runs.parameters, runs.fitness)

    def _changed(self) -> Iterator[tuple[str, str]]:
        """Yield what is not as in the run."""
        mine, runs = self.experiment, self.run.experiment
        changed = list(_changed(mine.parameters, runs.parameters, parse_settings(self.settings)))
        if changed:
            more = [f"and {len(changed) - _MOST_CHANGED} more"] if len(changed) > _MOST_CHANGED else []
            yield ("changed parameters", ", ".join([*changed[:_MOST_CHANGED], *more]))
        if mine.fitness != runs.fitness:
            own = "the simulation's"
            yield ("changed fitness", f"{mine.fitness or own} (in the run {runs.fitness or own})")

    def identity(self) -> dict[str, Any]:
        """Return what is played as plain values, for `--json`."""
        choice = self.choice
        return {
            "episode": self.number,
            "seed": self.seed,
            "generation": choice.generation if choice else None,
            "candidate": choice.candidate if choice else None,
            "candidate_fitness": choice.fitness if choice else None,
            "controller": str(self.source) if self.source else None,
        }

    def caption(self, recording: "Recording | PictureRecording | None" = None) -> Caption:
        """Return the title and the facts of the experiment that are beside a picture.

        recording: of the episode, which says what was simulated and what came out.
        """
        experiment = self.run.experiment
        facts = [*self._iter_mission(recording), *self._changed()]
        facts += [("controller", words_of(self.controller.specification)), *_origin(experiment)]
        if self.choice is not None:
            value = f"{self.choice.fitness + 0.0:.6g}"
            episodes = f" ({self.choice.made_of})" if self.choice.made_of else ""
            facts.append(("fitness of the candidate", f"{value}{episodes}"))
        if recording is not None and (self.choice is None or recording.fitness != self.choice.fitness):
            facts.append(("fitness of this episode", f"{recording.fitness + 0.0:.6g}"))
        facts.append(("simulation seed", str(self.seed)))
        return Caption(self.title, tuple(facts))


def names(replays: Iterable[Replay]) -> list[str]:
    """Return what episodes beside each other are called, with the names of their runs where these differ."""
    replays = list(replays)
    runs = [(replay.other or replay.run).path.resolve() for replay in replays]
    if len(set(runs)) < 2:
        return [replay.name for replay in replays]
    # Folders of the same name are told apart by those that they are in.
    of = [path.name for path in runs]
    depth = 1
    while len(set(of)) < len(set(runs)):
        depth += 1
        of = [str(Path(*path.parts[-depth:])) for path in runs]
    return [
        f"{run} {replay.name}" if replay.choice else replay.name
        for run, replay in zip(of, replays, strict=True)
    ]


def _changed(now: Mapping[str, Any], before: Mapping[str, Any], settings: Iterable[Setting]) -> Iterator[str]:
    """Yield parameters that are not as they were, as words: what was set as it was typed, then all others."""
    said: set[str] = set()
    # The last one of a key holds.
    for path, value in {
        setting.path[1:]: setting.value for setting in settings if setting.path[0] == "parameters"
    }.items():
        if not path or _value_at(now, path) == _value_at(before, path):
            continue
        said.add(path[0])  # a name of which a part is set is a mapping now: not all of it is news
        yield f"{'.'.join(path)} {_shortened(value)}{_earlier_value(_value_at(before, path))}"
    flat_now, flat_before = flatten(now), flatten(before)
    for key in dict.fromkeys([*flat_now, *flat_before]):
        if key == "seed" or key.split(".")[0] in said:
            continue
        value, was = flat_now.get(key, _NONE), flat_before.get(key, _NONE)
        if value != was:
            yield f"{key} {_shortened(value)}{_earlier_value(was)}"


_NONE = object()
"""Stands for a parameter that is not given."""


def _value_at(values: Any, path: Iterable[str]) -> Any:  # noqa: ANN401 - any value of a file
    """Return a parameter, or a part of one."""
    for part in path:
        if isinstance(values, Mapping):
            values = values.get(part, _NONE)
        elif isinstance(values, list) and part.isdecimal() and int(part) < len(values):
            values = values[int(part)]
        else:
            return _NONE
    return values


def _shortened(value: Any) -> str:  # noqa: ANN401 - any value of a file
    if value is _NONE:
        return "not given"
    text = value if isinstance(value, str) else json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= _VALUE_CHARACTERS else f"{text[: _VALUE_CHARACTERS - 1]}…"


def _earlier_value(value: Any) -> str:  # noqa: ANN401 - any value of a file
    """Return what a parameter was, in words; nothing where the run did not give it."""
    return "" if value is _NONE else f" (in the run {_shortened(value)})"


def _origin(experiment: "Experiment") -> list[tuple[str, str]]:
    return [("method", label_of(experiment.method.kind)), ("seed of the run", str(experiment.seed))]


def _broker_of(run: "Run", simulation: str | type | None) -> str | None:
    """Where a simulation is computed that is not here; None for one that is.

    simulation: instead of the run's.
    """
    title, broker = simulation or run.experiment.simulation, run.experiment.broker
    if isinstance(title, type) or catalogue.is_local(title):
        return None
    if broker is not None:
        return broker
    raise InputError(
        f"{run.path}: the simulation '{title}' is not built in; name the broker of a server that offers it "
        f"and has scenes (--broker URL), name its class or environment if that is here (--simulation NAME), "
        f"or have a server draw it itself: swarmwright simulate "
        f"{run.path / 'experiment.yaml'} --controller {run.path} --visual --broker URL"
    )
