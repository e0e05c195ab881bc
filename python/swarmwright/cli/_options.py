"""Options that commands share, and the types of their values."""

import errno
import functools
import json
import math
import os
import shlex
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import click
from click.core import ParameterSource

from swarmwright.cli._output import Output, print_note
from swarmwright.common.suggestions import did_you_mean
from swarmwright.experiment.broker_address import (
    PREFIX_VARIABLE,
    broker_problem,
    environment_prefix,
    prefix_problem,
)

if TYPE_CHECKING:
    from swarmwright import Experiment

LARGEST_ID = 2**63 - 1
"""Largest id of a server, in the protocol."""


class WholeNumber(click.IntRange):
    """A whole number in a range, with a clear error for anything else."""

    name = "n"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:  # noqa: ANN401 - click's signature
        """The number."""
        try:
            int(value)
        except ValueError:
            self.fail(f"'{value}' is not a valid integer: give a whole number.", param, ctx)
        return int(super().convert(value, param, ctx))


class RealNumber(click.FloatRange):
    """A number in a range; NaN, which no limit excludes, is refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:  # noqa: ANN401 - click's signature
        """The number."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if math.isnan(number):
            self.fail(f"'{value}' is not a number.", param, ctx)
        return float(super().convert(value, param, ctx))


class Seconds(RealNumber):
    """A duration in a range."""

    name = "seconds"


# Types below are functions: click reports the option, and the message of `click.BadParameter`.


def finite_number(value: str) -> float:
    """Parse any finite number; help shows no range."""
    number = float(click.FLOAT(value))
    if not math.isfinite(number):
        raise click.BadParameter(f"'{value}' is not a finite number.")
    return number


def broker_url(value: str) -> str:
    """Check a broker's address, which must have no password: other users can list processes."""
    problem = broker_problem(value)
    if problem:
        raise click.BadParameter(f"the broker's address {problem}.")
    return value


def topic_prefix(value: str) -> str:
    """Check a topic prefix, the first levels of all topics."""
    problem = prefix_problem(value)
    if problem:
        raise click.BadParameter(f"'{value}' {problem}.")
    return value


class ExistingPath(click.ParamType[Path]):
    """An existing file or folder; for a mistyped path, the error suggests its nearest neighbour.

    folder: True for a folder, False for a file, None for either. for_experiment: hint for an experiment file
    in place of a run folder; `FILE` and `PAGE` in it are replaced.
    """

    def __init__(self, *, folder: bool | None = False, for_experiment: str = "") -> None:
        self.name = "dir" if folder else "file"
        self.folder = folder
        self.for_experiment = for_experiment

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check that the path exists and is of the right kind."""
        path = Path(value)
        if not path.exists():
            if path.is_symlink():
                self.fail(f"'{path}' is a link to '{_target(path)}', which does not exist.", param, ctx)
            self.fail(f"'{path}' does not exist{_nearest(path)}.", param, ctx)
        if self.folder is True and not path.is_dir():
            self.fail(f"'{path}' is a file where a folder is expected{self._instead(path)}.", param, ctx)
        if self.folder is False and path.is_dir():
            self.fail(f"'{path}' is a folder where a file is expected{_experiment_in(path)}.", param, ctx)
        if not os.access(path, os.R_OK):
            self.fail(f"'{path}' may not be read by this user.", param, ctx)
        return path

    def _instead(self, file: Path) -> str:
        """Return a hint for a file of a run or for an experiment file; empty for other files."""
        if (file.parent / "run.sqlite").is_file():
            return f": name the folder of the run, {shlex.quote(str(file.parent))}"
        if file.suffix.lower() not in {".yaml", ".yml"}:
            return ""
        if not self.for_experiment:
            return f": name the folder of a run; 'swarmwright optimize {shlex.quote(str(file))}' makes one"
        page = shlex.quote(f"{file.stem}.html")
        return f", {self.for_experiment.replace('FILE', shlex.quote(str(file))).replace('PAGE', page)}"


def controller_or_candidate(value: str) -> str:
    """Check a file with a controller, the folder of a run, or a candidate `RUN:GENERATION:CANDIDATE`."""
    run, *numbers = value.rsplit(":", 2)
    if len(numbers) == 2 and not Path(value).exists():
        ExistingPath(folder=True).convert(run, None, None)
        candidate_id(":".join(numbers))
    else:
        ExistingPath(folder=None).convert(value, None, None)
    return value


class OutputFile(click.ParamType[Path]):
    """A file to write later, checked as far as possible before the work starts."""

    name = "file"

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check that the file can be written."""
        path = Path(value)
        if path.is_dir():
            self.fail(f"'{path}' is a folder where a file is expected.", param, ctx)
        if not path.parent.is_dir():
            self.fail(f"'{path}': there is no folder '{path.parent}'; create it first.", param, ctx)
        target = path if path.exists() else path.parent
        if not os.access(target, os.W_OK):
            reason = errno.EROFS if os.statvfs(target).f_flag & os.ST_RDONLY else errno.EACCES
            self.fail(f"{path}: cannot be written: {os.strerror(reason)}", param, ctx)
        return path


