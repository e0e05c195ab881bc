"""S1 to S4: discovery, episodes from parameters to fitness, their determinism, handling of actuators."""

import json
import statistics
import time
from contextlib import suppress

from swarmwright.common.json_text import Json, is_number, new_hash
from swarmwright.conformance._server_under_test import Always, Episode, Policy, Server, Trajectory, Wander
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.servers.broker.client import Failure, Message, format_payload

EPISODE = "protocol.md, An episode, 1"


@rule(
    "S1.1",
    "A free server answers a discovery of a simulation that it offers.",
    where=EPISODE,
    fix="subscribe to discovery; publish on server if the title is yours and the requirements are fulfilled",
    d61="5.2.3; 6.2 Discovery message",
)
def answers(server: Server) -> None:
    """Send a discovery; accept any answer with the server's ID."""
    question = server.discovery()
    sent = f"discovery {json.dumps(question)}"
    server.client.send("discovery", **question)
    answer = server.client.next(server.is_answer, server.settings.timeout)
    if answer is None:
        came = f"nothing arrived within {server.settings.timeout:g} s"
        raise Failure(came, f"a message on server with server {server.id}", sent)
    server.note_capabilities(answer.json)


@rule(
    "S1.2",
    "The answer repeats the hash of the discovery.",
    where="protocol.md, Topics",
    fix="copy simulation_hash from the discovery unchanged",
    d61="6.2 Server message; 7.2.4, Schemas 8 and 9",
    needs=["S1.1"],
)
def echoes(server: Server) -> None:
    """Send two discoveries with different hashes. Answers to earlier ones may be late."""
    for _ in range(2):
        before = set(server.question_hashes)
        question = server.discovery()
        hash_ = question["simulation_hash"]
        sent = server.client.send("discovery", **question)
        limit = time.monotonic() + server.settings.timeout
        late: Message | None = None
        while answer := server.client.next(server.is_answer, max(limit - time.monotonic(), 0.0)):
            echoed = answer.json.get("simulation_hash")
            if echoed == hash_:
                break
            if not (isinstance(echoed, str) and echoed in before):
                raise Failure(f"{answer} arrived", f'"simulation_hash": "{hash_}"', sent)
            late = answer
        else:
            came = "nothing came" if late is None else f"{late} arrived, which answers an earlier discovery"
            raise Failure(came, "an answer to each discovery", sent)


@rule(
    "S1.3",
    "The answer has all keys: server, simulation_hash, simulations with the title, capabilities "
    "with dimensions.",
    where="protocol/schemas/server.schema.json",
    fix="send every required key with the type in the schema",
    d61="6.2 Server message, Schema 2",
    needs=["S1.2"],
)
def has_its_keys(server: Server) -> None:
    """Check the keys and types of the answer."""
    answer = server.must_answer("an answer")
    text = f"server {format_payload(json.dumps(answer))} arrived"
    titles, capabilities = answer.get("simulations"), answer.get("capabilities")
    if not isinstance(titles, list) or not all(isinstance(title, str) for title in titles):
        raise Failure(text, '"simulations" is a list of titles')
    if server.settings.title not in titles:
        raise Failure(text, f'"simulations" has "{server.settings.title}", which was asked for')
    if not isinstance(capabilities, dict) or not is_number(capabilities.get("dimensions")):
        raise Failure(text, '"capabilities" is an object with the number "dimensions"')
    for key in ("max_agents", "max agents"):
        if key in capabilities and not is_number(capabilities[key]):
            raise Failure(text, f'"{key}" is a number, or left out for no limit')


@rule(
    "S1.4",
    "It does not answer a discovery of another simulation.",
    where=EPISODE,
    fix="compare the discovery's simulation with your titles exactly",
    d61="6.2 Discovery message, Server message",
    needs=["S1.2"],
)
def ignores_other_titles(server: Server) -> None:
    """Send titles that are almost right."""
    title = server.settings.title
    others = [f"{title}2", "", f"no {title}"]
    server.must_not_answer((server.discovery(simulation=other) for other in others), "another simulation")


