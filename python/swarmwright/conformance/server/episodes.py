"""S2: episodes from parameters to fitness."""

import statistics
import time
from contextlib import suppress

from swarmwright.conformance._episode import Episode
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance._trajectory import Always
from swarmwright.conformance.rules import Skip
from swarmwright.conformance.server._rules import rule
from swarmwright.servers.broker.client import Failure


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
