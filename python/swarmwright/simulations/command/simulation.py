"""Simulations that are commands, which use files (D6.1, 4.1) or standard input and output."""

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
    CapturedOutput,
    CommandFailure,
    Limits,
    Processes,
    ReportedFailure,
    resolve_word,
    run,
)
from swarmwright.simulations.command.stepwise import Dialogue, Start
from swarmwright.simulations.fitness import FITNESS_NAME, FitnessExpression
from swarmwright.simulations.parameters import Parameter
from swarmwright.simulations.user_code.command_sources import digest

_MOST_BUILDS = 32
"""Largest number of builds to keep; the least recently used ones are deleted."""


@contextmanager
def _lock(path: Path) -> Iterator[None]:
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _build_once(folder: Path, build: Callable[[Path], None]) -> None:
    """Create a folder and call `build` to fill it, unless that was done before. Raises its exceptions.

    folder: its name is a digest of its content; if there are many such folders beside it, the oldest are
    deleted.
    """
    folder.parent.mkdir(exist_ok=True)
    done = folder / ".done"
    with _lock(folder.parent / f"{folder.name[:2]}.lock"):
        if not done.exists():
            remove(folder)
            folder.mkdir()
            build(folder)
            done.touch()
            _delete_old_builds(folder.parent)
        os.utime(done)


def _delete_old_builds(builds: Path) -> None:
    """Delete builds that have not been used for a long time."""
    builds_by_time = []
    for done in builds.glob("*/.done"):
        with contextlib.suppress(OSError):
            builds_by_time.append((done.stat().st_mtime, done.parent))
    for _, folder in sorted(builds_by_time)[:-_MOST_BUILDS]:
        remove(folder)


class SteppedEpisodes:
    """The current episode of a stepwise command, and its process.

    Args:
        start: called before a process is started.
        limits: limits of an episode.
        recycle: most episodes of a process; 0 for any number.
        metrics: names of metrics that the last answer of an episode must have.
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
        """Metrics of the ended episode, and its fitness if the command reports it."""

    def reset(self, processes: Processes, parameters: Mapping[str, Any], seed: int) -> ArrayLike | None:
        """Start an episode; return the sensors of all agents, (agents, sensors), or None if it has ended.

        processes: starts the command; a new object if the previous one has ended.

        Raises CommandFailure for any failure, like `step`; the command is then ended.
        """
        if self._dialogue is None or processes is not self._processes:
            self._processes = processes
            self._dialogue = Dialogue(processes, self._start, self._limits, self._recycle)
        self.measured = {}
        return self._read_answer(self._dialogue.reset(parameters, seed))

    def step(self, actions: NDArray[np.float32]) -> ArrayLike | None:
        """Advance by one step; return the sensors like `reset`."""
        assert self._dialogue is not None
        return self._read_answer(self._dialogue.ask({"actuators": actions.tolist()}))

    def abandon(self) -> CapturedOutput:
        """End the command, whose state is unknown; return its output."""
        if self._dialogue is None:
            return CapturedOutput(0)
        self._dialogue.abandon()
        return self._dialogue.printed

    def _read_answer(self, answer: Mapping[str, Any]) -> ArrayLike | None:
        """Store the state in an answer; return its sensors."""
        self.done = answer.get("done") is True
        self.acting = answer.get("acting")
        if self.done:
            self.measured = self._results(answer)
        elif "sensors" not in answer:
            raise CommandFailure(f"answered {json.dumps(answer)[:80]}, which has neither sensors nor done")
        return answer.get("sensors")

    def _results(self, answer: Mapping[str, Any]) -> dict[str, float]:
        """Return fitness and declared metrics, possibly NaN or infinite, of an episode's last answer."""
        reported = answer.get("metrics") or {}
        if not isinstance(reported, Mapping):
            raise CommandFailure(f"metrics is {json.dumps(reported)[:40]}, expected {{NAME: NUMBER, ..}}")
        results = {name: reported[name] for name in self._metrics if name in reported}
        if FITNESS_NAME in answer or FITNESS_NAME in reported:
            results[FITNESS_NAME] = answer.get(FITNESS_NAME, reported.get(FITNESS_NAME))
        for name in self._metrics:
            if name not in results:
                available = ", ".join(reported) or "none"
                raise CommandFailure(f"ended the episode without the metric {name!r}; available: {available}")
        for name, value in results.items():
            if not isinstance(value, bool | int | float) or (
                name == FITNESS_NAME and isinstance(value, bool)
            ):
                raise CommandFailure(f"{name} is {json.dumps(value)[:40]}, expected a number")
        return {name: _to_float(value) for name, value in results.items()}