@rule(
    "S1.5",
    "It does not answer if another number of dimensions is required.",
    where=EPISODE,
    fix="answer only if requirements.dimensions equals your dimensions",
    needs=["S1.2"],
)
def ignores_other_dimensions(server: Server) -> None:
    """Require one dimension more, one less, and half a dimension more."""
    dimensions = server.settings.dimensions
    answer = server.must_answer("an answer")
    if answer.get("capabilities", {}).get("dimensions") != dimensions:
        raise Failure(
            f"server {format_payload(json.dumps(answer))} arrived",
            f'"dimensions" is {dimensions:g}, as the discovery required',
            f'discovery with "requirements": {{"dimensions": {dimensions:g}}}',
        )
    others = [server.discovery(requirements={"dimensions": dimensions + more}) for more in (1, -1, 0.5)]
    server.must_not_answer(others, f"it has {dimensions:g} dimensions")


@rule(
    "S1.6",
    "It answers if no more agents are required than its max_agents, and not if more are.",
    where=EPISODE,
    fix="answer only if max_agents is missing on either side or sufficient",
    d61="6.2 Discovery message, Schema 1; Server message, Schema 2",
    needs=["S1.2"],
)
def many_agents(server: Server) -> None:
    """Require exactly as many agents as announced, and one more, spelled as in Schema 1."""
    if server.max_agents is None:
        raise Skip("the server announces no max_agents: no limit")
    compare_agents(server, "max_agents", server.max_agents)


def compare_agents(server: Server, key: str, most: float) -> None:
    """Require as many agents as announced, then one more. Raises Failure if an answer is wrong."""
    needs = {"dimensions": server.settings.dimensions}
    fits = server.discovery(requirements={**needs, key: most})
    server.must_answer(
        f'an answer: "{key}" is not above what it announces',
        f"discovery {format_payload(json.dumps(fits))}",
        requirements=fits["requirements"],
    )
    many = server.discovery(requirements={**needs, key: most + 1})
    server.must_not_answer([many], f"it simulates {most:g} agents at most")


@rule(
    "S1.7",
    "A hash can be any text.",
    where="protocol.md, Hash",
    fix="treat simulation_hash as opaque text, not as 64 hexadecimal digits",
    d61="6.2 Discovery message, Schema 1",
    needs=["S1.2"],
)
def accepts_any_hash(server: Server) -> None:
    """Send hashes that are short, long, and with quotes, backslashes and non-ASCII letters."""
    for start in ("x", "ä ☃ 🤖", 'say "\\n"', "long " * 400):
        hash_ = start + new_hash()[:8]
        sent = f'discovery with "simulation_hash": {format_payload(json.dumps(hash_))}'
        server.must_answer("an answer with this hash", sent, simulation_hash=hash_)


@rule(
    "S1.8",
    "Unknown keys are ignored.",
    where="protocol.md, Reading",
    fix="read the keys that you know, ignore the others",
    d61="6.2, Schemas 1 to 7",
    needs=["S1.2"],
)
def tolerant(server: Server) -> None:
    """Send a discovery with unknown keys."""
    server.must_answer(
        "an answer",
        "discovery with the unknown keys note and deep",
        note="?",
        deep={"simulation": [1, {"run": None}]},
    )


def begin_episode(server: Server, topic: str = "control") -> Episode:
    """Begin an episode up to its first sensor messages; skip the rule if no agent is asked."""
    episode = server.episode()
    episode.configure()
    episode.start(topic)
    episode.gather()
    if episode.over:
        raise Skip("the simulation controls its agents itself, no agent is asked")
    return episode


def play_until_several(server: Server) -> Episode:
    """Play an episode until at least two agents are asked in one step."""
    episode = begin_episode(server)
    while not episode.over and len(episode.pending) < 2:
        for agent, turn, sensors in list(episode.pending):
            episode.answer(agent, server.policy(agent, turn, sensors))
        episode.gather()
    if episode.over:
        raise Skip("no two agents are asked in one step; give --parameters with several agents")
    return episode


