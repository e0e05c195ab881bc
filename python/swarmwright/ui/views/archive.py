"""The tab of an archive of elites, as `Run.elites` has it."""

import numpy as np
from starlette.requests import Request

from swarmwright import Run
from swarmwright.methods.map_elites import MapElitesOptions
from swarmwright.results import Grid
from swarmwright.ui.requests import read_integer
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.views._elites import check_method, describe_elites, describe_states
from swarmwright.ui.window import Window


def describe(window: Window, request: Request) -> Values:
    """Return the measures, and coverage and QD score over generations."""
    run = window.run(request)
    options = check_method(run, MapElitesOptions, "map_elites")
    axes = {
        name: {"low": axis.low, "high": axis.high, "bins": axis.bins}
        for name, axis in zip(options.needed_metrics, options.grid.axes, strict=False)
    }
    return {**describe_states(run), "axes": axes}


def find_bins(options: MapElitesOptions, values: Values) -> dict[str, list[int]]:
    """Return the bin of each elite by measure."""
    bins = {}
    for name, axis in zip(options.needed_metrics, options.grid.axes, strict=False):
        column = np.array(values["columns"][name], dtype=np.float64)
        bins[name] = Grid((axis,)).cells_of(column[:, np.newaxis]).tolist()
    return bins


def describe_cells(window: Window, request: Request) -> Values:
    """Return the elites after a generation, the cell of each by the index of its bin of each measure."""
    run = window.run(request)
    options = check_method(run, MapElitesOptions, "map_elites")
    values = describe_elites(run, read_integer(request, "generation"))
    return {**values, "bins": find_bins(options, values)}


def has_archive(run: Run) -> bool:
    """Return whether a run has an archive with measures."""
    method = run.experiment.method
    return run.generations > 0 and isinstance(method, MapElitesOptions) and bool(method.measures)


VIEW = View(
    "archive",
    STATIC / "archive.js",
    "Archive",
    tab_of=has_archive,
    answers={"archive": describe, "archive_cells": describe_cells},
)