def _to_float(number: float) -> float:
    try:
        return float(number)
    except OverflowError:  # a large integer
        return math.inf if number > 0 else -math.inf


PREFIX = "controller"
_MAIN = {"json": ".json", "c": ".c", "cpp": ".hpp", "python": ".py", "onnx": ".onnx"}
"""Suffix of the file {controller}."""
WEIGHTS = f"{PREFIX}.weights"
"""Name of the file {weights}."""
_PARTS = {".c", ".h", ".hpp", ".py", ".onnx"}


def _main_file(form: str) -> str:
    """Return the name of the file {controller}."""
    return f"{PREFIX}{_MAIN[form]}"


def _make_weights_file(controller: Controller) -> bytes:
    """Return the content of the file {weights}."""
    return c.format_weights(Subject(controller.specification)).encode()


def _make_controller_files(
    form: str, controller: Controller, *, without_weights: bool = False
) -> dict[str, bytes]:
    """Return the files of a controller by name, without self-tests and their build files.

    without_weights: C code that reads its weights from a separate file.
    """
    if without_weights:
        sources = c.format_loadable_source(Subject(controller.specification), PREFIX)
        return {name: file_bytes(content) for name, content in sources.items()}
    if form == "json":
        return {_main_file(form): f"{controller.json}\n".encode()}
    exported = EXPORTERS.get(form)().files(Subject(controller.specification), PREFIX)
    return {
        name: file_bytes(content)
        for name, content in exported.items()
        if PurePosixPath(name).stem == PREFIX and PurePosixPath(name).suffix in _PARTS and "/" not in name
    }


_log = logging.getLogger("swarmwright")
_TEMPORARY = ".tmp"
"""Folder for temporary files in a work folder."""
_LONGEST_TEMPORARY = 60
"""Largest number of characters of its path, since the path of a socket has at most 107."""
_DIGITS = 12
"""Digits of the digest in a title."""


