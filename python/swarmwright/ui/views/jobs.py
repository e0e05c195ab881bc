"""The page of what was started here."""

from dataclasses import asdict

from swarmwright.ui.requests import read_field
from swarmwright.ui.views._base import STATIC, View

VIEW = View(
    "jobs",
    STATIC / "jobs.js",
    "Jobs",
    is_for_changes=True,
    answers={"jobs": lambda window, _request: {"jobs": [asdict(job) for job in window.jobs.list_jobs()]}},
    changes={
        "stop": lambda window, values: {"jobs": [asdict(window.jobs.stop(read_field(values, "job", str)))]}
    },
)
