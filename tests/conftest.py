"""What all Python tests share: the program as a process, brokers, and a place to work in."""

import atexit
import contextlib
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest
from pytest_timeout import _get_item_settings  # type: ignore[import-untyped]

# A shell lets what it starts in the background ignore these, and children would inherit that: the tests that
# send them need them as on a terminal.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

ROOT = Path(__file__).parents[1]
# What the user of these tests trusts is forgotten after them.
STATE = tempfile.mkdtemp(prefix="swarmwright-state-")
os.environ["XDG_STATE_HOME"] = STATE
atexit.register(shutil.rmtree, STATE, ignore_errors=True)
# Most runs are not about their plot, which costs more than they do; see the fixture `plots`.
os.environ["SWARMWRIGHT_PLOT"] = "0"
PROGRAM = (sys.executable, "-P", "-m", "swarmwright")

Run = Callable[..., "subprocess.CompletedProcess[str]"]
Start = Callable[..., "subprocess.Popen[str]"]


def environment(extra: Mapping[str, str] | None = None) -> dict[str, str]:
    """This process's environment without what would change the program's behaviour."""
    hidden = ("SWARMWRIGHT_", "NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES", "PYTHONWARNINGS")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(hidden)}
    return {
        **kept,
        "SWARMWRIGHT_PLOT": os.environ["SWARMWRIGHT_PLOT"],
        "PYTHONIOENCODING": "utf-8",
        "TERM": "xterm-256color",
        **(extra or {}),
    }


COMMIT_TIER = ("python", "protocol", "typing")
"""Folders whose tests belong to the commit tier unless they are marked; those of all others are slow."""


SLOW_S = 240
"""Limit of a slow test, in seconds. It ends what hangs; the machine may be busy."""


STARTING = frozenset({"browser", "bundle", "classes", "fmus", "mosquitto"})
"""Fixtures that start programs: tests that use them are slow, too."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that chooses a part of the slow tier."""
    parser.addoption(
        "--part", metavar="K/N", help="run the K-th of N parts of the slow tests (K from 1), and all others"
    )


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Sort tests into tiers, see CONTRIBUTING.md, and begin with those that may take longest.

    Others then fill the time beside them to the end.
    """
    for item in items:
        folder = item.path.relative_to(ROOT / "tests").parts[0]
        starts = STARTING.intersection(getattr(item, "fixturenames", ()))
        if (folder not in COMMIT_TIER or starts) and item.get_closest_marker("journey") is None:
            item.add_marker("slow")
    part = config.getoption("--part")
    if part:
        number, parts = _part(part)
        left_out = [
            item
            for item in items
            # By its name, so that a test is in the same part whatever else there is.
            if item.get_closest_marker("slow") and zlib.crc32(item.nodeid.encode()) % parts != number - 1
        ]
        config.hook.pytest_deselected(items=left_out)
        gone = set(left_out)
        items[:] = [item for item in items if item not in gone]

    def longest(item: pytest.Item) -> float:
        marker = item.get_closest_marker("timeout")
        return -float(marker.args[0]) if marker is not None and marker.args else 0.0

    items.sort(key=longest)
    for item in items:
        if item.get_closest_marker("slow") and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(SLOW_S))


def _part(text: str) -> tuple[int, int]:
    """Return the number of a part and of all parts. Raises pytest.UsageError."""
    number, _, parts = text.partition("/")
    if not (number.isdecimal() and parts.isdecimal() and 1 <= int(number) <= int(parts)):
        raise pytest.UsageError(f"--part {text}: expected K/N, K from 1 to N, such as 2/4")
    return int(number), int(parts)


_STARTS = ("subprocess.Popen", "os.posix_spawn", "os.fork", "os.forkpty")
_ONCE = ("git", "uname", "/sbin/ldconfig")
"""Asked once in a process: the code's revision, and by Python the processor and places of libraries."""


class _Started:
    """Counts the processes that the current test starts."""

    number = 0

    def __init__(self) -> None:
        sys.addaudithook(self._note)

    def _note(self, event: str, arguments: tuple[object, ...]) -> None:
        if event in _STARTS and not (arguments and arguments[0] in _ONCE):
            self.number += 1


_STARTED = _Started()