def output_folder(value: str) -> Path:
    """Return a folder to write into, which may not exist yet; refuse "", which does not mean '.'."""
    if value == "":
        raise click.BadParameter("it is empty; name a folder, or '.' for the working folder.")
    return Path(value)


class OutputOption(click.Option):
    """An option for an output file or folder; names that users expect are accepted too, but not listed."""

    aliases: ClassVar[tuple[str, ...]] = ("--out", "--output")

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:  # noqa: ANN401 - click renames its class
        """Add all names; help and errors have those of the decorator."""
        listed = self.opts
        self.opts = [*listed, *(name for name in self.aliases if name not in listed)]
        try:
            super().add_to_parser(parser, ctx)
        finally:
            self.opts = listed


class SaveOption(OutputOption):
    """An output option for a file with content that is shown otherwise."""

    aliases = (*OutputOption.aliases, "--save")


def _experiment_in(folder: Path) -> str:
    """Return a hint for the folder of a run in place of a file; empty for other folders."""
    if not (folder / "run.sqlite").is_file():
        return ""
    return (
        f": name the experiment of this run, {folder}/experiment.yaml, or continue the run with 'swarmwright "
        f"resume {shlex.quote(str(folder))}'"
    )


def _target(link: Path) -> str:
    """Return the target of a link."""
    try:
        return os.fspath(link.readlink())
    except OSError:  # deleted meanwhile
        return "something"


def _nearest(path: Path) -> str:
    try:
        neighbours = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return f" (nor does its folder '{path.parent}')" if not path.parent.exists() else ""
    return did_you_mean(path.name, neighbours)


Servers = int | str
_SERVER_WORDS = ("auto", "local", "in-process")


def server_count(value: str) -> Servers:
    """Parse `auto`, `local`, `in-process`, a number of servers, or launchers with numbers, `slurm:4`."""
    if value in _SERVER_WORDS or ":" in value:
        return value
    try:
        number = int(value)
    except ValueError:
        raise click.BadParameter(
            f"'{value}' is neither a number of servers nor 'auto', 'local' or 'in-process', nor a "
            f"launcher with a number, such as slurm:4{_leave_out_hint(value)}."
        ) from None
    if not 1 <= number <= 1024:
        raise click.BadParameter(f"{number} is not in the range 1..1024.")
    return number


def _leave_out_hint(value: str) -> str:
    """Return a hint for the name of a launcher without a number; empty for other texts."""
    from swarmwright.servers.launchers import LAUNCHERS

    return "; leave --servers out to use the experiment's" if value in LAUNCHERS.names() else ""


def candidate_id(value: str) -> tuple[int | None, int]:
    """Parse `G:N`, a candidate of a generation, or `N`, an evaluation of the whole run; G is None then."""
    number = WholeNumber(min=0, max=2**63 - 1)
    parts = value.split(":")
    if len(parts) > 2 or not all(part.isascii() and part.isdigit() for part in parts):
        raise click.BadParameter(
            f"'{value}' is not G:N, such as 19:3: generation and candidate, both from 0."
        )
    *generation, candidate = (number.convert(part, None, None) for part in parts)
    return (generation[0] if generation else None), candidate


def parse_new_name(value: str) -> tuple[str, str]:
    """Split a group or task from its new name at the first equals sign."""
    old, equals, new = value.partition("=")
    if not old or not equals or not new.strip():
        raise click.BadParameter(f"{value!r} is not GROUP=NAME, such as nnga='genetic algorithm'.")
    return old, new.strip()


