"""S10: batched episodes, one message per step; S9.20 and S10.7: 64-bit seeds of evaluate and start."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmwright.common.json_text import Json
from swarmwright.conformance._extensions import (
    OTHER,
    TOOL,
    ControllerSet,
    answer_to,
    batch,
    controller_set,
    error_of,
    evaluation,
    free_again,
    must_be_refused,
    next_answer,
    numbers,
    play_episode,
)
from swarmwright.conformance._server_under_test import Server, Steer, Trajectory, is_same_fitness
from swarmwright.conformance.rules import Note, NotTried, Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.conformance.server.episodes import BEYOND_32_BITS, LARGEST_SEED
from swarmwright.conformance.server.offloaded import NUMBERS, SEEDS, list_controllers, request_fitness
from swarmwright.conformance.server.reservation import (
    HOLD_S,
    must_be_free_within,
    must_be_taken,
    short_patience,
)
from swarmwright.servers.broker.client import Failure

BATCHED = "protocol.md, Batched stepwise"
SILENT = "it gives up a batch without the error failed: is the tool to wait for its own time-out?"


class Batch:
    """A running batch: the rows that wait for actuators, and the fitness of finished episodes.

    patience: factor by which the first answer may take longer than the others.
    """

    def __init__(self, server: Server, seeds: Sequence[int], patience: int = 1, **changes: Any) -> None:  # noqa: ANN401 - JSON
        self.server = server
        self.request = batch(server, seeds, **changes)
        self.fitness: dict[int, float] = {}
        self.metrics: dict[int, dict[str, float]] = {}
        self.step = -1
        self.rows: list[tuple[int, int, NDArray[np.float32]]] = []
        self.sent = server.request(self.request)
        self.receive(patience)

    def receive(self, patience: int = 1) -> None:
        """Receive the next sensors message."""
        answer = answer_to(self.server, self.request, self.sent, patience * self.server.settings.timeout)
        kind, reason = error_of(answer)
        if kind:
            raise Failure(f'the error "{kind}" came: {reason}', "the sensors of the next step", self.sent)
        if answer.get("step") != self.step + 1:
            raise Failure(
                f'"step" is {answer.get("step")!r}', f"{self.step + 1}: steps count from 0", self.sent
            )
        self.step += 1
        episodes, agents = numbers(answer, "episodes", "<u4"), numbers(answer, "agents", "<u4")
        sensors = numbers(answer, "sensors", "<f4")
        each = self._sensors(len(episodes))
        if len(episodes) != len(agents) or len(sensors) != len(episodes) * each:
            came = f"{len(episodes)} episodes, {len(agents)} agents, {len(sensors)} sensors"
            raise Failure(came, f"as many agents as episodes, {each} sensors for each", self.sent)
        rows = sensors.reshape(len(episodes), each)
        self.rows = [
            (int(number), int(two), row) for number, two, row in zip(episodes, agents, rows, strict=True)
        ]
        ended, fitness = numbers(answer, "ended", "<u4"), numbers(answer, "fitness", "<f8")
        if len(ended) != len(fitness):
            raise Failure(f"{len(ended)} ended, {len(fitness)} fitness", "as many", self.sent)
        for index, (episode, value) in enumerate(zip(ended.tolist(), fitness.tolist(), strict=True)):
            self.fitness[episode] = value
            named = answer.get("metrics") or {}
            self.metrics[episode] = {name: float(numbers(named, name, "<f8")[index]) for name in named}

    def _sensors(self, rows: int) -> int:
        """Return the length of a row. Raises Failure if the simulation controls its agents itself."""
        if not self.server.steers_itself:
            return self.server.sensors
        if rows:
            raise Failure(f"{rows} agents are asked", "no rows: stepwise no agent is asked", self.sent)
        return 0

    def answer(self, values: Sequence[Sequence[float]], **changes: Any) -> str:  # noqa: ANN401 - JSON
        """Send a row of actuators for each row; return the sent message."""
        message: Json = {
            "kind": "actuators",
            "version": 1,
            "request": self.request["request"],
            "step": self.step,
            "actuators": np.array(values, dtype="<f4").tobytes(),
        } | changes
        self.sent = self.server.request(message)
        return self.sent

    def play(self, policy: Callable[[int, int, NDArray[np.float32]], Sequence[float]]) -> None:
        """Answer sensors until all episodes have ended."""
        while self.rows:
            self.answer([policy(*row) for row in self.rows])
            self.receive()


def _steps(server: Server) -> None:
    """Skip the rule unless the server steps batches and asks agents."""
    must_have_batches(server)
    _ = server.reference, server.actuators


def must_have_batches(server: Server) -> None:
    """Skip the rule unless the server offers batches; find out whether it asks agents."""
    server.announces(mode="batched")
    if not server.steers_itself:
        _ = server.actuators


def _zeros(server: Server) -> Callable[..., Sequence[float]]:
    return lambda *_: [0.0] * server.actuators


def _seeds(server: Server) -> list[int]:
    most = server.announced.get("batch", 1)
    return [3, 1, 2][: most if isinstance(most, int) else 1]


@rule(
    "S10.1",
    "A batch gives each episode its stepwise fitness, to the last bit.",
    where=f"{BATCHED}; decision 002",
    fix="give each episode a separate simulation; step all once the actuators have arrived",
    needs=["S2.3", "S3.2"],
)
def equal(server: Server) -> str:
    """Compare three episodes with three seeds, whose agents have a state.

    If the simulation asks no agents, the first message is the last.
    """
    must_have_batches(server)
    server.comparable()
    seeds = _seeds(server)
    controllers = None if server.steers_itself else controller_set(server, "fully_meshed", 1)
    steering = [Steer(controllers.specification(0)) for _ in seeds] if controllers else []
    turns: dict[tuple[int, int], int] = {}

    def act(episode: int, agent: int, sensors: NDArray[np.float32]) -> Sequence[float]:
        turn = turns.get((episode, agent), 0)
        turns[episode, agent] = turn + 1
        return steering[episode](agent, turn, sensors)

    def stepwise(seed: int) -> Trajectory:
        if controllers is None:
            return server.play(parameters={**server.settings.parameters, "seed": seed})
        trajectory: Trajectory = play_episode(server, controllers, 0, seed)
        return trajectory

    metrics = list(server.announced.get("metrics") or [])
    more: Json = {"metrics": metrics} if metrics else {}
    episodes = Batch(server, seeds, **more)
    episodes.play(act)
    free_again(server)
    for episode, seed in enumerate(seeds):
        trajectory = stepwise(seed)
        if not is_same_fitness(trajectory.fitness, episodes.fitness.get(episode)):
            came = f"seed {seed}: {episodes.fitness.get(episode)!r} batched, {trajectory.fitness!r} stepwise"
            raise Failure(came, "the same bits")
        for name in metrics:
            if name in trajectory.metrics and not is_same_fitness(
                trajectory.metrics[name], episodes.metrics[episode].get(name)
            ):
                batched = episodes.metrics[episode].get(name)
                came = f"{name}, seed {seed}: {batched!r} batched, {trajectory.metrics[name]!r} stepwise"
                raise Failure(came, "the same bits")
    return f"{len(seeds)} episodes, {episodes.step} steps"


@rule(
    "S10.2",
    "Actuators for another step, of the wrong number or not finite are refused, and it keeps waiting.",
    where=BATCHED,
    fix="compare step and the number of actuators with the last sensors message",
    needs=["S10.1"],
)
def refuses_actuators(server: Server) -> None:
    """Send wrong actuators in the first step, then the right ones."""
    _steps(server)
    episodes = Batch(server, _seeds(server)[:1])
    values = [[0.5] * server.actuators for _ in episodes.rows]
    nan = [[float("nan")] * server.actuators for _ in episodes.rows]
    tries: list[tuple[str, Sequence[Sequence[float]], Json]] = [
        ("the next step", values, {"step": episodes.step + 1}),
        ("a row too many", [*values, values[0]], {}),
        ("NaN", nan, {}),
        ("the number of no request", values, {"request": episodes.request["request"] + 1_000_000}),
        ("a list in place of binary", values, {"actuators": values}),
    ]
    for problem, rows, changes in tries:
        sent = episodes.answer(rows, **changes)
        for message in server.client.drain(server.quiet):
            if message.topic.endswith(server.token):
                raise Failure("an answer came", "silence: the actuators are wrong", f"{sent}: {problem}")
    episodes.play(_zeros(server))


@rule(
    "S10.3",
    "Actuators without numbers end the batch.",
    where=BATCHED,
    fix="end the batch on empty actuators; the server stays reserved for the tool",
    needs=["S10.1"],
)
def ends_on_empty(server: Server) -> None:
    """End a batch in its first step, then start another one."""
    _steps(server)
    episodes = Batch(server, _seeds(server))
    episodes.answer([])
    for message in server.client.drain(server.quiet):
        if message.topic.endswith(server.token):
            raise Failure("an answer came", "silence: the batch is over", episodes.sent)
    Batch(server, _seeds(server)).answer([])
    free_again(server)
    server.must_answer(
        "an answer: the batch is over", "actuators without numbers, then control with run: false"
    )


@rule(
    "S10.4",
    "Too many episodes and other wrong requests are answered with error invalid.",
    where=f"{BATCHED}; protocol.md, Messages of numbers",
    fix="compare the number of seeds with your batch; check every field before the start",
    needs=["S10.1"],
)
def invalid(server: Server) -> None:
    """Send a batch with one episode too many, none, an unknown simulation, and another version."""
    must_have_batches(server)
    most = server.announced.get("batch")
    if isinstance(most, int):
        must_be_refused(
            server, batch(server, range(most + 1)), ["invalid"], f"it announces batches of {most}"
        )
    must_be_refused(server, batch(server, []), ["invalid"], "there is no seed")
    must_be_refused(
        server, batch(server, [1], simulation="no such simulation"), ["invalid"], "it is not offered"
    )
    must_be_refused(server, batch(server, [1], version=2), ["invalid"], "the version is unknown")
    must_be_refused(
        server, batch(server, [1], metrics=["no_such_metric"]), ["invalid"], "there is no such metric"
    )


@rule(
    "S10.5",
    "During a batch, others get taken and no discovery is answered; a free server answers start "
    "for another instance with taken.",
    where="protocol.md, Messages of numbers; protocol.md, Two servers with one ID",
    fix="reserve on start as on control with a tool, and for 5 s after the batch; compare instance, if "
    "present, with yours",
    needs=["S10.1"],
)
def is_reserved(server: Server) -> None:
    """Send another tool's batch and discoveries during a batch; then batches for another and this instance.

    If the simulation asks no agents, the batch is over at once and the server is reserved.
    """
    must_have_batches(server)
    episodes = Batch(server, _seeds(server))
    why = f"a batch of {TOOL} is under way" if episodes.rows else f"it is held for {TOOL}"
    must_be_refused(server, batch(server, [1], tool=OTHER), ["taken"], why)
    must_be_taken(server, why, "start")
    episodes.play(_zeros(server))
    must_be_taken(server, f"it is held for {TOOL}", "a whole batch")
    free_again(server)
    server.must_come_free("an answer to every tool", f'control with run: false and "tool": "{TOOL}"')
    if instance := server.instance:
        other = batch(server, [1], instance=f"not {instance}")
        must_be_refused(server, other, ["taken"], "another instance of the server is meant")
        Batch(server, [1], instance=instance).play(_zeros(server))


@rule(
    "S10.6",
    "A batch accepts as many episodes as announced.",
    where="protocol.md, Presence",
    fix="announce in capabilities.swarmwright.batch only what you can step side by side",
    needs=["S10.1"],
    seconds=90,
)
def full(server: Server) -> str:
    """Start and end a batch of the largest size."""
    must_have_batches(server)
    most = server.announced.get("batch")
    if not isinstance(most, int):
        raise Skip("not announced: no capabilities.swarmwright.batch")
    episodes = Batch(server, range(min(most, 1000)), patience=12)
    received = {episode for episode, _, _ in episodes.rows} | set(episodes.fitness)
    if len(received) != min(most, 1000):
        raise Failure(f"{len(received)} episodes came", f"{min(most, 1000)}", episodes.sent)
    if episodes.rows:
        episodes.answer([])
    return f"{most} episodes"


@rule(
    "S10.8",
    "Control with run: false from its tool, with any hash, ends a batch and frees the server.",
    where="protocol.md, Messages of numbers",
    fix="on run: false with the batch's tool, drop the batch and answer discovery again",
    needs=["S10.1"],
)
def can_be_cancelled(server: Server) -> None:
    """Send run: false in the first step of a batch, then its actuators nevertheless."""
    _steps(server)
    episodes = Batch(server, _seeds(server))
    free_again(server)
    sent = f'control with run: false and "tool": "{TOOL}" in the first step of a batch'
    server.must_come_free("an answer to every tool: the batch is over", sent)
    episodes.answer([[0.0] * server.actuators for _ in episodes.rows])
    for message in server.client.drain(server.quiet):
        if message.topic.endswith(server.token):
            raise Failure(
                "an answer came", "silence: the batch was cancelled", f"{sent}, then {episodes.sent}"
            )


@rule(
    "S10.9",
    "It aborts a batch without actuators after its time-out.",
    where=BATCHED,
    fix="measure the time since a step began; after the time-out, answer error failed and drop the batch",
    needs=["S10.1"],
    seconds=60,
)
def gives_up(server: Server) -> Note:
    """Send no actuators until the time-out. The server may stay reserved for a while.

    Silence is accepted, too, since earlier protocols did not demand the error; but the tool waits in vain.
    """
    _steps(server)
    patience = short_patience(server)
    episodes = Batch(server, _seeds(server)[:1])
    expected = f"free after {patience:g} s without actuators"
    sent = f"{episodes.sent}, then no actuators"
    start = time.monotonic()
    answer = next_answer(server, episodes.request, sent, patience + server.settings.timeout)
    kind, reason = ("", "") if answer is None else error_of(answer)
    if answer is not None and kind != "failed":
        came = f'the error "{kind}" came: {reason}' if kind else "sensors came"
        raise Failure(came, 'the error "failed"', sent)
    must_be_free_within(server, HOLD_S + 3, expected, sent)
    text = f"free after {time.monotonic() - start:.1f} s"
    if answer is None:
        return Note(f'{text}; the error "failed" did not come: tools wait for their own time-out', SILENT)
    return Note(text)


_SEEDS = (BEYOND_32_BITS + 1, 2**53 + 1, LARGEST_SEED)
"""Seeds of evaluate and start that change if bits are lost."""
_OTHER_SEED = 5
"""The seed in the `parameters` of evaluate and start, which the message's seeds replace."""
_SEEDS_FIX = (
    "read each of seeds as an unsigned 64-bit integer and put it into the parameters, replacing their seed"
)


