"""What launchers on other machines run there, in a shell of this one; and Slurm, played by programs."""

import os
import re
import shlex
import subprocess
from pathlib import Path
from typing import Any

import pytest

from swarmwright.servers.launchers import Code, LauncherError, Specification
from swarmwright.servers.launchers._remote import RemoteOptions, format_setup, format_unpack
from swarmwright.servers.launchers.kubernetes import KubernetesOptions, make_job
from swarmwright.servers.launchers.slurm import Slurm, SlurmOptions

pytestmark = pytest.mark.slow

CODE = Code.from_files({"gather.py": b"class Gather: pass\n", "maps/a.json": b"{}"})


def shell(script: str, **variables: str) -> str:
    result = subprocess.run(
        ["/bin/sh", "-c", script],
        capture_output=True,
        text=True,
        check=False,
        env={"PATH": os.environ["PATH"], **variables},
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize(
    ("options", "inherited", "expected"),
    [
        ({}, {}, "{code}"),
        ({}, {"PYTHONPATH": "/image/a b:/c"}, "{code}:/image/a b:/c"),
        ({"setup": "export PYTHONPATH=/module"}, {"PYTHONPATH": "/image"}, "{code}:/module"),
        ({"setup": "PYTHONPATH=/a; export PYTHONPATH", "environment": {"PYTHONPATH": "/b"}}, {}, "{code}:/b"),
    ],
)
def test_the_search_path_of_setup_and_image_is_kept(
    tmp_path: Path, options: dict[str, Any], inherited: dict[str, str], expected: str
) -> None:
    folder = tmp_path / "the code"
    folder.mkdir()
    code = shlex.quote(str(folder))
    given = RemoteOptions(launcher="any", **options)
    specification = Specification("gather.py:Gather", "mqtt://b", environment=given.environment)
    lines = format_setup(given, specification.variables("/files"), code, code)
    said = shell("\n".join([*lines, 'echo "$PYTHONPATH"; pwd']), **inherited)
    assert said.splitlines() == [expected.format(code=folder), str(folder)]
    # Without code it is as it was, or as the experiment says.
    lines = format_setup(given, specification.variables("/files"), code)
    said = shell("\n".join([*lines, 'echo "$PYTHONPATH"']), **inherited)
    assert said.strip() == expected.format(code="").strip(":")


def test_pods_keep_the_search_path_of_their_image() -> None:
    specification = Specification("gather.py:Gather", "mqtts://b", code=CODE)
    made = make_job("name", "run", [7], KubernetesOptions(), specification)
    script = made["spec"]["template"]["spec"]["containers"][0]["command"][2]
    (line,) = [line for line in script.splitlines() if "PYTHONPATH" in line]
    assert shell(f'{line}\necho "$PYTHONPATH"', PYTHONPATH="/image") == "/run/swarmwright/code:/image\n"


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with programs of Slurm that note how they are called, and do what a file of theirs says."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in ("sbatch", "squeue", "scancel"):
        program = folder / name
        program.write_text(
            f'#!/bin/sh\necho {name} "$@" >> {folder}/calls\n[ {name} = sbatch ] && cat > {folder}/script\n'
            f"[ ! -e {folder}/{name}.sh ] || . {folder}/{name}.sh\n"
        )
        program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    return folder


def slurm(tmp_path: Path, **options: Any) -> Slurm:
    given = SlurmOptions(folder=str(tmp_path / "shared"), **options)
    return Slurm(given, Specification("gather.py:Gather", "mqtts://b", password="secret", code=CODE))


@pytest.mark.parametrize(
    ("words", "may_have_jobs"),
    [("Unable to contact slurm controller", False), ("Socket timed out on send/recv operation", True)],
)
def test_without_a_controller_nothing_is_cancelled_and_no_secret_is_left(
    programs: Path, tmp_path: Path, words: str, may_have_jobs: bool
) -> None:
    for name in ("sbatch", "squeue", "scancel"):
        (programs / f"{name}.sh").write_text(f"echo '{name}: error: {words}' >&2; exit 1")
    launcher = slurm(tmp_path)
    launcher.open()
    assert list((tmp_path / "shared").rglob("password"))
    with pytest.raises(LauncherError, match=f"sbatch: error: {words}"):
        launcher.start([1, 2])
    if may_have_jobs:
        left = f"scancel: error: {words}; cancel remaining jobs with `scancel --name={launcher.name}`"
        with pytest.raises(LauncherError, match=re.escape(left)):
            launcher.close()
    else:
        launcher.close()
    launcher.close()
    assert ("scancel" in (programs / "calls").read_text()) == may_have_jobs
    assert not list((tmp_path / "shared" / "run").iterdir())


def test_each_job_has_the_code_in_a_folder_of_its_own(programs: Path, tmp_path: Path) -> None:
    (programs / "sbatch.sh").write_text("echo 12")
    shows = 'sh -c \'pwd; echo "$PYTHONPATH"; ls; echo x > gather.py; echo "$@"\' sh'
    launcher = slurm(tmp_path, command=shows)
    launcher.open()
    launcher.start([5, 6])
    script = (programs / "script").read_text()
    found = []
    for index in ("0", "1", "1"):  # the last job was begun again
        said = shell(script, SLURM_ARRAY_JOB_ID="12", SLURM_ARRAY_TASK_ID=index).splitlines()
        assert said[0] == said[1]
        assert said[2:4] == ["gather.py", "maps"]
        assert Path(said[0], "gather.py").read_text() == "x\n"
        found.append((said[0], said[4].split("--id ")[1].split()[0]))
    assert [server for _, server in found] == ["5", "6", "6"]
    assert len({folder for folder, _ in found}) == 2
    launcher.close()
    assert not list((tmp_path / "shared" / "run").iterdir())


def test_an_archive_with_another_digest_is_not_unpacked(tmp_path: Path) -> None:
    archive, folder = tmp_path / "the code.tar.gz", shlex.quote(str(tmp_path / "unpacked code"))
    archive.write_bytes(CODE.archive)
    script = "\n".join([*format_unpack(shlex.quote(str(archive)), CODE.sha256, folder), "echo done"])
    assert shell(script) == "done\n"
    assert (tmp_path / "unpacked code" / "gather.py").is_file()
    archive.write_bytes(Code.from_files({"gather.py": b"import os\n"}).archive)
    (tmp_path / "unpacked code" / "gather.py").unlink()
    result = subprocess.run(["/bin/sh", "-c", script], capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert re.search(
        rf"the code\.tar\.gz: has SHA-256 [0-9a-f]{{64}} instead of {CODE.sha256}", result.stderr
    )
    assert not (tmp_path / "unpacked code" / "gather.py").exists()
