"""Leagues: controllers of runs, bundles and files, each in matches against all others."""

import hashlib
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmwright.analysis.standings import Standing, games_of_matches, games_on_side, standings
from swarmwright.analysis.table import columns, number
from swarmwright.common import yaml
from swarmwright.common.errors import InputError, RunError, SwarmwrightError
from swarmwright.common.formatting import format_count
from swarmwright.common.simulation_names import is_python
from swarmwright.common.untrusted import escape_line
from swarmwright.controllers.teams import TEAM
from swarmwright.experiment.competition import needed_metrics
from swarmwright.experiment.experiment import Experiment
from swarmwright.experiment.opponents import (
    Opponent,
    check_fits,
    find_run,
    is_bundle,
    load_opponent,
    read_bundled_experiment,
)
from swarmwright.methods.rankings.tournament import TournamentOptions
from swarmwright.runs.code import resolve_experiment
from swarmwright.runs.matches import SideFitness, sides_of
from swarmwright.runs.post_evaluation import EvaluationOptions
from swarmwright.runs.run import Run
from swarmwright.runs.store import FILE
from swarmwright.servers.evaluation.base import Backend, Controllers
from swarmwright.servers.evaluation.evaluate import log_failures
from swarmwright.servers.evaluation.opening import open_backend
from swarmwright.simulations import catalogue

EXPERIMENT = "league.yaml"
"""File in the folder that has the experiment, if it is not that of a run or a bundle."""
_ENDINGS = frozenset({".json", ".zip", ".bundle", ".yaml", ".yml"})
"""Endings of files that can be controllers, in lower case; others are ignored."""
_MOST_LEFT_OUT = 20
"""Largest number of printed files that are left out; the plain values have all."""
_CHUNK = 4096
"""Matches that are evaluated at once."""
_FEW_SEEDS = 5
"""Episodes of a match below which intervals are too narrow."""


class Participant(NamedTuple):
    """A controller of a league."""

    name: str
    """Its file or folder in the league's folder, in printable characters."""
    opponent: Opponent
    sides: Mapping[int, Opponent]
    """Index of each side that it can play -> the controller for it."""