def objective_value(value: str) -> tuple[str, float]:
    """Parse `NAME=VALUE`, a value of an objective."""
    name, equals, number = value.partition("=")
    if not name or not equals:
        raise click.BadParameter(f"'{value}' is not NAME=VALUE, such as fitness=0.")
    return name, finite_number(number)


Decorator = Callable[[Any], Any]


def combine_options(*options: Decorator) -> Decorator:
    """Return a decorator that adds several options, in the order of the help."""

    def decorate(command: Any) -> Any:  # noqa: ANN401 - click's decorators
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def gather(make: Callable[..., Mapping[str, Any]], *options: Decorator) -> Decorator:
    """Return a decorator that adds options, from whose values `make` makes arguments of the command.

    make: gets the values by name.
    """

    def holder() -> None:
        """Hold the options, whose names are read from it."""

    combine_options(*options)(holder)
    parameters: list[click.Parameter] = holder.__click_params__  # type: ignore[attr-defined]
    names = [parameter.name for parameter in parameters if parameter.expose_value]

    def decorate(command: Any) -> Any:  # noqa: ANN401 - click's decorators
        @functools.wraps(command)
        def with_arguments(**values: Any) -> Any:  # noqa: ANN401 - the command's
            own = {name: values.pop(name) for name in names}
            return command(**make(**own), **values)

        return combine_options(*options)(with_arguments)

    return decorate


def _is_set(option: str) -> bool:
    """Return whether an option of the current command is on the command line."""
    context = click.get_current_context()
    name = next(each.name for each in context.command.params if option in each.opts)
    return context.get_parameter_source(name or "") is ParameterSource.COMMANDLINE


def exclude(option: str, *others: str) -> None:
    """Raise UsageError if an option and one of the others are on the command line."""
    for other in others:
        if _is_set(option) and _is_set(other):
            raise click.UsageError(f"{option} and {other} exclude each other; leave one out.")


def need(option: str, *others: str) -> None:
    """Raise UsageError if an option is on the command line without any of the others."""
    if _is_set(option) and not any(map(_is_set, others)):
        added = "it" if len(others) == 1 else "one"
        raise click.UsageError(f"{option} needs {' or '.join(others)}; add {added}, or leave out {option}.")


servers_option: Decorator = click.option(
    "--servers",
    type=server_count,
    metavar="N",
    help="""\b
N           start N servers on this machine
auto        one per processor, 2 to 8; local
            in notebooks and with modules in
            Python
local       no servers: this process, or one
            per processor for Python code
in-process  no servers: this process alone
LAUNCHER:N  servers elsewhere: slurm:200, or
            slurm:100,process:2""",
)

simulation_option: Decorator = click.option(
    "--simulation", metavar="FILE:CLASS", help="Python class to use if the run's was edited or moved."
)


def _trust(context: click.Context, _parameter: click.Parameter, is_set: bool) -> None:
    if is_set:
        from swarmwright.simulations.user_code.trust import trusting

        context.with_resource(trusting())


trust_option: Decorator = click.option(
    "--trust",
    is_flag=True,
    expose_value=False,
    callback=_trust,
    help="Execute the code in a run folder from another machine. Remembered for this code.",
)


def set_option(text: str) -> Decorator:
    """Add `--set KEY=VALUE`, with this help, which overrides values of the experiment and can be repeated."""
    return click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="KEY=VALUE",
        help=f"{text} VALUE is YAML; null restores the default. Repeatable.",
    )


json_option: Decorator = click.option(
    "--json",
    "output",
    is_flag=True,
    callback=lambda _context, _parameter, is_set: Output(as_json=is_set),
    help="Print one JSON object per line.",
)
"""`--json`; the command gets `output`, an `Output`."""


def _choose_candidate(generation: int | None, chosen: tuple[int | None, int] | None) -> dict[str, int | None]:
    in_generation, number = chosen or (None, None)
    if in_generation is not None and generation is not None:
        raise click.UsageError(
            f"--candidate {in_generation}:{number} names the generation; leave out --generation."
        )
    return {"generation": generation if in_generation is None else in_generation, "candidate": number}


