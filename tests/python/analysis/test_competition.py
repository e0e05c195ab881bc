"""Progress of competitions: known games, and runs."""

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import swarmwright
from swarmwright import InputError, RunError
from swarmwright.analysis.competition import (
    CompetitionProgress,
    assess,
    color_sides,
    cyclic_share,
    fit_ranking,
    measure_progress,
    spread,
)
from swarmwright.runs.matches import play
from tests.python.analysis.test_league import TRIO
from tests.python.runs.optimization.test_competing import MINISIM, POPULATIONS, TOURNAMENT


def noisy(outcomes: NDArray[np.float64], noise: float, seed: int = 0) -> NDArray[np.float64]:
    """Return ten episodes of each match."""
    random = np.random.default_rng(seed)
    return outcomes[:, :, np.newaxis] + random.normal(scale=noise, size=(*outcomes.shape, 10))


def numbers_game(random: np.random.Generator, players: int = 20) -> NDArray[np.float64]:
    """Return victories in the intransitive game of Watson and Pollack 2001.

    The number of the dimension in which two players differ less decides.
    """
    own, other = random.random((2, players, 2))
    differences = own[:, np.newaxis] - other[np.newaxis]
    nearest = np.abs(differences).argmin(axis=2)
    decisive = np.take_along_axis(differences, nearest[..., np.newaxis], axis=2)[..., 0]
    return np.asarray(np.sign(decisive))


@pytest.mark.parametrize("noise", [0.0, 0.5, 1.0])
def test_an_intransitive_game_goes_in_circles(noise: float) -> None:
    progress = assess("left", range(20), noisy(numbers_game(np.random.default_rng(1)), noise))
    assert progress.cycles
    assert progress.cyclic_share > 0.4


def test_a_game_of_strength_rarely_seems_to_go_in_circles() -> None:
    alarms = 0
    for seed in range(12):
        random = np.random.default_rng(seed)
        own, other = np.sort(random.normal(size=15)), random.normal(size=15)
        outcomes = np.tanh(2 * (own[:, np.newaxis] - other[np.newaxis]))
        alarms += assess("left", range(15), noisy(outcomes, 1.0, seed)).cycles
    assert alarms <= 3


def test_the_better_always_winning_is_no_circle() -> None:
    strengths = np.arange(12.0)
    outcomes = np.sign(strengths[:, np.newaxis] - strengths[np.newaxis] + 0.5)
    assert cyclic_share(outcomes) == pytest.approx(0.0, abs=1e-12)
    assert cyclic_share(np.ones((4, 4))) == 0.0


def test_the_fit_of_a_ranking_is_monotone_and_a_projection() -> None:
    random = np.random.default_rng(3)
    outcomes = random.normal(size=(9, 5))
    fitted = fit_ranking(outcomes)
    order = np.argsort(outcomes.mean(axis=1), kind="stable")
    assert (np.diff(fitted[order], axis=0) >= -1e-12).all()
    assert fitted.mean(axis=0) == pytest.approx(outcomes.mean(axis=0))
    assert fit_ranking(fitted) == pytest.approx(fitted)


def test_progress_and_the_generation_to_take() -> None:
    strengths = np.minimum(np.arange(20.0), 12.0)  # no progress after generation 12
    outcomes = strengths[:, np.newaxis] - strengths[np.newaxis]
    progress = assess("left", range(0, 200, 10), noisy(outcomes, 0.5))
    assert progress.gain_low > 0
    assert 110 <= progress.take <= 130
    assert progress.low[5] < progress.means[5] < progress.high[5]
    backwards = assess("left", range(20), noisy(-outcomes, 0.5))
    assert backwards.gain_high < 0
    assert backwards.take == 0


@pytest.mark.parametrize("experiment", [POPULATIONS, TOURNAMENT], ids=["populations", "swiss"])
def test_champions_of_all_generations_meet(experiment: dict[str, object], tmp_path: Path) -> None:
    run = swarmwright.optimize(experiment, servers="in-process", out=tmp_path / "run")
    progress = measure_progress(run, champions=3, episodes=2, servers="in-process")
    own, other = progress.sides
    assert (own.side, other.side) == ("agents", "defenders")
    assert own.generations == other.generations == (0, 2, 3)
    assert other.outcomes == pytest.approx(-own.outcomes.T), "the match is zero-sum"
    repeated = measure_progress(run, champions=3, episodes=2, servers="in-process")
    assert repeated.sides[0].summary() == own.summary()


