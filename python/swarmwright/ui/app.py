"""The application: pages, and what they ask for."""

import asyncio
import contextlib
import json
import logging
import threading
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable, Collection, Mapping
from dataclasses import asdict
from html import escape
from pathlib import Path
from secrets import token_urlsafe
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from swarmwright import Run, SwarmwrightError, compare, templates
from swarmwright.common.errors import InputError
from swarmwright.common.yaml import dump
from swarmwright.ui import details, missions
from swarmwright.ui.guard import PLAYER_POLICY, Guard
from swarmwright.ui.index import RunIndex, as_values
from swarmwright.ui.jobs import Jobs

STATIC = Path(__file__).parent / "static"
REFRESH_S = 0.5
"""Between two looks at the stores."""
FIRST_S = 0.4
"""After which the rows that have been read are shown, where there are many."""
HEARTBEAT_S = 15.0
"""After which a silent stream of events says that it is there: proxies close silent ones."""
REPLAY_BYTES = 64 << 20
"""Pages of replays that are kept."""
MOST_COMPARED = 500
MOST_DIGITS = 20
REQUEST_BYTES = 2 << 20
CHANGES = ("check", "start", "stop", "resume", "delete", "mission_save")
ASKED = ("mission_text", "mission_parse", "mission_try")
"""Requests with a body that change nothing."""
KINDS: dict[type, str] = {str: "text", list: "a list", dict: "a mapping"}
T = TypeVar("T")
MOST_OPENED = 20
"""Runs that are kept open."""
Answer = Callable[[Request], Any]