@rule(
    "S2.1",
    "After parameters and control it publishes sensor messages, or the fitness if agents control themselves.",
    where="protocol.md, An episode, 2 to 4",
    fix="store the parameters by hash; on control with that hash, reset the simulation and publish the "
    "sensors",
    d61="6.2 Control message",
    needs=["S1.2"],
)
def begins(server: Server) -> None:
    """Send parameters and control; receive the first message."""
    episode = server.episode()
    sent = f"{episode.configure()}, then {episode.start()}"
    message = server.client.next(episode.is_mine, server.settings.timeout)
    if message is not None:
        with suppress(Failure):  # another rule checks its format
            episode.take(message)
    else:
        expected = "a message on sensor or fitness with this hash"
        raise Failure(f"nothing arrived within {server.settings.timeout:g} s", expected, sent)


@rule(
    "S2.2",
    "A sensor message has an integer agent and a non-empty list of finite sensor values.",
    where="protocol.md, Topics; protocol/schemas/sensor.schema.json",
    fix="publish {simulation_hash, agent, sensor: [numbers]}",
    d61="6.2 Sensor message, Schema 5",
    needs=["S2.1"],
)
def sensors(server: Server) -> str:
    """Check the messages of the first steps."""
    episode = first_steps(server)
    lengths = {len(numbers) for readings in episode.trajectory.readings.values() for numbers in readings}
    return f"{' or '.join(map(str, sorted(lengths)))} numbers"


def first_steps(server: Server) -> Episode:
    """Play three steps of an episode, and check its messages."""
    episode = begin_episode(server)
    for _ in range(3):
        for agent, turn, numbers in list(episode.pending):
            episode.answer(agent, server.policy(agent, turn, numbers))
        episode.gather()
    return episode


@rule(
    "S2.3",
    "A finite fitness ends the episode.",
    where="protocol.md, An episode, 5",
    fix="publish {simulation_hash, fitness} when the simulation is done; never NaN",
    d61="6.2 Fitness message, Schema 7",
    needs=["S2.1"],
)
def ends(server: Server) -> str:
    """Play a whole episode, answering each message at once; others are compared with its trajectory."""
    episode = server.episode()
    sent = episode.configure()
    episode.start()
    start = time.monotonic()
    waits = []
    while not episode.over:
        for agent, turn, numbers in list(episode.pending):
            sent = episode.answer(agent, server.policy(agent, turn, numbers))
        last = time.monotonic()
        episode.receive(sent)
        waits.append(time.monotonic() - last)
    trajectory = episode.trajectory
    trajectory.seconds = time.monotonic() - start
    server.trajectory = trajectory
    server.listen_for(3 * statistics.median(waits))
    agents = len(trajectory.readings)
    messages = f"{trajectory.messages} sensor messages of {agents} agents in {trajectory.seconds:.3f} s"
    return f"fitness {trajectory.fitness}; {messages}"


@rule(
    "S2.4",
    "Each agent is asked once per step, and again only after it has acted.",
    where="protocol.md, An episode, 4",
    fix="publish one sensor message per live agent at the start of a step, none while you wait for actuators",
    needs=["S2.3"],
)
def asks_once(server: Server) -> None:
    """Wait at the beginning of an episode and listen."""
    episode = begin_episode(server)
    episode.gather()
    if episode.repeated:
        raise Failure(
            f"{episode.repeated[0]} arrived, and the agent had been asked before",
            "one sensor message for each agent",
            "parameters, control, no actuators",
        )


