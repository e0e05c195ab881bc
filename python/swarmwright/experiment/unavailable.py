"""Stand-ins for methods that are not installed, and for classes in files that reading a run does not import.

Runs whose method is not installed can be read and evaluated, but not resumed. A class in a file is imported
when it is used, if the user trusts it.
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
    """Recorded options of an unavailable method."""

    model_config = ConfigDict(extra="allow")

    unavailable: ClassVar[bool] = True
    kind: str


class UnavailableMethod(Method):
    """Stand-in for a method that is not installed, whose options cannot be checked."""

    kind: ClassVar[str] = "unavailable"
    options_model = UnavailableOptions
    keeps_members = True
    steady_state = True

    def __init__(self, options: MethodOptions, representation: Representation, *, seed: int) -> None:  # noqa: ARG002
        require_method(options, None)

    @classmethod
    def problems(cls, options: MethodOptions, representation: Representation | None) -> dict[str, str]:  # noqa: ARG003
        """Return no problems."""
        return {}

    @classmethod
    def no_start(cls, options: MethodOptions, count: int) -> str | None:  # noqa: ARG003
        """Return None, as the run has started."""
        return None

    @property
    def budget(self) -> int:
        """Raise NotImplementedError, as the method is unavailable."""
        raise NotImplementedError

    @property
    def population_fitness(self) -> Fitness:
        """Raise NotImplementedError, as the method is unavailable."""
        raise NotImplementedError

    def _ask(self) -> Genomes:
        raise NotImplementedError

    def _tell(self, genomes: Genomes, fitness: Fitness) -> None:
        raise NotImplementedError


class UnreadRankingOptions(RankingOptions):
    """Recorded options of a ranking in a file that was not imported."""

    model_config = ConfigDict(extra="allow")

    unavailable: ClassVar[bool] = True
    kind: str


class UnreadRanking(Ranking):
    """Stand-in for a ranking in a file that was not imported."""

    kind: ClassVar[str] = "unread"
    options_model = UnreadRankingOptions

    def _score(self, episodes: Sequence[Sequence[float]]) -> NDArray[np.float64]:
        raise NotImplementedError


def method_of(options: MethodOptions) -> type[Method]:
    """Return the class of a method by its options, or a stand-in if it was not imported."""
    if isinstance(options, UnavailableOptions):
        return UnavailableMethod
    kind: str = options.kind
    return REGISTRIES["method"].get(kind)


def ranking_of(options: RankingOptions) -> type[Ranking]:
    """Return the class of a ranking by its options, or a stand-in if it was not imported."""
    if isinstance(options, UnreadRankingOptions):
        return UnreadRanking
    kind: str = options.kind
    return REGISTRIES["ranking"].get(kind)


def is_unread(section: str, options: MethodOptions | RankingOptions) -> bool:
    """Whether options belong to a class in a file that was not imported."""
    stand_in = isinstance(options, UnavailableOptions | UnreadRankingOptions)
    return stand_in and REGISTRIES[section].is_in_file(options.kind)


def explain_unreadable(options: RankingOptions) -> str | None:
    """Return why a run's ranking cannot be used to show its results, or None.

    Its code is not executed just to show a run, unless the user already trusts it.
    """
    if not is_unread("ranking", options) or trusts_file(options.kind):
        return None
    return (
        f"it is computed by the ranking {display_name(options.kind)}, whose code comes from a run of another "
        "user or machine; to trust it, use `swarmwright evaluate --trust`, or Run.open(folder, trust=True)"
    )


def options_with_code(section: str, options: Any) -> Any:  # noqa: ANN401 - options of a method or a ranking
    """Check options by their class, which is imported if it is in a file of a run.

    Raises InputError for an untrusted or invalid class, and for options that it refuses.
    """
    if not is_unread(section, options):
        return options
    require_file(options.kind)
    model = REGISTRIES[section].get(options.kind).options_model
    try:
        return model.model_validate(options.model_dump(exclude_none=True))
    except ValidationError as error:
        problems = problems_of(error, model, (section,))
        raise InputError("\n".join(f"{format_path(path)}: {words}" for path, words in problems)) from error


def require_method(options: MethodOptions, folder: Path | None) -> None:
    """Raise InputError for the options of a method that is not installed.

    folder: folder of the run, whose copy of the method's code is mentioned.
    """
    if not isinstance(options, UnavailableOptions) or is_unread("method", options):
        return
    if options.kind not in REGISTRIES["method"].names():
        _refuse(options.kind, f"no installed package provides the method {options.kind!r}", folder)
    try:
        REGISTRIES["method"].get(options.kind)
    except InputError as error:
        _refuse(options.kind, str(error), folder)
    raise InputError(
        f"method.kind: {options.kind!r} was installed after the run was opened; open the run again"
    )


def _refuse(kind: str, reason: str, folder: Path | None) -> NoReturn:
    modules = [] if folder is None else find_copies(folder, ["method"])
    copied = "".join(f"; the run used its module {module}, copied to {path}" for module, path in modules)
    raise InputError(
        f"method.kind: {reason}{copied}. To resume the run, install the package that provides {kind!r}"
    )


def find_not_installed(values: Mapping[str, Any]) -> list[str]:
    """Return the sections of an experiment, `controller` or `ranking`, whose kind is not installed."""
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


def find_copies(folder: Path, sections: Sequence[str]) -> Sequence[tuple[str, Path]]:
    """Return module and path of plug-in sections in the last version of a run's copy."""
    versions = sorted(int(path.name) for path in (folder / FOLDER).glob("*") if path.name.isdecimal())
    copy = Copy.find(folder, versions[-1]) if versions else None
    if copy is None:
        return []
    parts = [copy.parts[section] for section in sections if section in copy.parts]
    return [(part.module or part.main, copy.main_path(part)) for part in parts]
