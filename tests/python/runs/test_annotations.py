"""Tags and notes of runs."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import InputError, Run
from swarmwright.runs.annotations import Annotations, read_annotations, write_annotations
from swarmwright.runs.verification import verify


def test_tags_and_a_note_are_kept_beside_the_record(copy: Path) -> None:
    run = Run(copy)
    digest = run.digest
    assert (run.tags, run.note) == ((), "")
    run.annotate(tags=["thesis", "chapter 3"])
    run.annotate(note="more <noise>\nnext time")
    assert (Run(copy).tags, Run(copy).note) == (("thesis", "chapter 3"), "more <noise>\nnext time")
    run.annotate(tags=[])
    assert (run.tags, run.note) == ((), "more <noise>\nnext time")
    assert Run(copy).digest == digest
    assert verify(copy).problems == []


@given(st.lists(st.text(max_size=60), max_size=25), st.text(max_size=200))
def test_what_is_accepted_is_read_again(
    tmp_path_factory: pytest.TempPathFactory, tags: list[str], note: str
) -> None:
    folder = tmp_path_factory.mktemp("run")
    try:
        written = write_annotations(folder, tags, note)
    except InputError:
        assert not list(folder.iterdir())
    else:
        assert read_annotations(folder) == written == Annotations(tuple(tags), note)


@pytest.mark.parametrize(
    ("tags", "note", "message"),
    [
        (["x"] * 21, "", "tags: a run has at most 20"),
        (["x", "x"], "", "tags: 'x': is repeated"),
        ([""], "", "tags: '': use 1 to 50"),
        (["a,b"], "", "without commas"),
        (["a\nb"], "", "printable"),
        ([" a"], "", "space"),
        (["x" * 51], "", "1 to 50"),
        ([], "x" * 10_001, "note: has 10,001 characters"),
        ([], "\ud800", "not valid Unicode"),
    ],
)
def test_others_are_refused(tmp_path: Path, tags: list[str], note: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        write_annotations(tmp_path, tags, note)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"tags": 1, "note": ""}', '{"tags": [1], "note": ""}', "[" * 9999, "\0"]
)
def test_a_damaged_file_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "notes.json").write_text(text)
    with pytest.raises(InputError, match=r"notes\.json: must be JSON"):
        read_annotations(tmp_path)


def test_a_link_is_not_followed_to_another_file(tmp_path: Path) -> None:
    target = tmp_path / "target"
    target.write_text("mine")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "notes.json").symlink_to(target)
    with pytest.raises(InputError, match="is a link"):
        write_annotations(tmp_path / "run", [], "other")
    assert target.read_text() == "mine"


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        write_annotations(tmp_path / "gone", [], "other")