@rule(
    "S2.5",
    "A step is made once all asked agents have their actuators, not earlier.",
    where="protocol.md, An episode, 4",
    fix="count the missing agents and step the simulation at zero",
    needs=["S2.4"],
)
def waits_for_all(server: Server) -> None:
    """Answer all agents but one, and that one after a pause; then leave out another one."""
    episode = play_until_several(server)
    for index in (-1, 0):
        waiting = list(episode.pending)
        if len(waiting) < 2:
            break
        agents = [agent for agent, _, _ in waiting]
        last = waiting.pop(index)
        for agent, turn, numbers in waiting:
            episode.answer(agent, server.policy(agent, turn, numbers))
        sent = f"actuators for all agents that were asked but agent {last[0]}"
        episode.must_wait(agents, f"the actuators of agent {last[0]} are missing", sent)
        for agent, turn, numbers in list(episode.pending):
            sent = episode.answer(agent, server.policy(agent, turn, numbers))
        episode.receive(sent)
        episode.gather()
    episode.play()


@rule(
    "S2.6",
    "Nothing follows the fitness.",
    where="protocol.md, An episode, 5",
    fix="publish the fitness once; ignore later actuators",
    d61="6.2 Fitness message",
    needs=["S2.3"],
)
def sends_single_fitness(server: Server) -> None:
    """Send late actuators after an episode, and listen for a moment."""
    episode = server.episode()
    episode.configure()
    episode.start()
    episode.play()
    server.must_be_silent("the episode is over")
    sent = ""
    for agent in episode.trajectory.readings:
        sent = episode.answer(agent, server.policy(agent, 0, episode.trajectory.readings[agent][0]))
    server.must_be_silent("the episode is over", sent)


@rule(
    "S2.7",
    "After the fitness it is free for every tool, unless the tool named itself.",
    where="protocol.md, Reservation of servers",
    fix="answer discovery again as soon as the fitness is published",
    d61="5.2.3; 7.2.2",
    needs=["S2.6"],
)
def free_afterwards(server: Server) -> None:
    """Send a discovery immediately after an episode."""
    server.play()
    server.must_come_free("an answer: the episode is over", "the last actuators, then a discovery")


@rule(
    "S2.8",
    "The same parameters serve several episodes: control alone starts another one.",
    where="protocol.md, An episode",
    fix="keep the parameters of the last hashes after the fitness",
    needs=["S2.7"],
)
def serves_again(server: Server) -> None:
    """Send parameters once and control three times."""
    episode = server.episode()
    episode.configure()
    for _ in range(3):
        sent = episode.start()
        episode.receive(sent)
        episode.play()


@rule(
    "S2.9",
    "Control with run: false ends an episode and frees the server.",
    where="protocol.md, An episode, 5",
    fix="on run: false with the episode's hash, drop it, publish nothing, answer discovery again",
    d61="6.2 Control message, Schema 4",
    needs=["S2.3"],
)
def is_ended(server: Server) -> None:
    """Send run: false in the middle of a step, then its actuators nevertheless."""
    episode = begin_episode(server)
    sent = episode.stop()
    try:
        server.must_come_free("free again", sent)
    except Failure:
        episode.over = False
        raise
    server.client.waiting.clear()  # discard messages from before the end
    for agent, turn, numbers in list(episode.pending):
        sent = episode.answer(agent, server.policy(agent, turn, numbers))
    server.must_be_silent("the episode was ended", sent)


@rule(
    "S2.10",
    "Control with run: false after parameters, before any episode, frees the server.",
    where="protocol.md, Reservation of servers",
    fix="treat a configured server like a running one: run: false with its hash frees it",
    needs=["S2.9"],
)
def is_released(server: Server) -> None:
    """Send parameters, then run: false."""
    episode = server.episode()
    episode.configure()
    sent = episode.stop()
    server.must_answer("an answer: it is free again", sent)


@rule(
    "S2.11",
    "Control without parameters for its hash starts nothing.",
    where="protocol.md, An episode, 3",
    fix="look up the parameters by the control's hash; refuse control without them",
    needs=["S2.3"],
)
def needs_parameters(server: Server) -> None:
    """Send control with a new hash."""
    episode = server.episode()
    sent = episode.start()
    episode.over = True
    server.must_be_silent("no parameters came for this hash", sent)


