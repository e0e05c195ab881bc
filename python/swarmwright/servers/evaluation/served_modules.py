"""Behaviours and conditions in Python on a simulation server, as the engine calls them."""

import json
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright import _engine
from swarmwright.common.errors import InputError, RunError, SimulationError
from swarmwright.common.tracebacks import is_installed
from swarmwright.controllers.modules import grammar
from swarmwright.controllers.modules.grammar import Module
from swarmwright.controllers.modules.played import PlayedEpisode
from swarmwright.servers.evaluation.machines import LANES, MachineEvaluations
from swarmwright.servers.evaluation.module_code import ROLES, offered, sha256_of

_STACK = 8000
"""Characters of a traceback that are kept, of its end."""
_REMEMBERED = 100
"""Different failures that are reported, so that each is reported once."""

Report = Callable[[str, str], None]
"""Gets reason and traceback of a failure."""


class ServedModules:
    """The modules that a simulation server offers.

    Machines that came through the broker are made of these alone: they name modules, by their code's SHA-256,
    and nothing else is imported for them.

    Args:
        names: of the modules, see `module_code.offered`.
        simulation: its title, or a host.
        report: gets failures of their code, once for each reason.

    Raises InputError for modules that are not there, or not right.
    """

    def __init__(self, names: Sequence[str], simulation: Any, report: Report) -> None:  # noqa: ANN401 - as the engine takes it
        self._simulation = simulation
        self._report = report
        self._reported: set[str] = set()
        self._offered = {
            (role, module.name, sha256_of(role, module)): module
            for (role, _), many in offered(names).items()
            for module in many
        }
        self.together = LANES if isinstance(simulation, str) else 1
        """Episodes that are computed in about the time of one."""

    @property
    def announced(self) -> list[dict[str, str]]:
        """What the server says of each module, see docs/reference/protocol.md."""
        found = []
        for (role, name, sha256), module in self._offered.items():
            values = {"role": role, "name": name, "file": module.file or None, "sha256": sha256}
            found.append({key: value for key, value in values.items() if value is not None})
        return found

    def begin(
        self,
        architecture: dict[str, Any],
        weights: NDArray[np.float32],
        seeds: Sequence[int],
        parameters: dict[str, Any],
        metrics: Sequence[str],
    ) -> MachineEvaluations:
        """Begin to evaluate candidates. Raises the engine's InputError for machines of other modules."""
        with _refusals():
            return MachineEvaluations(
                self._simulation,
                parameters,
                self._made_of_these(architecture),
                weights,
                seeds,
                metrics,
                together=self.together,
                isolate=True,
            )

    def play(self, specification: str, parameters: dict[str, Any]) -> "ServedEpisode":
        """Begin one episode. Raises as `begin`."""
        values = json.loads(specification)
        with _refusals():
            machine = {**values, **self._made_of_these(values)}
            seed = int(parameters.get("seed", 0))
            return ServedEpisode(PlayedEpisode(self._simulation, parameters, seed, machine), self._tell)

    def _made_of_these(self, architecture: Mapping[str, Any]) -> dict[str, Any]:
        """Return a specification of the modules that are here: parameters are in the order of their class."""
        found = dict(architecture)
        for role, key in ROLES.items():
            found[key] = [
                self._module(role, grammar.module_of(module_name)).as_mapping()
                for module_name in architecture[key]
            ]
        return found

    def _module(self, role: str, wanted: Module) -> Module:
        if wanted.built_in:
            return wanted
        same = (
            module
            for (other, name, sha256), module in self._offered.items()
            if (other, name) == (role, wanted.name) and wanted.sha256 in ("", sha256)
        )
        found = next(same, None)
        if found is None:
            raise InputError(
                f"controller: this server does not have {role} {wanted.name!r}, or other code of it"
            )
        if dict(found.parameters) != dict(wanted.parameters):
            raise InputError(f"controller: {role} {wanted.name!r} has other parameters on this server")
        return found

    def _tell(self, reason: str, stack: str) -> None:
        if reason not in self._reported and len(self._reported) < _REMEMBERED:
            self._reported.add(reason)
            self._report(reason, stack)


class ServedEpisode:
    """An episode of which a failure is reported with its traceback."""

    def __init__(self, episode: PlayedEpisode, tell: Report) -> None:
        self._episode = episode
        self._tell = tell

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self._episode.done

    @property
    def fitness(self) -> float:
        """Fitness so far."""
        return self._episode.fitness

    @property
    def metric_names(self) -> list[str]:
        """Names of all metrics."""
        return self._episode.metric_names

    def metrics(self, names: list[str]) -> list[float]:
        """Return the named metrics so far."""
        return self._episode.metrics(names)

    def step(self) -> None:
        """Advance by one step. Raises SimulationError when the code of a module fails."""
        try:
            self._episode.step()
        except RunError as error:
            stack = _stack(error.__cause__)
            self._tell(str(error), stack)
            raise SimulationError(str(error), stack or None) from error


@contextmanager
def _refusals() -> Iterator[None]:
    """Raise what is wrong with a request as the engine takes it."""
    try:
        yield
    except InputError as error:
        raise _engine.InputError(str(error)) from None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise _engine.InputError(f"controller: is not a machine of modules: {error!r}") from None


def _stack(error: BaseException | None) -> str:
    """Return the traceback of what a module's code raised, from that code on; empty where nothing was."""
    if error is None:
        return ""
    first = trace = error.__traceback__
    while trace is not None and is_installed(trace.tb_frame.f_code.co_filename):
        trace = trace.tb_next
    text = "".join(traceback.format_exception(type(error), error, trace or first)).rstrip()
    return text if len(text) <= _STACK else f"...{text[3 - _STACK :]}"
