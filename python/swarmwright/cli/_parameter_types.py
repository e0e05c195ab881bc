"""Types of the values of options and arguments, and options for outputs that have several names."""

import errno
import math
import os
import shlex
from pathlib import Path
from typing import Any, ClassVar

import click

from swarmwright.common.suggestions import did_you_mean
from swarmwright.experiment.broker_address import broker_problem, prefix_problem

LARGEST_ID = 2**63 - 1
"""Largest id of a server, in the protocol."""


class WholeNumber(click.IntRange):
    """A whole number in a range, with a clear error for anything else."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:  # noqa: ANN401 - click's signature
        """The number."""
        try:
            int(value)
        except ValueError:
            self.fail(f"'{value}' is not a valid integer: give a whole number.", param, ctx)
        return int(super().convert(value, param, ctx))


class RealNumber(click.FloatRange):
    """A number in a range; NaN, which no limit excludes, is none."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:  # noqa: ANN401 - click's signature
        """The number."""
        found = float(super().convert(value, param, ctx))
        if math.isnan(found):
            self.fail(f"'{value}' is not a number.", param, ctx)
        return found


class FiniteNumber(click.ParamType[float]):
    """Any finite number; help shows no range, which those of a float would make unreadable."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:  # noqa: ANN401 - click's signature
        """The number."""
        found = float(click.FLOAT.convert(value, param, ctx))
        if not math.isfinite(found):
            self.fail(f"'{value}' is not a finite number.", param, ctx)
        return found


class BrokerUrl(click.ParamType[str]):
    """Address of a broker; without password, because every user of the machine can list processes."""

    name = "url"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The address as it is, when nothing is wrong with it."""
        problem = broker_problem(value)
        if problem:
            self.fail(f"the broker's address {problem}.", param, ctx)
        return value


class Prefix(click.ParamType[str]):
    """The first levels of all topics."""

    name = "prefix"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The prefix as it is, when nothing is wrong with it."""
        problem = prefix_problem(value)
        if problem:
            self.fail(f"'{value}' {problem}.", param, ctx)
        return value


class ExistingPath(click.ParamType[Path]):
    """A file or folder that is there; a mistyped one is answered with its nearest neighbour.

    folder: whether a folder is wanted rather than a file; None takes either. for_experiment: what an
    experiment file is for where the folder of a run is wanted; `FILE` and `PAGE` in it are replaced.
    """

    name = "path"

    def __init__(self, *, folder: bool | None = False, for_experiment: str = "") -> None:
        self.folder = folder
        self.for_experiment = for_experiment

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path, if it is there and of the right kind."""
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
        """Return what to do with a file of a run or with an experiment file, empty for another one."""
        if (file.parent / "run.sqlite").is_file():
            return f": name the folder of the run, {shlex.quote(str(file.parent))}"
        if file.suffix.lower() not in {".yaml", ".yml"}:
            return ""
        if not self.for_experiment:
            return f": name the folder of a run; 'swarmwright optimize {shlex.quote(str(file))}' makes one"
        page = shlex.quote(f"{file.stem}.html")
        return f", {self.for_experiment.replace('FILE', shlex.quote(str(file))).replace('PAGE', page)}"


class ControllerOrCandidate(click.ParamType[str]):
    """A file with a controller, the folder of a run, or a candidate of it, `RUN:GENERATION:CANDIDATE`."""

    name = "controller"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """What was given, if the file or folder is there."""
        run, *numbers = value.rsplit(":", 2)
        if len(numbers) == 2 and not Path(value).exists():
            ExistingPath(folder=True).convert(run, param, ctx)
            CandidateId().convert(":".join(numbers), param, ctx)
        else:
            ExistingPath(folder=None).convert(value, param, ctx)
        return value


class OutputFile(click.ParamType[Path]):
    """A file to be written later, checked as far as possible before the work whose results it gets."""

    name = "path"

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path, if a file can be there."""
        path = Path(value)
        if path.is_dir():
            self.fail(f"'{path}' is a folder where a file is expected.", param, ctx)
        if not path.parent.is_dir():
            self.fail(f"'{path}': there is no folder '{path.parent}'; create it first.", param, ctx)
        place = path if path.exists() else path.parent
        if not os.access(place, os.W_OK):
            reason = errno.EROFS if os.statvfs(place).f_flag & os.ST_RDONLY else errno.EACCES
            self.fail(f"{path}: cannot be written: {os.strerror(reason)}", param, ctx)
        return path


class OutputFolder(click.ParamType[Path]):
    """A folder to write into, which may not exist yet."""

    name = "path"

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path; "" does not mean the working folder, which is '.'."""
        if value == "":
            self.fail("it is empty; name a folder, or '.' for the working folder.", param, ctx)
        return Path(value)


