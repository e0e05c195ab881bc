"""Journals of evaluations."""

from swarmwright.servers.rows import AttemptEntry, Journal, WarningEntry


def attempt(candidate: int, episode: int) -> AttemptEntry:
    return AttemptEntry("offloaded", candidate, 1, episode, 1, 1, 1, None, 0.0, 1.0, "done", None, None)


def test_episodes_are_counted_from_another_one_on_and_words_of_others_kept() -> None:
    ours = WarningEntry.from_episode(2, " failed: episode 1 is out", 0, "episode 1 is out")
    others = WarningEntry("episode 3 of the server", error="episode 3 of the server")
    journal = Journal(warnings=[ours, others]).renumber([5], 5)
    assert journal.warnings == [
        ("episode 7 failed: episode 1 is out", 5, "episode 1 is out", 7, None, None, False),
        ("episode 3 of the server", None, "episode 3 of the server", None, None, None, False),
    ]


def test_candidates_of_a_part_have_their_numbers_in_the_whole() -> None:
    part = Journal([attempt(0, 0), attempt(1, 2)])
    assert part.renumber([7, 4], 3).attempts == [attempt(7, 3), attempt(4, 5)]
    whole = Journal([attempt(0, 0)])
    whole.extend(part.renumber(range(10, 100)))
    assert whole.attempts == [attempt(0, 0), attempt(10, 0), attempt(11, 2)]
