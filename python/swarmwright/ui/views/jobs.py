"""The page of what was started here."""

from dataclasses import asdict

from starlette.requests import Request

from swarmwright.ui.requests import read_field
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.window import Window


def list_jobs(window: Window, request: Request, *, only_services: bool = False) -> Values:
    """Return the jobs, and what those that are opened on the page have printed."""
    jobs = [job for job in window.jobs.list_jobs() if job.is_service or not only_services]
    outputs = window.jobs.read_outputs(request.query_params.getlist("opened"))
    return {"jobs": [asdict(job) for job in jobs], "outputs": outputs}


VIEW = View(
    "jobs",
    STATIC / "jobs.js",
    "Jobs",
    is_for_changes=True,
    answers={"jobs": list_jobs},
    changes={
        "stop": lambda window, values: {"jobs": [asdict(window.jobs.stop(read_field(values, "job", str)))]}
    },
)
