"""Caveats of a comparison: why the values of its groups may not be comparable."""

import shlex
from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING

from swarmwright.analysis.indicators import Indicator, shared_indicators
from swarmwright.runs.elites import has_elites
from swarmwright.runs.instances import by_instance
from swarmwright.runs.run import Run
from swarmwright.user_code.copying import shown

if TYPE_CHECKING:
    from swarmwright.analysis.comparison import Group

FEW = 5
"""Runs of a group below which a test has little power."""

_DEFINITIONS = {
    "fitness": "its expression",
    "ranking.aggregate": "the aggregate of episodes",
    "ranking.level": "the level of the aggregate",
}
"""Keys by which fitness is another quantity."""


_JUDGING = {"code", "code.simulation", "code.ranking"}
"""Code by which fitness may be another quantity; that of methods and controllers is what is compared."""


def _command(groups: Sequence["Group"], option: str) -> str:
    """Return the command that compares the runs otherwise; what lies beside them is not named."""
    paths = [run.path for one in groups for run in one.runs]
    folder = paths[0].parent
    everything = {path.name for path in folder.iterdir() if path.is_dir()} if folder.is_dir() else set()
    all_of_it = {path.parent for path in paths} == {folder} and everything <= {path.name for path in paths}
    which = f"{shlex.quote(str(folder))}/*" if all_of_it and len(paths) > 1 else "RUN .."
    return f"`swarmwright runs compare {which} {option}`"


def _definitions(groups: Sequence["Group"], indicator: Indicator, *, held_out: bool) -> Iterator[str]:
    """Yield why fitness of the groups, or an indicator, may not be comparable."""
    keys = {key for one in groups for key in one.differs}
    others = [words for key, words in _DEFINITIONS.items() if key in keys]
    if others and indicator.by != "coverage":
        yield f"fitness of different definitions is compared: groups differ in {' and '.join(others)}"
    parameters = {key.split(".")[1] for key in keys if key.startswith("parameters.")} - {"seed"}
    if parameters:
        names = ", ".join(sorted(parameters))
        yield f"groups differ in the simulation's parameters, so they solve different tasks: {names}"
    if held_out:
        yield from _held_out(groups)
        return
    made = {_recorded(one.runs[0]) for one in groups}
    if indicator.by != "fitness":
        yield from _luck(groups, made, indicator)
        return
    command = f"{_command(groups, '--held-out')} compares fitness on held-out seeds"
    missing = [run for one in groups for run in one.runs if run.validation is None]
    if missing:
        count = sum(len(one.runs) for one in groups)
        command = f"fitness on held-out seeds is known of {count - len(missing)} of {count} runs"
    if len(made) > 1:
        yield (
            f"the best recorded fitness is made of different episodes ({'; '.join(sorted(made))}), and the "
            f"fewer they are, the more it is too high; {command}"
        )
    elif any(_lucky(run) for one in groups for run in one.runs):
        yield (
            "the best recorded fitness is too high where fitness depends on the seed, most of all with "
            f"new seeds in each generation; {command}"
        )


def _luck(groups: Sequence["Group"], made: Collection[str], indicator: Indicator) -> Iterator[str]:
    """Yield that elites may owe their places to their seeds; made: what recorded fitness is made of."""
    if len(made) > 1:
        yield (
            f"the elites were chosen by different episodes ({'; '.join(sorted(made))}), and the fewer they "
            f"are, the more the {indicator.words} is too high where values depend on the seed"
        )
    elif any(_lucky(run) for one in groups for run in one.runs):
        yield (
            f"the elites are what came out best with the seeds of the run, so the {indicator.words} is too "
            "high where values depend on the seed"
        )


def _elites(groups: Sequence["Group"]) -> Iterator[str]:
    """Yield that runs of methods that are made for many candidates are compared by one of them."""
    kinds = [one.label for one in groups if has_elites(one.runs[0])]
    if not kinds:
        return
    shared = shared_indicators([one.runs[0] for one in groups])
    yield f"only the best fitness is compared, not the archive or the front of {' and '.join(kinds)}: " + (
        f"{_command(groups, f'--by {shared[0]}')} compares these{' (or --by coverage)' * (len(shared) > 1)}"
        if shared
        else "`swarmwright runs compare` has --by hypervolume for fronts with the same objectives, --by "
        "qd_score and --by coverage for archives with the same measures"
    )


