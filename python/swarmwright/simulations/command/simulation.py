"""Simulations that are commands, by files (D6.1, 4.1) or over standard input and output.

Forms in which a command gets a controller: JSON, or source code of the exporters.

Episodes of a command that is stepped over its standard input and output.

What is compiled once for a candidate, by whichever instance needs it first.
"""

import contextlib
import fcntl
import hashlib
import itertools
import json
import logging
import math
import os
import weakref
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmwright.common.errors import EpisodeError, InputError, describe_exception
from swarmwright.common.simulation_names import SimulationName
from swarmwright.common.temporary import private_folder, remove
from swarmwright.controllers.controller import Controller
from swarmwright.export import EXPORTERS, Subject, c, file_bytes
from swarmwright.simulations.base import Simulation
from swarmwright.simulations.command import (
    logs,
    parameter_file,
    placeholders,
    work_files,
)
from swarmwright.simulations.command.definition import STANDARD_OUTPUT, CommandOptions, Reduction
from swarmwright.simulations.command.placeholders import IN_A_COMMAND, Values, is_choice, names_in
from swarmwright.simulations.command.process import (
    CommandFailure,
    Limits,
    Printed,
    Processes,
    ReportedFailure,
    resolved_word,
    run,
)
from swarmwright.simulations.command.stepwise import Dialogue, Start
from swarmwright.simulations.fitness import FITNESS_NAME, FitnessExpression
from swarmwright.simulations.parameters import Parameter
from swarmwright.simulations.user_code.command_sources import digest

_KEPT = 32
"""Builds that are kept, the ones used last."""


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _built(folder: Path, build: Callable[[Path], None]) -> None:
    """Have a folder made by `build`, which gets it empty, unless that was done; what it raises is passed on.

    folder: whose name is a digest of what is built; others beside it are deleted when there are many.
    """
    folder.parent.mkdir(exist_ok=True)
    done = folder / ".done"
    with _locked(folder.parent / f"{folder.name[:2]}.lock"):
        if not done.exists():
            remove(folder)
            folder.mkdir()
            build(folder)
            done.touch()
            _forget(folder.parent)
        os.utime(done)


def _forget(builds: Path) -> None:
    """Delete builds that have not been used for long."""
    found = []
    for done in builds.glob("*/.done"):
        with contextlib.suppress(OSError):
            found.append((done.stat().st_mtime, done.parent))
    for _, folder in sorted(found)[:-_KEPT]:
        remove(folder)


class SteppedEpisodes:
    """The episode under way, and the process that runs it.

    Args:
        start: called before a process is started.
        limits: of an episode.
        recycle: episodes of a process; 0 for any number.
        metrics: names that the last answer of an episode must have.
    """

    def __init__(
        self, start: Callable[[], Start], limits: Limits, recycle: int, metrics: Collection[str]
    ) -> None:
        self._start, self._limits, self._recycle, self._metrics = start, limits, recycle, metrics
        self._processes: Processes | None = None
        self._dialogue: Dialogue | None = None
        self.done = False
        """Whether the episode has ended."""
        self.acting: ArrayLike | None = None
        """The agents that act next; None for all."""
        self.measured: dict[str, float] = {}
        """Metrics of the episode that has ended, and its fitness where the command says it."""

    def reset(self, processes: Processes, parameters: Mapping[str, Any], seed: int) -> ArrayLike | None:
        """Begin an episode; return the sensors of all agents, (agents, sensors), or None when it has ended.

        processes: which start the command; others than before when those have ended.

        Raises CommandFailure for any failure, as `step`; the command is then ended.
        """
        if self._dialogue is None or processes is not self._processes:
            self._processes = processes
            self._dialogue = Dialogue(processes, self._start, self._limits, self._recycle)
        self.measured = {}
        return self._taken(self._dialogue.reset(parameters, seed))

    def step(self, actions: NDArray[np.float32]) -> ArrayLike | None:
        """Advance by one step; return the sensors as `reset`."""
        assert self._dialogue is not None
        return self._taken(self._dialogue.ask({"actuators": actions.tolist()}))

    def abandon(self) -> Printed:
        """End the command, whose state is unknown; return what it has printed."""
        if self._dialogue is None:
            return Printed(0)
        self._dialogue.abandon()
        return self._dialogue.printed

    def _taken(self, answer: Mapping[str, Any]) -> ArrayLike | None:
        """Take in an answer; return the sensors in it."""
        self.done = answer.get("done") is True
        self.acting = answer.get("acting")
        if self.done:
            self.measured = self._results(answer)
        elif "sensors" not in answer:
            raise CommandFailure(f"answered {json.dumps(answer)[:80]}, which has neither sensors nor done")
        return answer.get("sensors")

    def _results(self, answer: Mapping[str, Any]) -> dict[str, float]:
        """Return fitness and declared metrics, which may be NaN or infinite, of an episode's last answer."""
        reported = answer.get("metrics") or {}
        if not isinstance(reported, Mapping):
            raise CommandFailure(f"metrics is {json.dumps(reported)[:40]}, expected {{NAME: NUMBER, ..}}")
        results = {name: reported[name] for name in self._metrics if name in reported}
        if FITNESS_NAME in answer or FITNESS_NAME in reported:
            results[FITNESS_NAME] = answer.get(FITNESS_NAME, reported.get(FITNESS_NAME))
        for name in self._metrics:
            if name not in results:
                there = ", ".join(reported) or "none"
                raise CommandFailure(f"ended the episode without the metric {name!r}; available: {there}")
        for name, value in results.items():
            if not isinstance(value, bool | int | float) or (
                name == FITNESS_NAME and isinstance(value, bool)
            ):
                raise CommandFailure(f"{name} is {json.dumps(value)[:40]}, expected a number")
        return {name: _float(value) for name, value in results.items()}