@rule(
    "S2.12",
    "In control, run defaults to true and visual to false.",
    where="protocol.md, Topics",
    fix="require only server and simulation_hash in control",
    d61="6.2 Control message, Schema 4",
    needs=["S2.3"],
)
def short_control(server: Server) -> None:
    """Send a control message without flags."""
    episode = server.episode()
    episode.configure()
    fields = {"simulation": server.settings.title, "simulation_hash": episode.hash}
    episode.receive(server.client.send("control", server=server.id, **fields))
    episode.play()


@rule(
    "S2.13",
    "Agents are numbered from 0, and all messages have the announced number of values.",
    where="protocol.md, Topics; Presence",
    fix="number agents from 0; send capabilities.swarmwright.sensors values for each",
    needs=["S2.2"],
)
def as_many_numbers(server: Server) -> str:
    """Count the values in the messages of the first steps."""
    episode = first_steps(server)
    announced = server.announced.get("sensors")
    lengths = {agent: {len(row) for row in rows} for agent, rows in episode.trajectory.readings.items()}
    for agent, lengths_of_agent in lengths.items():
        if agent < 0:
            raise Failure(f"a sensor message of agent {agent} arrived", "agents from 0")
        for length in lengths_of_agent:
            if isinstance(announced, int) and length != announced:
                raise Failure(
                    f"{length} numbers came for agent {agent}", f"{announced} numbers, as announced"
                )
    every = sorted(set().union(*lengths.values()))
    if len(every) > 1:
        raise Failure(f"{every} numbers came in different messages", "as many for every agent and step")
    return f"{every[0]} numbers"


@rule(
    "S2.14",
    "Control and actuator messages may omit simulation.",
    where="protocol.md, Reading",
    fix="do not rely on simulation: D6.1's schemas require it, its examples omit it",
    needs=["S2.3"],
)
def bare_control(server: Server) -> None:
    """Send the shortest control and actuator messages of D6.1's examples."""
    episode = server.episode()
    episode.configure()
    if len(server.announced.get("simulations", [1])) > 1:
        raise Skip("the server offers several simulations")
    sent = server.client.send("control", server=server.id, simulation_hash=episode.hash)
    episode.receive(sent)
    if episode.over:
        return
    policy = Always((0.0,) * server.actuators)
    for agent, turn, numbers in list(episode.pending):
        fields = {"agent": agent, "actuator": list(policy(agent, turn, numbers))}
        sent = server.client.send("actuator", simulation_hash=episode.hash, **fields)
    episode.pending.clear()
    episode.receive(sent)


@rule(
    "S2.15",
    "Control that names another simulation starts nothing.",
    where="protocol.md, Reservation of servers",
    fix="compare simulation in control, if present, with your titles: the tool may mean another server "
    "with your ID",
    needs=["S2.3"],
)
def another_title(server: Server) -> None:
    """Send parameters, then control with another title."""
    episode = server.episode()
    episode.configure()
    sent = episode.start(simulation=f"{server.settings.title} of another server")
    server.must_be_silent("it does not offer this simulation", sent)
    episode.stop()


SAME = "decision 002; protocol.md, Presence"
SEED_UNUSED = (
    "the seeds 1 and 2 give the same episode: the server ignores seed, or nothing is random with these "
    "parameters; give --parameters with which something is, or --vary another parameter"
)
SEED_UNUSED_ADVICE = (
    "The seeds 1 and 2 gave the same episode: either the server ignores the parameter seed, and all episodes "
    "of a run would be the same, or nothing is random with these --parameters."
)
SEED_DOUBT = "the seed changed nothing: is it ignored?"
LARGEST_SEED = 2**63 - 1
BEYOND_32_BITS = 5 * 2**32
"""Difference of two seeds that are equal if only 32 bits are read. Not 2^32, because Ruby's `Random.new`
drops a leading word of 1 and so gives 1 and 2^32 + 1 the same state."""
PAIRS = 8
"""Pairs of seeds that must all give equal episodes before bits count as lost: two seeds can be equal by
chance, for example with few start positions. Testing stops at the first pair that differs."""


