"""Metrics of a run or of servers for Prometheus, https://prometheus.io/docs/instrumenting/exposition_formats.

Names follow its conventions: a prefix, base units, and `_total` for counters.
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
    "server_failures": "Server failures: lost, silent for too long, or unusable results.",
    "time_outs": "Server failures by silence for too long.",
    "benched": "Pauses of servers after a failure.",
    "broker_losses": "Lost connections to the broker.",
    "retries": "Repeated attempts.",
    "failed": "Evaluations that failed in all attempts.",
    "quarantined": "Failed evaluations that were quarantined after they took down several servers.",
    "backups": "Backups of running work on another server.",
    "late": "Rejected results that arrived after the end of their evaluation.",
    "double": "Rejected results of evaluations that already had a result.",
    "foreign": "Rejected messages of episodes that named another simulation.",
    "audits": "Evaluations repeated on another server for comparison.",
    "audits_left_out": "Results accepted without their planned audit because no other server was usable.",
    "disagreements": "Audits in which two servers disagreed.",
    "recomputed": "Evaluations repeated because their server was found to be wrong.",
}
"""Events that the pool counts: descriptions of the counters."""

TRAFFIC = {
    "sent_bytes": "Bytes sent to the broker, without TLS.",
    "received_bytes": "Bytes received from the broker, without TLS.",
    "sent_messages": "Messages published.",
    "received_messages": "Messages received.",
}


_NAMED_SERVERS = 10
"""Largest number of servers with their own sample, since each label value is a time series in Prometheus."""


class _Metrics:
    """Metrics that are set by one thread and collected by another."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._started = time.time()

    def collect(self) -> "Iterator[Metric]":
        """Yield all metrics; called by the Prometheus client."""
        with self._lock:
            families = list(self._families())
        yield _gauge("start_time_seconds", "Start time, seconds since 1970.", self._started)
        yield from families

    def _families(self) -> "Iterator[Metric]":
        raise NotImplementedError


class ToolMetrics(_Metrics):
    """Metrics of an optimization tool, counted from its reports."""

    def __init__(self) -> None:
        super().__init__()
        self._generation: Generation | None = None
        self._candidates = self._failed = 0
        self._run_candidates = 0  # counted candidates of the present run
        self._servers: dict[int, str] = {}
        self._attempts: Counter[tuple[str, str]] = Counter()
        self._evaluations = self._done = self._pending = 0
        self._benched = self._broker_losses = 0
        self._connected = 1
        self._status: Mapping[str, Any] = {}
        self._traffic: Counter[str] = Counter()
        self._counts: Mapping[str, int] = {}

    def generation(self, generation: "Generation") -> None:
        """Count an evaluated generation."""
        with self._lock:
            if generation.evaluations < self._run_candidates:
                self._run_candidates = 0  # another run of a sweep
            self._candidates += generation.evaluations - self._run_candidates
            self._run_candidates = generation.evaluations
            self._failed += generation.failed
            self._generation = generation

    def report(self, report: Mapping[str, Any]) -> None:
        """Count a pool's report, see `_engine.Pool.listen`."""
        with self._lock:
            match report["event"]:
                case "status":
                    self._update_status(report)
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

    def _update_status(self, report: Mapping[str, Any]) -> None:
        status = report["status"]
        done, total = status["done"], status["total"]
        self._evaluations += done - self._done if done >= self._done else done
        # After all have ended, the next work counts from 0 again.
        self._done = 0 if done >= total else done
        self._pending = total - done
        self._status = status
        self._traffic = report["traffic"]
        self._counts = report.get("counts", {})

    def _families(self) -> "Iterator[Metric]":
        generation = self._generation
        if generation is not None:
            yield _gauge("generation", "The last finished generation, from 0.", generation.generation)
            if generation.generations is not None:
                yield _gauge("generations", "Generations of the whole run.", generation.generations)
            yield _gauge("best_fitness", "Best fitness since the start of the run.", generation.best_so_far)
            yield _gauge("mean_fitness", "Mean fitness of the population.", generation.mean)
            yield _gauge("run_seconds", "Seconds since the run started or resumed.", generation.seconds)
        yield _counter("candidates", "Evaluated candidates.", self._candidates)
        yield _counter("candidates_failed", "Evaluated candidates that failed.", self._failed)
        yield _counter("evaluations", "Finished evaluations on servers.", self._evaluations)
        yield _gauge("evaluations_pending", "Requested evaluations that have not finished.", self._pending)
        yield _make_labelled_counter(
            "attempts", "Attempts at evaluations, single or in batches.", ("mode", "outcome"), self._attempts
        )
        states = Counter(self._servers.values())
        benched = sum(server.get("benched") is not None for server in self._status.get("servers", ()))
        yield _make_labelled_gauge(
            "servers",
            "Servers with the simulation by state; benched: pausing after a failure.",
            ("state",),
            {**{(state,): states[state] for state in ("ready", "busy", "lost")}, ("benched",): benched},
        )
        silence = _measure_silence(self._status)
        longest = sorted(silence, key=lambda server: -silence[server])[:_NAMED_SERVERS]
        yield _gauge("silence_seconds", "Silence of the blocking server.", max(silence.values(), default=0))
        yield _make_labelled_gauge(
            "server_silence_seconds",
            "Silence of servers with work, the longest first; at most ten.",
            ("server",),
            {(str(server),): silence[server] for server in longest},
        )
        yield _gauge("broker_connected", "1 while connected to the broker, otherwise 0.", self._connected)
        counts = {"benched": self._benched, "broker_losses": self._broker_losses, **self._counts}
        for name, meaning in COUNTS.items():
            if name in counts:
                yield _counter(f"pool_{name}", meaning, counts[name])
        for name, meaning in TRAFFIC.items():
            yield _counter(f"broker_{name}", meaning, self._traffic.get(name, 0))