class LeftOut(NamedTuple):
    """A file or folder that does not take part."""

    name: str
    reason: str


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class League:
    """The results of a league; `print(league)` shows the table."""

    experiment: Experiment
    sides: tuple[str, str]
    participants: tuple[Participant, ...]
    """In alphabetical order."""
    seeds: list[int]
    """Seed of each episode of each match."""
    fitness: NDArray[np.float64]
    """(participants, participants, seeds, sides): fitness of both sides in the match in which the first
    participant plays the first side; NaN if it was not played or has failed."""
    left_out: tuple[LeftOut, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def has_roles(self) -> bool:
        """Whether the sides have different tasks: players of one side are compared, not opponents."""
        return bool(self.experiment.populations)

    @cached_property
    def tables(self) -> list[tuple[str, list[tuple[Participant, Standing]]]]:
        """The tables, best first: (side, rows); a single one, of side "", unless sides differ in tasks."""
        if not self.has_roles:
            everybody = list(range(len(self.participants)))
            return [("", self._rows(standings(games_of_matches(self.fitness)), everybody))]
        return [
            (
                name,
                self._rows(
                    standings(games_on_side(self.fitness, side)),
                    [index for index, each in enumerate(self.participants) if side in each.sides],
                ),
            )
            for side, name in enumerate(self.sides)
        ]

    def _rows(
        self, all_standings: list[Standing], members: Sequence[int]
    ) -> list[tuple[Participant, Standing]]:
        rows = [(self.participants[index], all_standings[index]) for index in members]
        return sorted(rows, key=lambda row: (np.nan_to_num(-row[1].rating, nan=np.inf), row[0].name))

    @property
    def matches(self) -> int:
        """Number of matches."""
        return int(_playable(self.participants).sum())

    @property
    def failed(self) -> int:
        """Number of episodes that failed, which do not count."""
        failed: NDArray[np.bool_] = np.asarray(np.isnan(self.fitness).any(axis=3))
        return int(failed[_playable(self.participants)].sum())

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the participants, seeds and results in hexadecimal, whatever the files are called."""
        order = np.argsort([each.opponent.digest for each in self.participants], kind="stable")
        content = hashlib.sha256()
        for index in order:
            content.update(self.participants[index].opponent.digest.encode())
        content.update(np.array(self.seeds, dtype="<u8").tobytes())
        content.update((self.fitness[np.ix_(order, order)] + 0.0).astype("<f8").tobytes())
        return content.hexdigest()

    def mean_fitness(self, participant: Participant, side: int) -> float:
        """Return the mean fitness of a participant in its matches on a side; NaN if all have failed."""
        index = self.participants.index(participant)
        values = self.fitness[index, :, :, 0] if side == 0 else self.fitness[:, index, :, 1]
        finished = values[np.isfinite(values)]
        return float(finished.mean()) if len(finished) else float("nan")

    @cached_property
    def caveats(self) -> tuple[str, ...]:
        """Restrictions of the conclusions, a sentence each."""
        notes = list(self.notes)
        if self.failed:
            notes.append(f"{format_count(self.failed, 'episode')} failed and did not count")
        played = self.fitness[_playable(self.participants)]
        if len(self.seeds) > 1 and np.array_equal(played, np.broadcast_to(played[:, :1], played.shape), True):
            notes.append("the results do not depend on the seed, so there are no intervals")
        elif all(standing.rating_interval is None for _, rows in self.tables for _, standing in rows):
            notes.append("each seed has the same winners, so there are no intervals")
        elif len(self.seeds) < _FEW_SEEDS:
            notes.append("intervals of so few episodes are too narrow; choose more with --episodes")
        if self.has_roles:
            notes.append("a game compares two controllers of a side against the same opponent and seed")
        return tuple(notes)

    @property
    def heading(self) -> list[str]:
        """Lines above the tables: what was played."""
        name = escape_line(self.experiment.subject)
        matches = f"{self.matches:,} {'match' if self.matches == 1 else 'matches'}"
        controllers = format_count(len(self.participants), "controller")
        return [
            f"{controllers}, {matches} of {format_count(len(self.seeds), 'episode')} in {name}",
            f"Seeds: {format_seeds(self.seeds)}",
            f"SHA-256 of the results: {self.digest}",
        ]

    def cells(self, side: str) -> list[list[str]]:
        """Return the cells of the table of a side (empty: of all), with a head."""
        rows = next(rows for name, rows in self.tables if name == side)
        indices = [index for index, name in enumerate(self.sides) if side in {"", name}]
        head = ["rank", "controller", "rating", "95 %", "points", "95 %", "won", "drawn", "lost"]
        cells = [[*head, *(f"fitness as {self.sides[index]}" for index in indices), "SHA-256"]]
        for rank, (participant, standing) in enumerate(rows, start=1):
            cells.append(
                [
                    str(rank),
                    participant.name,
                    _format(standing.rating),
                    _format_interval(standing.rating_interval),
                    _format(standing.points, percent=True),
                    _format_interval(standing.points_interval, percent=True),
                    *map(str, (standing.wins, standing.draws, standing.losses)),
                    *(
                        number(self.mean_fitness(participant, index)) if index in participant.sides else "-"
                        for index in indices
                    ),
                    participant.opponent.digest[:12],
                ]
            )
        return cells

    def __repr__(self) -> str:
        return f"<League: {self.heading[0]}>"

    def __str__(self) -> str:
        lines = list(self.heading)
        for side, _ in self.tables:
            title = [f"Side {escape_line(side)}", ""] if side else []
            lines += ["", *title, *columns(self.cells(side))]
        ends = describe_left_out(self.left_out)
        ends += [f"Note: {escape_line(note)}." for note in self.caveats]
        return "\n".join([*lines, *([""] if ends else []), *ends])

    def markdown(self) -> str:
        """Return the tables in Markdown."""
        lines = ["# League", "", *(f"- {_escape_markdown(line)}" for line in self.heading)]
        for side, _ in self.tables:
            head, *rows = self.cells(side)
            lines += ["", f"## {_escape_markdown(side)}", ""] if side else [""]
            lines += [_row(head), _row(["---"] * len(head), escape=False), *map(_row, rows)]
        ends = [f"- {_escape_markdown(line)}" for line in describe_left_out(self.left_out)]
        ends += [f"- {_escape_markdown(note)}." for note in self.caveats]
        return "\n".join([*lines, *([""] if ends else []), *ends]) + "\n"

    def to_mapping(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON; NaN is not converted."""
        names = [participant.name for participant in self.participants]
        options = self.experiment.ranking
        assert isinstance(options, TournamentOptions)
        return {
            "simulation": self.experiment.label,
            "parameters": self.experiment.parameters,
            "sides": dict(options.sides or {}),
            "seeds": self.seeds,
            "digest": self.digest,
            "participants": [
                {
                    "name": participant.name,
                    "sha256": participant.opponent.digest,
                    "sides": [self.sides[side] for side in participant.sides],
                }
                for participant in self.participants
            ],
            "tables": [
                {
                    "side": side or None,
                    "rows": [
                        {
                            "rank": rank,
                            "name": participant.name,
                            **vars(standing),
                            "fitness": {
                                self.sides[index]: self.mean_fitness(participant, index)
                                for index in participant.sides
                            },
                        }
                        for rank, (participant, standing) in enumerate(rows, start=1)
                    ],
                }
                for side, rows in self.tables
            ],
            "matches": [
                {
                    "players": [names[first], names[second]],
                    "fitness": self.fitness[first, second].T.tolist(),
                }
                for first, second in np.argwhere(_playable(self.participants)).tolist()
            ],
            "failed": self.failed,
            "left_out": [each._asdict() for each in self.left_out],
            "notes": list(self.caveats),
        }


def describe_left_out(left_out: Sequence[LeftOut]) -> list[str]:
    """Return a line for each file or folder that is left out; of many, for the first and their number."""
    more = len(left_out) - _MOST_LEFT_OUT
    lines = [f"Left out: {each.reason}" for each in left_out[:_MOST_LEFT_OUT]]
    return [*lines, *([f"Left out: {more:,} more; --json has all"] if more > 0 else [])]


def find_entries(folder: Path) -> list[str]:
    """Return the names of files and folders that can be controllers, in alphabetical order.

    Raises InputError if the folder cannot be read, or is a run itself.
    """
    if (folder / FILE).is_file():
        raise InputError(f"{folder}: is a run folder; name the folder in which runs and controllers are")
    try:
        return sorted(
            path.name
            for path in folder.iterdir()
            if not path.name.startswith(".")
            and path.name != EXPERIMENT
            and (path.is_dir() or path.suffix.lower() in _ENDINGS)
        )
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror}") from error