class Window:
    """What the routes share: the list of runs, opened runs, replays.

    Args:
        folder: whose runs are shown.
        read_only: start nothing.
    """

    def __init__(self, folder: Path, *, read_only: bool = False) -> None:
        self.index = RunIndex(folder)
        self.jobs = Jobs(folder)
        self._read_only = read_only
        self._opened: OrderedDict[str, tuple[object, Run]] = OrderedDict()
        self._replays: OrderedDict[tuple[object, ...], str] = OrderedDict()
        self._lock = threading.Lock()
        self._figures = threading.Lock()
        """Matplotlib draws in one thread at a time."""
        self._changed = asyncio.Condition()

    async def watch(self) -> None:
        """Look for changes until cancelled."""
        while True:
            try:
                if not self._read_only:
                    await run_in_threadpool(self.jobs.advance)
                is_changed = await run_in_threadpool(self.index.refresh, FIRST_S)
            except OSError as error:  # a full disk, a folder that is gone: later it may be there again
                logging.getLogger("swarmwright").warning("the list of runs is not up to date: %s", error)
                is_changed = False
            if is_changed:
                async with self._changed:
                    self._changed.notify_all()
            await asyncio.sleep(REFRESH_S if self.index.is_complete else 0)

    async def events(self, version: int) -> AsyncIterator[bytes]:
        """Yield changes of the list since a version, as server-sent events.

        A reader that is slow gets what has changed meanwhile at once: nothing is queued for it.
        """
        while True:
            if self.index.version != version:
                version, message = self.index.delta(version)
                yield b"data: " + message + b"\n\n"
            async with self._changed:
                if self.index.version == version:
                    try:
                        await asyncio.wait_for(self._changed.wait(), HEARTBEAT_S)
                    except TimeoutError:
                        yield b": still here\n\n"

    def run(self, request: Request) -> Run:
        """Return the run that a request names, opened anew where it has changed."""
        name = request.query_params.get("run", "")
        row = self.index.row(name)
        with self._lock:
            opened = self._opened.get(name)
            if opened is not None and opened[0] == row:
                return opened[1]
        run = Run(self.index.path(name))
        with self._lock:
            self._opened[name] = (row, run)
            self._opened.move_to_end(name)
            while len(self._opened) > MOST_OPENED:
                self._opened.popitem(last=False)
        return run

    def replay(self, request: Request) -> str:
        """Return the page of a replay."""
        run = self.run(request)
        options: dict[str, Any] = {
            name: whole(request, name)
            for name in ("generation", "candidate", "episode", "seed")
            if name in request.query_params
        }
        best = () if {"generation", "candidate"} & options.keys() else (run.evaluations,)
        key = (str(run.path), *sorted(options.items()), *best)
        with self._lock:
            if key in self._replays:
                self._replays.move_to_end(key)
                return self._replays[key]
        page = run.replay(**options).html
        self._keep(key, page)
        return page

    def _keep(self, key: tuple[object, ...], page: str) -> None:
        """Keep the page of an episode, as long as it is among the newest."""
        with self._lock:
            self._replays[key] = page
            while sum(map(len, self._replays.values())) > REPLAY_BYTES and len(self._replays) > 1:
                self._replays.popitem(last=False)

    def density(self, request: Request) -> dict[str, Any]:
        """Return the evaluations of a run as a grid."""
        return details.density(self.run(request), whole(request, "columns"), whole(request, "rows"))

    def nearest(self, request: Request) -> dict[str, Any]:
        """Return the evaluation that is nearest to a point of the grid."""
        point = [number(request, name) for name in ("number", "fitness", "width", "height")]
        return details.nearest(self.run(request), *point)

    def experiment(self, request: Request) -> dict[str, Any]:
        """Return a template, or the experiment of a run, as YAML."""
        if "run" in request.query_params:
            file = self.run(request).path / "experiment.yaml"
            try:
                return {"text": file.read_text("utf-8")}
            except (OSError, UnicodeDecodeError) as error:
                raise InputError(f"{file}: cannot be read: {error}") from None
        name, _, mission = request.query_params.get("template", "minisim").partition(":")
        return {"text": templates.arena(mission) if mission else templates.text(name)}

    def templates(self, _request: Request) -> dict[str, Any]:
        """Return the names of the templates; those of missions are `arena:MISSION`."""
        missions = [f"arena:{mission}" for mission in templates.missions()]
        return {"names": [*(name for name in templates.names() if name != "arena"), *missions]}

    def mission(self, name: str, values: dict[str, Any]) -> dict[str, Any]:
        """Do what the drawing board asks for; return the answer."""
        if name == "mission_parse":
            try:
                parsed = missions.parse(field(values, "text", str))
            except InputError as error:
                return {"problems": str(error).splitlines()}
            return {"mission": as_values(parsed), "problems": missions.problems(parsed)}
        mission = field(values, "mission", dict)
        if name == "mission_text":
            return {"text": dump(mission), "problems": missions.problems(mission)}
        if name == "mission_save":
            saved = missions.save(
                self.index.folder, field(values, "name", str), mission, replace=values.get("replace") is True
            )
            return {"file": saved}
        run = field(values, "run", str)
        controller = Run(self.index.path(run)).best.controller if run else None
        page = missions.try_out(mission, index(values.get("seed")), controller)
        name = token_urlsafe(12)
        self._keep((name,), page)
        return {"id": name}

    def find_try(self, request: Request) -> str:
        """Return the page of an episode that the drawing board asked for."""
        with self._lock:
            page = self._replays.get((request.query_params.get("id", ""),))
        if page is None:
            raise InputError("this episode is not kept any more; press Try again")
        return page

    def change(self, name: str, values: dict[str, Any]) -> dict[str, Any]:
        """Do what a request to change something asks for; return the answer."""
        if name.startswith("mission_"):
            return self.mission(name, values)
        if name == "check":
            return {"problems": self.jobs.check(field(values, "text", str))}
        if name == "start":
            text = field(values, "text", str)
            wrong = self.jobs.check(text)
            if wrong:
                return {"problems": wrong}
            seeds = [index(seed) for seed in field(values, "seeds", list)]
            return {"jobs": [asdict(job) for job in self.jobs.start(text, field(values, "name", str), seeds)]}
        if name == "stop":
            return {"jobs": [asdict(self.jobs.stop(field(values, "job", str)))]}
        runs = [field({"runs": run}, "runs", str) for run in field(values, "runs", list)]
        for run in runs:
            self.index.path(run)
        if not 1 <= len(runs) <= MOST_COMPARED:
            raise InputError(f"runs: choose 1 to {MOST_COMPARED} runs, not {len(runs)}")
        if name == "delete":
            return {"jobs": [asdict(self.jobs.delete(runs))]}
        generations = values.get("generations")
        return {
            "jobs": [
                asdict(self.jobs.resume(run, None if generations is None else index(generations)))
                for run in runs
            ]
        }

    def compare(self, request: Request) -> dict[str, Any]:
        """Return the comparison of several runs: its text, values and figure."""
        names = request.query_params.getlist("run")
        if not 1 <= len(names) <= MOST_COMPARED:
            raise InputError(f"run: choose 1 to {MOST_COMPARED} runs, not {len(names)}")
        paths = [self.index.path(name) for name in names]
        is_held_out = request.query_params.get("held_out") == "true"
        with self._figures:
            comparison = compare(paths, held_out=is_held_out, at=optional(request, "at"))
            with TemporaryDirectory() as folder:
                figure = comparison.plot(Path(folder) / "comparison.svg").read_text("utf-8")
        return {"text": str(comparison), "values": as_values(comparison.to_mapping()), "figure": figure}


def whole(request: Request, name: str) -> int:
    """Return a whole number of the query. Raises InputError for anything else."""
    text = request.query_params.get(name, "")
    try:
        if len(text) > MOST_DIGITS:
            raise ValueError
        return int(text)
    except ValueError:
        raise InputError(f"{name}: must be a whole number, not {text[:50]!r}") from None


def optional(request: Request, name: str) -> int | None:
    """Return a whole number of the query, None where it is missing or empty."""
    return whole(request, name) if request.query_params.get(name) else None


def number(request: Request, name: str) -> float:
    """Return a number of the query. Raises InputError for anything else."""
    text = request.query_params.get(name, "")
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name}: must be a number, not {text[:50]!r}") from None