def test_no_name_is_a_formula_or_a_command_of_the_terminal(tmp_path: Path) -> None:
    run = swarmwright.optimize(TOURNAMENT, servers="in-process", out=tmp_path / "run")
    names = ("=HYPERLINK(1)", "\x1b[2J\n@x")
    sides = tuple(assess(name, range(4), noisy(np.eye(4), 0.1)) for name in names)
    progress = CompetitionProgress(run, sides, 10, 0)
    progress.export(tmp_path / "progress.csv")
    table = list(csv.DictReader((tmp_path / "progress.csv").read_text().splitlines()))
    assert {row["side"] for row in table} == {"'=HYPERLINK(1)", r"\x1b[2J\n@x"}
    progress.plot(tmp_path / "progress.svg")
    assert "\x1b" not in (tmp_path / "progress.svg").read_text(encoding="utf-8")


def test_each_of_three_sides_meets_the_others_together(tmp_path: Path) -> None:
    run = swarmwright.optimize(TRIO, servers="in-process", out=tmp_path / "run")
    reports: list[tuple[int, int]] = []
    progress = measure_progress(
        run,
        episodes=2,
        servers="in-process",
        on_progress=lambda done, whole, _: reports.append((done, whole)),
    )
    assert [(side.side, side.opponents) for side in progress.sides] == [
        ("first", "the others"),
        ("second", "the others"),
        ("third", "the others"),
    ]
    assert reports[-1] == (3 * 9 * 2, 3 * 9 * 2)
    champions = {name: run.champions(name) for name in ("first", "second", "third")}
    match = np.concatenate([champions[name][2 if name == "second" else 0].genome for name in champions])
    expected = play(run.experiment, [match], [progress.seed, progress.seed + 1], servers="in-process")
    assert progress.sides[1].outcomes[2, 0] == expected[0, :, 1].mean()
    progress.plot(tmp_path / "progress.svg")
    assert "generation of the others" in (tmp_path / "progress.svg").read_text(encoding="utf-8")


def test_mistakes_are_a_message(tmp_path: Path) -> None:
    run = swarmwright.optimize(TOURNAMENT, servers="in-process", out=tmp_path / "run")
    with pytest.raises(InputError, match="champions: must be from 2 to 1000, not 1"):
        measure_progress(run, champions=1)
    with pytest.raises(InputError, match="episodes: must be from 2 to 10000, not 1"):
        measure_progress(run, episodes=1)
    short = swarmwright.optimize(
        {**TOURNAMENT, "method": {"population": 4, "generations": 1}},
        servers="in-process",
        out=tmp_path / "short",
    )
    with pytest.raises(InputError, match="needs at least two finished generations, not 1"):
        measure_progress(short)
    alone = swarmwright.optimize({**MINISIM, "parameters": {}}, servers="in-process", out=tmp_path / "alone")
    with pytest.raises(InputError, match="not a competition"):
        measure_progress(alone)


def test_fitness_that_cannot_be_averaged_is_a_message(tmp_path: Path) -> None:
    huge = {**POPULATIONS["populations"], "agents": {"fitness": "1e200 * (1 + steps)"}}
    values = {**POPULATIONS, "populations": huge}
    run = swarmwright.optimize(values, servers="in-process", out=tmp_path / "run")
    with pytest.raises(RunError, match=r"fitness is up to .*e\+20., but progress needs at most 1e\+100"):
        measure_progress(run, champions=3, episodes=2, servers="in-process")


def test_ratings_recover_the_order_of_strengths() -> None:
    strengths = np.arange(12.0)
    outcomes = np.tanh((strengths[:, np.newaxis] - strengths[np.newaxis]) / 4)
    progress = assess("left", range(12), noisy(outcomes, 0.1))
    assert (np.diff(progress.ratings) > 0).all()
    assert (progress.ratings_low <= progress.ratings).all()
    assert (progress.ratings_high >= progress.ratings).all()
    assert (progress.ratings_high > progress.ratings_low).any()
    certain = assess("left", range(12), np.repeat(outcomes[..., np.newaxis], 2, axis=2))
    assert certain.ratings_low.tolist() == certain.ratings.tolist() == certain.ratings_high.tolist()


def test_generations_are_evenly_spread() -> None:
    assert spread(4, 30) == [0, 1, 2, 3]
    assert spread(1000, 5) == [0, 250, 500, 749, 999]


@pytest.mark.parametrize(
    ("mission", "colors"),
    [
        ({"mission": "pursuit"}, ["#D55E00", "#0072B2"]),
        ({"mission": "territory"}, ["#0072B2", "#D55E00"]),
    ],
)
def test_sides_have_the_colours_of_their_robots(mission: dict[str, str], colors: list[str]) -> None:
    values = {"simulation": "arena", "parameters": mission, "ranking": {"kind": "tournament"}}
    if mission["mission"] == "pursuit":
        values = {**values, "populations": {"predators": {}, "prey": {}}}
        values.pop("ranking")
    assert color_sides(swarmwright.Experiment.from_mapping(values)) == colors


def test_other_sides_have_the_first_colours() -> None:
    assert color_sides(swarmwright.Experiment.from_mapping(TOURNAMENT)) == ["#0072B2", "#D55E00"]