def _float(number: float) -> float:
    try:
        return float(number)
    except OverflowError:  # of a whole number
        return math.inf if number > 0 else -math.inf


PREFIX = "controller"
_MAIN = {"json": ".json", "c": ".c", "cpp": ".hpp", "python": ".py", "onnx": ".onnx"}
"""The ending of the file that {controller} stands for."""
WEIGHTS = f"{PREFIX}.weights"
"""What the file is called that {weights} stands for."""
_PARTS = {".c", ".h", ".hpp", ".py", ".onnx"}


def _main_file(form: str) -> str:
    """Return the name of the file that {controller} stands for."""
    return f"{PREFIX}{_MAIN[form]}"


def _weights_of(controller: Controller) -> bytes:
    """Return the file that {weights} stands for."""
    return c.format_weights(Subject(controller.specification)).encode()


def _files_of(form: str, controller: Controller, *, without_weights: bool = False) -> dict[str, bytes]:
    """Return the files of a controller by their names, without self-tests and what builds these.

    without_weights: C whose weights are in a file of their own, `weights`.
    """
    if without_weights:
        made = c.format_loadable_source(Subject(controller.specification), PREFIX)
        return {name: file_bytes(content) for name, content in made.items()}
    if form == "json":
        return {_main_file(form): f"{controller.json}\n".encode()}
    written = EXPORTERS.get(form)().files(Subject(controller.specification), PREFIX)
    return {
        name: file_bytes(content)
        for name, content in written.items()
        if PurePosixPath(name).stem == PREFIX and PurePosixPath(name).suffix in _PARTS and "/" not in name
    }


_log = logging.getLogger("swarmwright")
_TEMPORARY = ".tmp"
"""Folder in a work folder."""
_LONGEST_TEMPORARY = 60
"""Characters of its path; that of a socket has 107 at most."""
_DIGITS = 12
"""Of the digest in a title."""