def read_determinism(server: Server) -> str | None:
    """Return `capabilities.swarmwright.determinism`; None if it is missing."""
    declaration = server.announced.get("determinism")
    return declaration if isinstance(declaration, str) else None


def another(server: Server) -> Trajectory:
    """Play an episode with other actuators and another seed."""
    policy = Wander(server.actuators, seed=77) if server.trajectory and server.trajectory.messages else None
    return server.play(policy, {**server.settings.parameters, "seed": 77})


def seeded(server: Server, seed: int) -> Json:
    """Return the parameters with a seed."""
    return {**server.settings.parameters, "seed": seed}


@rule(
    "S3.1",
    "Equal parameters and actuators give the same episode, to the last bit.",
    where=SAME,
    fix="take random numbers only from the seed, use no clock; or declare "
    'capabilities.swarmwright.determinism "statistical" or "none"',
    needs=["S2.5", "S2.8"],
)
def deterministic(server: Server) -> str | None:
    """Play an episode twice, each time after the same other one."""
    declaration = read_determinism(server)
    another(server)
    trajectory = server.play(parameters=seeded(server, 1))
    another(server)
    two = server.play(parameters=seeded(server, 1))
    difference = trajectory.difference(two)
    if declaration in {"none", "statistical"}:
        server.deterministic = False
        if declaration == "statistical":
            _check_tolerance(server, trajectory, two)
        raise Skip(f'declared "{declaration}"; twice the same episode: {difference or "the same bits"}')
    if difference:
        server.deterministic = False
        promise = 'declared "bitwise"' if declaration else "nothing else is declared"
        raise Failure(
            f"in two episodes {difference}",
            f"the same bits ({promise})",
            "the same parameters and actuators twice",
        )
    server.deterministic = True
    return 'declared "bitwise"' if declaration else None


def _check_tolerance(server: Server, first: Trajectory, second: Trajectory) -> None:
    tolerance = server.announced.get("tolerance")
    if not is_number(tolerance):
        return
    pairs = {"the fitness": (first.fitness or 0.0, second.fitness or 0.0)}
    pairs |= {
        f"metric {name}": (first.metrics[name], second.metrics[name])
        for name in first.metrics.keys() & second.metrics
    }
    for name, (low, high) in pairs.items():
        if abs(low - high) > tolerance * max(1.0, abs(low), abs(high)):
            raise Failure(
                f"{name} is {low!r} and {high!r}",
                f'no more apart than the declared "tolerance" {tolerance}',
            )


@rule(
    "S3.2",
    "An episode does not depend on the one before it.",
    where=SAME,
    fix="reset everything at the start: positions, counters, controllers, random numbers",
    needs=["S3.1", "S2.9"],
)
def forgets(server: Server) -> None:
    """Play an episode after itself, after another one, and after one that was aborted."""
    server.comparable()
    first = server.play(parameters=seeded(server, 1))
    second = server.play(parameters=seeded(server, 1))
    difference, after = first.difference(second), "itself"
    if not difference:
        another(server)
        second = server.play(parameters=seeded(server, 1))
        difference, after = first.difference(second), "another one"
    if not difference:
        cut = server.episode()
        cut.configure()
        cut.start()
        cut.receive()
        cut.stop()
        server.must_answer("an answer: the episode was ended")
        second = server.play(parameters=seeded(server, 1))
        difference, after = first.difference(second), "one that was ended"
    if difference:
        came = f"{difference}, the second time after {after}"
        if first.find_sensor_difference(second):
            server.deterministic, server.repeats, server.carries_over = None, False, True
        else:
            server.sensors_only = True
            came += "; the sensors were the same: the fitness is of an earlier episode, or computed late"
        raise Failure(came, "the same bits whatever was before")