candidate_options = gather(
    _choose_candidate,
    click.option(
        "--candidate",
        "chosen",
        type=candidate_id,
        metavar="G:N",
        help="""\b
G:N  candidate N of generation G
N    with --generation: candidate N of it
N    alone: evaluation N of the whole run
Counted from 0. Default: the best.""",
    ),
    click.option(
        "--generation",
        type=WholeNumber(min=0, max=2**63 - 1),
        metavar="G",
        help="Generation, counted from 0. Without --candidate: its best candidate.",
    ),
)
"""`--candidate G:N`, or `--generation G --candidate N`: an evaluation in a run's record.

The command gets `generation` and `candidate`, as `Run.evaluation` takes them.
"""


BROKER_VARIABLE = "SWARMWRIGHT_BROKER"


def broker_option(*, default: str | None, text: str) -> Decorator:
    """Add `--broker URL`. SWARMWRIGHT_BROKER has priority over a default.

    Commands without a default read it after the experiment file: see `experiment_broker`.
    """
    return click.option(
        "--broker",
        type=broker_url,
        metavar="URL",
        default=default,
        envvar=BROKER_VARIABLE if default else None,
        show_envvar=bool(default),
        show_default=bool(default),
        help=text,
    )


peer_prefix_option: Decorator = click.option(
    "--prefix",
    type=topic_prefix,
    metavar="P",
    help=f"Topic prefix, such as lab/1. Default: {PREFIX_VARIABLE} on a named broker, or none.",
)
prefix_option: Decorator = click.option(
    "--prefix",
    type=topic_prefix,
    default="",
    metavar="P",
    envvar=PREFIX_VARIABLE,
    show_envvar=True,
    help="Topic prefix, such as lab/1. Default: none.",
)


def _clear_environment_prefix(
    _context: click.Context, _parameter: click.Parameter, prefix: str | None
) -> str | None:
    """Let an empty `--prefix`, which experiments cannot distinguish from none, override the environment's."""
    if prefix == "":
        os.environ.pop(PREFIX_VARIABLE, None)
    return prefix


experiment_prefix_option: Decorator = click.option(
    "--prefix",
    type=topic_prefix,
    metavar="P",
    callback=_clear_environment_prefix,
    help=f"Topic prefix. Default: the experiment's, {PREFIX_VARIABLE}, or none.",
)
"""`--prefix P` of commands that have an experiment, which may name a prefix itself."""


SERVERS_OF_EXPERIMENT = (
    "Use the servers on this broker. Default: the experiment's, SWARMWRIGHT_BROKER, or a private one."
)


def experiment_broker_options(text: str = SERVERS_OF_EXPERIMENT) -> Decorator:
    """Add `--broker URL`, with this help, and `--prefix P` to a command that has an experiment."""
    return combine_options(broker_option(default=None, text=text), experiment_prefix_option)


def prefix_settings(prefix: str | None) -> tuple[str, ...]:
    """Return `--prefix` as settings in the form of `--set`."""
    return () if prefix is None else (f"prefix={json.dumps(prefix)}",)


wait_option: Decorator = click.option(
    "--wait",
    type=Seconds(0, 31 * 86400.0),
    help="Time to wait for an unreachable broker. Default: the experiment's timeouts.connect, or 0.",
)


def experiment_broker(experiment: "Experiment", broker: str | None, servers: object = None) -> str | None:
    """Return the broker of an experiment: the option, then the experiment file, then the environment.

    None without a broker, and for evaluation in this process, which connects to none.
    """
    servers = experiment.servers if servers is None else servers
    if broker is not None or experiment.broker is not None or servers in ("local", "in-process"):
        return broker
    return environment_broker()


def peer_broker(broker: str | None, command: str | None) -> str | None:
    """Return the broker for checking a peer: the option, or without `command` the environment's.

    None without a broker: then the kit starts one.
    """
    chosen = environment_broker() if broker is None and command is None else broker
    if chosen is not None and "," in chosen:
        raise click.BadParameter("names several brokers; a peer is tried on one.", param_hint="'--broker'")
    return chosen


def peer_prefix(prefix: str | None, broker: str | None) -> str:
    """Return the prefix for checking a peer: the option, or on a named broker the environment's.

    A peer that the kit starts inherits it.
    """
    if prefix is None:
        prefix = "" if broker is None else environment_prefix()
    os.environ[PREFIX_VARIABLE] = prefix
    return prefix


