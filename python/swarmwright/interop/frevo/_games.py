"""The entries of FREVO's games, for simulations that have parameters with their names."""

from collections.abc import Collection

from swarmwright.interop.frevo._document import COMPLETE, HEBBIAN, MESHED, NEAT, Section, Session
from swarmwright.interop.frevo._mapped import Line, Mapped

PONG, SOCCER = "pong.Pong", "components.simplesoccer.SimpleSoccer"
_ENTRIES = {
    PONG: ("playersPerTeam", "paddleHeight", "paddleSpeed", "numberOfBalls", "maximumSteps"),
    SOCCER: (
        "playersPerTeam",
        "position_weight",
        "ball_distance_weight",
        "kick_weight",
        "ball_goal_weight",
        "score_weight",
        "evaluation_time",
        "max_kicks",
    ),
}
_NUMBERS = {"paddleSpeed"}
"""Entries that need not be whole."""
_WITH_MEMORY = (MESHED, COMPLETE, HEBBIAN, NEAT)


def map_game(session: Session, parameters: Collection[str], mapped: Mapped) -> None:
    """Convert the entries of a game that a simulation has parameters for, and note what differs.

    Raises InputError for an entry that is not a number.

    Args:
        session: FREVO's session; does nothing for other problems than games.
        parameters: names of the simulation's parameters.
        mapped: gets lines and notes.
    """
    problem = session.problem
    keys = [
        key for key in _ENTRIES.get(problem.class_name, ()) if key in problem.entries and key in parameters
    ]
    if not keys:
        return
    mapped.parameters += [Line(key, _take(problem, key), key) for key in keys]
    if session.representation.class_name in _WITH_MEMORY:
        mapped.notes.append(
            f"problem.class = {problem.class_name}: in this problem, FREVO's controllers forget everything "
            "in each step; recurrent ones do not here"
        )


def _take(problem: Section, key: str) -> float:
    return problem.take_number(key, 0.0) if key in _NUMBERS else problem.take_integer(key, 0)