def find_experiment(folder: Path, names: Sequence[str]) -> Experiment:
    """Return the experiment of a league: its file in the folder, or that of the first run or bundle.

    The simulation of the file or a bundle must be built in, since both may come from others.

    Raises InputError if there is none, if the file names code, or if that of a run is missing or not trusted.
    """
    if (folder / EXPERIMENT).is_file():
        return _read_experiment(folder / EXPERIMENT)
    for name in names:
        path = folder / name
        if (path / FILE).is_file():
            try:
                run = Run.open(path)
                sides_of(run.experiment)
            except SwarmwrightError:  # is reported as left out, or is not a competition
                continue
            return resolve_experiment(run)
        values = read_bundled_experiment(path) if is_bundle(path) else None
        if values is not None and values["simulation"] in catalogue.titles():
            try:
                return Experiment.from_mapping(values)
            except InputError:  # of another version, or invalid
                continue
    raise InputError(
        f"{folder}: no run in it is a competition, nor any bundle of a built-in simulation, so the "
        f"experiment is unknown; name one with --experiment FILE, or add it as {EXPERIMENT}"
    )


def _read_experiment(file: Path) -> Experiment:
    """Read the file of a folder, which executes no code. Raises InputError if it names some."""
    values = yaml.read(file).values
    simulation = values.get("simulation") if isinstance(values, Mapping) else None
    if str(simulation) not in catalogue.titles() or _names_code(values):
        raise InputError(
            f"{file}: names a simulation that is not built in, or code, which is not executed unasked; if "
            f"you trust it: --experiment {shlex.quote(str(file))}"
        )
    return Experiment.load(file)