def skip_unused_seed(server: Server) -> Skip:
    """Return the reason to skip a rule that needs two seeds with different episodes.

    With --vary, the seed is known to change nothing, so the reason has no doubt.
    """
    if server.settings.vary:
        return Skip(SEED_UNUSED)
    return Skip(SEED_UNUSED, SEED_UNUSED_ADVICE, SEED_DOUBT)


def differing(server: Server) -> tuple[Json, Json, Trajectory, Trajectory]:
    """Return two sets of parameters with different trajectories; skip the rule if none are found."""
    server.comparable()
    first_trajectory, second_trajectory = seeded(server, 1), seeded(server, 2)
    first, second = server.play(parameters=first_trajectory), server.play(parameters=second_trajectory)
    if server.settings.vary and not first.difference(second):
        second_trajectory = {**first_trajectory, **server.settings.vary}
        second = server.play(parameters=second_trajectory)
    if not first.difference(second):
        raise skip_unused_seed(server)
    return first_trajectory, second_trajectory, first, second


@rule(
    "S3.3",
    "Control starts an episode with the latest parameters of its hash.",
    where="protocol.md, An episode, 3",
    fix="replace the parameters of a hash when new ones arrive",
    needs=["S3.1"],
)
def the_last_count(server: Server) -> None:
    """Send parameters with one seed, then with another, for the same hash."""
    first_trajectory, second_trajectory, _, second = differing(server)
    episode = server.episode(first_trajectory)
    episode.configure()
    sent = episode.configure(**second_trajectory)
    episode.start()
    difference = second.difference(episode.play())
    if difference:
        raise Failure(f"{difference}: the parameters before", "the parameters received last", sent)


@rule(
    "S3.4",
    "Parameters with another hash change nothing.",
    where="protocol.md, An episode, 3",
    fix="store parameters by hash, for several tools at once",
    needs=["S3.1"],
)
def separates_hashes(server: Server) -> None:
    """Send parameters with two hashes, then control with the first."""
    first_trajectory, second_trajectory, first, _ = differing(server)
    episode, other = server.episode(first_trajectory), server.episode(second_trajectory)
    episode.configure()
    sent = other.configure()
    other.over = True
    episode.start()
    difference = first.difference(episode.play())
    if difference:
        raise Failure(f"{difference}: the parameters of the other hash", "those of the control's hash", sent)


@rule(
    "S3.5",
    "All 64 bits of the seed count: those beyond the lowest 32, differences of 1 beyond 2^53, and 2^63 - 1.",
    where="protocol.md, An episode, 2",
    fix="read the seed as a 64-bit integer; if the generator takes 32 bits, fold it: seed ^ seed >> 32",
    needs=["S3.1"],
)
def exact_seed(server: Server) -> None:
    """Play an episode with the largest seed, then pairs of seeds that are equal if bits are lost."""
    episode = server.episode(seeded(server, LARGEST_SEED))
    sent = f"{episode.configure()}, then {episode.start()}"
    episode.receive(sent)
    episode.play()
    server.comparable()
    if not server.play(parameters=seeded(server, 1)).difference(server.play(parameters=seeded(server, 2))):
        raise skip_unused_seed(server)
    for distance, base, lost in (
        (BEYOND_32_BITS, 1, "as if the seed, or what the generator makes of it, were truncated to 32 bits"),
        (1, 2**53, "as if the seed were read through a double, which has 53 bits"),
    ):
        pairs = [(base + 4 * index, base + 4 * index + distance) for index in range(PAIRS)]
        if all(_alike(server, *pair) for pair in pairs):
            first, second = pairs[0]
            raise Failure(
                f"the same bits with seed {first} and with seed {second}, {lost}",
                "different episodes, as with the seeds 1 and 2",
                f'parameters with "seed": {first}, then with "seed": {second}',
            )


def _alike(server: Server, first: int, second: int) -> bool:
    one_episode, another = (server.play(parameters=seeded(server, seed)) for seed in (first, second))
    return not one_episode.difference(another)


