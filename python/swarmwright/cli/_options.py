"""Options and arguments that several commands share."""

import functools
from collections.abc import Callable
from typing import Any

import click

from swarmwright.cli._parameter_types import (
    CandidateId,
    FiniteNumber,
    ObjectiveValue,
    Renamed,
    ServerCount,
    WholeNumber,
)

Decorator = Callable[[Any], Any]


servers_option: Decorator = click.option(
    "--servers",
    type=ServerCount(),
    metavar="N",
    help="""\b
N           start N servers on this machine
auto        one per processor, 2 to 8; same
            as local in notebooks and with
            modules in Python
local       no server: one process per
            processor for simulations in
            Python, this process for others
in-process  no server: all in this process
LAUNCHER:N  servers elsewhere: slurm:200, or
            slurm:100,process:2; options of
            launchers are in the experiment""",
)

simulation_option: Decorator = click.option(
    "--simulation",
    metavar="FILE:CLASS",
    help="Use this Python class instead of the run's, whose code was edited or moved.",
)


def _trust(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        from swarmwright.simulations.user_code.trust import trusting

        context.with_resource(trusting())


trust_option: Decorator = click.option(
    "--trust",
    is_flag=True,
    expose_value=False,
    callback=_trust,
    help="Execute the code in a run folder even if the run was not made on this machine. Remembered for this "
    "code.",
)


def set_option(
    text: str = "Override a value of FILE: method.generations=50, 'controller.hidden=[8, 4]'.",
) -> Decorator:
    """`--set KEY=VALUE`, may be repeated: overrides values of the experiment."""
    return click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="KEY=VALUE",
        help=f"{text} The value is YAML; null means the default. May be repeated.",
    )


json_option: Decorator = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object per line."
)


def candidate_options(command: Any) -> Any:  # noqa: ANN401 - click's decorators
    """`--candidate G:N`, or `--generation G --candidate N`: one line of a run's record.

    The command gets `generation` and `candidate`, as `Run.evaluation` takes them.
    """
    generation = click.option(
        "--generation",
        type=WholeNumber(min=0, max=2**63 - 1),
        metavar="G",
        help="Generation of the candidate, numbered from 0. Without --candidate: its best one.",
    )
    candidate = click.option(
        "--candidate",
        "chosen",
        type=CandidateId(),
        metavar="G:N",
        help="""\b
G:N  candidate N of generation G
N    with --generation: candidate N of it
N    alone: evaluation N of the whole run
All are numbered from 0. Default: the best.""",
    )

    @functools.wraps(command)
    def with_candidate(
        *, generation: int | None, chosen: tuple[int | None, int] | None, **others: object
    ) -> Any:  # noqa: ANN401
        of, number = chosen or (None, None)
        if of is not None and generation is not None:
            raise click.UsageError(f"--candidate {of}:{number} names the generation; leave out --generation.")
        return command(generation=generation if of is None else of, candidate=number, **others)

    return candidate(generation(with_candidate))


held_out_option: Decorator = click.option(
    "--held-out",
    is_flag=True,
    help="Compare the fitness of each run's best candidate on held-out seeds, by its validation, instead of "
    "the best recorded fitness.",
)
at_option: Decorator = click.option(
    "--at",
    type=WholeNumber(min=1),
    metavar="EVALUATIONS",
    help="Compare the best of the first EVALUATIONS of each run; where candidates are evaluated again "
    "(racing, reevaluate), the last generation that was finished by then. Default: the whole runs.",
)
at_episodes_option: Decorator = click.option(
    "--at-episodes",
    type=WholeNumber(min=1),
    metavar="EPISODES",
    help="Compare after equally much simulation, where ranking.episodes differs: the best of the evaluations "
    "that took at most EPISODES episodes.",
)


_BY_OPTIONS: tuple[Decorator, ...] = (
    click.option(
        "--by",
        type=click.Choice(["fitness", "hypervolume", "qd_score", "coverage"]),
        default="fitness",
        show_default=True,
        help="What is compared: the best fitness, the hypervolume of the fronts of nsga2, or the QD score or "
        "the coverage of the archives of map_elites.",
    ),
    click.option(
        "--reference",
        type=ObjectiveValue(),
        multiple=True,
        metavar="NAME=VALUE",
        help="With --by hypervolume: reference point, once for fitness and for each objective; hypervolume "
        "is then in their units. Default: objectives are scaled to the range that they have in the fronts "
        "that are compared, and the point is a tenth of it worse.",
    ),
    click.option(
        "--offset",
        type=FiniteNumber(),
        metavar="FITNESS",
        help="With --by qd_score: worst possible fitness, which is subtracted from that of each elite. "
        "Default: 0, or the lowest fitness of an elite that is compared where that is negative.",
    ),
)


_SHOWN_OPTIONS: tuple[Decorator, ...] = (
    click.option(
        "--unfinished",
        is_flag=True,
        help="Also count runs that failed, were interrupted or are still running, with what they have. "
        "Without it, they are left out and named, except those that had as many evaluations or episodes as "
        "--at or --at-episodes ask for.",
    ),
    click.option(
        "--order",
        multiple=True,
        metavar="ORDER",
        help="Order of the groups in tables and figures: rank (by their median, the best first), name, "
        "given (as the runs are), or labels of groups, each with an --order of its own. Default: rank.",
    ),
    click.option(
        "--label",
        "labels",
        type=Renamed(),
        multiple=True,
        metavar="GROUP=NAME",
        help="Call a group, or a task, otherwise: --label nnga='genetic algorithm'. Repeatable.",
    ),
)


def compare_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add what commands that compare runs have in common: the fields of `_comparison.Compared`."""
    every = (*_BY_OPTIONS, at_option, at_episodes_option, held_out_option, *_SHOWN_OPTIONS)
    for option in reversed(every):
        command = option(command)
    return command