class ServerMetrics(_Metrics):
    """Metrics of servers that a process has started."""

    def __init__(self) -> None:
        super().__init__()
        self._states: dict[int, str] = {}
        self._events: Counter[tuple[str]] = Counter()

    def event(self, server: int, event: str) -> None:
        """Count an event of a server: waiting, ready, busy, lost, warning, failure, error, ended."""
        with self._lock:
            self._events[(event,)] += 1
            if event in {"ready", "busy", "lost", "ended"}:
                self._states[server] = event

    def _families(self) -> "Iterator[Metric]":
        states = Counter(self._states.values())
        yield _make_labelled_gauge(
            "servers",
            "Servers of this process, by state.",
            ("state",),
            {(state,): states[state] for state in ("ready", "busy", "lost", "ended")},
        )
        yield _make_labelled_counter("server_events", "Events of servers.", ("event",), self._events)


def _measure_silence(status: Mapping[str, Any]) -> dict[int, float]:
    """Return for how many seconds each server with work has been silent."""
    silence: dict[int, float] = {}
    for work in status.get("waiting_for", ()):
        silence[work["server"]] = max(silence.get(work["server"], 0.0), work["silent"])
    return silence


def _gauge(name: str, meaning: str, value: float) -> "Metric":
    from prometheus_client.core import GaugeMetricFamily

    return GaugeMetricFamily(f"swarmwright_{name}", meaning, value=value)


def _counter(name: str, meaning: str, value: float) -> "Metric":
    from prometheus_client.core import CounterMetricFamily

    return CounterMetricFamily(f"swarmwright_{name}", meaning, value=value)


def _make_labelled_gauge(
    name: str, meaning: str, labels: tuple[str, ...], values: Mapping[Any, float]
) -> "Metric":
    from prometheus_client.core import GaugeMetricFamily

    family = GaugeMetricFamily(f"swarmwright_{name}", meaning, labels=labels)
    for label, value in values.items():
        family.add_metric(label, value)
    return family


def _make_labelled_counter(
    name: str, meaning: str, labels: tuple[str, ...], values: Mapping[Any, float]
) -> "Metric":
    from prometheus_client.core import CounterMetricFamily

    family = CounterMetricFamily(f"swarmwright_{name}", meaning, labels=labels)
    for label, value in values.items():
        family.add_metric(label, value)
    return family


@contextmanager
def serve_metrics(metrics: _Metrics, host: str, port: int) -> Iterator[str]:
    """Serve metrics to Prometheus within a `with` block; yield the URL.

    Raises InputError when it cannot listen on the address, or prometheus-client is not installed.
    """
    try:
        from prometheus_client import CollectorRegistry

        from swarmwright.runs.monitoring.metrics_server import MetricsServer
    except ImportError:
        raise InputError(
            "--metrics needs the package prometheus-client: pip install 'swarmwright[metrics]'"
        ) from None
    registry = CollectorRegistry()
    registry.register(metrics)
    try:
        server = MetricsServer(host, port, registry)
    except (OSError, UnicodeError) as error:
        raise InputError(f"--metrics: cannot listen on {host}:{port}: {error}") from error
    thread = threading.Thread(target=server.serve_forever, name="metrics", daemon=True)
    thread.start()
    address = f"[{host}]" if ":" in host else host
    try:
        yield f"http://{address}:{server.server_port}/metrics"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
