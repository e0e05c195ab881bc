"""The tab of an archive of elites, as `Run.elites` has it."""

import numpy as np
from starlette.requests import Request

from swarmwright import Run
from swarmwright.methods.map_elites import MapElitesOptions
from swarmwright.results import Axis, Grid, Voronoi
from swarmwright.runs.elites import options_of_elites
from swarmwright.ui.requests import read_integer
from swarmwright.ui.views._base import STATIC, Values, View
from swarmwright.ui.views._elites import check_method, describe_elites, describe_states
from swarmwright.ui.window import Window

_BINS = 40
"""Bins of each measure in the map of an archive that is not a grid."""
_RASTER = 120
"""Columns and rows of the map of Voronoi cells."""


def describe(window: Window, request: Request) -> Values:
    """Return the measures, the raster of Voronoi cells of two measures, and indicators over generations."""
    run = window.run(request)
    options = check_method(run, MapElitesOptions, "map_elites or novelty")
    axes = {
        name: {"low": axis.low, "high": axis.high, "bins": axis.bins} for name, axis in _axes(options).items()
    }
    return {**describe_states(run), "axes": axes, "raster": find_raster(options)}


def _axes(options: MapElitesOptions) -> dict[str, Axis]:
    """Return the measures with the bins of the map."""
    is_grid = isinstance(options.cells, Grid)
    axes = [axis if is_grid else Axis(axis.low, axis.high, _BINS) for axis in options.axes]
    return dict(zip(options.needed_metrics, axes, strict=False))


def find_raster(options: MapElitesOptions) -> Values | None:
    """Return the Voronoi cell of each point of a raster, column after column; None for other archives."""
    cells = options.cells
    if not isinstance(cells, Voronoi) or len(cells.axes) != 2:
        return None
    x, y = (axis.low + (axis.high - axis.low) * (np.arange(_RASTER) + 0.5) / _RASTER for axis in cells.axes)
    points = np.stack([np.repeat(x, _RASTER), np.tile(y, _RASTER)], axis=1)
    return {"size": _RASTER, "cells": cells.cells_of(points).tolist()}


def find_bins(options: MapElitesOptions, values: Values) -> dict[str, list[int]]:
    """Return the bin of each elite by measure."""
    bins = {}
    for name, axis in _axes(options).items():
        column = np.array(values["columns"][name], dtype=np.float64)
        bins[name] = Grid((axis,)).cells_of(column[:, np.newaxis]).tolist()
    return bins


def describe_cells(window: Window, request: Request) -> Values:
    """Return the elites after a generation: the bin of each for each measure, and its Voronoi cell."""
    run = window.run(request)
    options = check_method(run, MapElitesOptions, "map_elites or novelty")
    values = describe_elites(run, read_integer(request, "generation"))
    measures = [values["columns"][name] for name in options.needed_metrics]
    cells = options.cells
    indices = cells.cells_of(np.array(measures, dtype=np.float64).T).tolist() if cells is not None else []
    return {**values, "bins": find_bins(options, values), "cells": indices}


def has_archive(run: Run) -> bool:
    """Return whether a run has an archive with measures."""
    method = options_of_elites(run)
    return run.generations > 0 and isinstance(method, MapElitesOptions) and bool(method.measures)


VIEW = View(
    "archive",
    STATIC / "archive.js",
    "Archive",
    tab_of=has_archive,
    answers={"archive": describe, "archive_cells": describe_cells},
)
