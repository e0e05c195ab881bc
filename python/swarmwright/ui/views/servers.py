"""The servers of a broker, live, and those that are started here."""

from dataclasses import asdict
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from swarmwright.simulations import catalogue
from swarmwright.ui.requests import read_field, read_whole
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.views.jobs import list_jobs
from swarmwright.ui.window import Window


def look(window: Window, request: Request) -> Response:
    """Return the servers and tools of a broker; without an address, of the first one."""
    query = request.query_params
    watch = window.brokers.find(query.get("broker", ""), query.get("prefix", ""))
    return Response(watch.look(), media_type="application/json")


def list_brokers(window: Window, request: Request) -> Values:
    """Return the brokers of this window, and the servers and brokers that were started here."""
    return {
        **list_jobs(window, request, only_services=True),
        "brokers": [{"url": url, "prefix": prefix} for url, prefix in window.brokers.list_addresses()],
        "simulations": list(catalogue.titles()),
    }


def add_broker(window: Window, values: dict[str, Any]) -> Values:
    """Add a broker to those of the window."""
    window.brokers.add(read_field(values, "broker", str).strip(), read_field(values, "prefix", str).strip())
    return {}


def serve(window: Window, values: dict[str, Any]) -> Values:
    """Start servers on a broker of the window."""
    url, prefix = read_field(values, "broker", str), read_field(values, "prefix", str)
    window.brokers.find(url, prefix)
    count = read_whole(values.get("count"), "count")
    return {
        "jobs": [asdict(window.jobs.serve(read_field(values, "simulation", str), count, url, prefix))],
    }


def start_broker(window: Window, values: dict[str, Any]) -> Values:
    """Start a broker on this machine."""
    return {"jobs": [asdict(window.jobs.start_broker(read_whole(values.get("port"), "port")))]}


VIEW = View(
    "servers",
    STATIC / "servers.js",
    "Servers",
    answers={"servers": look, "brokers": list_brokers},
    changes={"broker": add_broker, "serve": serve, "start_broker": start_broker},
)
