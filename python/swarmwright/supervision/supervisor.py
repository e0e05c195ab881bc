"""Keeps simulation servers alive: starts them, ends those that hang, starts again those that have ended."""

import logging
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from swarmwright.core.errors import RunError
from swarmwright.supervision.news import Ended, Event, News, Restarted
from swarmwright.supervision.output import Output
from swarmwright.supervision.process import Process
from swarmwright.supervision.progress import Sample
from swarmwright.supervision.server_exit import ServerExit

if TYPE_CHECKING:
    from swarmwright import _engine

_log = logging.getLogger("swarmwright")

CHECK_S = 0.2
"""Seconds between two checks of the servers, and when one seems to end."""
FAST_CHECK_S = 0.01
"""Seconds between two checks where a server is silent or is about to end."""

START_S = 30.0
"""Seconds that a server has to start, at least."""

FIRST_PAUSE_S = 0.1
"""Seconds before a server is started again; doubled with each end in a row before which it did nothing."""
LONGEST_PAUSE_S = 5.0
LONGEST_PAUSE_AT_WORK_S = 1.0
"""For servers that ended while they evaluated: these ends are counted by candidate."""

MOST_STARTS = 5
"""Starts in a row that fail before a server is given up; also ends in a row at nothing, twice as many."""


@dataclass
class _Place:
    """A server's id, and the process that has it now."""

    settings: Mapping[str, Any]
    process: Process | None = None
    again_at: float | None = None
    """When it is to be started again."""
    was_ready: bool = False
    """Whether one of its processes was ready once."""
    failed_starts: int = 0
    fruitless: int = 0
    """Ends in a row at no evaluation, without any before."""
    ends: int = 0
    """Ends in a row without an evaluation before."""
    sample: Sample = field(default_factory=Sample)
    since: float = 0.0
    """When it was first seen to be there."""
    episode_since: float = 0.0
    last: ServerExit | None = None
    given_up: bool = False
    """Whether it will not be started again."""
    left: bool = False
    """Whether it was ready and left by itself for a reason that lasts: another server has its id."""


