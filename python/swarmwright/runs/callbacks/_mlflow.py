"""The callback for MLflow, which logs parameters, curves and files to a tracking server."""

import logging
import math
import os
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from swarmwright.common.arguments import check_arguments
from swarmwright.common.errors import InputError, RunError
from swarmwright.common.values import flatten
from swarmwright.runs import picture
from swarmwright.runs.callbacks._base import Callback, figures, get_held_out_figures

if TYPE_CHECKING:
    from swarmwright.experiment.experiment import Experiment
    from swarmwright.runs.optimization.generation import Generation
    from swarmwright.runs.run import Run

_log = logging.getLogger("swarmwright")
_PERIOD_S = 1.0
"""Least time between messages to the server."""
_MAX_FIGURES = 900
"""Largest number of figures in a message; the server accepts 1000."""
_MAX_PARAMETERS = 100
"""Largest number of parameters in a message."""
_VALUE_CHARACTERS = 6000
"""Largest length of a parameter's value that the server accepts."""
_FILES = ("experiment.yaml", "best.json", "fitness.png")


class MLflow(Callback):
    """Creates a run on an MLflow tracking server.

    The experiment's keys become parameters (`method.population`), the figures of each generation become
    metrics with the generation as step, and experiment.yaml, best.json and fitness.png become artifacts.

    Args:
        uri: URI of the tracking server (http://..) or database (sqlite:///mlflow.db); by default the
            environment variable MLFLOW_TRACKING_URI.
        experiment: its values become parameters, and its file's name becomes the run's name.
        group: name of the MLflow experiment that lists the runs.

    Raises:
        InputError: MLflow is not installed.
        RunError: the tracking server does not answer or refuses.
    """

    @check_arguments
    def __init__(
        self, uri: str | None = None, experiment: "Experiment | None" = None, *, group: str = "swarmwright"
    ) -> None:
        try:
            # Do not wait minutes for a server that is unavailable.
            os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")
            os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "10")
            os.environ.setdefault("MLFLOW_LOGGING_LEVEL", "WARNING")
            from mlflow import MlflowClient
            from mlflow.exceptions import MlflowException
        except ImportError:
            raise InputError("MLflow is not installed: pip install 'swarmwright[mlflow]'") from None
        self._error: type[Exception] = MlflowException
        self._server = uri or os.environ.get("MLFLOW_TRACKING_URI", "its default location")
        self._waiting: list[Any] = []
        self._sent = time.monotonic()
        self._ended = False
        try:
            self._client = MlflowClient(tracking_uri=uri)
            existing = self._client.get_experiment_by_name(group)
            group_id = existing.experiment_id if existing else self._client.create_experiment(group)
            self._run = self._client.create_run(group_id, run_name=_name_run(experiment)).info.run_id
            if experiment is not None:
                self._describe(experiment)
        except Exception as error:  # its back ends raise various exceptions
            raise RunError(f"MLflow at {self._server}: {_first_line(error)}") from error

    @property
    def run_id(self) -> str:
        """The run's id on the tracking server."""
        return str(self._run)

    def _describe(self, experiment: "Experiment") -> None:
        from mlflow.entities import Param

        values = {key: str(value) for key, value in flatten(experiment.to_mapping()).items()}
        parameters = [Param(name, value[:_VALUE_CHARACTERS]) for name, value in values.items()]
        for first in range(0, len(parameters), _MAX_PARAMETERS):
            self._client.log_batch(self._run, params=parameters[first : first + _MAX_PARAMETERS])

    def __call__(self, generation: "Generation") -> None:
        """Add the figures, which are sent about once a second."""
        from mlflow.entities import Metric

        now = time.time_ns() // 1_000_000
        self._waiting += [
            Metric(name, value, now, generation.generation)
            for name, value in figures(generation).items()
            if math.isfinite(value)
        ]
        if time.monotonic() - self._sent > _PERIOD_S or len(self._waiting) > _MAX_FIGURES:
            self._send()

    def _send(self) -> None:
        """Send the waiting figures. A temporarily unavailable server does not end the run."""
        while self._waiting:
            part = self._waiting[:_MAX_FIGURES]
            try:
                self._client.log_batch(self._run, metrics=part)
            except Exception as error:  # noqa: BLE001 - its back ends raise various exceptions
                _log.warning(
                    "MLflow at %s: %s; the figures are kept and sent later", self._server, _first_line(error)
                )
                break
            del self._waiting[: len(part)]
        self._sent = time.monotonic()

    def conclude(self, run: "Run") -> None:
        """Send the fitness on held-out seeds, the files and the outcome."""
        from mlflow.entities import Metric

        now = time.time_ns() // 1_000_000
        self._waiting += [
            Metric(name, value, now, run.generations - 1) for name, value in get_held_out_figures(run).items()
        ]
        self._send()
        picture.wait()
        try:
            for name in _FILES:
                if (run.path / name).exists():
                    self._client.log_artifact(self._run, str(run.path / name))
            self._client.set_tag(self._run, "record", run.digest)
            self._client.set_terminated(self._run, "KILLED" if run.interrupted else "FINISHED")
            self._ended = True
        except Exception as error:  # noqa: BLE001 - its back ends raise various exceptions
            _log.warning(
                "MLflow at %s: %s; the run itself is complete in %s",
                self._server,
                _first_line(error),
                run.path,
            )

    def close(self) -> None:
        """Send the remaining figures; a run without a conclusion has failed."""
        self._send()
        if not self._ended:
            self._ended = True
            with suppress(Exception):  # the user has been warned already
                self._client.set_terminated(self._run, "FAILED")


def _name_run(experiment: "Experiment | None") -> str | None:
    """Name a run by its experiment file, or a resumed run by its folder."""
    path = None if experiment is None else experiment.path
    if path is None:
        return None
    return path.absolute().parent.name if path.name == "experiment.yaml" else path.stem


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
