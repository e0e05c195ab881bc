"""Keeps simulation servers alive: starts them, ends those that hang, starts again those that have ended."""

import logging
import signal
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import RunError
from swarmwright.servers.supervision.news import Ended, Event, News, Restarted
from swarmwright.servers.supervision.output import Output
from swarmwright.servers.supervision.place import LONGEST_PAUSE_S, Limits, Place, quotas
from swarmwright.servers.supervision.process import Process
from swarmwright.servers.supervision.progress import Sample
from swarmwright.servers.supervision.server_exit import ServerExit

if TYPE_CHECKING:
    from swarmwright import _engine

_log = logging.getLogger("swarmwright")

CHECK_S = 0.2
"""Seconds between two checks of the servers, and when one seems to end."""
FAST_CHECK_S = 0.01
"""Seconds between two checks where a server is silent or is about to end."""


class Supervisor:
    """Servers of these settings, from `start` to `stop`.

    Args:
        settings: one mapping of `server_process`'s arguments per server, with its `id`.
        draws: whether they draw on this process's standard output.
        restart: whether those that end are started again.
        output: takes what they print.
        tell: gets the news, on another thread; must not call back.
        limits: of their time.
        environment: further variables of the processes.
        recycle: evaluations after which a process is replaced; 0 for never. The first processes of servers
            that start together are replaced one after another, some after fewer.
    """

    def __init__(
        self,
        settings: Sequence[Mapping[str, Any]],
        *,
        draws: bool = False,
        restart: bool = True,
        output: Output,
        tell: Callable[[News], None],
        limits: Limits | None = None,
        environment: Mapping[str, str] | None = None,
        recycle: int = 0,
    ) -> None:
        self._places = self._placed(settings, recycle)
        self._environment = dict(environment or {})
        self._leaving: set[int] = set()
        self._draws, self._restart, self._recycle = draws, restart, recycle
        self._output = output
        self._tell = tell
        self._limits = limits or Limits()
        self._supervision: _engine.Supervision | None = None
        self._last: _engine.Supervision | None = None
        self._stopping = threading.Event()
        self._news = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._watch, daemon=True, name="supervisor")
        self._failure: Exception | None = None
        self.restarts = 0
        """Servers that were started again."""

    @staticmethod
    def _placed(settings: Sequence[Mapping[str, Any]], recycle: int) -> dict[int, Place]:
        first = quotas(len(settings), recycle)
        return {
            int(setting["id"]): Place(setting, quota) for setting, quota in zip(settings, first, strict=True)
        }

    @property
    def identifiers(self) -> list[int]:
        """Ids of all servers."""
        return list(self._places)

    @property
    def pids(self) -> list[int]:
        """Process ids of those that run."""
        with self._lock:
            return [place.process.pid for place in self._places.values() if place.process is not None]

    def given_up(self) -> list[ServerExit]:
        """How those ended last that will not be started again."""
        with self._lock:
            places = self._places.values()
            return [place.last for place in places if place.given_up and place.last is not None]

    def printed(self, server: int) -> tuple[str, ...]:
        """Return the last lines of a server that runs."""
        place = self._places.get(server)
        process = None if place is None else place.process
        return () if process is None else process.lines

    def check(self) -> None:
        """Raise RunError when the servers are not watched any more, because of an error in that."""
        if self._failure is not None:
            raise RunError(f"servers are not watched any more: {self._failure!r}") from self._failure

    def all_given_up(self) -> bool:
        """Whether no server is left."""
        return len(self.given_up()) == len(self._places)

    def start(self) -> None:
        """Start all servers; `stop` is needed also when this raises."""
        for place in self._places.values():
            self._begin(place)
        self._thread.start()

    def add(self, settings: Sequence[Mapping[str, Any]]) -> None:
        """Start further servers. Raises OSError when the system does not allow another process."""
        with self._lock:
            for server, place in self._placed(settings, self._recycle).items():
                self._begin(place)
                self._places = {**self._places, server: place}  # others iterate over it
            self._count()

    def remove(self, servers: Collection[int]) -> None:
        """End servers soon, which are not started again; those that are not there are left out."""
        with self._lock:
            self._leaving.update(servers)
        self._news.set()

    def _remove(self) -> None:
        with self._lock:
            servers, self._leaving = self._leaving, set()
            leaving = [place for server, place in self._places.items() if server in servers]
            self._places = {server: slot for server, slot in self._places.items() if server not in servers}
            self._count()
        _end([place.process for place in leaving if place.process is not None])

    def stop(self, grace: float = 0.0) -> None:
        """End all servers: ask all, then wait for each, then kill.

        grace: seconds for which each may go on with the request or the episode that it computes.
        """
        self._stopping.set()
        self._news.set()
        if self._thread.is_alive():
            self._thread.join()
        self._finish(grace)
        _end([place.process for place in self._places.values() if place.process is not None])
        for place in self._places.values():
            place.process = None

    def _finish(self, grace: float) -> None:
        """Ask each server to end when it has finished what it computes; wait for that."""
        deadline = time.monotonic() + grace
        computing = {}
        for place in self._places.values():
            if place.process is not None:
                computing[place.process] = place.process.progress.read()
        while computing and time.monotonic() < deadline:
            for process, before in list(computing.items()):
                now = process.progress.read()
                if not now.goes_on_with(before):
                    process.dismiss()
                    del computing[process]
            time.sleep(FAST_CHECK_S)

    def attach(self, supervision: "_engine.Supervision | None") -> None:
        """Report the state of the servers to this pool from now on; None: to no pool."""
        with self._lock:
            self._supervision = supervision
            if supervision is not None:
                # What they printed for the pool before may still come. No number of a request is used twice.
                before = self._last
                self._last = supervision
                self._output.place = lambda request: (
                    supervision.place(request) or (before and before.place(request))
                )
            self._count()

    def _begin(self, place: Place) -> None:
        place.sample, place.since = Sample(), time.monotonic()
        place.again_at = None
        place.process = Process(
            place.settings,
            draws=self._draws,
            on_event=self._heard,
            on_line=self._output.line,
            on_end=self._news.set,
            environment=self._environment,
        )

    def _heard(self, process: Process, report: dict[str, Any]) -> None:
        if report.get("event") == "ready":
            with self._lock:
                place = self._places.get(process.identifier)
                if place is not None:  # it was not removed meanwhile
                    place.was_ready, place.failed_starts = True, 0
                self._count()
        elif report.get("event") == "error" and process.ready:
            with self._lock:
                place = self._places.get(process.identifier)
                if place is not None:
                    place.left = True
        self._tell(Event(process.identifier, process.pid, report))

    def _count(self) -> None:
        """Tell the pool how many are being started."""
        if self._supervision is not None:
            places = self._places.values()
            starting = [
                place
                for place in places
                if place.again_at is not None or (place.process is not None and not place.process.ready)
            ]
            self._supervision.starting(len(starting))

    def _watch(self) -> None:
        try:
            self._watch_servers()
        except Exception as error:  # noqa: BLE001 - raised by `check`, in the thread of its caller
            self._failure = error
            _log.exception("Servers are not watched any more: those that end or hang are not started again.")

    def _watch_servers(self) -> None:
        last = time.monotonic()
        while not self._stopping.is_set():
            self._news.wait(self._patience())
            self._news.clear()
            if self._leaving:
                self._remove()
            now = time.monotonic()
            # This process slept, and the servers probably, too.
            away = max(0.0, now - last - 5 * CHECK_S)
            last = now
            overdue = self._overdue()
            for place in self._places.values():
                if self._stopping.is_set():
                    return
                place.since += away
                place.episode_since += away
                self._look(place, now, overdue=int(place.settings["id"]) in overdue)

    def _patience(self) -> float:
        times = [place.again_at for place in self._places.values() if place.again_at is not None]
        # The end of what it writes is seen a moment before that of the process.
        look = (
            FAST_CHECK_S
            if any(place.process and place.process.silent for place in self._places.values())
            else CHECK_S
        )
        return max(0.0, min([look, *(at - time.monotonic() for at in times)]))

    def _overdue(self) -> set[int]:
        supervision = self._supervision
        return set() if supervision is None else set(supervision.take_overdue())

    def _look(self, place: Place, now: float, *, overdue: bool) -> None:
        process = place.process
        if process is None:
            if place.again_at is not None and place.again_at <= now:
                self._begin_again(place)
            return
        if overdue and self._supervision is not None and process.ready:
            if process.progress.read().candidates:
                self._supervision.is_alive(process.identifier)
            else:
                process.end_hung("did not answer in time")
        elif process.hung is None and (why := place.hangs(process, now, self._limits)) is not None:
            process.end_hung(why)
        elif place.is_to_be_replaced(process):
            process.recycle()
        server_exit = process.end()
        if server_exit is not None:
            self._ended(place, process, server_exit)

    def _ended(self, place: Place, process: Process, server_exit: ServerExit) -> None:
        """Handle the end of a process: report it, and set when it is started again."""
        sample = process.progress.read()
        with self._lock:
            place.process, place.last = None, server_exit
            pause = place.pause(process, server_exit, sample) if self._restart else None
            supervision = self._supervision
        place_of = None if supervision is None else supervision.place(sample.request)
        whose = ""
        if place_of is not None and sample.candidates == 1:
            whose = self._output.named(place_of, sample.first, sample.episode or 0)
        # Asked to end it finishes its work and ends by this signal; the system may kill it meanwhile.
        is_recycled = process.recycled and server_exit.status == -signal.SIGTERM
        how = "has had its evaluations (recycle)" if is_recycled else server_exit.how
        self._output.say(server_exit.server, f"[{how}]", whose)
        if supervision is not None:
            supervision.ended(
                server_exit.server,
                server_exit.pid,
                f"a simulation server {how}",
                stack=server_exit.words or None,
                outside=server_exit.outside,
                at=sample.place,
            )
        process.close()
        self._tell(Ended(server_exit, pause))
        with self._lock:
            place.again_at = None if pause is None else time.monotonic() + pause
            place.given_up = pause is None
            self._count()
        self._news.set()

    def _begin_again(self, place: Place) -> None:
        try:
            with self._lock:
                if self._stopping.is_set():
                    return
                place.quota = self._recycle
                self._begin(place)
                self.restarts += 1
                process = place.process
        except OSError as error:  # too many processes or no memory: possibly temporary
            place.again_at = time.monotonic() + LONGEST_PAUSE_S
            self._output.say(int(place.settings["id"]), f"[cannot be started: {error}]")
            return
        assert process is not None
        self._tell(Restarted(process.identifier, process.pid))


def _end(processes: Sequence[Process]) -> None:
    """Ask all to end, then wait for each, then kill."""
    for process in processes:
        process.dismiss()
    for process in processes:
        process.close()