def _names_code(values: object, path: tuple[object, ...] = ()) -> bool:
    """Return whether a text names a class or a program; opponents cannot."""
    if path == ("ranking", "opponents"):
        return False
    if isinstance(values, Mapping):
        return any(_names_code(value, (*path, key)) for key, value in values.items())
    if isinstance(values, list):
        return any(_names_code(value, path) for value in values)
    return isinstance(values, str) and is_python(values)


def play_league(
    folder: Path, experiment: Experiment | None, where: EvaluationOptions, names: Sequence[str] | None = None
) -> League:
    """Let the controllers in a folder play against each other, on both sides if they can.

    Args:
        folder: has run folders (their best candidates), bundles, and files of controllers.
        experiment: a competition of two sides; None for that of `find_experiment`.
        where: episodes of each match, and where they are evaluated. By default, seeds that no run has used.
        names: the files and folders; default: all.

    Raises:
        InputError: there is no experiment of two sides, or there are no two controllers that can meet.
        RunError: no broker, no matching server, or all episodes failed.
    """
    names = find_entries(folder) if names is None else names
    experiment = experiment or find_experiment(folder, names)
    sides = tuple(sides_of(experiment))
    if len(sides) != 2:
        raise InputError(
            "a league needs two sides, so that two controllers meet in a match, but the experiment has "
            f"{', '.join(sides)}"
        )
    options = experiment.ranking
    assert isinstance(options, TournamentOptions)
    opponents, left_out, used = load_participants(folder, names)
    seeds = where.seeds(experiment, used)
    with open_backend(
        experiment, broker=where.broker, servers=where.servers, metrics=needed_metrics(options)
    ) as backend:
        architecture = experiment.representation(backend.sensors, backend.actuators).architecture()
        participants, unfit = select_participants(opponents, architecture, experiment)
        playable = _playable(participants)
        if not playable.any():
            reasons = "".join(f"; {each.reason}" for each in [*left_out, *unfit][:3])
            raise InputError(f"{folder}: has no two controllers that can meet in a match{reasons}")
        fitness = play_matches(participants, playable, architecture, experiment, seeds, where, backend)
    if not np.isfinite(fitness).any():
        raise RunError("every episode failed; the reasons are above")
    return League(
        experiment=experiment,
        sides=(sides[0], sides[1]),
        participants=tuple(participants),
        seeds=seeds,
        fitness=fitness,
        left_out=tuple(sorted([*left_out, *unfit])),
    )


def load_participants(folder: Path, names: Sequence[str]) -> tuple[list[Opponent], list[LeftOut], set[int]]:
    """Return the controllers, what is left out, and the seeds that their runs have used."""
    opponents: list[Opponent] = []
    left_out: list[LeftOut] = []
    used: set[int] = set()
    by_digest: dict[str, str] = {}
    for name in names:
        label = escape_line(name)
        try:
            opponent = load_opponent(name, folder)
            run = find_run(name, folder)
            if run is not None:
                used |= Run.open(run)._store.collect_seeds()
        except SwarmwrightError as error:
            left_out.append(LeftOut(label, escape_line(str(error))))
            continue
        other = by_digest.setdefault(opponent.digest, opponent.name)
        if other != opponent.name:
            left_out.append(LeftOut(label, f"{opponent.name}: is the same controller as {other}"))
            continue
        opponents.append(opponent)
    return opponents, left_out, used


def select_participants(
    opponents: Sequence[Opponent], architecture: Mapping[str, Any], experiment: Experiment
) -> tuple[list[Participant], list[LeftOut]]:
    """Return the controllers that fit at least one side, and the others."""
    titles = (catalogue.title(experiment.simulation),)
    participants, left_out = [], []
    for opponent in opponents:
        playing: dict[int, Opponent] = {}
        reasons = []
        for side, group in enumerate(architecture["groups"]):
            needed = group["controller"]
            try:
                controller = opponent.playing(str(group["name"]))
                if controller.parts:
                    raise InputError(f"{controller.name}: is a team within a team")
                check_fits(
                    controller,
                    int(needed["sensors"]),
                    int(needed["actuators"]),
                    experiment.simulation,
                    titles=titles,
                )
                playing[side] = controller
            except InputError as error:
                reasons.append(str(error))
        if playing:
            participants.append(Participant(opponent.name, opponent, playing))
        else:
            left_out.append(LeftOut(opponent.name, reasons[0]))
    return participants, left_out


