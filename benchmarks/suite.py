"""What is measured: suites that take a sample of everything in a repetition, ours beside its floor."""

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from benchmarks.measurement import Samples


@dataclass(frozen=True, kw_only=True)
class Scale:
    """How much is done for one sample. seconds: what a saturated sample of the floor is to take.

    round_trips: of a ping-pong and of an episode. smaller: blocks of rollouts are divided by this. extras:
    whether libraries that only benchmarks need (JAX, Ray, Dask) are there.
    """

    repetitions: int = 5
    seconds: float = 0.7
    round_trips: int = 5000
    flood: int = 200_000
    smaller: int = 1
    extras: bool = True


QUICK = Scale(repetitions=1, seconds=0.02, round_trips=100, flood=2000, smaller=100, extras=False)


class NotBuiltError(Exception):
    """What a suite measures is not built on this machine; the message names it, and the command that does."""


class Suite(Protocol):
    """Figures that belong together."""

    def repeat(self) -> None:
        """Take one sample of everything."""

    def samples(self) -> list[Samples]:
        """Everything measured, in the order of the table."""

    def close(self) -> None:
        """End everything that was started."""


def _mqtt(scale: Scale) -> Suite:
    from benchmarks.broker_suite import MqttSuite

    return MqttSuite(scale.seconds, scale.round_trips, scale.flood)


def _build(_scale: Scale) -> Suite:
    from benchmarks.build import BuildSuite

    return BuildSuite()


def _program(_scale: Scale) -> Suite:
    from benchmarks.program import ProgramSuite

    return ProgramSuite()


def _rollouts(scale: Scale) -> Suite:
    from benchmarks.rollout import RolloutSuite

    return RolloutSuite(scale.smaller)


def _arena(scale: Scale) -> Suite:
    from benchmarks.arena import ArenaSuite

    return ArenaSuite(scale.smaller)


def _competition(scale: Scale) -> Suite:
    from benchmarks.competition import CompetitionSuite

    return CompetitionSuite(scale.smaller)


def _jax(_scale: Scale) -> Suite:
    from benchmarks.against_jax import JaxSuite

    return JaxSuite()


def _evosax(_scale: Scale) -> Suite:
    from benchmarks.against_evosax import EvosaxSuite

    return EvosaxSuite()


def _ribs(_scale: Scale) -> Suite:
    from benchmarks.against_ribs import RibsSuite

    return RibsSuite()


def _bound(scale: Scale) -> Suite:
    from benchmarks.bound import BoundSuite

    return BoundSuite(scale.smaller)


def _growth(_scale: Scale) -> Suite:
    from benchmarks.growth import GrowthSuite

    return GrowthSuite()


def _tasks(scale: Scale) -> Suite:
    from benchmarks.tasks import TaskSuite

    return TaskSuite(libraries=scale.extras, scale=scale.smaller)


def _ray(scale: Scale) -> Suite:
    from benchmarks.on_ray import RaySuite

    return RaySuite(scale=scale.smaller)


def _methods(scale: Scale) -> Suite:
    from benchmarks.methods import MethodSuite

    return MethodSuite(scale.smaller)


def _store(scale: Scale) -> Suite:
    from benchmarks.store import StoreSuite

    return StoreSuite(scale.smaller)


def _long(scale: Scale) -> Suite:
    from benchmarks.long import LongSuite

    return LongSuite(scale.smaller)


def _wrappers(scale: Scale) -> Suite:
    from benchmarks.wrappers import WrapperSuite

    return WrapperSuite(scale.smaller)


def _gazebo(scale: Scale) -> Suite:
    from benchmarks.gazebo import GazeboSuite

    return GazeboSuite(scale.smaller)


def _commands(scale: Scale) -> Suite:
    from benchmarks.commands import CommandSuite

    return CommandSuite(scale.smaller)


def _window(scale: Scale) -> Suite:
    from benchmarks.window import WindowSuite

    return WindowSuite(scale.smaller)


def _busy(_scale: Scale) -> Suite:
    from benchmarks.busy import BusySuite

    return BusySuite()


def _servers(_scale: Scale) -> Suite:
    from benchmarks.on_servers import ServersSuite

    return ServersSuite()


def _frevo(_scale: Scale) -> Suite:
    from benchmarks.whole import WholeSuite

    return WholeSuite()


SUITES: dict[str, Callable[[Scale], Suite]] = {
    "mqtt": _mqtt,
    "rollouts": _rollouts,
    "arena": _arena,
    "competition": _competition,
    "jax": _jax,
    "evosax": _evosax,
    "ribs": _ribs,
    "bound": _bound,
    "growth": _growth,
    "tasks": _tasks,
    "ray": _ray,
    "methods": _methods,
    "store": _store,
    "long": _long,
    "wrappers": _wrappers,
    "gazebo": _gazebo,
    "commands": _commands,
    "window": _window,
    "busy": _busy,
    "servers": _servers,
    "frevo": _frevo,
    "program": _program,
    "build": _build,
}
"""By name, which `--only` searches."""
QUICK_SUITES = (
    "mqtt",
    "rollouts",
    "arena",
    "competition",
    "bound",
    "tasks",
    "methods",
    "store",
    "wrappers",
    "commands",
)
"""Those that take seconds and need no library for Python of their own."""


def run(scale: Scale, only: str = "") -> Iterator[tuple[str, Callable[[], list[Samples]]]]:
    """Yield the suites whose names match the pattern `only`: the name, and what measures.

    Raises SystemExit where there is none. What measures raises NotBuiltError, or whatever goes wrong.
    """
    names = [name for name in SUITES if re.search(only, name)]
    if not names:
        raise SystemExit(f"--only {only}: no suite's name matches; there are: {', '.join(SUITES)}")
    for name in names:
        if scale == QUICK and name not in QUICK_SUITES:
            continue
        yield name, partial(_measure, SUITES[name], scale)


def _measure(make: Callable[[Scale], Suite], scale: Scale) -> list[Samples]:
    with contextlib.closing(make(scale)) as suite:
        for _ in range(scale.repetitions):
            suite.repeat()
        return suite.samples()