@rule(
    "S9.20",
    "All 64 bits of the seeds of evaluate count, and replace a seed in its parameters.",
    where=f"{NUMBERS}; protocol/schemas/evaluate.schema.json",
    fix=_SEEDS_FIX,
    needs=["S3.5", "S9.3", "S9.6"],
)
def seeds_of_evaluations(server: Server) -> None:
    """Use seeds beyond 32 and beyond 53 bits, with another seed in the parameters.

    Other rules cover controllers whose offloaded fitness is wrong with every seed.
    """
    controllers = list_controllers(server, 1)
    server.comparable()
    parameters = {**server.settings.parameters, "seed": _OTHER_SEED}
    request = evaluation(server, controllers, _SEEDS, parameters=parameters)
    fitness = numbers(request_fitness(server, request), "fitness", "<f8").tolist()
    free_again(server)
    if len(fitness) != len(_SEEDS):
        raise Failure(f"{len(fitness)} numbers", f"{len(_SEEDS)}, one for each episode")

    def stepwise(seed: int) -> Trajectory:
        trajectory: Trajectory = play_episode(server, controllers, 0, seed)
        return trajectory

    for seed, value in zip(_SEEDS, fitness, strict=True):
        expected = stepwise(seed).fitness
        if not is_same_fitness(expected, value):
            _must_be_right(server, controllers)
            agrees = partial(_has_fitness, value)
            cause = _describe_lost_seed(stepwise, seed, agrees)
            raise Failure(
                f"seed {seed}: {value!r} offloaded, {expected!r} stepwise{cause}",
                "the same bits",
                f'evaluate with the seeds {list(_SEEDS)}, and "seed": {_OTHER_SEED} in parameters',
            )