def _refuse_processes(item: pytest.Item, before: int) -> None:
    if _STARTED.number > before and not any(map(item.get_closest_marker, ("slow", "journey"))):
        pytest.fail("this test starts a process: mark it as slow, or call what it tests in this process")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Keep the commit tier in one process: what starts others is slow, or a journey."""
    before = _STARTED.number
    yield
    _refuse_processes(item, before)


def _timed_anew(item: pytest.Item) -> None:
    settings = _get_item_settings(item)
    if settings.timeout:
        hooks = item.config.pluginmanager.hook
        hooks.pytest_timeout_cancel_timer(item=item)
        hooks.pytest_timeout_set_timer(item=item, settings=settings)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    """Give a repeated test its time again: pytest-timeout counts to the first failure, and then no more.

    Fixtures of the commit tier start no processes either.
    """
    if getattr(item, "execution_count", 1) > 1:
        _timed_anew(item)
    before = _STARTED.number
    yield
    _refuse_processes(item, before)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> Iterator[None]:
    """Give fixtures the time of a test to end, also after a failure."""
    _timed_anew(item)
    return (yield)


@pytest.fixture
def plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of this test end with their plot, as those of users."""
    monkeypatch.setenv("SWARMWRIGHT_PLOT", "1")


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture
def program(tmp_path: Path) -> Run:
    """Runs `swarmwright ARGUMENTS` to its end, in a temporary folder."""

    def run(
        *arguments: str | Path,
        env: Mapping[str, str] | None = None,
        timeout: float = 50,
        cwd: Path = tmp_path,
    ) -> "subprocess.CompletedProcess[str]":
        result = subprocess.run(
            [*PROGRAM, *map(str, arguments)],
            capture_output=True,
            text=True,
            encoding="utf-8",
            stdin=subprocess.DEVNULL,
            env=environment(env),
            timeout=timeout,
            cwd=cwd,
            check=False,
        )
        assert "Traceback" not in result.stderr + result.stdout, result.stderr
        return result

    return run


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts `swarmwright ARGUMENTS` beside the test and stops it when the test is over."""
    running: list[subprocess.Popen[str]] = []

    def begin(*arguments: str | Path, env: Mapping[str, str] | None = None) -> "subprocess.Popen[str]":
        process = subprocess.Popen(
            [*PROGRAM, *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            env=environment(env),
            cwd=tmp_path,
        )
        running.append(process)
        return process

    yield begin
    for process in running:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
        with contextlib.suppress(ValueError):  # the test read it to its end
            process.communicate(timeout=10)


def free_port() -> int:
    """A TCP port of loopback that nobody listens on.

    It is none of those that systems give to outgoing connections (32768 and above): a broker that a test
    stops and starts again would find its port taken now and then.
    """
    for _ in range(100):
        with socket.socket() as probe, contextlib.suppress(OSError):
            port = random.SystemRandom().randrange(10_000, 32_768)
            probe.bind(("127.0.0.1", port))
            return port
    raise RuntimeError("of 100 ports between 10000 and 32767 none is free")


@pytest.fixture
def unused_port() -> int:
    """A TCP port of loopback that nobody listens on."""
    return free_port()


def _mosquitto(folder: Path) -> Iterator[str]:
    binary = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
    assert binary, "mosquitto is missing; `make test` installs it"
    port = free_port()
    configuration = folder / "mosquitto.conf"
    user = "user root\n" if os.getuid() == 0 else ""
    configuration.write_text(f"{user}listener {port} 127.0.0.1\nallow_anonymous true\nset_tcp_nodelay true\n")
    process = subprocess.Popen([binary, "-c", str(configuration)], stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 10
        while True:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
                break
            assert process.poll() is None, "mosquitto ended"
            assert time.monotonic() < deadline, "mosquitto does not answer"
            time.sleep(0.02)
        yield f"mqtt://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.wait(10)


@pytest.fixture
def mosquitto(tmp_path: Path) -> Iterator[str]:
    """URL of a Mosquitto on a free port, for one test."""
    yield from _mosquitto(tmp_path)


@pytest.fixture
def embedded_broker() -> Iterator[str]:
    """URL of an embedded broker on a free port, for one test."""
    from swarmwright import _engine

    broker = _engine.Broker()
    yield broker.url
    broker.stop()


@pytest.fixture(params=["embedded", "mosquitto"])
def any_broker(request: pytest.FixtureRequest) -> str:
    """URL of a broker; the test runs once with the embedded one and once with Mosquitto."""
    name = "embedded_broker" if request.param == "embedded" else "mosquitto"
    url: str = request.getfixturevalue(name)
    return url