class CommandSimulation(Simulation):
    """A simulation that is a command; each episode is a process with its own folder.

    Most commands need only a definition in the experiment, `simulation: {command: ..}`. For others, derive a
    class with a `definition` that has the same keys, and override functions of D6.1 (4.1). They are called in
    this order for an episode: `setEnvironment`, `exportRepresentation` (for a controller that was not
    compiled before), `setParameters`, `run`, `readLogs`, which may use `getLogs`.

        class Rescue(CommandSimulation):
            definition = {"command": "python3 rescue.py {parameters}", "log": "rescue.txt"}
            metrics = ["rescued"]

            def readLogs(self):
                return {"rescued": self.getLogs()["rescue.txt"].count("RESCUED")}
    """

    definition: ClassVar[Mapping[str, Any]] = {}
    """The section `simulation` of an experiment; paths are relative to the file of the class."""
    adapted: ClassVar[str] = ""
    """The name from which the class was made; empty for a user-written class."""
    digest: ClassVar[str] = ""
    """SHA-256 of definition and files when the class was made; empty for a user-written class."""
    copies = False
    takes_controller = False
    most_steps = None
    """`timeout` is the limit."""
    steers_itself = True
    """Declared so that no episode is run to find out; parameter sets are possible."""
    _is_own_program: ClassVar[bool] = False
    """Whether the command is a program of Swarmwright, which reports complete messages."""
    visual: ClassVar[bool] = False
    """Whether to run episodes with `runVisual`, as for `swarmwright simulate --visual`."""

    folder: Path
    """The work folder of the episode."""
    build: Path | None = None
    """The folder where the controller is compiled; None if it is not compiled."""
    environment: dict[str, str]
    """Environment variables of the command, in addition to those of this process."""
    seed: int
    """Seed of the episode, 0 to 2**64 - 1."""

    def __init__(self) -> None:
        self.options = self._options()
        self._definition_folder = Path(self.options.folder)
        self.takes_controller = self.options.takes_controller
        self.title = type(self).title or self.options.title or self._title()
        self.sensors, self.actuators = self.options.sensors or 1, self.options.actuators or 1
        self.dimensions, self.determinism = self.options.dimensions, self.options.determinism
        self._expression = None if self.options.fitness is None else FitnessExpression(self.options.fitness)
        self._reductions = self.options.reductions
        if not self.metrics:
            names = () if self._expression is None else self._expression.metrics
            self.metrics = [name for name in self._reductions or names if name != FITNESS_NAME]
        if not self.parameters and self.options.parameters is not None:
            self.parameters = parameter_file.read_defaults(self._definition_folder / self.options.parameters)
        declared = {
            name: parameter for name, parameter in self.parameters.items() if isinstance(parameter, Parameter)
        }
        self._choices = self.options.choices | {
            name: declaration.choices
            for name, declaration in declared.items()
            if declaration.choices is not None
        }
        self._declared = {
            **self.parameters,
            **{name: declaration.default for name, declaration in declared.items()},
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
        """Messages about metrics that are NaN or infinite, by name."""

    @classmethod
    def _options(cls) -> CommandOptions:
        if cls.adapted:
            return CommandOptions.parse(cls.adapted)
        from swarmwright.simulations.command.checking import require_definition
        from swarmwright.simulations.loading import file_of

        file = file_of(cls)
        return require_definition(cls.definition, Path() if file is None else file.parent, cls.__name__)

    def _title(self) -> str:
        return f"{self._label}@{(self.digest or digest(self.options))[:_DIGITS]}"

    @property
    def _label(self) -> str:
        """Name of the simulation in messages and in its title."""
        return SimulationName.parse(self.options.name).label

    # The functions of D6.1.

    def setEnvironment(self, environment: Mapping[str, str]) -> None:  # noqa: N802 - D6.1's name
        """Set variables of the command's environment, with their placeholders filled in."""
        self.environment = {
            name: placeholders.variable(name, text).fill(self._values) for name, text in environment.items()
        }

    def setParameters(self, parameters: Mapping[str, Any]) -> None:  # noqa: N802 - D6.1's name
        """Write the parameter file and the definition's files into the work folder.

        parameters: all parameters of the simulation, and `seed`.
        """
        form = self.options.parameters_format
        self._write(parameter_file.FILES[form], parameter_file.format_file(parameters, form).encode())
        for name, path in work_files.resolve_files(self.options.files, self._definition_folder).items():
            data = work_files.read(path)
            text = work_files.decode_text(data)
            if text is not None:
                data = placeholders.file(name, text).fill(self._values).encode("utf-8", "surrogateescape")
            target = self._write(name, data)
            if os.access(path, os.X_OK):
                target.chmod(target.stat().st_mode | 0o100)

    def exportRepresentation(self, controller: Controller) -> None:  # noqa: N802 - D6.1's name
        """Write the controller for the simulator: into the work folder, or the folder of its build."""
        form, loads = self.options.controller, self.options.loads_weights
        for name, data in _make_controller_files(form, controller, without_weights=loads).items():
            (self.build or self.folder).joinpath(name).write_bytes(data)

    def run(self) -> None:
        """Run the command to its end."""
        self._run(self.options.command)

    def runVisual(self) -> None:  # noqa: N802 - D6.1's name
        """Run the command with a display: `visual` of the definition, else like `run`."""
        if self.options.visual is None:
            self.run()
        else:
            self._run(self.options.visual)

    def readLogs(self) -> Mapping[str, float]:  # noqa: N802 - D6.1's name
        """Return the metrics of the episode, and `fitness` if the logs have it."""
        required = {reduction.column for reduction in self._reductions.values()}
        required |= set(self.metrics) - set(self._reductions)
        if (self._expression is None and FITNESS_NAME not in self._reductions) or self._uses_reported_fitness:
            required.add(FITNESS_NAME)
        columns = logs.read(self._log_files(), self.options.log_format, required)
        plain = (set(self.metrics) | {FITNESS_NAME}) & set(columns)
        reductions = {name: Reduction("last", name) for name in sorted(plain)} | self._reductions
        for name, reduction in reductions.items():
            problem = columns[reduction.column].problem(reduction.function)
            if problem is not None and not problem.is_number:
                raise CommandFailure(problem.text)
            if problem is not None:
                self._unusable[name] = problem.text
        return {name: reduction.reduce(columns[reduction.column]) for name, reduction in reductions.items()}

    def getLogs(self) -> dict[str, str]:  # noqa: N802 - D6.1's name
        """Return the contents of the logs by file name; `stdout` is the output."""
        return {
            name: (file if isinstance(file, bytes) else file.read_bytes()).decode("utf-8", "replace")
            for name, file in self._log_files().items()
        }

    # Methods that the engine calls.

    def reset(self, parameters: dict[str, Any], seed: int, controller: str | None = None) -> ArrayLike:
        """Run the episode, or start a stepwise one; see `Simulation.reset`."""
        self.seed = seed
        self._measured, self._unusable = {}, {}
        self._check_choices(parameters)
        if self._stepped is not None:
            stepped, processes = self._stepped, self._prepare()[1]
            return self._exchange(lambda: stepped.reset(processes, parameters, seed))
        if controller is None and self.takes_controller:
            raise InputError(
                "simulation.controller: the command receives its controller as a file, which needs the mode "
                "offloaded and a controller of a kind other than parameter_set"
            )
        self._episode(parameters, None if controller is None else Controller(controller))
        return np.zeros((1, self.sensors))

    def step(self, actions: NDArray[np.float32]) -> ArrayLike:
        """Advance a stepwise command by one step."""
        stepped = self._stepped
        assert stepped is not None
        return self._exchange(lambda: stepped.step(actions))

    def done(self) -> bool:
        """Return whether the episode has ended."""
        return self._stepped is None or self._stepped.done

    def acting(self) -> ArrayLike | None:
        """Return the agents that act next."""
        return None if self._stepped is None else self._stepped.acting

    def fitness(self) -> float:
        """Return the value of the definition's expression, or the fitness in the logs."""
        if self._expression is None or not self._can_compute_expression:
            if FITNESS_NAME not in self._measured:
                raise EpisodeError(f"{self._label}: {self._missing_fitness}")
            return self._measured[FITNESS_NAME]
        row = np.array([[self._measured[name] for name in self._expression.metrics]])
        values, faults = self._expression(np.array([self._measured.get(FITNESS_NAME, 0.0)]), row)
        if faults:
            raise EpisodeError(f"fitness: {faults[0].reason}")
        return float(values[0])

    @property
    def _missing_fitness(self) -> str:
        """Message about a missing fitness, with remedies."""
        remedy = "give the experiment a `fitness`, an expression over metrics"
        if self._stepped is None:
            return f"readLogs has returned no fitness; return it, or {remedy}"
        return (
            'ended an episode without a fitness; write {"done": true, "fitness": NUMBER} in its last line, '
            f"or {remedy} that the command reports"
        )

    def measure(self) -> Mapping[str, float]:
        """Return the metrics."""
        return self._measured

    # Episodes with files.

    def _check_used(self) -> None:
        """Raise CommandFailure if the fitness depends on a number that is not finite."""
        expression = self._expression if self._can_compute_expression else None
        used = (
            [FITNESS_NAME]
            if expression is None
            else [*expression.metrics, *([FITNESS_NAME] if expression.uses_simulation_fitness else [])]
        )
        for name in used:
            value = self._measured.get(name, 0.0)
            if not math.isfinite(value):
                raise CommandFailure(
                    self._unusable.get(name) or f"{name} is {value}, expected a finite number"
                )

    @property
    def _uses_reported_fitness(self) -> bool:
        """Whether the fitness expression uses the fitness in the logs."""
        return self._expression is not None and self._expression.uses_simulation_fitness

    @property
    def _can_compute_expression(self) -> bool:
        """Whether its metrics are present: a stepwise command may report a fitness and no metrics."""
        return self._expression is not None and all(
            name in self._measured for name in self._expression.metrics
        )

    def _episode(self, parameters: Mapping[str, Any], controller: Controller | None) -> None:
        """Run an episode from files to files."""
        instance = self._prepare()[0]
        number = next(self._episodes)
        # A constant name, so that the same failure always has the same reason.
        name = f"episode-{number}" if self.options.keep == "all" else "episode"
        self.folder = instance.new_folder(name)
        for log in self.options.log:
            (self.folder / log).parent.mkdir(parents=True, exist_ok=True)
        # A parameter named like a placeholder is passed only in the parameter file.
        built_in = {"seed": self.seed} | self._placeholders(instance, number)
        self._values = Values(built_in, parameters, self._choices, self._declared)
        self._printed = CapturedOutput(self._limits.most_output, keep=STANDARD_OUTPUT in self.options.log)
        try:
            self._check_names(parameters)
            if controller is not None and self.options.compile is not None:
                self.build = self._get_build_folder(controller, instance.root)
                self._values |= {"build": self.build, "controller": self.build / self._controller_file}
            self.setEnvironment(self.options.environment)
            if controller is not None and self.options.compile is not None:
                self._compile(controller, self.options.compile)
            elif controller is not None:
                self.exportRepresentation(controller)
            if controller is not None and self.options.loads_weights:
                (self.folder / WEIGHTS).write_bytes(_make_weights_file(controller))
            self.setParameters({**parameters, "seed": self.seed})
            (self.runVisual if self.visual else self.run)()
            self._measured = {name: float(value) for name, value in self.readLogs().items()}
            self._check_used()
        except CommandFailure as failure:
            self._put_away(str(failure))
            raise self._make_episode_error(failure, self._printed) from None
        except (Exception, SystemExit) as error:  # raised by a derived class
            self._put_away(describe_exception(error))
            raise
        except BaseException:  # an interrupt is not a failure of the episode
            self._put_away()
            raise
        self._put_away()

    def _check_choices(self, parameters: Mapping[str, Any]) -> None:
        """Raise InputError for a value that is not among the declared choices."""
        for name, choices in self._choices.items():
            if name in parameters and not is_choice(parameters[name], choices):
                raise InputError(
                    f"{name}: {parameters[name]!r} found, expected one of {', '.join(map(repr, choices))} "
                    "(simulation.choices)"
                )

    def _check_names(self, parameters: Mapping[str, Any]) -> None:
        """Raise CommandFailure if a parameter has the name of a placeholder that is used.

        Such experiments are refused, but other tools may send such a parameter, which would have no effect.
        """
        declared = self.parameters
        for name, value in parameters.items():
            if name in self._placeholders_used and (name not in declared or declared[name] != value):
                raise CommandFailure(
                    f"the parameter {name} has the name of {{{name}}}, {IN_A_COMMAND[name]}, so its value "
                    "would not reach the command; rename the parameter and its placeholder"
                )

    @cached_property
    def _placeholders_used(self) -> frozenset[str]:
        """Swarmwright's placeholders, except the seed, in the command, its files and its environment."""
        options = self.options
        texts = [*options.command, *options.environment.values(), *(options.compile or ())]
        texts += options.visual or ()
        texts += [text for _, text in work_files.iterate_texts(options.files, self._definition_folder)]
        used = frozenset(name for text in texts for name in names_in(text))
        return used & IN_A_COMMAND.keys() - {"seed"}

    def _put_away(self, failure: str = "") -> None:
        """Remove the work folder or keep it, and log the folder of the first failure of each kind.

        The reason of a failed episode does not contain the folder, because runs count failures by reason.

        failure: the reason of the failure; empty if the episode did not fail.
        """
        instance, keep = self._instance, self.options.keep
        if instance is None or not self.folder.exists():
            return
        is_named = bool(failure) and instance.is_first_of_kind(failure)
        if keep == "failed" and is_named:
            folder = instance.keep_failed(self.folder)
        elif keep == "all":
            folder = self.folder
        else:
            remove(self.folder)
            return
        if is_named:
            _log.warning("%s: %s; the work folder of this episode is kept: %s", self._label, failure, folder)

    def _make_episode_error(self, failure: CommandFailure, printed: CapturedOutput) -> EpisodeError:
        """Return the error for a failure, with the last output of the command."""
        reason = str(failure)
        if self._is_own_program and isinstance(failure, ReportedFailure):
            reason = failure.reason
        last = f"; its last output: {printed.summary}" if printed.summary else ""
        return EpisodeError(f"{self._label}: {reason}{last}", printed.tail or None)

    def _compile(self, controller: Controller, command: list[str]) -> None:
        """Compile a controller, unless it, or another with the same source, was compiled before."""

        def build(folder: Path) -> None:
            assert self._processes is not None
            self.exportRepresentation(controller)
            words = self._command(command)
            run(self._processes, words, folder, self._variables, self._limits, self._printed)

        assert self.build is not None
        try:
            _build_once(self.build, build)
        except CommandFailure as failure:
            raise CommandFailure(f"compile: {failure}") from None

    def _get_build_folder(self, controller: Controller, root: Path) -> Path:
        """Return the folder for compiling a controller."""
        compiled = controller.json
        if self.options.loads_weights:
            compiled = json.dumps({**controller.specification, "weights": None}, sort_keys=True)
        key = hashlib.sha256(f"{self.digest or self.options.name}\n{compiled}".encode())
        return root / "builds" / key.hexdigest()

    @property
    def _controller_file(self) -> str:
        return _main_file(self.options.controller)

    def _run(self, command: list[str]) -> None:
        assert self._processes is not None
        words = self._command(command)
        run(self._processes, words, self.folder, self._variables, self._limits, self._printed)

    @property
    def _variables(self) -> Mapping[str, str]:
        """Environment variables of the command, which place temporary files in the work folder.

        The latter are left out if paths would be too long for sockets of the program.
        """
        folder = self.folder / _TEMPORARY
        if len(str(folder)) > _LONGEST_TEMPORARY:
            return self.environment
        folder.mkdir(exist_ok=True)
        return {**dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(folder)), **self.environment}

    def _command(self, words: list[str]) -> list[str]:
        return [
            resolve_word(template.fill(self._values), self._definition_folder)
            for template in placeholders.command(tuple(words))
        ]

    def _prepare(self) -> tuple[work_files.Instance, Processes]:
        """Return the instance and its processes, creating them if necessary."""
        if self._instance is None:
            root = (
                private_folder() if self.options.work is None else self._definition_folder / self.options.work
            )
            self._instance = work_files.Instance(root)
            if self.options.keep != "all":
                self._instance.clear()
            weakref.finalize(self, self._instance.close)
        if self._processes is None or not self._processes.is_alive:
            self._processes = Processes()
        return self._instance, self._processes

    def _placeholders(self, instance: work_files.Instance, episode: int) -> dict[str, Any]:
        """Return the values of Swarmwright's placeholders."""
        values: dict[str, Any] = {
            "folder": self.folder,
            "here": self._definition_folder.resolve(),
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

    # Stepwise episodes.

    def _start(self) -> Start:
        instance = self._prepare()[0]
        self.folder = instance.new_folder("stepwise")
        self._values = Values(self._placeholders(instance, next(self._episodes)))
        self.setEnvironment(self.options.environment)
        return Start(self._command(self.options.command), self.folder, self._variables)

    def _exchange(self, exchange: Callable[[], ArrayLike | None]) -> ArrayLike:
        """Send a message and return the sensors, zeros if the episode has ended."""
        assert self._stepped is not None
        try:
            sensors = exchange()
            self._measured = self._stepped.measured
            if self._stepped.done:
                self._check_used()
        except CommandFailure as failure:
            raise self._make_episode_error(failure, self._stepped.abandon()) from None
        return np.zeros((1, self.sensors)) if sensors is None else sensors
