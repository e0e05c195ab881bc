"""Episodes that the evaluations of compared runs took."""

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swarmwright
from swarmwright import InputError, Run, compare
from swarmwright.runs.store import Record, StoreReader
from tests.python.analysis.runs import runs

EIGHT = {"ranking": {"episodes": 8}}
MISSIONS = ("homing", "foraging")


def about_episodes(notes: tuple[str, ...]) -> list[str]:
    return [note for note in notes if "episodes in all groups" in note]


def test_unlike_numbers_of_episodes_per_evaluation_are_shown_and_noted(tmp_path: Path) -> None:
    comparison = compare([*runs(tmp_path, [1, 2.0]), *runs(tmp_path, [5, 6.0], **EIGHT)], order="given")
    assert [one.counts for one in comparison.groups] == [(4, 4)] * 2
    assert [one.episodes for one in comparison.groups] == [(4, 4), (32, 32)]
    head, first, second = [line.split() for line in str(comparison).splitlines()[:3]]
    assert head[2:4] == ["evaluations", "episodes"]
    assert (first[3:5], second[3:5]) == (["4", "4"], ["4", "32"])
    (note,) = about_episodes(comparison.notes)
    assert "(episodes 1: 1; episodes 8: 8)" in note
    assert "--at-episodes 8`" in note, "not 4, in which the second group had nothing"
    assert [one["episodes"] for one in comparison.to_mapping()["groups"][1]["runs"]] == [32, 32]
    with comparison.export(tmp_path / "table.csv").open() as file:
        assert [row["episodes"] for row in csv.DictReader(file)] == ["4", "4", "32", "32"]


def test_runs_are_compared_after_as_many_episodes(tmp_path: Path) -> None:
    once, often = runs(tmp_path, [1, 2.0]), runs(tmp_path, [5, 6.0], **EIGHT)
    for run in once:
        run._fitness = [np.arange(1.0 + run.experiment.seed, 41.0)]
    (note,) = about_episodes(compare([*once, *often]).notes)
    assert note.endswith("--at-episodes 32` compares all after as many")
    comparison = compare([*once, *often], at_episodes=32)
    assert [one.counts for one in comparison.groups] == [(32, 32), (4, 4)]
    assert [one.episodes for one in comparison.groups] == [(32, 32), (32, 32)]
    assert [one.final.tolist() for one in comparison.groups] == [[33, 34], [5, 6]]
    assert about_episodes(comparison.notes) == []
    assert not [note for note in comparison.notes if "ended before" in note]
    assert (comparison.at, comparison.to_mapping()["at_episodes"]) == (None, 32)
    (axes,) = comparison.figure().axes[1:]
    assert "after 32 episodes" in axes.get_ylabel().replace("\n", " ")
    assert ", after 32 episodes" in comparison.export(tmp_path / "table.tex").read_text()
    fewer = compare([*once, *often], at_episodes=17)
    assert [one.counts for one in fewer.groups] == [(17, 17), (2, 2)]
    (ended,) = [note for note in compare([*once, *often], at_episodes=38).notes if "ended before" in note]
    assert ended.startswith("ended before 38 episodes")
    assert all(run.path.name not in ended for run in once)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"at_episodes": 0}, "^at_episodes: must be at least 1, not 0$"),
        ({"at_episodes": 7}, "had nothing to compare after 7 episodes; compare at 8 or later$"),
        ({"at_episodes": 8, "at": 3}, "leave out at, held_out and by, or leave out at_episodes"),
        ({"at_episodes": 8, "held_out": True}, "leave out at, held_out and by"),
    ],
)
def test_numbers_of_episodes_that_cannot_be_compared(
    tmp_path: Path, given: dict[str, Any], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        compare(runs(tmp_path, [5, 6.0], **EIGHT), **given)


def test_one_episode_per_evaluation_needs_no_column(tmp_path: Path) -> None:
    other = {"kind": "random_search", "population": 4, "generations": 3}
    comparison = compare([*runs(tmp_path, [1, 2.0]), *runs(tmp_path, [5, 6.0], method=other)])
    assert "episodes" not in str(comparison).splitlines()[0]
    assert about_episodes(comparison.notes) == []


def test_other_tasks_may_have_other_numbers_of_episodes(tmp_path: Path) -> None:
    """Groups of different tasks are not tested against each other."""
    homing, foraging = ({"simulation": "arena", "parameters": {"mission": name}} for name in MISSIONS)
    comparison = compare([*runs(tmp_path, [1.0], **homing), *runs(tmp_path, [5.0], **foraging, **EIGHT)])
    assert about_episodes(comparison.notes) == []


def test_the_hint_on_lengths_says_what_as_many_evaluations_took(tmp_path: Path) -> None:
    long = [*runs(tmp_path, [1, 2.0]), *runs(tmp_path, [5, 6.0], **EIGHT)]
    long[0]._fitness += long[0]._fitness
    (note,) = [note for note in compare(long).notes if "--at 4`" in note]
    assert note.endswith("compares all after as many, which took 4 to 32 episodes")


def test_episodes_that_a_race_left_out_do_not_count(tmp_path: Path) -> None:
    plain: dict[str, Any] = {
        "simulation": "minisim", "parameters": {"maxSteps": 10, "placement": "random"},
        "method": {"population": 20, "generations": 3}, "ranking": {"episodes": 10, "seeds": "new"},
    }  # fmt: skip
    race = {**plain, "ranking": {"kind": "race", "seeds": "new"}}
    for name, values in {"plain": plain, "race": race}.items():
        experiment = swarmwright.Experiment.from_mapping(values)
        swarmwright.optimize(experiment, servers="in-process", out=tmp_path / name)
    raced = Run.open(tmp_path / "race")
    assert raced.episodes_saved > 0
    whole, less = compare([tmp_path / "plain", raced], order="given").groups
    assert whole.episodes == (10 * whole.runs[0].evaluations,)
    assert less.episodes == (np.isfinite(raced.record.episodes).sum(),)
    early = compare([tmp_path / "plain", raced], at=30, order="given").groups[1].episodes[0]
    assert early == np.isfinite(raced.record.episodes[:30]).sum()
    used = np.cumsum(np.isfinite(raced.record.episodes).sum(axis=1))
    for episodes in (early - 1, early, early + 1, used[-1] - 1, used[-1]):
        (group,) = compare([raced], at_episodes=episodes).groups
        assert group.counts == ((used <= episodes).sum(),)
        assert group.episodes == (used[group.counts[0] - 1],)


def test_a_race_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = swarmwright.Experiment.from_mapping(
        {
            "simulation": "minisim",
            "parameters": {"maxSteps": 10, "placement": "random"},
            "method": {"population": 6, "generations": 3},
            "ranking": {"kind": "race", "seeds": "new"},
        }
    )
    for seed in (1, 2):
        swarmwright.optimize(experiment.replace(seed=seed), servers="in-process", out=tmp_path / str(seed))
    read: list[Path] = []
    rows = StoreReader.rows

    def noting(store: StoreReader) -> Iterator[Record]:
        read.append(store.file.parent)
        return rows(store)

    monkeypatch.setattr(StoreReader, "rows", noting)
    raced = [Run.open(tmp_path / str(seed)) for seed in (1, 2)]
    compare(raced)
    compare(raced, at_episodes=50)
    compare(raced, at=8)
    assert sorted(read) == [run.path for run in raced]
