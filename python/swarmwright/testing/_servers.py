"""Checks of launchers, and the conformance kit for tests."""

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from swarmwright import _engine
from swarmwright.servers.broker.private import start_private
from swarmwright.servers.launchers import LAUNCHERS, Launcher, LauncherOptions, Specification
from swarmwright.testing._common import check_common_options

if TYPE_CHECKING:
    from swarmwright.conformance import Report


def check_server(command: str | None = None, **options: Any) -> "Report":  # noqa: ANN401 - see there
    """Check that a simulation server follows every rule of the protocol; return the report.

    command: command that starts it, with {broker} and {id}. options: those of
    `swarmwright.conformance.check_server`.

    Raises AssertionError with each violated rule and the sent, received and expected messages.
    """
    from swarmwright.conformance import check_server as check  # noqa: PLC0415 - an extra

    report = check(command=command, **options)
    assert report.ok, str(report)
    return report


def check_optimizer(command: str | None = None, **options: Any) -> "Report":  # noqa: ANN401 - see there
    """Check that an optimization tool follows every rule of the protocol; return the report.

    command: command that starts it, with {broker} or {experiment}. options: those of
    `swarmwright.conformance.check_optimizer`.

    Raises AssertionError with each violated rule and the sent, received and expected messages.
    """
    from swarmwright.conformance import check_optimizer as check  # noqa: PLC0415 - an extra

    report = check(command=command, **options)
    assert report.ok, str(report)
    return report


_POLL_S = 0.2


def check_launcher(
    kind: str,
    options: Mapping[str, Any] | None = None,
    *,
    broker: str | None = None,
    timeout: float = 120.0,
    alive: Callable[[], int] | None = None,
) -> None:
    """Check that a registered launcher starts servers, reports their state, and leaves nothing behind.

    Two servers of `minisim` are started on a broker, one is stopped, another is started, all are stopped.

    Args:
        kind: name of the launcher.
        options: required options, as in an experiment, without `launcher` and `count`.
        broker: address of a reachable broker without accounts. Default: a broker with an account is
            started on the loopback address of this machine.
        timeout: time for a server to start or to stop, seconds.
        alive: returns the number of processes or jobs of the servers, independently of the launcher,
            for instance from the queue; it must be 0 after the end.

    Raises:
        AssertionError: a rule is violated.
    """
    component = LAUNCHERS.get(kind)
    values = dict(options or {})
    validated = _check_options(component, kind, values)
    with ExitStack() as stack:
        if broker is None:
            address, account = start_private(stack)
            username, password = account.username, account.password
        else:
            address, username, password = broker, None, None
        specification = Specification(
            simulation="minisim",
            broker=address,
            username=username,
            password=password,
            label="swarmwright-check",
        )
        _check_launcher(component(validated, specification), address, timeout, alive)


def _check_launcher(
    launcher: Launcher, address: str, timeout: float, alive: Callable[[], int] | None
) -> None:
    try:
        _check_life(launcher, address, timeout)
        launcher.close()
        launcher.close()  # a second time does no harm
        _wait_until(lambda: not _ready(address), timeout, "after `close` no server may be on the broker")
        if alive is not None:
            _wait_until(lambda: alive() == 0, timeout, "after `close` nothing may be left")
    finally:
        launcher.close()


def _check_options(component: type[Launcher], kind: str, values: Mapping[str, Any]) -> LauncherOptions:
    assert component.kind == kind, f"{component.__name__}.kind is {component.kind!r}, registered as {kind!r}"
    model = component.options_model
    assert issubclass(model, LauncherOptions), (
        f"{model.__name__} must derive from swarmwright.servers.launchers.LauncherOptions"
    )
    check_common_options(model, "launcher", kind, values)
    return model.model_validate({**values, "launcher": kind, "count": 2})


def _check_life(launcher: Launcher, broker: str, timeout: float) -> None:
    launcher.open()
    assert dict(launcher.health()) == {}, "before the first start there are no servers"
    launcher.start([11, 12])
    states = launcher.health()
    assert set(states) == {11, 12}, f"`health` must name the servers 11 and 12, not {sorted(states)}"
    _wait_until(
        lambda: _ready(broker) == {11, 12}, timeout, "the servers 11 and 12 must be on the broker", launcher
    )
    _wait_until(
        lambda: {state.state for state in launcher.health().values()} == {"running"},
        timeout,
        "servers that are on the broker must be running",
        launcher,
    )
    launcher.stop([11])
    _wait_until(
        lambda: _ready(broker) == {12}, timeout, "`stop` must end server 11, and no other one", launcher
    )
    _wait_until(
        lambda: 11 not in launcher.health(), timeout, "`health` must forget stopped servers", launcher
    )
    launcher.start([13])
    _wait_until(lambda: _ready(broker) == {12, 13}, timeout, "server 13 must join server 12", launcher)
    assert all(isinstance(line, str) for line in launcher.logs(12)), "`logs` must return lines of text"
    launcher.stop([99])  # was never started, does no harm


def _ready(broker: str) -> set[int]:
    return {server["server"] for server in _engine.servers(broker, wait=_POLL_S) if server["state"] != "lost"}


def _wait_until(
    holds: Callable[[], bool], timeout: float, rule: str, launcher: Launcher | None = None
) -> None:
    deadline = time.monotonic() + timeout
    while not holds():
        if time.monotonic() > deadline:
            raise AssertionError(f"{rule}; it did not happen within {timeout:g} s{_state(launcher)}")
        time.sleep(_POLL_S)


def _state(launcher: Launcher | None) -> str:
    if launcher is None:
        return ""
    states = launcher.health()
    lines = [f"{server}: {state.state} {state.reason}".rstrip() for server, state in sorted(states.items())]
    logs = [line for server in states for line in launcher.logs(server)]
    return ": " + "\n".join([*lines, *logs])
