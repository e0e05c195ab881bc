"""Password files: made, changed, never half."""

import stat
from pathlib import Path

import pytest

from swarmwright.common.errors import InputError
from swarmwright.servers.broker.mosquitto import set_password


def test_users_are_added_and_changed(tmp_path: Path) -> None:
    path = tmp_path / "users"
    assert set_password(path, "ada", "correct horse")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    path.write_text(path.read_text() + "# guests\nbob:$7$1$c2FsdA==$aGFzaA==")  # no line break at the end
    path.chmod(0o640)
    first = path.read_text()
    assert set_password(path, "eve", "battery staple")
    assert path.read_text().startswith(first + "\neve:$argon2id$v=19$m=19456,t=2,p=1$")
    assert not set_password(path, "ada", "battery staple")
    lines = path.read_text().splitlines()
    assert [line.split(":")[0] for line in lines] == ["ada", "# guests", "bob", "eve"]
    assert lines[0] != first.splitlines()[0]
    assert "correct" not in path.read_text()
    assert "battery" not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o640, "as its owner had set it"
    assert [file.name for file in tmp_path.iterdir()] == ["users"]


@pytest.mark.parametrize(
    ("user", "password"), [("", "x"), ("a:b", "x"), ("#a", "x"), ("a b", "x"), ("a\n", "x"), ("a", "")]
)
def test_what_cannot_stand_in_the_file(tmp_path: Path, user: str, password: str) -> None:
    with pytest.raises(InputError):
        set_password(tmp_path / "users", user, password)
    assert not list(tmp_path.iterdir())


def test_files_that_cannot_be_changed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        set_password(tmp_path / "nowhere" / "users", "ada", "x")
    (tmp_path / "users").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        set_password(tmp_path / "users", "ada", "x")
    assert (tmp_path / "users").read_bytes() == b"\xff\xfe"
