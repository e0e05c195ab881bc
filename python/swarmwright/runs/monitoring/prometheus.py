"""Figures of a run or of servers for Prometheus, https://prometheus.io/docs/instrumenting/exposition_formats.

Names follow its conventions: a prefix, base units, `_total` for what only grows.
"""

import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from swarmwright.common.errors import InputError

if TYPE_CHECKING:
    from prometheus_client.core import Metric

    from swarmwright.runs.optimization.generation import Generation

COUNTS = {
    "server_failures": "Times that a server was lost, fell silent for too long, or sent what cannot be used.",
    "time_outs": "Of the failures of servers, those in which one was silent for too long.",
    "benched": "Times that a server had to pause because it failed.",
    "broker_losses": "Times that the connection to the broker broke.",
    "retries": "Attempts that were made again.",
    "failed": "Evaluations that have finally failed.",
    "quarantined": "Of these, those that took so many servers down that no other one got them.",
    "backups": "Backup copies of running work that were given to another server.",
    "late": "Results that arrived after their evaluation had ended; they were refused.",
    "double": "Results for evaluations that had one already; they were refused.",
    "foreign": "Messages of an episode that named another simulation; they were refused.",
    "audits": "Evaluations that were repeated on another server to see whether it finds the same.",
    "audits_left_out": "Results that count without the audit that was drawn, as no other server was usable.",
    "disagreements": "Of the audits, those in which two servers did not agree.",
    "recomputed": "Evaluations that were made again because their server turned out to be wrong.",
}
"""Events that the pool counts: descriptions of the counters."""

TRAFFIC = {
    "sent_bytes": "Bytes sent to the broker, without those of TLS.",
    "received_bytes": "Bytes received from the broker, without those of TLS.",
    "sent_messages": "Messages published.",
    "received_messages": "Messages received.",
}


_NAMED = 10
"""Servers that have a sample of their own: each new label value is a time series in Prometheus."""


class _Figures:
    """Numbers that are set by one thread and collected by another."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._started = time.time()

    def collect(self) -> "Iterator[Metric]":
        """Yield every number; Prometheus' client calls it."""
        with self._lock:
            families = list(self._families())
        yield _gauge("start_time_seconds", "When it was started, seconds since 1970.", self._started)
        yield from families

    def _families(self) -> "Iterator[Metric]":
        raise NotImplementedError


class ToolFigures(_Figures):
    """Metrics of an optimization tool, counted from its reports."""

    def __init__(self) -> None:
        super().__init__()
        self._generation: Generation | None = None
        self._candidates = self._failed = 0
        self._seen = 0  # candidates of the run under way
        self._servers: dict[int, str] = {}
        self._attempts: Counter[tuple[str, str]] = Counter()
        self._evaluations = self._done = self._pending = 0
        self._benched = self._broker_losses = 0
        self._connected = 1
        self._status: Mapping[str, Any] = {}
        self._traffic: Counter[str] = Counter()
        self._counts: Mapping[str, int] = {}

    def generation(self, generation: "Generation") -> None:
        """A generation has been evaluated."""
        with self._lock:
            if generation.evaluations < self._seen:
                self._seen = 0  # another run of a sweep
            self._candidates += generation.evaluations - self._seen
            self._seen = generation.evaluations
            self._failed += generation.failed
            self._generation = generation

    def report(self, report: Mapping[str, Any]) -> None:
        """Count a pool's report, see `_engine.Pool.listen`."""
        with self._lock:
            match report["event"]:
                case "status":
                    self._stands(report)
                case "server" if report["state"] == "left":
                    self._servers.pop(report["server"], None)
                case "server":
                    self._servers[report["server"]] = report["state"]
                case "attempt":
                    self._attempts[report["mode"], report["outcome"]] += 1
                case "benched":
                    self._benched += 1
                case "broker_lost":
                    self._broker_losses += 1
                    self._connected = 0
                case "broker_back":
                    self._connected = 1

    def _stands(self, report: Mapping[str, Any]) -> None:
        status = report["status"]
        done, total = status["done"], status["total"]
        self._evaluations += done - self._done if done >= self._done else done
        # Once all have ended the next piece of work counts from 0 again.
        self._done = 0 if done >= total else done
        self._pending = total - done
        self._status = status
        self._traffic = report["traffic"]
        self._counts = report.get("counts", {})

    def _families(self) -> "Iterator[Metric]":
        generation = self._generation
        if generation is not None:
            yield _gauge(
                "generation", "The last generation that was finished, from 0.", generation.generation
            )
            if generation.generations is not None:
                yield _gauge("generations", "Generations of the whole run.", generation.generations)
            yield _gauge("best_fitness", "Best fitness since the start of the run.", generation.best_so_far)
            yield _gauge("mean_fitness", "Mean fitness of the population.", generation.mean)
            yield _gauge("run_seconds", "Since the run was started or resumed.", generation.seconds)
        yield _counter("candidates", "Candidates that were evaluated.", self._candidates)
        yield _counter("candidates_failed", "Of these, those whose evaluation failed.", self._failed)
        yield _counter("evaluations", "Evaluations on servers that have ended.", self._evaluations)
        yield _gauge("evaluations_pending", "Evaluations asked for that have not ended.", self._pending)
        yield _labelled_counter(
            "attempts", "Attempts at evaluations, single or in batches.", ("mode", "outcome"), self._attempts
        )
        states = Counter(self._servers.values())
        benched = sum(used.get("benched") is not None for used in self._status.get("servers", ()))
        yield _labelled_gauge(
            "servers",
            "Servers with the simulation, by what they say; benched: those that have a pause.",
            ("state",),
            {**{(state,): states[state] for state in ("ready", "busy", "lost")}, ("benched",): benched},
        )
        silent = _silent(self._status)
        yield _gauge(
            "silence_seconds", "How long the blocking server was silent.", max(silent.values(), default=0)
        )
        yield _labelled_gauge(
            "server_silence_seconds",
            "How long servers were silent that have work, the blocking ones first; at most ten.",
            ("server",),
            {
                (str(server),): silent[server]
                for server in sorted(silent, key=lambda one: -silent[one])[:_NAMED]
            },
        )
        yield _gauge("broker_connected", "Whether there is a connection to the broker.", self._connected)
        counts = {"benched": self._benched, "broker_losses": self._broker_losses, **self._counts}
        for name, meaning in COUNTS.items():
            if name in counts:
                yield _counter(f"pool_{name}", meaning, counts[name])
        for name, meaning in TRAFFIC.items():
            yield _counter(f"broker_{name}", meaning, self._traffic.get(name, 0))