class Supervisor:
    """Servers of these settings, from `start` to `stop`.

    Args:
        settings: one mapping of `server_process`'s arguments per server, with its `id`.
        draws: whether they draw on this process's standard output.
        restart: whether those that end are started again.
        output: takes what they print.
        tell: gets the news, on another thread; must not call back.
        step_timeout: seconds that a step of an offloaded evaluation may take; None for any time.
        episode_timeout: seconds that one evaluation may take.
        start_timeout: seconds that a server may take until it is on the broker.
        environment: further variables of the processes.
        recycle: evaluations after which a process is replaced; 0 for never.
    """

    def __init__(
        self,
        settings: Sequence[Mapping[str, Any]],
        *,
        draws: bool = False,
        restart: bool = True,
        output: Output,
        tell: Callable[[News], None],
        step_timeout: float | None = None,
        episode_timeout: float | None = None,
        start_timeout: float = START_S,
        environment: Mapping[str, str] | None = None,
        recycle: int = 0,
    ) -> None:
        self._places = {int(one["id"]): _Place(one) for one in settings}
        self._environment = dict(environment or {})
        self._leaving: set[int] = set()
        self._draws, self._restart, self._recycle = draws, restart, recycle
        self._output = output
        self._tell = tell
        self._step, self._episode, self._start = step_timeout, episode_timeout, start_timeout
        self._supervision: _engine.Supervision | None = None
        self._last: _engine.Supervision | None = None
        self._stopping = threading.Event()
        self._news = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._watch, daemon=True, name="supervisor")
        self._failure: Exception | None = None
        self.restarts = 0
        """Servers that were started again."""

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
            for one in settings:
                place = _Place(one)
                self._begin(place)
                self._places = {**self._places, int(one["id"]): place}  # others iterate over it
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
            self._places = {server: one for server, one in self._places.items() if server not in servers}
            self._count()
        _end([place.process for place in leaving if place.process is not None])

    def stop(self, grace: float = 0.0) -> None:
        """End all servers: ask all, then wait for each, then kill.

        grace: seconds for which each may go on with the request that it computes.
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
        """Ask each server to end when it has answered the request that it computes; wait for that."""
        deadline = time.monotonic() + grace
        computing = {}
        for place in self._places.values():
            if place.process is not None:
                computing[place.process] = place.process.progress.read()
        while computing and time.monotonic() < deadline:
            for process, before in list(computing.items()):
                now = process.progress.read()
                if not now.candidates or now.request != before.request:
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

    def _begin(self, place: _Place) -> None:
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

    def _look(self, place: _Place, now: float, *, overdue: bool) -> None:
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
        elif process.hung is None and (why := self._hangs(place, process, now)) is not None:
            process.end_hung(why)
        elif self._is_to_be_replaced(process):
            process.recycle()
        server_exit = process.end()
        if server_exit is not None:
            self._ended(place, process, server_exit)

    def _is_to_be_replaced(self, process: Process) -> bool:
        if not self._recycle or process.recycled or process.hung is not None:
            return False
        sample = process.progress.read()
        # An episode that is stepped from elsewhere would be lost.
        is_stepped = sample.is_at_work and not sample.candidates
        return sample.ended >= self._recycle and not is_stepped

    def _hangs(self, place: _Place, process: Process, now: float) -> str | None:
        """Why a process is to be ended, if it is."""
        if not process.ready:
            most = self._start + float(place.settings.get("wait", 0.0))
            late = place.was_ready and now - process.started > most
            return f"did not start within {most:g} s" if late else None
        sample = process.progress.read()
        if sample != place.sample:
            if (sample.place, sample.ended) != (place.sample.place, place.sample.ended):
                place.episode_since = now
            place.sample, place.since = sample, now
        if not sample.candidates:
            return None
        if self._step is not None and now - place.since > self._step:
            return f"made no step for {self._step:g} s"
        if (
            self._episode is not None
            and sample.episode is not None
            and now - place.episode_since > self._episode
        ):
            return f"was at one episode for {self._episode:g} s"
        return None

    def _ended(self, place: _Place, process: Process, server_exit: ServerExit) -> None:
        """Handle the end of a process: report it, and set when it is started again."""
        sample = process.progress.read()
        with self._lock:
            place.process, place.last = None, server_exit
            pause = self._pause(place, process, server_exit, sample)
            supervision = self._supervision
        place_of = None if supervision is None else supervision.place(sample.request)
        whose = ""
        if place_of is not None and sample.candidates == 1:
            whose = self._output.named(place_of, sample.first, sample.episode or 0)
        is_recycled = process.recycled and server_exit.outside
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

    def _pause(
        self, place: _Place, process: Process, server_exit: ServerExit, sample: Sample
    ) -> float | None:
        """How long to wait before it is started again; None: not at all."""
        # Never ready: the cause is permanent, unless a user or a scheduler has ended it.
        if not self._restart or place.left or not (place.was_ready or server_exit.outside):
            return None
        place.failed_starts = 0 if process.ready else place.failed_starts + 1
        place.ends = 0 if sample.ended else place.ends + 1
        wasted = not sample.ended and not sample.is_at_work and not server_exit.outside
        place.fruitless = place.fruitless + 1 if wasted else 0
        if place.failed_starts >= MOST_STARTS or place.fruitless >= 2 * MOST_STARTS:
            return None
        longest = LONGEST_PAUSE_AT_WORK_S if sample.is_at_work else LONGEST_PAUSE_S
        return min(FIRST_PAUSE_S * 2.0 ** max(place.ends - 1, 0), longest)

    def _begin_again(self, place: _Place) -> None:
        try:
            with self._lock:
                if self._stopping.is_set():
                    return
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
