"""Private temporary folders: whose they are, and when they go."""

import os
import signal
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from swarmwright.common.temporary import TemporaryFolder, private_folder, remove


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The system's folder for temporary files."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    folder.chmod(0o1777)
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def mode(path: Path) -> int:
    return stat.S_IMODE(path.lstat().st_mode)


@pytest.mark.slow
def test_the_place_is_private_and_the_same_each_time(temporary: Path) -> None:
    place = private_folder()
    assert place.parent == temporary
    assert mode(place) == 0o700
    assert private_folder() == place
    code = "from swarmwright.common.temporary import private_folder; print(private_folder())"
    other = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "TMPDIR": str(temporary)},
        capture_output=True,
        check=True,
        text=True,
    )
    assert other.stdout.strip() == str(place)


@pytest.mark.parametrize("what", ["a link", "a file", "open to all", "another user's"])
def test_what_others_put_at_such_a_name_is_passed_over(temporary: Path, tmp_path: Path, what: str) -> None:
    name = temporary / f"swarmwright-{os.getuid()}-00000000"
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    if what == "a link":
        name.symlink_to(tmp_path / "elsewhere")
    elif what == "a file":
        name.touch(0o700)
    else:
        name.mkdir(mode=0o700)
        if what == "open to all":
            name.chmod(0o777)
        elif os.getuid() != 0:
            pytest.skip("only root can make a folder of another user")
        else:
            os.chown(name, 65534, 65534)
    place = private_folder()
    assert place != name
    assert private_folder() == place
    with TemporaryFolder("x") as folder:
        assert folder.parent == place
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_folder_goes_with_its_block_and_with_its_object() -> None:
    with TemporaryFolder("kind") as folder:
        assert folder.name.startswith("kind-")
        assert mode(folder) == 0o700
        (folder / "file").touch()
    assert not folder.exists()
    left = TemporaryFolder("kind")
    path = left.path
    del left
    assert not path.exists()


@pytest.mark.slow
def test_what_a_killed_process_has_left_goes_and_nothing_else(temporary: Path) -> None:
    code = (
        "import sys; from swarmwright.common.temporary import TemporaryFolder; "
        "folder = TemporaryFolder('key'); "
        "(folder.path / 'key.pem').touch(); print(folder.path, flush=True); sys.stdin.read()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, "TMPDIR": str(temporary)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    path = Path(process.stdout.readline().strip())
    with TemporaryFolder("key") as own:
        assert path.exists(), "its process lives"
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert path.exists()
        with TemporaryFolder("key"):
            assert not path.exists()
            assert own.exists(), "in use by this process"


def test_of_a_link_the_link_alone_is_removed(tmp_path: Path) -> None:
    """A program may have put a link in the place of its work folder, or into it."""
    target = tmp_path / "target"
    (target / "inner").mkdir(parents=True)
    (target / "file").touch(0o640)
    target.chmod(0o555)
    link = tmp_path / "link"
    link.symlink_to(target)
    remove(link)
    assert not link.is_symlink()
    folder = tmp_path / "folder"
    (folder / "locked").mkdir(parents=True)
    (folder / "locked" / "link").symlink_to(target)
    (folder / "locked" / "file").touch()
    (folder / "locked").chmod(0o000)
    remove(folder)
    assert not folder.exists()
    assert mode(target) == 0o555
    assert mode(target / "file") == 0o640
    assert (target / "inner").is_dir()


def test_a_file_or_a_dangling_link_is_removed_and_nothing_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    for name in ("file", "dangling", "nothing"):
        remove(tmp_path / name)
    assert not list(tmp_path.glob("[fdn]*"))