class CommandSimulation(Simulation):
    """A simulation that is a command; an episode is a process with a folder of its own.

    An experiment can say all that is needed, `simulation: {command: ..}`. Where it cannot, derive a class: it
    has `definition` with the same keys, and overrides some of the functions of D6.1 (4.1), which are called
    for an episode in this order: `setEnvironment`, `exportRepresentation` where there is a controller that
    was not compiled before, `setParameters`, `run`, `readLogs`, which may use `getLogs`.

        class Rescue(CommandSimulation):
            definition = {"command": "python3 rescue.py {parameters}", "log": "rescue.txt"}
            metrics = ["rescued"]

            def readLogs(self):
                return {"rescued": self.getLogs()["rescue.txt"].count("RESCUED")}
    """

    definition: ClassVar[Mapping[str, Any]] = {}
    """What an experiment would say below `simulation`; paths are relative to the file of the class."""
    adapted: ClassVar[str] = ""
    """The name from which the class was made; empty for a user-written class."""
    digest: ClassVar[str] = ""
    """SHA-256 of definition and files when the class was made; empty for a user-written class."""
    copies = False
    takes_controller = False
    most_steps = None
    """`timeout` is the limit."""
    steers_itself = True
    """Parameter sets are possible; said so that no episode is run to find out."""
    _is_own_program: ClassVar[bool] = False
    """Whether the command is Swarmwright's own program: the reasons that it reports are complete messages."""
    visual: ClassVar[bool] = False
    """Whether episodes are run by `runVisual`, as `swarmwright simulate --visual` asks for."""

    folder: Path
    """The work folder of the episode."""
    build: Path | None = None
    """The folder where the controller is compiled, where it is."""
    environment: dict[str, str]
    """Variables of the environment that the command gets beside those of this process."""
    seed: int
    """Of the episode, 0 to 2**64 - 1."""

    def __init__(self) -> None:
        self.options = self._options()
        self._here = Path(self.options.folder)
        self.takes_controller = self.options.takes_controller
        self.title = type(self).title or self.options.title or self._title()
        self.sensors, self.actuators = self.options.sensors or 1, self.options.actuators or 1
        self.dimensions, self.determinism = self.options.dimensions, self.options.determinism
        self._own = None if self.options.fitness is None else FitnessExpression(self.options.fitness)
        self._reductions = self.options.reductions
        if not self.metrics:
            named = () if self._own is None else self._own.metrics
            self.metrics = [name for name in self._reductions or named if name != FITNESS_NAME]
        if not self.parameters and self.options.parameters is not None:
            self.parameters = parameter_file.defaults(self._here / self.options.parameters)
        own = {
            name: parameter for name, parameter in self.parameters.items() if isinstance(parameter, Parameter)
        }
        self._choices = self.options.choices | {
            name: declaration.choices for name, declaration in own.items() if declaration.choices is not None
        }
        self._declared = {
            **self.parameters,
            **{name: declaration.default for name, declaration in own.items()},
        }
        self._limits = Limits(
            self.options.timeout, self.options.output, self.options.disk, self.options.children
        )
        self._instance: work_files.Instance | None = None
        self._processes: Processes | None = None
        self._stepped = (
            SteppedEpisodes(self._start, self._limits, self.options.recycle, self.metrics)
            if self.options.controller == "stepwise"
            else None
        )
        self._episodes = itertools.count()
        self._measured: dict[str, float] = {}
        self._unusable: dict[str, str] = {}
        """What is wrong with metrics that are NaN or infinite."""

    @classmethod
    def _options(cls) -> CommandOptions:
        if cls.adapted:
            return CommandOptions.of(cls.adapted)
        from swarmwright.simulations.command.checking import checked_definition
        from swarmwright.simulations.loading import file_of

        file = file_of(cls)
        return checked_definition(cls.definition, Path() if file is None else file.parent, cls.__name__)

    def _title(self) -> str:
        return f"{self._label}@{(self.digest or digest(self.options))[:_DIGITS]}"

    @property
    def _label(self) -> str:
        """What failures and the title call it."""
        return SimulationName.parse(self.options.name).label

    # The functions of D6.1.

    def setEnvironment(self, environment: Mapping[str, str]) -> None:  # noqa: N802 - D6.1's name
        """Set variables of the command's environment, with their placeholders filled in."""
        self.environment = {
            name: placeholders.variable(name, text).filled(self._values) for name, text in environment.items()
        }

    def setParameters(self, parameters: Mapping[str, Any]) -> None:  # noqa: N802 - D6.1's name
        """Write the parameter file, and the files that have placeholders, into the work folder.

        parameters: all of the simulation, and `seed`.
        """
        form = self.options.parameters_format
        self._write(parameter_file.FILES[form], parameter_file.text(parameters, form).encode())
        for name, path in work_files.named(self.options.files, self._here).items():
            data = work_files.read(path)
            text = work_files.text_of(data)
            if text is not None:
                data = placeholders.file(name, text).filled(self._values).encode("utf-8", "surrogateescape")
            target = self._write(name, data)
            if os.access(path, os.X_OK):
                target.chmod(target.stat().st_mode | 0o100)

    def exportRepresentation(self, controller: Controller) -> None:  # noqa: N802 - D6.1's name
        """Write the controller as the simulator reads it: into the work folder, or where it is compiled."""
        form, loads = self.options.controller, self.options.loads_weights
        for name, data in _files_of(form, controller, without_weights=loads).items():
            (self.build or self.folder).joinpath(name).write_bytes(data)

    def run(self) -> None:
        """Run the command to its end."""
        self._run(self.options.command)

    def runVisual(self) -> None:  # noqa: N802 - D6.1's name
        """Run the command so that it shows itself: `visual` of the definition, else as `run`."""
        if self.options.visual is None:
            self.run()
        else:
            self._run(self.options.visual)

    def readLogs(self) -> Mapping[str, float]:  # noqa: N802 - D6.1's name
        """Return the metrics of the episode, and `fitness` where the logs have that."""
        wanted = {reduction.column for reduction in self._reductions.values()}
        wanted |= set(self.metrics) - set(self._reductions)
        if (self._own is None and FITNESS_NAME not in self._reductions) or self._asks_own:
            wanted.add(FITNESS_NAME)
        columns = logs.read(self._log_files(), self.options.log_format, wanted)
        plain = (set(self.metrics) | {FITNESS_NAME}) & set(columns)
        reductions = {name: Reduction("last", name) for name in sorted(plain)} | self._reductions
        for name, reduction in reductions.items():
            problem = columns[reduction.column].problem(reduction.function)
            if problem is not None and not problem.is_number:
                raise CommandFailure(problem.text)
            if problem is not None:
                self._unusable[name] = problem.text
        return {name: reduction.of(columns[reduction.column]) for name, reduction in reductions.items()}

    def getLogs(self) -> dict[str, str]:  # noqa: N802 - D6.1's name
        """Return the content of the logs, by the names of their files; `stdout` is what was printed."""
        return {
            name: (file if isinstance(file, bytes) else file.read_bytes()).decode("utf-8", "replace")
            for name, file in self._log_files().items()
        }

    # What the engine calls.

    def reset(self, parameters: dict[str, Any], seed: int, controller: str | None = None) -> ArrayLike:
        """Run the episode, or begin one that is stepped; see `Simulation.reset`."""
        self.seed = seed
        self._measured, self._unusable = {}, {}
        self._check_choices(parameters)
        if self._stepped is not None:
            stepped, processes = self._stepped, self._ready()[1]
            return self._sensed(lambda: stepped.reset(processes, parameters, seed))
        if controller is None and self.takes_controller:
            raise InputError(
                "simulation.controller: the command gets its controller as a file, which needs the mode "
                "offloaded, and a controller of another kind than parameter_set"
            )
        self._episode(parameters, None if controller is None else Controller(controller))
        return np.zeros((1, self.sensors))

    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        """Advance by one step, where the command is stepped."""
        stepped = self._stepped
        assert stepped is not None
        return self._sensed(lambda: stepped.step(actions))

    def done(self) -> bool:
        """Return whether the episode has ended."""
        return self._stepped is None or self._stepped.done

    def acting(self) -> ArrayLike | None:
        """Return who acts next."""
        return None if self._stepped is None else self._stepped.acting

    def fitness(self) -> float:
        """Return the fitness: of the definition's expression, or what the logs say."""
        if self._own is None or not self._own_applies:
            if FITNESS_NAME not in self._measured:
                raise EpisodeError(f"{self._label}: {self._without_fitness}")
            return self._measured[FITNESS_NAME]
        row = np.array([[self._measured[name] for name in self._own.metrics]])
        values, faults = self._own(np.array([self._measured.get(FITNESS_NAME, 0.0)]), row)
        if faults:
            raise EpisodeError(f"fitness: {faults[0].reason}")
        return float(values[0])

    @property
    def _without_fitness(self) -> str:
        """What is missing, and where it can come from."""
        other = "give the experiment a `fitness`, an expression over metrics"
        if self._stepped is None:
            return f"readLogs has returned no fitness: have it return one, or {other}"
        return (
            'ended an episode without a fitness: have its last line say {"done": true, "fitness": NUMBER}, '
            f"or {other} that it reports"
        )

    def measure(self) -> Mapping[str, float]:
        """Return the metrics."""
        return self._measured

    # How it is done.

    def _check_used(self) -> None:
        """Raise CommandFailure where the fitness is made of a number that is not finite; others may be."""
        own = self._own if self._own_applies else None
        used = (
            [FITNESS_NAME]
            if own is None
            else [*own.metrics, *([FITNESS_NAME] if own.uses_simulation_fitness else [])]
        )
        for name in used:
            value = self._measured.get(name, 0.0)
            if not math.isfinite(value):
                raise CommandFailure(
                    self._unusable.get(name) or f"{name} is {value}, expected a finite number"
                )

    @property
    def _asks_own(self) -> bool:
        """Whether the expression of the fitness uses what the logs call fitness."""
        return self._own is not None and self._own.uses_simulation_fitness

    @property
    def _own_applies(self) -> bool:
        """Whether the expression is computed: a stepped command may report a fitness and no metrics."""
        return self._own is not None and all(name in self._measured for name in self._own.metrics)

    def _episode(self, parameters: Mapping[str, Any], controller: Controller | None) -> None:
        """Run an episode from files to files."""
        instance = self._ready()[0]
        number = next(self._episodes)
        # One name, so that the same failure has the same reason.
        name = f"episode-{number}" if self.options.keep == "all" else "episode"
        self.folder = instance.new_folder(name)
        for log in self.options.log:
            (self.folder / log).parent.mkdir(parents=True, exist_ok=True)
        # A parameter of the program with the name of a placeholder is in the parameter file alone.
        own = {"seed": self.seed} | self._placeholders(instance, number)
        self._values = Values(own, parameters, self._choices, self._declared)
        self._printed = Printed(self._limits.most_output, keep=STANDARD_OUTPUT in self.options.log)
        try:
            self._check_names(parameters)
            if controller is not None and self.options.compile is not None:
                self.build = self._build_of(controller, instance.place)
                self._values |= {"build": self.build, "controller": self.build / self._controller_file}
            self.setEnvironment(self.options.environment)
            if controller is not None and self.options.compile is not None:
                self._compile(controller, self.options.compile)
            elif controller is not None:
                self.exportRepresentation(controller)
            if controller is not None and self.options.loads_weights:
                (self.folder / WEIGHTS).write_bytes(_weights_of(controller))
            self.setParameters({**parameters, "seed": self.seed})
            (self.runVisual if self.visual else self.run)()
            self._measured = {name: float(value) for name, value in self.readLogs().items()}
            self._check_used()
        except CommandFailure as failure:
            self._put_away(str(failure))
            raise self._explained(failure, self._printed) from None
        except (Exception, SystemExit) as error:  # of a class that is derived
            self._put_away(describe_exception(error))
            raise
        except BaseException:  # an interrupt is no failure of the episode
            self._put_away()
            raise
        self._put_away()

    def _check_choices(self, parameters: Mapping[str, Any]) -> None:
        """Raise InputError for a value that is none of those that the definition declares."""
        for name, choices in self._choices.items():
            if name in parameters and not is_choice(parameters[name], choices):
                raise InputError(
                    f"{name}: {parameters[name]!r} found, expected one of {', '.join(map(repr, choices))} "
                    "(simulation.choices)"
                )

    def _check_names(self, parameters: Mapping[str, Any]) -> None:
        """Raise CommandFailure where a value of the experiment has the name of a placeholder that is used.

        Experiments are refused then; other tools may send such a parameter, whose value would reach nothing.
        """
        own = self.parameters
        for name, value in parameters.items():
            if name in self._placeholders_used and (name not in own or own[name] != value):
                raise CommandFailure(
                    f"the parameter {name} has the name of {{{name}}}, {IN_A_COMMAND[name]}, so that its "
                    "value would not reach the command; give the parameter, and its placeholder, another name"
                )

    @cached_property
    def _placeholders_used(self) -> frozenset[str]:
        """Those beside parameters and the seed that command, files and environment have."""
        options = self.options
        texts = [*options.command, *options.environment.values(), *(options.compile or ())]
        texts += options.visual or ()
        texts += [text for _, text in work_files.texts(options.files, self._here)]
        used = frozenset(name for text in texts for name in names_in(text))
        return used & IN_A_COMMAND.keys() - {"seed"}

    def _put_away(self, failure: str = "") -> None:
        """Remove the work folder, or keep it; the log names the folder of the first failure of each kind.

        The reason of a failed episode does not: runs store it, and count failures that have the same one.

        failure: why the episode failed; empty if it did not.
        """
        instance, keep = self._instance, self.options.keep
        if instance is None or not self.folder.exists():
            return
        is_named = bool(failure) and instance.is_first_of_kind(failure)
        if keep == "failed" and is_named:
            kept = instance.keep_failed(self.folder)
        elif keep == "all":
            kept = self.folder
        else:
            remove(self.folder)
            return
        if is_named:
            _log.warning("%s: %s; the work folder of this episode is kept: %s", self._label, failure, kept)

    def _explained(self, failure: CommandFailure, printed: Printed) -> EpisodeError:
        """Return a failure with the last of what the command printed."""
        reason = str(failure)
        if self._is_own_program and isinstance(failure, ReportedFailure):
            reason = failure.reason
        last = f"; its last output: {printed.summary}" if printed.summary else ""
        return EpisodeError(f"{self._label}: {reason}{last}", printed.tail or None)

    def _compile(self, controller: Controller, command: list[str]) -> None:
        """Compile a controller, unless that was done for this one, or for one with the same source."""

        def build(folder: Path) -> None:
            assert self._processes is not None
            self.exportRepresentation(controller)
            words = self._command(command)
            run(self._processes, words, folder, self._variables, self._limits, self._printed)

        assert self.build is not None
        try:
            _built(self.build, build)
        except CommandFailure as failure:
            raise CommandFailure(f"compile: {failure}") from None

    def _build_of(self, controller: Controller, place: Path) -> Path:
        """Return the folder where a controller is compiled."""
        compiled = controller.json
        if self.options.loads_weights:
            compiled = json.dumps({**controller.specification, "weights": None}, sort_keys=True)
        key = hashlib.sha256(f"{self.digest or self.options.name}\n{compiled}".encode())
        return place / "builds" / key.hexdigest()

    @property
    def _controller_file(self) -> str:
        return _main_file(self.options.controller)

    def _run(self, command: list[str]) -> None:
        assert self._processes is not None
        words = self._command(command)
        run(self._processes, words, self.folder, self._variables, self._limits, self._printed)

    @property
    def _variables(self) -> Mapping[str, str]:
        """The variables that the command gets, also for temporary files, which go with the work folder.

        Not where their paths would be too long for the sockets that programs make there.
        """
        folder = self.folder / _TEMPORARY
        if len(str(folder)) > _LONGEST_TEMPORARY:
            return self.environment
        folder.mkdir(exist_ok=True)
        return {**dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(folder)), **self.environment}

    def _command(self, words: list[str]) -> list[str]:
        return [
            resolved_word(template.filled(self._values), self._here)
            for template in placeholders.command(tuple(words))
        ]

    def _ready(self) -> tuple[work_files.Instance, Processes]:
        """Return the instance and its processes, which are made where there are none."""
        if self._instance is None:
            place = private_folder() if self.options.work is None else self._here / self.options.work
            self._instance = work_files.Instance(place)
            if self.options.keep != "all":
                self._instance.clear()
            weakref.finalize(self, self._instance.close)
        if self._processes is None or not self._processes.is_alive:
            self._processes = Processes()
        return self._instance, self._processes

    def _placeholders(self, instance: work_files.Instance, episode: int) -> dict[str, Any]:
        """Return what can be put into the command beside the parameters."""
        values: dict[str, Any] = {
            "folder": self.folder,
            "here": self._here.resolve(),
            "instance": instance.number,
            "port": instance.port(),
            "episode": episode,
        }
        if self._stepped is None:
            values["parameters"] = self.folder / parameter_file.FILES[self.options.parameters_format]
        if self.takes_controller:
            values["controller"] = self.folder / self._controller_file
        if self.options.loads_weights:
            values["weights"] = self.folder / WEIGHTS
        if len(self.options.log) == 1:
            values["log"] = self.folder / self.options.log[0]
        return values

    def _write(self, name: str, data: bytes) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        return path

    def _log_files(self) -> dict[str, Path | bytes]:
        files: dict[str, Path | bytes] = {}
        if STANDARD_OUTPUT in self.options.log:
            files[STANDARD_OUTPUT] = bytes(self._printed.all or b"")
        paths = logs.find(self.folder, [log for log in self.options.log if log != STANDARD_OUTPUT])
        return files | {path.relative_to(self.folder).as_posix(): path for path in paths}

    # A command that is stepped.

    def _start(self) -> Start:
        instance = self._ready()[0]
        self.folder = instance.new_folder("stepwise")
        self._values = Values(self._placeholders(instance, next(self._episodes)))
        self.setEnvironment(self.options.environment)
        return Start(self._command(self.options.command), self.folder, self._variables)

    def _sensed(self, exchange: Callable[[], ArrayLike | None]) -> ArrayLike:
        """Exchange a message for sensors, zeros where the episode has ended."""
        assert self._stepped is not None
        try:
            sensors = exchange()
            self._measured = self._stepped.measured
            if self._stepped.done:
                self._check_used()
        except CommandFailure as failure:
            raise self._explained(failure, self._stepped.abandon()) from None
        return np.zeros((1, self.sensors)) if sensors is None else sensors