class OutputOption(click.Option):
    """An option that names what is written; other names that users expect are accepted as well, unlisted."""

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
    """The same for a file with what is shown otherwise."""

    aliases = (*OutputOption.aliases, "--save")


def _experiment_in(folder: Path) -> str:
    """Return what may be meant by the folder of a run, empty for another folder."""
    if not (folder / "run.sqlite").is_file():
        return ""
    return (
        f": name the experiment of this run, {folder}/experiment.yaml, or continue the run with 'swarmwright "
        f"resume {shlex.quote(str(folder))}'"
    )


def _target(link: Path) -> str:
    """Return what a link names."""
    try:
        return os.fspath(link.readlink())
    except OSError:  # it has gone
        return "something"


def _nearest(path: Path) -> str:
    try:
        neighbours = [entry.name for entry in path.parent.iterdir()]
    except OSError:
        return f" (nor does its folder '{path.parent}')" if not path.parent.exists() else ""
    return did_you_mean(path.name, neighbours)


Servers = int | str
_SERVER_WORDS = ("auto", "local", "in-process")


class ServerCount(click.ParamType[Servers]):
    """`auto`, `local`, `in-process`, a number of servers, or launchers with numbers, `slurm:4`."""

    name = "auto|local|in-process|N|LAUNCHER:N"

    def convert(self, value: str | int, param: click.Parameter | None, ctx: click.Context | None) -> Servers:
        """The word or the number."""
        if value in _SERVER_WORDS or (isinstance(value, str) and ":" in value):
            return value
        try:
            number = int(value)
        except ValueError:
            self.fail(
                f"'{value}' is neither a number of servers nor 'auto', 'local' or 'in-process', nor a "
                f"launcher with a number, such as slurm:4{_leave_out_hint(str(value))}.",
                param,
                ctx,
            )
        if not 1 <= number <= 1024:
            self.fail(f"{number} is not in the range 1..1024.", param, ctx)
        return number


def _leave_out_hint(value: str) -> str:
    """Return what to do for the launcher of the experiment, empty for a text that is no launcher."""
    from swarmwright.servers.launchers import LAUNCHERS

    return "; leave --servers out to use the experiment's" if value in LAUNCHERS.names() else ""


class CandidateId(click.ParamType[tuple[int | None, int]]):
    """`G:N`, a candidate of a generation; or `N`, an evaluation of the whole run."""

    name = "candidate"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int | None, int]:
        """Generation, if one is named, and candidate."""
        number = WholeNumber(min=0, max=2**63 - 1)
        generation, colon, candidate = value.rpartition(":")
        if not all(
            part.isascii() and part.isdigit() for part in (candidate, *([generation] if colon else []))
        ):
            self.fail(
                f"'{value}' is not G:N, such as 19:3: generation and candidate, both from 0.", param, ctx
            )
        return (
            number.convert(generation, param, ctx) if colon else None,
            number.convert(candidate, param, ctx),
        )


class Renamed(click.ParamType[tuple[str, str]]):
    """A name and another one for it."""

    name = "GROUP=NAME"

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's signature
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[str, str]:
        """Split it at the first equals sign."""
        if isinstance(value, tuple):
            return value
        old, equals, new = str(value).partition("=")
        if not old or not equals or not new.strip():
            self.fail(f"{value!r} is not GROUP=NAME, such as nnga='genetic algorithm'.", param, ctx)
        return old, new.strip()


class ObjectiveValue(click.ParamType[tuple[str, float]]):
    """`NAME=VALUE`, a value of an objective."""

    name = "value"

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's signature
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[str, float]:
        """The name and the value."""
        if isinstance(value, tuple):
            return value
        name, equals, number = value.partition("=")
        if not name or not equals:
            self.fail(f"'{value}' is not NAME=VALUE, such as fitness=0.", param, ctx)
        return name, FiniteNumber().convert(number, param, ctx)
