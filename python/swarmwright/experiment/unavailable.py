"""Methods that are not installed here, and classes in files, which reading a run does not import.

Runs whose method is not installed can be read and evaluated, but not resumed. A class in a file is imported
where it is used, if the user trusts it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, NoReturn

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, ValidationError

from swarmwright.common.arrays import Fitness, Genomes
from swarmwright.common.errors import InputError
from swarmwright.common.problems import problems_of
from swarmwright.common.yaml import format_path
from swarmwright.controllers import Representation
from swarmwright.methods import Method, MethodOptions
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.methods.rankings import Ranking, RankingOptions
from swarmwright.simulations.user_code.copying import FOLDER, Copy, display_name
from swarmwright.simulations.user_code.permission import require_file, trusts_file


class UnavailableOptions(MethodOptions):
    """Options of a method that is not known here, as they were recorded."""

    model_config = ConfigDict(extra="allow")

    unavailable: ClassVar[bool] = True
    kind: str


class UnavailableMethod(Method):
    """In the place of a method that is not installed here: nothing of its options can be checked."""

    kind: ClassVar[str] = "unavailable"
    options_model = UnavailableOptions
    keeps_members = True
    steady_state = True

    def __init__(self, options: MethodOptions, representation: Representation, *, seed: int) -> None:  # noqa: ARG002
        require(options, None)

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:  # noqa: ARG003
        """Return nothing."""
        return {}

    @classmethod
    def no_start(cls, options: MethodOptions, count: int) -> str | None:  # noqa: ARG003
        """Return None: it has started."""
        return None

    @property
    def budget(self) -> int:
        """Not known."""
        raise NotImplementedError

    @property
    def population_fitness(self) -> Fitness:
        """Not known."""
        raise NotImplementedError

    def _ask(self) -> Genomes:
        raise NotImplementedError

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        raise NotImplementedError


class UnreadRankingOptions(RankingOptions):
    """Options of a ranking in a file that was not imported, as they were recorded."""

    model_config = ConfigDict(extra="allow")

    unavailable: ClassVar[bool] = True
    kind: str


class UnreadRanking(Ranking):
    """In the place of a ranking in a file that was not imported."""

    kind: ClassVar[str] = "unread"
    options_model = UnreadRankingOptions

    def _score(self, episodes: Sequence[Sequence[float]]) -> NDArray[np.float64]:
        raise NotImplementedError


def method_of(options: MethodOptions) -> type[Method]:
    """Return the class of a method by its options; a stand-in where these were read without it."""
    if isinstance(options, UnavailableOptions):
        return UnavailableMethod
    kind: str = options.kind
    return REGISTRIES["method"].get(kind)


def ranking_of(options: RankingOptions) -> type[Ranking]:
    """Return the class of a ranking by its options; a stand-in where these were read without it."""
    if isinstance(options, UnreadRankingOptions):
        return UnreadRanking
    kind: str = options.kind
    return REGISTRIES["ranking"].get(kind)


def is_unread(section: str, options: MethodOptions | RankingOptions) -> bool:
    """Whether options are those of a class in a file that was not imported when they were read."""
    stand_in = isinstance(options, UnavailableOptions | UnreadRankingOptions)
    return stand_in and REGISTRIES[section].is_in_file(options.kind)


def unreadable(options: RankingOptions) -> str | None:
    """Return why a run's ranking cannot be used to show what it makes of results; None where it can.

    Its code is not executed only to show a run, unless the user trusts it already.
    """
    if not is_unread("ranking", options) or trusts_file(options.kind):
        return None
    return (
        f"the ranking {display_name(options.kind)} makes it of the episodes, and its code is not of a run "
        "that was made here by this user; to trust it, give `swarmwright evaluate` --trust (in Python, "
        "Run.open(folder, trust=True))"
    )


def options_with_code(section: str, options: Any) -> Any:  # noqa: ANN401 - options of a method or a ranking
    """Return options as the class checks them, which is imported if a run named its file.

    Raises InputError for a class that is not trusted, or not right, and for options that it refuses.
    """
    if not is_unread(section, options):
        return options
    require_file(options.kind)
    model = REGISTRIES[section].get(options.kind).options_model
    try:
        return model.model_validate(options.model_dump(exclude_none=True))
    except ValidationError as error:
        found = problems_of(error, model, (section,))
        raise InputError("\n".join(f"{format_path(path)}: {words}" for path, words in found)) from error


def require(options: MethodOptions, folder: Path | None) -> None:
    """Raise InputError for the options of a method that is not installed here.

    folder: of the run, whose copy of the method's code is named.
    """
    if not isinstance(options, UnavailableOptions) or is_unread("method", options):
        return
    if options.kind not in REGISTRIES["method"].names():
        _refuse(options.kind, f"no package that is installed here has the method {options.kind!r}", folder)
    try:
        REGISTRIES["method"].get(options.kind)
    except InputError as error:
        _refuse(options.kind, str(error), folder)
    raise InputError(
        f"method.kind: {options.kind!r} has been installed since the run was opened; open it again"
    )


def _refuse(kind: str, reason: str, folder: Path | None) -> NoReturn:
    found = [] if folder is None else copies(folder, ["method"])
    copied = "".join(
        f"; the run used its module {module}, of which {place} is a copy" for module, place in found
    )
    raise InputError(
        f"method.kind: {reason}{copied}. Install the package that provides {kind!r}: resuming the run needs "
        "the method, everything else does not"
    )


def not_installed(values: Mapping[str, Any]) -> list[str]:
    """Return the sections of an experiment, `controller` or `ranking`, whose kind no package here has."""
    kinds = {
        section: values[section].get("kind")
        for section in ("controller", "ranking")
        if isinstance(values.get(section), Mapping)
    }
    return [
        section
        for section, kind in kinds.items()
        if isinstance(kind, str)
        and kind not in REGISTRIES[section].names()
        and not REGISTRIES[section].is_in_file(kind)
    ]


def copies(folder: Path, sections: Sequence[str]) -> Sequence[tuple[str, Path]]:
    """Return what the last version of a run's copy has of sections that are plug-ins: modules, and places."""
    versions = sorted(int(path.name) for path in (folder / FOLDER).glob("*") if path.name.isdecimal())
    copy = Copy.find(folder, versions[-1]) if versions else None
    if copy is None:
        return []
    kept = [copy.parts[section] for section in sections if section in copy.parts]
    return [(part.module or part.main, copy.main_path(part)) for part in kept]