class ServeFigures(_Figures):
    """Figures of servers that one process started."""

    def __init__(self) -> None:
        super().__init__()
        self._states: dict[int, str] = {}
        self._events: Counter[tuple[str]] = Counter()

    def event(self, server: int, event: str) -> None:
        """Something happened to a server: waiting, ready, busy, lost, warning, failure, error, ended."""
        with self._lock:
            self._events[(event,)] += 1
            if event in {"ready", "busy", "lost", "ended"}:
                self._states[server] = event

    def _families(self) -> "Iterator[Metric]":
        states = Counter(self._states.values())
        yield _labelled_gauge(
            "servers",
            "Servers of this process, by state.",
            ("state",),
            {(state,): states[state] for state in ("ready", "busy", "lost", "ended")},
        )
        yield _labelled_counter("server_events", "What happened to servers.", ("event",), self._events)


def _silent(status: Mapping[str, Any]) -> dict[int, float]:
    """Return how long servers with work have been silent, seconds."""
    silent: dict[int, float] = {}
    for work in status.get("waiting_for", ()):
        silent[work["server"]] = max(silent.get(work["server"], 0.0), work["silent"])
    return silent


def _gauge(name: str, meaning: str, value: float) -> "Metric":
    from prometheus_client.core import GaugeMetricFamily

    return GaugeMetricFamily(f"swarmwright_{name}", meaning, value=value)


def _counter(name: str, meaning: str, value: float) -> "Metric":
    from prometheus_client.core import CounterMetricFamily

    return CounterMetricFamily(f"swarmwright_{name}", meaning, value=value)


def _labelled_gauge(
    name: str, meaning: str, labels: tuple[str, ...], values: Mapping[Any, float]
) -> "Metric":
    from prometheus_client.core import GaugeMetricFamily

    family = GaugeMetricFamily(f"swarmwright_{name}", meaning, labels=labels)
    for label, value in values.items():
        family.add_metric(label, value)
    return family


def _labelled_counter(
    name: str, meaning: str, labels: tuple[str, ...], values: Mapping[Any, float]
) -> "Metric":
    from prometheus_client.core import CounterMetricFamily

    family = CounterMetricFamily(f"swarmwright_{name}", meaning, labels=labels)
    for label, value in values.items():
        family.add_metric(label, value)
    return family


@contextmanager
def offered(figures: _Figures, host: str, port: int) -> Iterator[str]:
    """Offer figures to Prometheus for the time of a `with` block; yield the URL.

    Raises InputError when the address cannot be listened on, or prometheus-client is not installed.
    """
    try:
        from prometheus_client import CollectorRegistry

        from swarmwright.runs.monitoring.metrics_server import MetricsServer
    except ImportError:
        raise InputError(
            "--metrics needs the package prometheus-client: pip install 'swarmwright[metrics]'"
        ) from None
    registry = CollectorRegistry()
    registry.register(figures)
    try:
        server = MetricsServer(host, port, registry)
    except (OSError, UnicodeError) as error:
        raise InputError(f"--metrics: {host}:{port} cannot be listened on: {error}") from error
    thread = threading.Thread(target=server.serve_forever, name="metrics", daemon=True)
    thread.start()
    at = f"[{host}]" if ":" in host else host
    try:
        yield f"http://{at}:{server.server_port}/metrics"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