def _must_be_right(server: Server, controllers: ControllerSet) -> None:
    """Raise NotTried unless a controller has its stepwise fitness with a single, small seed."""
    parameters = {name: value for name, value in server.settings.parameters.items() if name != "seed"}
    request = evaluation(server, controllers, SEEDS[:1], parameters=parameters)
    fitness = numbers(request_fitness(server, request), "fitness", "<f8").tolist()
    free_again(server)
    stepwise: Trajectory = play_episode(server, controllers, 0, SEEDS[0])
    if len(fitness) != 1 or not is_same_fitness(stepwise.fitness, fitness[0]):
        kind = controllers.architecture["kind"]
        raise NotTried(
            f"controllers of the kind {kind} give another fitness offloaded than stepwise with the seed "
            f"{SEEDS[0]}, too"
        )


@rule(
    "S10.7",
    "All 64 bits of the seeds of start count, and replace a seed in its parameters.",
    where=f"{BATCHED}; protocol/schemas/batch_start.schema.json",
    fix=_SEEDS_FIX,
    needs=["S3.5", "S10.1"],
)
def seeds_of_batches(server: Server) -> None:
    """Use seeds beyond 32 and beyond 53 bits, one per batch, with another seed in the parameters."""
    must_have_batches(server)
    server.comparable()
    parameters = {**server.settings.parameters, "seed": _OTHER_SEED}
    for seed in _SEEDS:
        trajectory = Trajectory()

        def act(
            _episode: int, agent: int, sensors: NDArray[np.float32], trajectory: Trajectory = trajectory
        ) -> list[float]:
            readings = trajectory.readings[agent]
            readings.append(sensors)
            return list(server.policy(agent, len(readings) - 1, sensors))

        episodes = Batch(server, [seed], parameters=parameters)
        episodes.play(act)
        free_again(server)
        trajectory.fitness = episodes.fitness.get(0)
        difference = _difference(server, seed, trajectory)
        if difference:
            cause = _describe_lost_seed(
                lambda other: _stepwise(server, other),
                seed,
                lambda other, trajectory=trajectory: not _differs(other, trajectory),  # type: ignore[misc]
            )
            raise Failure(
                f"seed {seed}, stepwise and batched: {difference}{cause}",
                "the same bits",
                f'start with the seed {seed}, and "seed": {_OTHER_SEED} in parameters',
            )


