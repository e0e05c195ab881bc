"""The tab of what each server did when."""

from starlette.requests import Request

from swarmwright import InputError
from swarmwright.runs.timeline import timeline, waiting
from swarmwright.ui.index import as_values
from swarmwright.ui.requests import read_number, read_optional_integer
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.views.genes import encode
from swarmwright.ui.window import Window

BINS = 400
MOST_SERVERS = 500
LONGEST_REASON = 300


def describe(window: Window, request: Request) -> Values:
    """Return the lanes of a part of a session, and the shares of the servers in the whole run."""
    run = window.run(request)
    begin, end = (
        read_number(request, name) if request.query_params.get(name) else None for name in ("begin", "end")
    )
    session = read_optional_integer(request, "session")
    shown = timeline(run, session, begin=begin, end=end, bins=BINS)
    timing = shown.timing
    if len(timing.servers) > MOST_SERVERS:
        raise InputError(f"{run.path}: {len(timing.servers)} servers are more than can be shown here")
    return {
        "session": shown.session,
        "sessions": [each.session for each in run.sessions],
        "seconds": shown.seconds,
        "begin": shown.begin,
        "end": shown.end,
        "bins": BINS,
        "servers": as_values(timing.servers),
        "busy": encode(timing.busy),
        "episodes": encode(timing.episodes),
        "evaluated": timing.evaluated.tolist(),
        "failures": [
            as_values({**failure._asdict(), "reason": failure.reason[:LONGEST_REASON]})
            for failure in timing.failures
        ],
    }


def describe_shares(window: Window, request: Request) -> Values:
    """Return what each server did in the whole run, and how long the others waited for it in a session."""
    run = window.run(request)
    shares = run.servers()
    total = sum(share.evaluations for share in shares) or 1
    waits = waiting(run, read_optional_integer(request, "session"))
    return {
        "shares": [
            {
                **as_values(share._asdict()),
                "share": share.evaluations / total,
                "rate": share.evaluations / share.seconds if share.seconds > 0 else None,
            }
            for share in shares[:MOST_SERVERS]
        ],
        "waiting": {str(server): as_values(wait._asdict()) for server, wait in waits.items()},
    }


VIEW = View(
    "timeline",
    STATIC / "timeline.js",
    "Timeline",
    tab_of=lambda run: run.generations > 0,
    answers={"timeline": describe, "timeline_shares": describe_shares},
)