def json_response(values: Mapping[str, Any], status: int = 200) -> Response:
    """Return values as JSON."""
    return Response(json.dumps(values, allow_nan=False), status, media_type="application/json")


def create_app(
    folder: Path,
    *,
    token: str | None,
    port: int = 0,
    hosts: Collection[str] = (),
    read_only: bool = False,
) -> Starlette:
    """Return the application for an ASGI server.

    Args:
        folder: whose runs are shown.
        token: that requests need; None: none.
        port: that it listens on, for the name of its cookie.
        hosts: names by which it is reached, beside those of loopback.
        read_only: refuse what changes something.
    """
    window = Window(folder, read_only=read_only)

    def player(make: Callable[[Request], str]) -> Callable[[Request], Any]:
        async def respond(request: Request) -> Response:
            try:
                page = await run_in_threadpool(make, request)
            except SwarmwrightError as error:
                page = message_page(str(error))
            return HTMLResponse(page, headers={"Content-Security-Policy": PLAYER_POLICY})

        return respond

    async def events(request: Request) -> Response:
        version = request.query_params.get("version", "0")
        return StreamingResponse(
            window.events(int(version) if version.isdecimal() and len(version) < MOST_DIGITS else 0),
            media_type="text/event-stream",
            headers={"X-Accel-Buffering": "no"},
        )

    async def start(_request: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    @contextlib.asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
        watcher = asyncio.create_task(window.watch())
        yield
        watcher.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await watcher

    answers: dict[str, Answer] = {
        "window": lambda _request: {"folder": str(folder), "read_only": read_only},
        "compare": window.compare,
        "run": lambda request: details.describe(window.run(request)),
        "density": window.density,
        "nearest": window.nearest,
        "missions": lambda _request: missions.names(folder),
        "mission": lambda request: {
            "mission": as_values(
                missions.parse(missions.text_of(folder, request.query_params.get("name", "")))
            )
        },
        "templates": window.templates,
        "experiment": window.experiment,
        "jobs": lambda _request: {"jobs": [asdict(job) for job in window.jobs.list_jobs()]},
        "journal": lambda request: details.journal(window.run(request)),
    }
    return Starlette(
        routes=[
            Route("/", start),
            Route("/api/events", events),
            *(Route(f"/api/{name}", endpoint(compute)) for name, compute in answers.items()),
            *(Route(f"/api/{name}", changing(window, name), methods=["POST"]) for name in (*CHANGES, *ASKED)),
            Route("/replay", player(window.replay)),
            Route("/try", player(window.find_try)),
            Mount("/static", StaticFiles(directory=STATIC)),
        ],
        middleware=[
            Middleware(
                Guard,
                token=token,
                hosts=hosts,
                port=port,
                read_only=read_only,
                asking=[f"/api/{name}" for name in ASKED],
            )
        ],
        lifespan=lifespan,
    )


def endpoint(compute: Answer) -> Callable[[Request], Any]:
    """Return an endpoint that computes values in a thread, and says what is wrong with a request."""

    async def respond(request: Request) -> Response:
        try:
            return json_response(await run_in_threadpool(compute, request))
        except SwarmwrightError as error:
            return json_response({"error": str(error)}, 422)

    return respond


def changing(window: Window, name: str) -> Callable[[Request], Any]:
    """Return an endpoint that takes an object of JSON and changes something."""

    async def respond(request: Request) -> Response:
        if request.headers.get("content-type", "").partition(";")[0] != "application/json":
            return json_response({"error": "the request must be application/json"}, 415)
        body = bytearray()
        async for part in request.stream():
            body += part
            if len(body) > REQUEST_BYTES:
                return json_response({"error": "the request is larger than 2 MiB"}, 413)
        try:
            values = json.loads(body)
            if not isinstance(values, dict):
                raise InputError("the request must be an object of JSON")
            return json_response(await run_in_threadpool(window.change, name, values))
        except SwarmwrightError as error:
            return json_response({"error": str(error)}, 422)
        except (ValueError, RecursionError):
            return json_response({"error": "the request is not valid JSON"}, 400)

    return respond


def field(values: dict[str, Any], name: str, kind: type[T]) -> T:
    """Return a value of a request. Raises InputError when it is missing or of another type."""
    value = values.get(name)
    if not isinstance(value, kind):
        raise InputError(f"{name}: must be {KINDS[kind]}")
    if kind is str:
        try:
            str(value).encode()
        except UnicodeEncodeError:
            raise InputError(f"{name}: is not valid Unicode") from None
    return value


def index(value: Any) -> int:  # noqa: ANN401 - JSON
    """Return a whole number of a request. Raises InputError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{str(value)[:50]!r}: must be a whole number")
    return value


def message_page(text: str) -> str:
    """Return a page that says why there is no replay."""
    style = "font: 15px system-ui, sans-serif; margin: 2rem; color: #888; white-space: pre-wrap"
    return (
        f'<!doctype html><meta charset="utf-8"><title>No replay</title><p style="{style}">{escape(text)}</p>'
    )
