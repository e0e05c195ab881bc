"""Episodes that a simulation server computes and this process shows."""

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar, cast

from swarmwright import _engine
from swarmwright.common.errors import RunError, engine_errors
from swarmwright.common.time_limit import bound_seconds, check_time_limit
from swarmwright.common.untrusted import escape_line
from swarmwright.display import Playable, Recording, record
from swarmwright.experiment.derived import with_environment
from swarmwright.servers.broker.credentials import prepare
from swarmwright.servers.broker.waiting import connect_with_retries
from swarmwright.simulations import catalogue

if TYPE_CHECKING:
    from swarmwright.common.engine_types import Requirements
    from swarmwright.experiment.experiment import Experiment

Result = TypeVar("Result")

ATTEMPTS = 3
"""Attempts at an episode whose messages get lost."""

_LOGGER = logging.getLogger("swarmwright")


def begin(
    experiment: "Experiment", broker: str, parameters: dict[str, Any], controller: str
) -> _engine.RemoteEpisode:
    """Begin an episode on a server that has scenes.

    Args:
        experiment: names simulation, requirements, prefix and time-outs.
        broker: where servers are.
        parameters: parameters of the episode, `seed` among them.
        controller: its specification with weights, as JSON.

    Raises:
        RunError: no broker, no free server with scenes, or the episode did not begin.
        InputError: the address or the requirements cannot be used.
    """
    prepare(broker)
    prefix = with_environment(experiment).prefix
    requirements = cast("Requirements", experiment.requirements.model_dump(exclude_none=True))

    def attempt() -> _engine.RemoteEpisode:
        check_time_limit()
        return _engine.RemoteEpisode(
            broker,
            simulation=catalogue.title(experiment.simulation),
            parameters=parameters,
            requirements=requirements,
            controller=controller,
            prefix=prefix,
            discovery=bound_seconds(experiment.timeouts.discovery),
            step=bound_seconds(experiment.timeouts.step),
        )

    with engine_errors():
        return retry_lost(lambda: connect_with_retries(attempt, experiment.timeouts.connect, _LOGGER.warning))


def record_episode(make: Callable[[], tuple[_engine.RemoteEpisode, Playable]]) -> Recording:
    """Record an episode to its end; restart it if messages get lost.

    make: begins the episode and returns it with its playable view. Raises RunError if all attempts fail.
    """

    def attempt() -> Recording:
        episode, played = make()
        try:
            recording = record(played)
            if episode.missing:
                scenes = f"{episode.missing} scene{'s' * (episode.missing > 1)}"
                _LOGGER.warning("server %d: %s did not arrive and are left out", episode.server, scenes)
            return recording
        finally:
            episode.close()

    with engine_errors():
        return retry_lost(attempt)


def retry_lost(attempt: Callable[[], Result]) -> Result:
    """Call `attempt` again while messages get lost, and return its result.

    Raises RunError with the last reason if all attempts fail.
    """
    for number in range(1, ATTEMPTS + 1):
        try:
            return attempt()
        except _engine.LostError as error:
            reason = escape_line(str(error))
            if number == ATTEMPTS:
                raise RunError(f"{reason}; tried {ATTEMPTS} times") from error
            _LOGGER.warning("%s; restarting the episode", reason)
    raise AssertionError  # the last attempt returns or raises
