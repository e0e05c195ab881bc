"""What all views of a window share: the list of runs, the queue, opened runs, pages of replays."""

import asyncio
import logging
import threading
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable, Hashable
from pathlib import Path
from typing import TypeVar, cast

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from swarmwright import InputError, Run, SwarmwrightError
from swarmwright.experiment.broker_address import DEFAULT_BROKER
from swarmwright.servers.evaluation.base import BROKERLESS
from swarmwright.simulations import catalogue
from swarmwright.ui.brokers import Brokers
from swarmwright.ui.index import RunIndex
from swarmwright.ui.jobs import Jobs

REFRESH_S = 0.5
"""Between two looks at the stores."""
FIRST_S = 0.4
"""After which the rows that have been read are shown, where there are many."""
HEARTBEAT_S = 15.0
"""After which a silent stream of events says that it is there: proxies close silent ones."""
REPLAY_BYTES = 64 << 20
"""Pages of replays that are kept."""
MOST_OPENED = 20
"""Runs that are kept open."""

Page = TypeVar("Page", str, bytes)
T = TypeVar("T")


class Window:
    """What the views share.

    Attributes:
        index: the list of runs.
        jobs: the queue of commands.
        brokers: those whose servers are shown.
        figures: held while Matplotlib draws, which it does in one thread at a time.

    Args:
        folder: whose runs are shown.
        read_only: start nothing.
        broker: address of the broker whose servers are shown first.
        prefix: of its topics.
    """

    def __init__(
        self, folder: Path, *, read_only: bool = False, broker: str = DEFAULT_BROKER, prefix: str = ""
    ) -> None:
        self.index = RunIndex(folder)
        self.brokers = Brokers(broker, prefix)
        self.jobs = Jobs(folder, count_servers=self.brokers.count_servers)
        self._read_only = read_only
        self._opened: OrderedDict[str, tuple[object, Run]] = OrderedDict()
        self._pages: OrderedDict[Hashable, str | bytes] = OrderedDict()
        self._lock = threading.Lock()
        self.figures = threading.Lock()
        self._changed = asyncio.Condition()
        self._is_ending = False
        self._warnings: dict[str, str] = {}
        """Why each of the looks fails now."""

    async def watch(self) -> None:
        """Look for changes until cancelled, whatever goes wrong."""
        while True:
            if not self._read_only:
                await self._attempt("the queue stands still", self.jobs.advance)
            is_changed = await self._attempt("the list of runs is not up to date", self._refresh)
            if is_changed:
                async with self._changed:
                    self._changed.notify_all()
            await asyncio.sleep(0 if is_changed and not self.index.is_complete else REFRESH_S)

    def _refresh(self) -> bool:
        return self.index.refresh(FIRST_S)

    async def _attempt(self, consequence: str, look: Callable[[], T]) -> T | None:
        """Return what a look at the stores returns, None where it fails: later it may succeed.

        The same failure is logged once.
        """
        try:
            result = await run_in_threadpool(look)
        except (OSError, SwarmwrightError) as error:  # a full disk, a folder that is gone
            self._warn(consequence, str(error), None)
        except Exception as error:  # noqa: BLE001 - a mistake of ours, after which the window goes on as well
            self._warn(consequence, repr(error), error)
        else:
            self._warnings.pop(consequence, None)
            return result
        return None

    def _warn(self, consequence: str, reason: str, error: Exception | None) -> None:
        if self._warnings.get(consequence) != reason:
            self._warnings[consequence] = reason
            logging.getLogger("swarmwright").warning("%s: %s", consequence, reason, exc_info=error)

    def close(self) -> None:
        """Close the connections to brokers."""
        self.brokers.close()

    async def end_events(self) -> None:
        """Let all streams of events end."""
        self._is_ending = True
        async with self._changed:
            self._changed.notify_all()

    async def events(self, version: int) -> AsyncIterator[bytes]:
        """Yield changes of the list since a version, as server-sent events.

        A slow reader gets all changes since its version at once; nothing is queued for it.
        """
        while not self._is_ending:
            if self.index.version != version:
                version, message = await run_in_threadpool(self.index.delta, version)
                yield b"data: " + message + b"\n\n"
            async with self._changed:
                if self.index.version == version and not self._is_ending:
                    try:
                        await asyncio.wait_for(self._changed.wait(), HEARTBEAT_S)
                    except TimeoutError:
                        yield b": still here\n\n"

    def run(self, request: Request) -> Run:
        """Return the run that a request names, opened anew where it has changed."""
        return self.run_of(request.query_params.get("run", ""))

    def run_of(self, name: str) -> Run:
        """Return a run by its id, opened anew where it has changed."""
        content = self.index.content(name)
        with self._lock:
            opened = self._opened.get(name)
            if opened is not None and opened[0] == content:
                return opened[1]
        run = Run(self.index.path(name))
        with self._lock:
            self._opened[name] = (content, run)
            self._opened.move_to_end(name)
            while len(self._opened) > MOST_OPENED:
                self._opened.popitem(last=False)
        return run

    def check_broker(self, run: Run) -> None:
        """Raise InputError where a run names a broker that is not of this window.

        Somebody else may have made the run, and a connection has the account of the environment.
        """
        experiment = run.experiment
        if experiment.broker is not None and experiment.servers not in BROKERLESS:
            self.brokers.require(experiment.broker)

    def find_broker(self, run: Run) -> str | None:
        """Return the broker whose servers compute a run's episodes; None where this machine can.

        It is that of the run, or else the first of the window. Raises InputError as `check_broker`.
        """
        if catalogue.is_local(run.experiment.simulation):
            return None
        broker = run.experiment.broker
        if broker is None:
            return self.brokers.list_addresses()[0][0]
        self.brokers.require(broker)
        return broker

    def keep_page(self, key: Hashable, page: str | bytes) -> None:
        """Keep a page, as of an episode, as long as it is among the newest."""
        with self._lock:
            self._pages[key] = page
            self._pages.move_to_end(key)
            while sum(map(len, self._pages.values())) > REPLAY_BYTES and len(self._pages) > 1:
                self._pages.popitem(last=False)

    def find_page(self, key: Hashable) -> str | bytes | None:
        """Return a page that is kept, None where there is none."""
        with self._lock:
            return self._pages.get(key)

    def page(self, key: Hashable, make: Callable[[], Page] | None = None) -> Page:
        """Return a page that is kept, or make and keep it. Raises InputError where there is none to make."""
        with self._lock:
            if key in self._pages:
                self._pages.move_to_end(key)
                return cast("Page", self._pages[key])
        if make is None:
            raise InputError("this page is not kept any more; make it again")
        content = make()
        self.keep_page(key, content)
        return content