def _held_out(groups: Sequence["Group"]) -> Iterator[str]:
    """Yield why fitness on held-out seeds of runs may not be comparable."""
    of_runs = [run.unseen.seeds for one in groups for run in one.runs if run.unseen is not None]
    least, most = (limit(map(len, of_runs), default=0) for limit in (min, max))
    if least != most:
        yield (
            f"the runs were validated in {least:,} to {most:,} episodes, and the fewer they are, the less "
            f"certain fitness is; `swarmwright resume RUN --set validate.episodes={most}` validates a run "
            "in as many"
        )
    elif len(set(map(tuple, of_runs))) > 1:
        yield "the runs were validated on different held-out seeds"


def _lucky(run: Run) -> bool:
    """Return whether the best of a run may owe its recorded fitness to its seeds."""
    return run.experiment.ranking.seeds == "new" or run.unseen is not None


def _recorded(run: Run) -> str:
    """Return of what recorded fitness is made."""
    experiment = run.experiment
    if by_instance(experiment):
        return "the mean of all instances of racing"
    episodes = experiment.ranking.episodes
    past = " and those before, evaluated again" if experiment.ranking.reevaluate else ""
    return f"{episodes} episode{'s' if episodes > 1 else ''}{past}"


def _waits(one: "Group", at: int) -> bool:
    """Return whether evaluations of a generation that was not finished do not count."""
    return any(count < min(at, run.evaluations) for run, count in zip(one.runs, one.counts, strict=True))


def caveats(groups: Sequence["Group"], at: int | None, indicator: Indicator, *, held_out: bool) -> list[str]:
    """Return what restricts the conclusions of a comparison, a sentence each."""
    found = list(indicator.notes)
    few = [one for one in groups if len(one.runs) < FEW]
    if few and len(groups) > 1:
        least = min(len(one.runs) for one in few)
        counts = "; ".join(f"{one.label}: {len(one.runs)}" for one in few)
        if len(few) > 3:
            counts = f"{len(few)} groups have {least} or more"
        found.append(f"with fewer than {FEW} runs in a group ({counts}) a test has little power")
    shortest = min(one.evaluations[0] for one in groups)
    longest = max(one.evaluations[1] for one in groups)
    ended = [str(run.path) for one in groups for run in one.runs if run.evaluations < (at or 0)]
    if ended:
        more = f" and {len(ended) - 5} more" if len(ended) > 5 else ""
        found.append(
            f"ended before {at:,} evaluations, and count with what they had: {', '.join(ended[:5])}{more}"
        )
    waiting = [one.label for one in groups if at is not None and _waits(one, at)]
    if waiting:
        found.append(
            f"candidates of {' and '.join(waiting)} are evaluated again, so the last generation that was "
            f"finished within the first {at:,} evaluations counts"
        )
    if at is None and not held_out and len(groups) > 1 and longest > 1.1 * shortest:
        found.append(
            f"the runs have {shortest:,} to {longest:,} evaluations, and each is compared at its end; "
            f"{_command(groups, f'{indicator.options} --at {shortest}'.lstrip())} compares all after as many"
        )
    found += _definitions(groups, indicator, held_out=held_out)
    if indicator.by == "fitness":
        found += _elites(groups)
    simulations = {shown(one.runs[0].experiment.simulation) for one in groups}
    if len(simulations) > 1:
        found.append(
            f"{indicator.words} of different simulations is compared: {', '.join(sorted(simulations))}"
        )
    if any(_JUDGING & one.differs.keys() for one in groups):
        found.append(
            f"{indicator.words} that different code computed is compared: `swarmwright runs show` names the "
            "files"
        )
    interrupted = [run for one in groups for run in one.runs if run.interrupted]
    running = [run for run in interrupted if run.state == "running"]
    for words, some in (
        ("still running", running),
        ("ended early", [run for run in interrupted if run not in running]),
    ):
        if some:
            found.append(f"{words}: {', '.join(str(run.path) for run in some)}")
    return found