def environment_broker() -> str | None:
    """Return the broker that the environment names, checked as the option is."""
    named = os.environ.get(BROKER_VARIABLE)
    try:
        return broker_url(named) if named else None
    except click.BadParameter as error:
        error.param_hint = f"'{BROKER_VARIABLE}' (environment)"
        raise


LINES = 20


@contextmanager
def _collect_server_output() -> Iterator[None]:
    from swarmwright.servers.supervision import listening_to_output

    last: deque[str] = deque(maxlen=LINES)
    try:
        with listening_to_output(last.append):
            yield
    finally:
        if last:
            print_note(f"The last output of the servers ({LINES} lines at most):", last)


def _show_server_output(context: click.Context, _parameter: click.Parameter, is_set: bool) -> None:
    if is_set:
        context.with_resource(_collect_server_output())


def server_output_option(command: Any) -> Any:  # noqa: ANN401 - click's decorators
    """Add `--server-output`, which the command itself does not receive."""
    option = click.option(
        "--server-output",
        is_flag=True,
        expose_value=False,
        callback=_show_server_output,
        help=f"At the end, show the last {LINES} output lines of local servers on standard error.",
    )
    return option(command)


HELD_OUT_SEEDS = (
    "Simulation seed of the first episode; the others count up. Default: held-out seeds that no run used."
)


def seed_option(text: str, *, default: int | None = None, most: int = 2**62) -> Decorator:
    """Add `--seed S`, with this help, default and largest value."""
    return click.option(
        "--seed",
        type=WholeNumber(min=0, max=most),
        metavar="S",
        default=default,
        show_default=default is not None,
        help=text,
    )


def controller_option(text: str) -> Decorator:
    """Add `--controller C`, a controller file or run folder, with this help."""
    return click.option("--controller", type=ExistingPath(folder=None), metavar="C", help=text)


def experiment_option(text: str) -> Decorator:
    """Add `--experiment FILE`, with this help; the command gets `experiment_file`."""
    return click.option("--experiment", "experiment_file", type=ExistingPath(folder=False), help=text)


def figure_option(name: str, text: str) -> Decorator:
    """Add an option for a figure to write, with this help; the command gets `file`."""
    return click.option(name, "file", cls=SaveOption, type=OutputFile(), help=text)


def target_option(metavar: str, text: str, *, required: bool = False) -> Decorator:
    """Add `--output FILE`, which is checked when it is written; the command gets `target`."""
    return click.option(
        "--output",
        "target",
        cls=OutputOption,
        type=click.Path(path_type=Path),
        metavar=metavar,
        required=required,
        help=text,
    )


def folder_option(text: str) -> Decorator:
    """Add `--out DIR`, with this help."""
    path = click.Path(path_type=Path, file_okay=False)
    return click.option("--out", cls=OutputOption, type=path, metavar="DIR", help=text)


force_option: Decorator = click.option(
    "--force",
    is_flag=True,
    help="Overwrite files that Swarmwright did not export, or that were edited since.",
)


def episodes_option(
    text: str, *, default: int | None = None, least: int = 1, most: int = 10_000_000
) -> Decorator:
    """Add `--episodes N`, with this help, default and range."""
    return click.option(
        "--episodes",
        type=WholeNumber(min=least, max=most),
        default=default,
        show_default=default is not None,
        help=text,
    )


def file_options(figure: str, table: str) -> Decorator:
    """Add `--out FILE` for a figure and `--csv FILE` for a table, with these help texts.

    The command gets `picture` and `table`, whose endings are checked before it runs.
    """
    return gather(
        _check_files,
        click.option("--out", "picture", cls=SaveOption, type=OutputFile(), help=figure),
        click.option("--csv", "table", type=OutputFile(), help=table),
    )


def _check_files(picture: Path | None, table: Path | None) -> dict[str, Path | None]:
    if picture is not None:
        from swarmwright.display.figures import style

        style.check_figure_path(picture)
    if table is not None:
        from swarmwright.analysis.table import CSV, check

        check(table, CSV)
    return {"picture": picture, "table": table}


def write_files(output: Output, result: Any, picture: Path | None, table: Path | None) -> None:  # noqa: ANN401
    """Write the files of `file_options`. result: has `plot` and `export`."""
    if table is not None:
        result.export(table)
        output.text(f"The table is in {table}")
    if picture is not None:
        result.plot(picture)
        output.text(f"The figure is in {picture}")
