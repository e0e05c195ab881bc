"""A simulation server between rules: finds, frees and restarts it."""

import time
from contextlib import suppress

from swarmwright.common.json_text import Json
from swarmwright.conformance._episode import Episode
from swarmwright.conformance._server_under_test import Server
from swarmwright.conformance.rules import Rule
from swarmwright.servers.broker.client import Client, Failure, Message, Overdue

MOST_EPISODES = 40
"""Largest number of episodes in a rule; their duration extends its deadline."""
FREE_AFTER_S = 8.0
"""Seconds after which a reserved server becomes free on its own, with a margin."""


WATCH_S = 2.0
"""Seconds within which a server that does not wait for actuators asks agents again."""


class ServerPeer(Server):
    """The server under test as a `Peer`."""

    _waits: bool | None = None

    def ready(self, rule: Rule) -> None:
        """Discard earlier messages; set the deadline of the rule."""
        self.client.deadline = float("inf")
        self.client.drain()
        self.episodes, self.tools = [], set()
        self._allow(rule.seconds + self.settings.timeout)

    def _allow(self, seconds: float) -> None:
        """Set the deadline, with extra time for episodes."""
        episode = self.trajectory.seconds if self.trajectory else self.settings.timeout
        self.client.deadline = time.monotonic() + seconds + MOST_EPISODES * episode

    def recover(self) -> str:
        """Make the server free; return why it does not answer discovery, empty if it does."""
        if self.left:
            return ""
        self.client.deadline = time.monotonic() + FREE_AFTER_S + 4 * self.settings.timeout
        try:
            return self._free_server()
        except Overdue:
            return "it no longer answered discoveries"

    def _free_server(self) -> str:
        if self.door is not None:
            self.door.open()
        for episode in self.episodes:
            episode.stop()
        for tool in self.tools:
            self._end_episode(tool)
        limit = time.monotonic() + FREE_AFTER_S
        while not self.describe_exit():
            if self._is_free(min(1.0, self.settings.timeout)):
                return ""
            if time.monotonic() > limit:
                return f"it answered no discovery for {FREE_AFTER_S:g} s"
            for episode in self.episodes:
                self._play_out(episode)
            for tool in self.tools:
                self._end_episode(tool)
        return self.describe_exit()

    def _is_free(self, seconds: float) -> bool:
        """Return whether the server answers with its ID; another rule checks the hash."""

        def is_answer(message: Message) -> bool:
            for episode in self.episodes:
                if message.topic == "sensor" and message.maybe.get("simulation_hash") == episode.hash:
                    with suppress(Failure):
                        episode.take(message)
            return self.is_answer(message)

        self.client.send("discovery", **self.discovery())
        free = self.client.next(is_answer, seconds) is not None
        self.client.waiting.clear()
        return free

    def _end_episode(self, tool: str) -> None:
        fields = {"server": self.id, "simulation_hash": tool, "run": False, "tool": tool}
        self.client.send("control", simulation=self.settings.title, **fields)

    def _play_out(self, episode: Episode) -> None:
        """Play an episode that could not be aborted to its end."""
        episode.over = not episode.pending
        with suppress(Failure):
            episode.play()
        episode.over = True

    def revive(self) -> bool:
        """Restart its process if the kit started it; return whether it answers."""
        if self.process is None:
            return False
        self.process.start()
        answer = await_answer(self, 30.0)
        if answer is None:
            return False
        # A restarted server has another instance.
        self.note_capabilities(answer)
        return True

    def prepare_retry(self) -> bool:
        """Prepare for another try within a rule; return whether that was possible."""
        if self.recover() and not self.revive():
            return False
        self.client.drain()
        self._allow(10 + 4 * self.settings.timeout)
        return True

    def waits(self) -> bool:
        """Return whether the server sends nothing until agents are answered; tested once."""
        if self._waits is None:
            self.client.deadline = time.monotonic() + WATCH_S + 2 * self.settings.timeout
            episode = self.episode()
            episode.configure()
            episode.start()
            with suppress(Failure, Overdue):
                episode.gather()
                limit = time.monotonic() + WATCH_S
                while time.monotonic() < limit and not (episode.repeated or episode.over):
                    for message in self.client.drain(0.1):
                        if episode.is_mine(message):
                            episode.take(message)
            self._waits = not (episode.repeated or episode.over)
        return self._waits

    def describe_exit(self) -> str:
        """Describe how the process ended; empty while it runs, or if the kit did not start it."""
        return "" if self.process is None else self.process.ended


def await_answer(server: Server, seconds: float) -> Json | None:
    """Repeat the discovery until the server answers; return the answer, None after a time-out."""
    client: Client = server.client
    client.deadline = float("inf")
    limit = time.monotonic() + seconds
    while time.monotonic() < limit:
        client.send("discovery", **server.discovery())
        answer = client.next(server.is_answer, 0.2)
        if answer is not None:
            return dict(answer.maybe)
        if server.process is not None and server.process.ended:
            return None
    return None
