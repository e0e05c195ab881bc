"""Second answers to a message: by their ids, and how long they are waited for."""

import pytest

from swarmwright.simulations.command.process import CommandFailure
from swarmwright.simulations.command.stepwise import SETTLE_S, SUSPECT_S, MessageIds, WaitTimes


def test_ids_are_optional_in_all_answers_of_a_process() -> None:
    ids = MessageIds()
    assert ids.next(is_reset=True) == 1
    assert ids.accepts({"sensors": []})
    assert ids.next(is_reset=False) == 2
    answer = {"sensors": [], "id": 2}
    assert ids.accepts(answer)
    assert answer == {"sensors": []}
    assert ids.are_repeated
    ids.next(is_reset=False)
    with pytest.raises(CommandFailure, match='answered message 3 without its "id", unlike earlier messages'):
        ids.accepts({})


def test_a_second_answer_counts_in_its_own_episode_alone() -> None:
    ids = MessageIds()
    ids.next(is_reset=True)
    assert ids.accepts({"id": 1})
    ids.next(is_reset=False)
    with pytest.raises(CommandFailure, match="answered message 1 twice"):
        ids.accepts({"id": 1})
    ids.next(is_reset=True)
    assert not ids.accepts({"id": 2})
    assert ids.accepts({"id": 3})


@pytest.mark.parametrize("found", [0, 3, "1", True, None, [1]])
def test_other_ids_are_refused(found: object) -> None:
    ids = MessageIds()
    ids.next(is_reset=True)
    with pytest.raises(CommandFailure) as raised:
        ids.accepts({"id": found})
    assert f'answered with the "id" {found!r}, expected 1, the number of the message' in str(raised.value)
    assert ids.accepts({"id": found, "error": "no motor"}), "which says more"


def test_an_error_counts_unless_its_episode_has_ended() -> None:
    ids = MessageIds()
    ids.next(is_reset=True)
    assert ids.accepts({"id": 1})
    ids.next(is_reset=False)
    assert ids.accepts({"error": "no motor", "id": 1})
    assert ids.accepts({"error": "no motor"})
    ids.next(is_reset=True)
    assert not ids.accepts({"error": "no motor", "id": 2})
    assert ids.accepts({"error": "no motor", "id": 3})


def episode(looks: WaitTimes, step_s: float, steps: int) -> list[float]:
    """Return how long one looks after the answers of an episode."""
    looks.begin_episode()
    return [looks.seconds(step_s, is_reset=not step, is_end=step == steps) for step in range(steps + 1)]


def test_the_first_episodes_are_looked_at_closely() -> None:
    looks = WaitTimes()
    found = [episode(looks, 0.01, 50) for _ in range(6)]
    assert sum(found[0][:-1]) == pytest.approx(0.2)
    assert [one[-1] for one in found] == pytest.approx([SETTLE_S] * 5 + [0.015])
    assert found[0][0] == 0.01
    assert not any(found[5][:1])
    assert sum(found[5]) < 0.06 * 50 * 0.01
    looks.suspect()
    assert episode(looks, 0.01, 50)[-1] == SUSPECT_S


def test_a_look_takes_a_small_part_of_an_episode_later() -> None:
    looks = WaitTimes()
    for _ in range(5):
        episode(looks, 2.0, 1)
    assert sum(episode(looks, 2.0, 1)) <= 0.1 * 4.0
    assert episode(looks, 0.0001, 3) == [0.0] * 4
