"""The conversion of FREVO's rankings in which candidates meet."""

from swarmwright.interop.frevo._document import FULL_TOURNAMENT, MULTI_SORT, MULTI_SWISS, SWISS, Section
from swarmwright.interop.frevo._mapped import Line, Mapped

_PAIRINGS = {
    FULL_TOURNAMENT: "frevo_full_tournament",
    SWISS: "frevo_swiss_system",
    MULTI_SWISS: "frevo_multi_swiss",
    MULTI_SORT: "random",
}


def map_tournament(section: Section, mapped: Mapped, *, alone: bool) -> None:
    """Convert all entries. Raises InputError for an invalid entry, or a problem without opponents.

    Args:
        section: the ranking, a tournament.
        mapped: gets its lines.
        alone: whether the problem is Emergency Exit, in which candidates do not meet.
    """
    if alone:
        raise section.element.error(
            f"{section.class_name} is for candidates that meet, which Emergency Exit has not: use "
            "AbsoluteRanking, or name a simulation with two sides with --simulation"
        )
    name = section.class_name
    mapped.ranking_kind = "tournament"
    add = mapped.ranking.append
    add(Line("pairing", _PAIRINGS[name], "the pairs of this class"))
    if name == MULTI_SORT:
        add(Line("rounds", section.take_integer("evaluation_times", 10, 1), "evaluation_times"))
    add(Line("both_sides", "false", "two candidates meet once"))
    add(_score_line(name))
    if name == FULL_TOURNAMENT:
        mapped.ranking += [Line("win", 2, "FREVO's points"), Line("draw", 1, "FREVO's points")]
    elif name == SWISS:
        add(Line("win", section.take_integer("points_win", 2, 1), "points_win"))
        add(Line("draw", section.take_integer("points_tie", 1, 0), "points_tie"))
    elif name == MULTI_SWISS:
        mapped.notes.append(
            "ranking.class = MultiSwiss.MultiSwiss: games are for two; in FREVO, up to maximumCandidates of "
            "the problem play a game"
        )
    else:
        mapped.notes.append(
            "ranking.class = MultiSort.MultiSort: games are for two; FREVO takes the results of a problem "
            "for those of the players in their order, although problems name the best first"
        )


def _score_line(name: str) -> Line:
    if name == MULTI_SWISS:
        return Line("score", "frevo_multi_swiss", "the mean of 2 and 1")
    if name == MULTI_SORT:
        return Line("score", "fitness", "a mean, where FREVO has the sum")
    return Line("score", "points", "as in FREVO")