def _stepwise(server: Server, seed: int) -> Trajectory:
    return server.play(parameters={**server.settings.parameters, "seed": seed})


def _difference(server: Server, seed: int, trajectory: Trajectory) -> str:
    return _differs(_stepwise(server, seed), trajectory)


def _differs(stepwise: Trajectory, batched: Trajectory) -> str:
    """Describe the first difference; metrics are not compared, since none were requested."""
    return stepwise.difference(replace(batched, metrics=stepwise.metrics))


def _has_fitness(fitness: float, trajectory: Trajectory) -> bool:
    return is_same_fitness(trajectory.fitness, fitness)


def _describe_lost_seed(
    played: Callable[[int], Trajectory], seed: int, agrees: Callable[[Trajectory], bool]
) -> str:
    """Describe the wrong seed with which an episode of `seed` was played; empty if none is found.

    played: returns the episode of a seed. agrees: returns whether the result is that episode.
    """
    causes = {
        _OTHER_SEED: "which is in parameters",
        seed & 0xFFFF_FFFF: "as if it were truncated to 32 bits",
        int(float(seed)): "as if it were read through a double, which has 53 bits",
    }
    for other, cause in causes.items():
        if other not in {seed, 2**63} and agrees(played(other)):
            return f", as with the seed {other}, {cause}"
    return ""
