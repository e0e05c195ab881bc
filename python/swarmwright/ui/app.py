"""The application: the views of the window behind its guard."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable, Collection, Mapping
from html import escape
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, Response, StreamingResponse
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from swarmwright import SwarmwrightError
from swarmwright.experiment.broker_address import DEFAULT_BROKER
from swarmwright.ui.guard import PLAYER_POLICY, Guard, check_ancestors, read_host
from swarmwright.ui.requests import MOST_DIGITS
from swarmwright.ui.sessions import Sessions
from swarmwright.ui.views import View, load_views
from swarmwright.ui.views._base import STATIC
from swarmwright.ui.window import Window

REQUEST_BYTES = 2 << 20


def create_app(
    folder: Path,
    *,
    token: str | None,
    port: int = 0,
    hosts: Collection[str] = (),
    read_only: bool = False,
    broker: str = DEFAULT_BROKER,
    prefix: str = "",
    sessions: Sessions | None = None,
    is_public: bool = False,
    ancestors: Collection[str] = (),
) -> Starlette:
    """Return the application for an ASGI server.

    Args:
        folder: whose runs are shown.
        token: that requests need; None: none.
        port: that it listens on, for the name of its cookie.
        hosts: names by which it is reached, beside those of loopback.
        read_only: refuse what changes something.
        broker: address of the broker whose servers are shown first.
        prefix: of its topics.
        sessions: of those who have entered the password, which takes the place of the token.
        is_public: whether other machines may reach it.
        ancestors: origins of pages that may show it in a frame.

    Raises InputError for a view of another package that is broken, and for a host or ancestor that is none.
    """
    check_ancestors(ancestors)
    window = Window(folder, read_only=read_only, broker=broker, prefix=prefix)
    views = load_views()

    async def start(_request: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    async def events(request: Request) -> Response:
        version = request.query_params.get("version", "0")
        return StreamingResponse(
            window.events(int(version) if version.isdecimal() and len(version) < MOST_DIGITS else 0),
            media_type="text/event-stream",
            headers={"X-Accel-Buffering": "no"},
        )

    def describe(_request: Request) -> Mapping[str, Any]:
        return {
            "folder": str(folder),
            "read_only": read_only,
            "views": [
                {
                    "name": view.name,
                    "title": view.title,
                    "script": address(view),
                    "is_tab": view.tab_of is not None,
                    "is_for_changes": view.is_for_changes,
                }
                for view in views
            ],
        }

    def list_tabs(request: Request) -> Mapping[str, Any]:
        run = window.run(request)
        return {"tabs": [view.name for view in views if view.tab_of is not None and view.tab_of(run)]}

    @contextlib.asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncIterator[None]:
        watcher = asyncio.create_task(window.watch())
        yield
        watcher.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await watcher
        await run_in_threadpool(window.close)

    routes: list[Route | Mount] = [
        Route("/", start),
        Route("/api/events", events),
        Route("/api/window", answering(describe)),
        Route("/api/tabs", answering(list_tabs)),
        Mount("/static", StaticFiles(directory=STATIC)),
    ]
    for view in views:
        for name, answer in view.answers.items():
            routes.append(Route(f"/api/{name}", answering(bind(answer, window))))
        for name, change in {**view.asks, **view.changes}.items():
            routes.append(Route(f"/api/{name}", changing(bind(change, window)), methods=["POST"]))
        for name, make in view.documents.items():
            routes.append(Route(f"/{name}", showing(bind(make, window))))
        if view.script.parent != STATIC:
            routes.append(Mount(f"/views/{view.name}", StaticFiles(directory=view.script.parent)))
    app = Starlette(
        routes=routes,
        middleware=[
            Middleware(
                Guard,
                token=token,
                hosts=[read_host(host) for host in hosts],
                port=port,
                read_only=read_only,
                sessions=sessions,
                is_public=is_public,
                ancestors=ancestors,
                asking=[f"/api/{name}" for view in views for name in view.asks],
            )
        ],
        lifespan=lifespan,
    )
    app.state.window = window
    return app


def address(view: View) -> str:
    """Return where the module of a view is served, relative to the window."""
    folder = "static" if view.script.parent == STATIC else f"views/{view.name}"
    return f"{folder}/{view.script.name}"


def bind(compute: Callable[[Window, Any], Any], window: Window) -> Callable[[Any], Any]:
    """Return what a view computes, of a request alone."""
    return lambda request: compute(window, request)


def json_response(values: Mapping[str, Any], status: int = 200) -> Response:
    """Return values as JSON."""
    return Response(json.dumps(values, allow_nan=False), status, media_type="application/json")


def answering(compute: Callable[[Request], Any]) -> Callable[[Request], Any]:
    """Return an endpoint that computes values in a thread, and says what is wrong with a request."""

    async def respond(request: Request) -> Response:
        return await run_in_threadpool(answer, compute, request)

    return respond


def answer(compute: Callable[[Any], Any], question: Any) -> Response:  # noqa: ANN401 - whatever it takes
    """Return what is computed, or what is wrong with a question.

    An error stays in its thread: it may hold an episode, which must not get into another one.
    """
    try:
        values = compute(question)
    except SwarmwrightError as error:
        return json_response({"error": str(error)}, 422)
    except RecursionError:
        return json_response({"error": "the request is nested too deeply"}, 422)
    return values if isinstance(values, Response) else json_response(values)


def changing(change: Callable[[dict[str, Any]], Any]) -> Callable[[Request], Any]:
    """Return an endpoint that takes an object of JSON."""

    async def respond(request: Request) -> Response:
        if request.headers.get("content-type", "").partition(";")[0] != "application/json":
            return json_response({"error": "the request must be application/json"}, 415)
        body = bytearray()
        try:
            async for part in request.stream():
                body += part
                if len(body) > REQUEST_BYTES:
                    return json_response({"error": "the request is larger than 2 MiB"}, 413)
            values = json.loads(body)
        except ClientDisconnect:  # nobody reads the answer
            return Response(status_code=400)
        except (ValueError, RecursionError):
            return json_response({"error": "the request is not valid JSON"}, 400)
        if not isinstance(values, dict):
            return json_response({"error": "the request must be an object of JSON"}, 422)
        return await run_in_threadpool(answer, change, values)

    return respond


def showing(make: Callable[[Request], str]) -> Callable[[Request], Any]:
    """Return an endpoint for HTML documents, such as replays, that cannot access the network."""

    def make_page(request: Request) -> str:
        try:
            return make(request)
        except SwarmwrightError as error:
            return message_page(str(error))

    async def respond(request: Request) -> Response:
        page = await run_in_threadpool(make_page, request)
        return HTMLResponse(page, headers={"Content-Security-Policy": PLAYER_POLICY})

    return respond


def message_page(text: str) -> str:
    """Return a page that says why there is no replay."""
    style = "font: 15px system-ui, sans-serif; margin: 2rem; color: #888; white-space: pre-wrap"
    return (
        f'<!doctype html><meta charset="utf-8"><title>No replay</title><p style="{style}">{escape(text)}</p>'
    )