def _playable(participants: Sequence[Participant]) -> NDArray[np.bool_]:
    """Return which matches are possible, (participants, participants): the first plays the first side."""
    first, second = (np.array([side in each.sides for each in participants], dtype=bool) for side in (0, 1))
    playable: NDArray[np.bool_] = np.logical_and.outer(first, second)
    np.fill_diagonal(playable, val=False)
    return playable


def join_controllers(architecture: Mapping[str, Any], parts: Sequence[Opponent]) -> dict[str, Any]:
    """Return the architecture of a team whose groups have these controllers."""
    groups = [
        {**group, "controller": dict(part.architecture)}
        for group, part in zip(architecture["groups"], parts, strict=True)
    ]
    return {**architecture, "kind": TEAM, "groups": groups}


def play_matches(
    participants: Sequence[Participant],
    playable: NDArray[np.bool_],
    architecture: Mapping[str, Any],
    experiment: Experiment,
    seeds: list[int],
    where: EvaluationOptions,
    backend: Backend,
) -> NDArray[np.float64]:
    """Return the fitness of all matches, see `League.fitness`."""
    options = experiment.ranking
    assert isinstance(options, TournamentOptions)
    compute = SideFitness(options)
    count = len(participants)
    fitness = np.full((count, count, len(seeds), 2), np.nan)
    kinds = [
        {side: repr(controller.architecture) for side, controller in participant.sides.items()}
        for participant in participants
    ]
    by_architecture: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for first, second in np.argwhere(playable).tolist():
        by_architecture.setdefault((kinds[first][0], kinds[second][1]), []).append((first, second))
    total, done = int(playable.sum()) * len(seeds), 0
    for matches in by_architecture.values():
        example = matches[0]
        team = join_controllers(
            architecture, [participants[example[side]].sides[side] for side in range(len(example))]
        )
        for start in range(0, len(matches), _CHUNK):
            chunk = matches[start : start + _CHUNK]

            def progress(part: int, _: int, waiting_for: str, before: int = done) -> None:
                if where.on_progress is not None:
                    where.on_progress(before + part, total, waiting_for)

            weights = np.stack(
                [
                    np.concatenate([participants[i].sides[0].weights, participants[j].sides[1].weights])
                    for i, j in chunk
                ]
            )
            results = backend.evaluate(Controllers(team, weights), seeds, progress)
            rows, others = np.array(chunk).T
            fitness[rows, others], warnings = compute(backend.metrics, results)
            log_failures(backend, replace(results, journal=results.journal.with_warnings(warnings)))
            done += len(chunk) * len(seeds)
    return fitness


def _format(value: float, *, percent: bool = False) -> str:
    if not np.isfinite(value):
        return "-"
    return f"{_round(100 * value)} %" if percent else _round(value)


def _format_interval(ends: tuple[float, float] | None, *, percent: bool = False) -> str:
    if ends is None:
        return "-"
    low, high = (_round((100 if percent else 1) * end) for end in ends)
    return f"{low} to {high}"


def _round(value: float) -> str:
    return f"{round(value):d}"  # no -0


def format_seeds(seeds: Sequence[int]) -> str:
    """Return seeds as text: consecutive ones by the first and the last."""
    runs: list[list[int]] = []
    for seed in seeds:
        if runs and seed == runs[-1][-1] + 1:
            runs[-1] = [runs[-1][0], seed]
        else:
            runs.append([seed])
    return ", ".join(" to ".join(map(str, run)) for run in runs)


def _row(cells: Sequence[str], *, escape: bool = True) -> str:
    return f"| {' | '.join(map(_escape_markdown, cells) if escape else cells)} |"


def _escape_markdown(text: str) -> str:
    """Escape text so that it is neither markup nor a link, nor ends a cell."""
    line = escape_line(text)
    return "".join(f"\\{sign}" if sign in "\\`*_{}[]<>|#!" else sign for sign in line)
