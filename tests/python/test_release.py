"""What `make release` refuses, and the checksums that it writes."""

import re
import subprocess
from pathlib import Path

import pytest

from deploy import release

ROOT = Path(__file__).parents[2]
VERSION = release.version(ROOT)
NOTES = f"# Changelog\n\n## Unreleased\n\n## {VERSION} - 2026-12-01\n\n- First release.\n"
FILES = (*release.VERSIONS, "engine/Cargo.toml", "engine/Cargo.lock")


def git(folder: Path, *arguments: str) -> None:
    identity = ("-c", "user.name=A", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
    subprocess.run(["git", *identity, *arguments], cwd=folder, check=True, capture_output=True)


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A commit that can be released."""
    folder = tmp_path / "clone"
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes((ROOT / name).read_bytes())
    (folder / "CHANGELOG.md").write_text(NOTES)
    git(folder.parent, "init", "--quiet", str(folder))
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "--message", "all: release it")
    return folder


def commit(clone: Path, name: str, old: str, new: str) -> None:
    text = (clone / name).read_text()
    assert old in text
    (clone / name).write_text(text.replace(old, new, 1))
    git(clone, "commit", "--quiet", "--all", "--message", "all: change a file")


@pytest.mark.slow
def test_a_commit_that_can_be_released(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert release.main(["check"], clone) == 0
    assert release.main(["check", "--tag", f"v{VERSION}"], clone) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.slow
def test_uncommitted_and_untracked_files(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (clone / "CITATION.cff").write_text((clone / "CITATION.cff").read_text() + "# more\n")
    (clone / "new.py").touch()
    assert release.main(["check"], clone) == 1
    said = "release: uncommitted changes in CITATION.cff, new.py: commit or remove them\n"
    assert capsys.readouterr().err == said
    for number in range(9):
        (clone / f"new{number}.py").touch()
    (problem,) = release.problems(clone, None)
    assert problem.endswith("new2.py and 6 more: commit or remove them")


@pytest.mark.slow
def test_a_folder_without_git(clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(clone.parent))
    (clone / ".git").rename(clone.parent / "git")
    (problem,) = release.problems(clone, None)
    assert problem.startswith("git status failed: fatal: not a git repository")


@pytest.mark.slow
@pytest.mark.parametrize("tag", [VERSION, "v9.9.9", f"v{VERSION}-rc1", ""])
def test_a_tag_of_another_version(clone: Path, tag: str) -> None:
    (problem,) = release.problems(clone, tag)
    assert problem.startswith(f"the tag is {tag}, but v{VERSION} ")


@pytest.mark.slow
@pytest.mark.parametrize("name", release.VERSIONS)
def test_another_version_in_one_file(clone: Path, name: str) -> None:
    line = re.search(release.VERSIONS[name], (clone / name).read_text(), re.MULTILINE)
    assert line is not None
    commit(clone, name, line[0], line[0].replace(VERSION, "9.9.9"))
    expected = f"{name}: the version is 9.9.9, but {VERSION} in engine/Cargo.toml"
    assert release.problems(clone, None) == [expected]


@pytest.mark.slow
def test_a_file_without_its_version(clone: Path) -> None:
    commit(clone, "CITATION.cff", "\nversion: ", "\nrelease: ")
    (problem,) = release.problems(clone, None)
    assert problem.startswith("CITATION.cff: the version is missing")


@pytest.mark.slow
def test_a_lock_file_of_an_earlier_version(clone: Path) -> None:
    commit(clone, "engine/Cargo.toml", f'version = "{VERSION}"', 'version = "9.9.9"')
    found = release.problems(clone, None)
    assert f"engine/Cargo.lock (swarmwright-pool): the version is {VERSION}, but 9.9.9" in "\n".join(found)
    assert any(problem.startswith("CHANGELOG.md: ") for problem in found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("## Unreleased\n", "## Unreleased\n\n- More.\n", "Unreleased has entries; move them"),
        (f"## {VERSION} - 2026-12-01", "## 0.0.1 - 2026-12-01", "must be `## "),
        (f"## {VERSION} - 2026-12-01", f"## {VERSION}", "must be `## "),
        (f"## {VERSION} - 2026-12-01", f"## {VERSION}1 - 2026-12-01", "must be `## "),
        ("- First release.\n", "", "is empty"),
        (NOTES, "", "must be `## "),
    ],
)
def test_a_changelog_without_the_version(clone: Path, old: str, new: str, said: str) -> None:
    commit(clone, "CHANGELOG.md", old, new)
    (problem,) = release.problems(clone, None)
    assert problem.startswith("CHANGELOG.md: ")
    assert said in problem


@pytest.mark.parametrize("heading", [f"## [{VERSION}] - 2026-12-01", f"## {VERSION} - 2026-12-01 "])
def test_headings_of_the_changelog(heading: str) -> None:
    assert release.missing_notes(f"# Changelog\n\n{heading}\n\n- First.\n", VERSION) == []


@pytest.mark.slow
def test_checksums(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [f"swarmwright-{VERSION}-cp311-abi3-manylinux_2_17_{one}.whl" for one in ("aarch64", "x86_64")]
    for name in names:
        (tmp_path / name).write_bytes(name.encode() * 1000)
    for _ in range(2):  # what an earlier call wrote is not listed
        assert release.main(["list", str(tmp_path)]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert [line.split()[0] for line in lines] == names
        assert [line.split()[1:3] for line in lines] == [["0.1", "MB"]] * 2
    check = ["sha256sum", "--check", "--strict", "--quiet", "SHA256SUMS"]
    subprocess.run(check, cwd=tmp_path, check=True)
    (tmp_path / names[1]).write_bytes(b"changed")
    assert subprocess.run(check, cwd=tmp_path, check=False, capture_output=True).returncode == 1


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ([], "has no wheel"),
        ([f"swarmwright-{VERSION}-image.tar.gz"], "has no wheel"),
        (["swarmwright-9.9.9-cp311-abi3-linux_x86_64.whl"], f"is not a file of version {VERSION}"),
        ([f"swarmwright-{VERSION}-a.whl", "notes.txt"], f"is not a file of version {VERSION}"),
    ],
)
def test_a_folder_with_other_files(
    files: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in files:
        (tmp_path / name).touch()
    assert release.main(["list", str(tmp_path)]) == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / "SHA256SUMS").exists()


def test_a_folder_that_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert release.main(["list", str(tmp_path / "missing")]) == 1
    assert "No such file or directory" in capsys.readouterr().err
