"""The order of credentials, with a real keyring: a file in a temporary folder, in processes of their own."""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from swarmwright.common.errors import InputError
from swarmwright.servers.broker import credentials
from swarmwright.servers.broker.credentials import CREDENTIALS, check_environment, location_of
from tests.conftest import environment

# What of the engine reads the environment is tested beside it; here is who fills it.
ASK = """
import os, sys
from swarmwright.servers.broker.credentials import load_from_keyring
from swarmwright.common.errors import InputError
try:
    load_from_keyring(sys.argv[1])
except InputError as error:
    print("error:", error)
print(os.environ.get("SWARMWRIGHT_PASSWORD"))
"""

Ask = Callable[..., str]


@pytest.fixture
def keyring(tmp_path: Path) -> Mapping[str, str]:
    """The variables that make a plain file in this folder the keyring."""
    return {
        "PYTHON_KEYRING_BACKEND": "keyrings.alt.file.PlaintextKeyring",
        "XDG_DATA_HOME": str(tmp_path / "data"),
        "XDG_CONFIG_HOME": str(tmp_path / "config"),
    }


@pytest.fixture
def ask(keyring: Mapping[str, str], tmp_path: Path) -> Ask:
    """What a process with these variables takes for the password of a broker."""

    def run(broker: str, **variables: str) -> str:
        done = subprocess.run(
            [sys.executable, "-c", ASK, broker],
            env=environment({**keyring, **variables}),
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.strip()

    return run


def store(keyring: Mapping[str, str], account: str, password: str) -> None:
    """As people do it."""
    subprocess.run(
        [sys.executable, "-m", "keyring", "set", "swarmwright", account],
        env=environment(keyring),
        input=password,
        text=True,
        check=True,
    )


@pytest.mark.slow
def test_the_keyring_has_passwords_by_user_and_broker(keyring: Mapping[str, str], ask: Ask) -> None:
    store(keyring, "tool", "general")
    store(keyring, "tool@lab:8883", "special")
    assert ask("mqtts://lab", SWARMWRIGHT_USERNAME="tool") == "special"
    assert ask("mqtts://lab:8883", SWARMWRIGHT_USERNAME="tool") == "special"
    assert ask("mqtts://elsewhere", SWARMWRIGHT_USERNAME="tool") == "general"
    assert ask("mqtts://lab", SWARMWRIGHT_USERNAME="server") == "None"
    assert ask("mqtts://lab") == "None"


@pytest.mark.slow
def test_environment_and_file_come_before_the_keyring(
    keyring: Mapping[str, str], ask: Ask, tmp_path: Path
) -> None:
    store(keyring, "tool", "of the keyring")
    user = {"SWARMWRIGHT_USERNAME": "tool"}
    assert ask("mqtt://lab", **user, SWARMWRIGHT_PASSWORD="mine") == "mine"
    # The engine reads the file itself.
    assert ask("mqtt://lab", **user, SWARMWRIGHT_PASSWORD_FILE=str(tmp_path / "file")) == "None"
    assert ask("mqtt://lab", **user) == "of the keyring"


@pytest.mark.slow
def test_a_keyring_that_cannot_be_read_is_an_error_that_says_how_to_mend_it(ask: Ask, tmp_path: Path) -> None:
    (tmp_path / "data" / "python_keyring").mkdir(parents=True)
    (tmp_path / "data" / "python_keyring" / "keyring_pass.cfg").write_text("no keyring at all\n[\n")
    said = ask("mqtt://lab", SWARMWRIGHT_USERNAME="tool")
    assert said.startswith("error: the password of tool cannot be read from the keyring")
    assert "SWARMWRIGHT_PASSWORD_FILE" in said


@pytest.mark.slow
def test_no_keyring_is_no_error(ask: Ask) -> None:
    backend = {"PYTHON_KEYRING_BACKEND": "keyring.backends.fail.Keyring"}
    assert ask("mqtt://lab", SWARMWRIGHT_USERNAME="tool", **backend) == "None"


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("mqtt://lab", "lab:1883"),
        ("lab", "lab:1883"),
        ("lab:1884", "lab:1884"),
        ("mqtts://[::1]:8884", "[::1]:8884"),
        ("mqtts://[::1]", "[::1]:8883"),
        ("wss://lab/mqtt", "lab:443"),
        ("unix:///run/lab.sock?mqtt=5", "/run/lab.sock"),
    ],
)
def test_a_broker_is_named_by_host_and_port(url: str, expected: str) -> None:
    assert location_of(url) == expected


