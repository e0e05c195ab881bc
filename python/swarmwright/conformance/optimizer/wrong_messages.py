"""O4: what servers may send by mistake, and what others send on the same topics."""

import json
import time

from swarmwright.conformance._rules import Failure
from swarmwright.conformance.optimizer._rules import rule
from swarmwright.conformance.optimizer._stage import Actor, Json, sensed
from swarmwright.conformance.optimizer._tool import Tool, must_go_on

READING = "protocol.md, Reading"


class Junk(Actor):
    """Sends what is no JSON object before everything that it says."""

    junk = ("", "hello", "[]", "7", '{"simulation_hash":', b"\xff\xfe{}", "[" * 10_000)

    def says(self, topic: str, **fields: object) -> None:
        """Junk, then the message."""
        for payload in self.junk:
            self.stage.client.publish(topic, payload)
        super().says(topic, **fields)


@rule(
    "O4.1",
    "What is no JSON object in UTF-8 is refused, and the run goes on.",
    where=READING,
    mend="catch what your JSON reader throws; in paho an exception in a callback ends the loop",
    needs=["O3.1"],
    seconds=600,
)
def no_json(tool: Tool) -> None:
    """Junk before every message of two servers."""
    must_go_on(tool, "junk", [Junk(1), Junk(2)], "junk on server, sensor and fitness")


class WrongSensors(Actor):
    """Sends sensor messages that cannot be answered before those that can."""

    def sense(self, agent: int) -> None:
        """Wrong ones first."""
        assert self.episode is not None
        values = sensed(7, self.stage.sensors)
        right: Json = {"simulation_hash": self.episode.hash, "agent": agent, "sensor": values}
        wrong: list[Json] = [
            {**right, "agent": None},
            {**right, "agent": str(agent)},
            {**right, "agent": -1},
            {**right, "agent": agent + 0.5},
            {**right, "sensor": []},
            {**right, "sensor": "0.5"},
            {**right, "sensor": [None] * len(values)},
            {**right, "sensor": [str(value) for value in values]},
            {key: value for key, value in right.items() if key != "agent"},
            {key: value for key, value in right.items() if key != "sensor"},
            {key: value for key, value in right.items() if key != "simulation_hash"},
            {**right, "simulation_hash": 7},
        ]
        texts = [json.dumps(fields) for fields in wrong]
        head = json.dumps({key: value for key, value in right.items() if key != "sensor"})[:-1]
        rest = ", 0.5" * (len(values) - 1)
        texts += [f'{head}, "sensor": [{word}{rest}]}}' for word in ("NaN", "Infinity", "1e999")]
        for text in texts:
            self.stage.client.publish("sensor", text)
        super().sense(agent)


@rule(
    "O4.2",
    "Sensor messages with missing keys, wrong types or numbers that are not finite are not answered.",
    where=READING,
    mend="check agent and sensor before the controller gets them; the right message is still to come",
    needs=["O3.1"],
    seconds=600,
)
def wrong_sensors(tool: Tool) -> None:
    """Fifteen wrong messages before every right one, which senses something else."""
    sent = "sensor messages with a wrong agent or wrong numbers before each right one"
    must_go_on(tool, "wrong sensors", [WrongSensors(1), WrongSensors(2)], sent)


class Foreign(Actor):
    """Speaks for others: sensors, fitness and offers with hashes that nobody asked for."""

    def says(self, topic: str, **fields: object) -> None:
        """The same with two other hashes, then the message."""
        hash_ = str(fields["simulation_hash"])
        for other in (hash_[::-1] + "0", hash_[:-1]):
            changed = {**fields, "simulation_hash": other}
            if topic == "server":
                changed["server"] = self.server + 10
            super().says(topic, **changed)
        super().says(topic, **fields)


@rule(
    "O4.3",
    "Messages with other hashes belong to others: they are ignored.",
    where="protocol.md, Hash",
    mend="look the hash up among your discoveries and the episodes under way",
    needs=["O3.1"],
    seconds=600,
)
def foreign(tool: Tool) -> None:
    """Offers, sensors and fitness with other hashes before each right one."""
    record = must_go_on(tool, "foreign", [Foreign(1), Foreign(2)], "messages with other hashes")
    known = {episode.hash for episode in record.episodes}
    for content in record.on("actuator"):
        if content.get("simulation_hash") not in known:
            raise Failure(f"actuator {json.dumps(content)}", "no answer to sensors of other episodes")
    for topic in ("parameters", "control"):
        for content in record.on(topic):
            if content.get("server") not in {1, 2}:
                raise Failure(
                    f"{topic} {json.dumps(content)}", "nothing for a server whose answer has another hash"
                )


class WrongFitness(Actor):
    """Sends a fitness that is none, waits, then the right one."""

    def __init__(self, server: int) -> None:
        super().__init__(server)
        self.right_at = 0.0

    def finish(self) -> None:
        """Wrong ones first; the right one a few looks later."""
        assert self.episode is not None
        hash_ = self.episode.hash
        for text in ('"7"', "null", "NaN", "1e999", "[1]", "true"):
            self.stage.client.publish("fitness", f'{{"simulation_hash": "{hash_}", "fitness": {text}}}')
        self.stage.client.publish("fitness", f'{{"simulation_hash": "{hash_}"}}')
        self.right_at = time.monotonic() + 0.1

    def tick(self) -> None:
        """Now the right one."""
        if self.episode is not None and 0 < self.right_at < time.monotonic():
            self.right_at = 0.0
            super().finish()

    def control(self, content: Json) -> None:
        """Nobody should begin or end anything before the right one has come."""
        if self.right_at:
            self.stage.record.notes.setdefault("early", f"control {json.dumps(content)}")
        super().control(content)


@rule(
    "O4.4",
    "A fitness that is no finite number is refused; the right one counts.",
    where=READING,
    mend="check that fitness is a finite number before you end the episode",
    needs=["O3.1"],
    seconds=600,
)
def wrong_fitness(tool: Tool) -> None:
    """Seven wrong messages, a pause, and the fitness."""
    actors: list[Actor] = [WrongFitness(1), WrongFitness(2)]
    sent = "fitness as text, null, NaN, 1e999, a list, true, and missing"
    record = must_go_on(tool, "wrong fitness", actors, sent)
    if "early" in record.notes:
        raise Failure(f"{record.notes['early']} came", "nothing before the right fitness", sent)


class Chatty(Actor):
    """Adds keys that nobody knows, and simulation, which may be there or not."""

    def says(self, topic: str, **fields: object) -> None:
        """With more keys."""
        super().says(topic, **fields, note={"deep": [1, {"run": None}]}, simulation="anything")


@rule(
    "O4.5",
    "Unknown keys are ignored, and simulation is not relied on.",
    where=READING,
    mend="read the keys that you know; tell episodes apart by the hash alone",
    needs=["O3.1"],
    seconds=600,
)
def unknown_keys(tool: Tool) -> None:
    """More keys in every message."""
    must_go_on(tool, "chatty", [Chatty(1), Chatty(2)], "messages with unknown keys")