def effective(server: Server, first: Policy, second: Policy) -> tuple[Trajectory, Trajectory]:
    """Return two different trajectories; skip the rule if actuators have no visible effect."""
    server.comparable()
    _ = server.reference
    trajectories = server.play(first), server.play(second)
    if not trajectories[0].difference(trajectories[1]):
        raise Skip("other actuators change nothing that can be seen; give --parameters with longer episodes")
    return trajectories


@rule(
    "S4.1",
    "Actuators outside -1 to +1 are clamped.",
    where="protocol.md, Reading",
    fix="clamp every actuator to -1..+1 when you read it",
    needs=["S3.1"],
)
def clamps_actuators(server: Server) -> None:
    """Send +1 and 7.5, then -1 and -1e30, to all actuators."""
    count = server.actuators
    plus, _ = effective(server, Always((1.0,) * count), Wander(count))
    minus = server.play(Always((-1.0,) * count))
    for value, limit, trajectory in ((7.5, "+1", plus), (-1e30, "-1", minus), (1.0000001, "+1", plus)):
        difference = trajectory.difference(server.play(Always((value,) * count)))
        if difference:
            came = f"with {value:g} instead of {limit} {difference}"
            raise Failure(
                came, f"{value:g} counts as {limit}", f'"actuator": {[value] * count} to all agents'
            )


@rule(
    "S4.2",
    "Actuators of a step may arrive in any order.",
    where="protocol.md, An episode, 4",
    fix="sort actuators by agent, not by arrival",
    needs=["S3.1", "S2.9"],
)
def accepts_any_order(server: Server) -> None:
    """Play a whole episode, answering the last agent of each step first."""
    server.comparable()
    play_until_several(server).stop()
    server.must_answer("an answer: the episode was ended")
    episode = server.episode()
    episode.configure()
    episode.start()
    episode.gather()
    while not episode.over:
        for agent, turn, numbers in reversed(list(episode.pending)):
            episode.answer(agent, server.policy(agent, turn, numbers))
        episode.gather()
    difference = server.reference.difference(episode.trajectory)
    if difference:
        raise Failure(difference, "the same episode", "the last agent's actuators first in each step")


@rule(
    "S4.3",
    "A second answer for one agent and step is refused.",
    where="protocol.md, Reading",
    fix="keep the first actuators of an agent in a step",
    needs=["S3.1"],
)
def the_first_counts(server: Server) -> None:
    """Send the first agent also the opposite actuators in one step, before the others get theirs."""
    episode = play_until_several(server)
    agents = [agent for agent, _, _ in episode.pending]
    agent, turn, numbers = episode.pending[0]
    values = server.policy(agent, turn, numbers)
    episode.answer(agent, values)
    sent = episode.answer(agent, [-value if value else 1.0 for value in values])
    episode.must_wait(agents, "other agents have no actuators yet", sent)
    trajectory = episode.play()
    if server.deterministic:
        difference = server.reference.difference(trajectory)
        if difference:
            raise Failure(difference, "the episode without the second answer", sent)


@rule(
    "S4.4",
    "Actuators are read as the nearest IEEE binary32.",
    where="protocol.md, Reading; decision 002",
    fix="round to binary32 on reading, if necessary from a double",
    needs=["S3.1"],
)
def binary32(server: Server) -> None:
    """Send decimals with many digits, then the shortest ones that round to the same binary32."""
    count = server.actuators
    long = Always(tuple(0.1000000001 + 0.2 * (index % 3) for index in range(count)))
    short = Always(tuple((0.1, 0.3, 0.5)[index % 3] for index in range(count)))
    effective(server, short, Wander(count, seed=5))
    difference = server.play(short).difference(server.play(long))
    if difference:
        raise Failure(
            f"with 0.1000000001 instead of 0.1 {difference}",
            "the same: both are the binary32 0.1",
            f'"actuator": {list(long.values)} to all agents, after {list(short.values)} in another episode',
        )