@pytest.mark.parametrize(
    ("broker", "clear"),
    [
        ("mqtt://broker.example", True),
        ("ws://192.0.2.1:80/mqtt", True),
        ("broker.example:1884", True),
        ("mqtt://[2001:db8::1]", True),
        ("mqtts://broker.example", False),
        ("wss://broker.example", False),
        ("mqtt://localhost:1883", False),
        ("mqtt://127.0.0.2?mqtt=5", False),
        ("mqtt://[::1]:1883", False),
        ("unix:///run/lab.sock", False),
        ("mqtt://broker.example:1885,unix:///run/lab.sock", True),
        ("unix:///run/lab.sock,mqtts://broker.example", False),
    ],
)
def test_a_password_that_would_travel_in_the_clear_is_warned_of_once(
    broker: str, clear: bool, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(credentials, "_warned", set())
    monkeypatch.setenv("SWARMWRIGHT_USERNAME", "ada")
    monkeypatch.setenv("SWARMWRIGHT_PASSWORD", "")
    monkeypatch.setenv("SWARMWRIGHT_PASSWORD_FILE", "")
    monkeypatch.setattr(credentials, "load_from_keyring", lambda _broker: None)
    credentials.prepare(broker)
    assert not caplog.messages
    monkeypatch.setenv("SWARMWRIGHT_PASSWORD", "correct horse")
    for _ in range(2):
        credentials.prepare(broker)
    assert ["is sent unencrypted" in text for text in caplog.messages] == [True] * clear
    assert "correct horse" not in caplog.text


@pytest.mark.parametrize(
    ("variables", "words"),
    [
        ({"KEEP_ALIVE": "0"}, "SWARMWRIGHT_KEEP_ALIVE (environment): expected whole seconds from 1 to 3600"),
        ({"KEEP_ALIVE": "3601"}, "not '3601'"),
        ({"KEEP_ALIVE": "1.5"}, "not '1.5'"),
        ({"PASSWORD": "horse"}, "SWARMWRIGHT_USERNAME is not"),
        ({"USERNAME": "ada", "PASSWORD_FILE": "/none"}, "/none cannot be read: No such file"),
        ({"CERTIFICATE_FILE": "chain.pem"}, "SWARMWRIGHT_KEY_FILE is not"),
        ({"KEY_FILE": "key.pem"}, "SWARMWRIGHT_CERTIFICATE_FILE is not"),
    ],
)
def test_a_wrong_environment_is_reported(
    variables: Mapping[str, str], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in (*CREDENTIALS, "SWARMWRIGHT_KEEP_ALIVE"):
        monkeypatch.setenv(name, variables.get(name.removeprefix("SWARMWRIGHT_"), ""))
    with pytest.raises(InputError) as error:
        check_environment()
    assert words in str(error.value)
    assert "horse" not in str(error.value)
    if "KEEP_ALIVE" not in variables:
        check_environment(credentials=False)


def test_a_right_environment_is_accepted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "word").write_text("horse\n")
    monkeypatch.setenv("SWARMWRIGHT_KEEP_ALIVE", "3600")
    monkeypatch.setenv("SWARMWRIGHT_USERNAME", "ada")
    monkeypatch.setenv("SWARMWRIGHT_PASSWORD_FILE", str(tmp_path / "word"))
    check_environment()


def test_a_password_is_left_in_a_pipe(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It can be read once, by the connection; one that nobody writes to would block."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    monkeypatch.setenv("SWARMWRIGHT_USERNAME", "ada")
    monkeypatch.setenv("SWARMWRIGHT_PASSWORD_FILE", str(pipe))
    check_environment()
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        pipe.write_text("horse\n")
        check_environment()
        assert os.read(reading, 100) == b"horse\n"
    finally:
        os.close(reading)


@pytest.mark.parametrize("text", ["", "\n", "\r\nhorse\n"])
def test_a_password_file_without_a_password(
    text: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "word").write_text(text, newline="")
    monkeypatch.setenv("SWARMWRIGHT_USERNAME", "ada")
    monkeypatch.setenv("SWARMWRIGHT_PASSWORD_FILE", str(tmp_path / "word"))
    with pytest.raises(InputError, match=r"word has no password in its first line$"):
        check_environment()


def test_a_folder_is_no_password_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SWARMWRIGHT_USERNAME", "ada")
    monkeypatch.setenv("SWARMWRIGHT_PASSWORD_FILE", str(tmp_path))
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        check_environment()
