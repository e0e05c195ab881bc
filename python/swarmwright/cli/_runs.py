"""Output of the commands of `swarmwright runs`."""

import math
import re
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from typing import TYPE_CHECKING, Any

from swarmwright.cli._output import Output
from swarmwright.cli._validation import (
    explain_missing_validation,
    transfer_of,
    unseen_facts,
    validation_facts,
    validation_lines,
)
from swarmwright.common.formatting import format_count, format_duration, format_table
from swarmwright.common.simulation_names import label_of
from swarmwright.common.untrusted import escape_line

if TYPE_CHECKING:
    from pathlib import Path

    from swarmwright import Run
    from swarmwright.runs.elites import Elite, Elites
    from swarmwright.runs.reproduction import Reproduction
    from swarmwright.runs.store.verification import Verification

_WARNINGS = 10
"""Largest number of warnings to show."""
_SLOW_S, _UPDATE_S = 1.0, 0.2
"""Seconds until the progress of reading runs is shown, and between its updates."""
_FAILURES = 10
"""Largest number of failure reasons, and of servers per reason, to show."""
_SERVER = re.compile(r"\bserver \d+\b")


@contextmanager
def reading_progress(count: int) -> Iterator[Callable[[int], None]]:
    """Yield a function to call with the index of each run before it is read.

    After a second, a line on the terminal shows how many of the `count` runs have been read.
    """
    began = updated = time.monotonic()
    terminal = Output.has_status()

    def begin(index: int) -> None:
        nonlocal updated
        now = time.monotonic()
        if terminal and now - began > _SLOW_S and now - updated > _UPDATE_S:
            updated = now
            Output.status(f"{index:,} of {count:,} runs read")

    try:
        yield begin
    finally:
        if updated > began:
            Output.status("")


def facts_of(run: "Run") -> dict[str, Any]:
    """Return the facts of a run that a line of the list shows."""
    from swarmwright.simulations.user_code.copying import display_name

    experiment, unseen = run.experiment, run.unseen
    return {
        "run": str(run.path),
        "state": run.state,
        "simulation": display_name(experiment.simulation),
        "controller": experiment.controller.kind,
        "method": label_of(experiment.method.kind),
        "seed": experiment.seed,
        "generations": run.generations,
        "of": experiment.budget.generations,
        "evaluations": run.evaluations,
        "failed": run.failed_evaluations,
        "best": run.history[-1].best_so_far if run.history else None,
        "held_out": None if unseen is None else unseen.fitness.mean,
        "held_out_failed": 0 if unseen is None else unseen.failed,
        "seconds": run.seconds,
        "created": run.created,
    }


def local_time(stamp: str) -> str:
    """Convert a time in UTC (ISO 8601) to local time: 2026-01-31 14:05:09."""
    try:
        return datetime.fromisoformat(stamp).astimezone().isoformat(sep=" ", timespec="seconds")[:19]
    except (ValueError, OverflowError):  # damaged: the journal has no digest
        return stamp


def list_table(output: Output, runs: Sequence[Mapping[str, Any]]) -> None:
    """Print an aligned line per run."""
    # Columns that would be empty are omitted.
    failed = any(facts["failed"] for facts in runs)
    held_out = any(facts["held_out"] is not None for facts in runs)
    heading = (
        *("run", "state", "simulation", "method", "seed", "generations"),
        *(["failed"] * failed),
        "best",
        *(["held-out"] * held_out),
        "created",
    )
    rows = [
        (
            facts["run"],
            facts["state"],
            facts["simulation"],
            facts["method"],
            str(facts["seed"]),
            str(facts["generations"]) if facts["of"] is None else f"{facts['generations']}/{facts['of']}",
            *([_share(facts["failed"], facts["evaluations"])] * failed),
            "-" if facts["best"] is None else f"{facts['best']:.6g}",
            *([_format_held_out(facts)] * held_out),
            local_time(facts["created"])[:16],
        )
        for facts in runs
    ]
    _table(output, [heading, *rows])


def _format_held_out(facts: Mapping[str, Any]) -> str:
    """Return the fitness on held-out seeds, with the number of failed episodes if there are any."""
    if facts["held_out"] is None:
        return "-"
    failed = f" ({facts['held_out_failed']} failed)" if facts["held_out_failed"] else ""
    return f"{facts['held_out']:.6g}{failed}"


def _share(failed: int, evaluations: int) -> str:
    """Return the number of failed evaluations and of all, such as 167 of 200."""
    return f"{failed} of {evaluations}" if failed else "0"


def failure_lines(run: "Run") -> Iterator[str]:
    """Yield lines on the failed evaluations of a run, if there are any."""
    failed = run.failed_evaluations
    if not failed:
        return
    ranking = run.experiment.ranking
    episodes = run.failed_episodes
    aggregation = (
        f" ({format_count(episodes, 'failed episode')})" if episodes and ranking.episodes > 1 else ""
    )
    value = ranking.failure_fitness
    how = "they rank below all others" if value is None else f"a failed episode counts as {value:g}"
    yield f"{failed:,} of {format_count(run.evaluations, 'evaluation')} failed{aggregation}: {how}."


def _table(output: Output, rows: list[tuple[str, ...]]) -> None:
    """Print aligned rows, the first of which is the heading."""
    for line in format_table([tuple(map(escape_line, row)) for row in rows]):
        output.text(line)


def list_elites(output: Output, elites: "Elites", limit: int, offset: float) -> None:
    """Print the elites of a run as a table, the best first; limit: rows, 0 for all."""
    output.text(elites_line(elites, offset))
    sampled = any(elite.evaluations > 1 for elite in elites.candidates)
    evidence = ("evaluations", "95 % interval") if sampled else ()
    heading = ("generation", "candidate", "fitness", *elites.goals, *evidence)
    shown_elites = elites.candidates[: limit or None]
    rows = [
        (
            str(elite.generation),
            str(elite.candidate),
            f"{elite.fitness + 0.0:.6g}",
            *(f"{value + 0.0:.6g}" for value in elite.metrics.values()),
            *(_evidence(elite) if sampled else ()),
        )
        for elite in shown_elites
    ]
    if rows:
        _table(output, [heading, *rows])
    if len(shown_elites) < len(elites.candidates):
        output.text(f".. and {len(elites.candidates) - len(shown_elites):,} more: --limit 0 shows all")
    for note in elites.notes:
        output.text(note)


def _evidence(elite: "Elite") -> tuple[str, str]:
    """Return the number of evaluations of an elite, and the interval of its fitness."""
    interval = "" if elite.interval is None else f"{elite.interval[0]:.4g} to {elite.interval[1]:.4g}"
    return str(elite.evaluations), interval


def list_reproduction(output: Output, reproduction: "Reproduction", offset: float) -> None:
    """Print how the elites of a run did on held-out seeds."""
    facts = reproduction.to_mapping(offset)
    output.text(
        f"On held-out seeds, {format_count(facts['episodes'], 'episode')} each: {facts['illusory']:,} of "
        f"{format_count(len(facts['elites']), 'elite')} are illusory ({facts['moved']:,} in another cell, "
        f"{facts['overestimated']:,} with less fitness)."
    )
    rows: list[tuple[str, ...]] = [("", "held-out", "95 % interval")]
    for name, key, form in (
        ("reproducibility", "reproducibility", ".3g"),
        ("coverage", "coverage", ".3g"),
        ("QD score", "qd_score", ".6g"),
    ):
        value, low, high = (f"{facts[key][part]:{form}}" for part in ("value", "low", "high"))
        rows.append((name, value, f"{low} to {high}"))
    _table(output, rows)


def elites_facts(elites: "Elites", offset: float = 0.0) -> dict[str, Any]:
    """Return the facts on elites for `--json`, without the elites themselves."""
    return {
        "kind": elites.kind,
        "goals": elites.goals,
        "count": len(elites.candidates),
        "cells": None if elites.cells is None else elites.cells.cells,
        "coverage": elites.coverage,
        "qd_score": elites.qd_score(offset),
        "evaluated": elites.evaluated,
        "missing": elites.missing,
        "outside": {name: outside._asdict() for name, outside in elites.outside.items()},
        "partial": elites.partial,
    }


def elites_line(elites: "Elites", offset: float = 0.0) -> str:
    """Return a sentence on the number of elites."""
    count = len(elites.candidates)
    if elites.kind == "front":
        goals = ", ".join(f"{name} ({goal}d)" for name, goal in elites.goals.items())
        return (
            f"The front has {format_count(count, 'candidate')} not dominated in fitness, "
            f"{escape_line(goals)}."
        )
    score = f"QD score {elites.qd_score(offset):.6g}" + (f" (offset {offset:g})" if offset else "")
    if elites.cells is None:
        return f"The unstructured archive has {format_count(count, 'elite')}, {score}."
    cells, share = elites.cells.cells, 100 * (elites.coverage or 0.0)
    return f"The archive has elites in {count:,} of {cells:,} cells (coverage {share:.3g} %), {score}."


def describe(output: Output, run: "Run") -> None:
    """Print a summary of a run."""
    from swarmwright.runs.code import describe_edits
    from swarmwright.runs.elites import has_elites
    from swarmwright.runs.feasibility import feasibility_of

    facts = facts_of(run)
    servers = [share._asdict() for share in run._store.servers()]
    failures = [reason._asdict() for reason in run._store.failures()]
    code = [{"version": version, "sha256": digest} for version, digest in run.code.items()]
    edited = describe_edits(run)
    sessions = [vars(session) for session in run.sessions]
    warnings = [vars(event) for event in run.events()]
    best, unseen, validation, transfer = None, run.unseen, run.validation, transfer_of(run)
    feasibility = feasibility_of(run)
    if run.generations:
        best = {
            "fitness": run.best.fitness,
            "generation": run.best.generation,
            "candidate": run.best.candidate,
        }
    output.json(
        facts
        | {
            "best": best,
            "ended": run.ended,
            "constraints": None if feasibility is None else feasibility._asdict(),
            "elites": elites_facts(run.elites) if run.generations and has_elites(run) else None,
            "failed_episodes": run.failed_episodes,
            "episodes_saved": run.episodes_saved,
            "unseen": None if unseen is None else unseen_facts(unseen),
            "audit": run.audit,
            "validation": None if validation is None else validation_facts(validation),
            "transfer": None if transfer is None else transfer.to_mapping(),
            "digest": run.digest,
            "code": code,
            "edited": edited,
            "servers": servers,
            "failures": failures,
            "sessions": sessions,
            "warnings": warnings,
        }
    )
    if output.as_json:
        return
    _summary(output, run, facts)
    for version in code:
        output.text(f"  code {version['version']} SHA-256 {version['sha256']}")
    for remark in edited:
        output.block(remark, indent="  ")
    _list_sessions(output, run)
    _list_servers(output, servers)
    _list_failures(output, failures)
    if warnings:
        output.text()
    for event in warnings[:_WARNINGS]:
        output.item(f"{local_time(event['time'])} {_generation(event)}{event['text']}", indent="    ")
    if len(warnings) > _WARNINGS:
        output.text(f".. and {len(warnings) - _WARNINGS} more: --json shows all")


def _list_sessions(output: Output, run: "Run") -> None:
    from swarmwright.servers.rows import NOTHING_LEFT

    for session in run.sessions:
        took = "?" if session.seconds is None else format_duration(session.seconds)
        output.text()
        outcome = session.outcome or run.state
        output.text(f"session {session.session}: {local_time(session.started)}, {took}, {outcome}")
        used = "" if session.code is None else f", code version {session.code}"
        location = session.place
        if location != NOTHING_LEFT:
            location = f"evaluated {location}" if location.startswith("in ") else f"evaluated by {location}"
        output.text(f"  {location}{used}, on host {session.host} ({session.machine})")
        output.text("  " + ", ".join(f"{name} {version}" for name, version in session.versions.items()))


def _list_servers(output: Output, servers: list[dict[str, Any]]) -> None:
    if servers:
        output.text()
    for server in servers:
        text = f"server {server['server']}: {format_count(server['evaluations'], 'episode')}"
        text += " (failed ones included)" * server["with_failed"]
        text += f", busy for {format_duration(server['seconds'])}"
        if server["failed"]:
            text += f", {format_count(server['failed'], 'attempt')} failed"
        if server["lost"]:
            text += f", {server['lost']:,} more lost with it"
        if server["handed_back"]:
            text += f", {format_count(server['handed_back'], 'attempt')} handed back for another tool"
        if server["slower"]:
            text += (
                f", {format_count(server['slower'], 'attempt')} stopped as another server was faster (backup)"
            )
        output.text(text)


def _list_failures(output: Output, failures: list[dict[str, Any]]) -> None:
    """Print why attempts failed, how often and on which servers."""
    from swarmwright.servers.rows import IN_PROCESS

    if failures:
        output.text()
        output.text("failed attempts by reason:")
    for failure in failures[:_FAILURES]:
        servers = [
            f"{'in this process' if server == IN_PROCESS else f'server {server}'}: {count}"
            for server, count in failure["servers"].items()
        ]
        named = ", ".join(servers[:_FAILURES]) + ", .." * (len(servers) > _FAILURES)
        reason = failure["reason"]
        if len(servers) > 1:  # the reason names only the first
            reason = _SERVER.sub("the server", reason)
        output.item(f"  {format_count(failure['attempts'], 'attempt')} ({named}): {reason}", indent="    ")
        if failure["lost"]:
            lost = format_count(failure["lost"], "attempt")
            output.item(f"    {lost} at other evaluations, lost with the server and repeated", indent="    ")
    if len(failures) > _FAILURES:
        output.text(f".. and {format_count(len(failures) - _FAILURES, 'more reason')}: --json shows all")


def _generation(event: dict[str, Any]) -> str:
    return "" if event["generation"] is None else f"generation {event['generation']}: "


def _describe_best(run: "Run") -> str:
    """Return the fitness of the best, or the last match of the champions of a competition."""
    from swarmwright.runs.matches import describe_champions

    best, champions = run.best, describe_champions(run)
    if champions is not None:
        return f"champions of generation {best.generation}: {champions}"
    fitness = "without fitness" if math.isnan(best.fitness) else f"{best.fitness:.6g}"
    return f"best {fitness} (generation {best.generation}, candidate {best.candidate})"


def _summary(output: Output, run: "Run", facts: dict[str, Any]) -> None:
    """Print the progress and the results of a run."""
    from swarmwright.runs.instances import averages_instances

    best = run.best if run.generations else None
    validation = run.validation
    output.text(f"{run.path}: {facts['state']}")
    output.text(f"  {facts['simulation']}, {facts['controller']} by {facts['method']}, seed {facts['seed']}")
    whole = "" if facts["of"] is None else f" of {facts['of']}"
    instance = " (an instance each)" if averages_instances(run.experiment) else ""
    output.text(
        f"  {run.generations}{whole} generations{instance}, {run.evaluations} evaluations, "
        f"{format_duration(run.seconds)}"
    )
    for line in (*failure_lines(run), *extra_lines(run)):
        _clause(output, line)
    if run.ended is not None:
        output.text(
            "  ended because "
            f"{run.experiment.budget.describe_end(run.ended, run.generations, run.evaluations)}"
        )
    if run.experiment.method.operation == "steady_state":
        window = run.experiment.method.in_flight
        output.text(
            f"  steady state: candidate n was created from the results of candidates 0 to n - {window}"
        )
    if best is not None:
        output.text(f"  {_describe_best(run)}")
    for row in () if best is None else _controller(best.specification):
        output.text(f"    {row}")
    if run.audit is not None:
        output.text(f"  {_audit_words(run.audit)}")
    missing = explain_missing_validation(run)
    for line in () if validation is None else validation_lines(validation, run):
        _clause(output, line)
    if missing is not None:
        _clause(output, missing)
    resume = f"run `swarmwright resume {shlex.quote(str(run.path))}`"
    if run.validation_is_due and facts["state"] in {"done", "stopped"}:
        output.text(f"  its best candidates are not validated yet; {resume}")
    transfer = transfer_of(run)
    if transfer is not None:
        output.block(str(transfer), indent="  ")
    if run.transfer_is_due:
        output.text(f"  its best candidates are not transferred yet; {resume}")
    output.text(f"  record SHA-256 {run.digest}")


def _clause(output: Output, sentence: str) -> None:
    """Print a sentence as an indented clause."""
    output.text(f"  {sentence[0].lower()}{sentence[1:]}".removesuffix("."))


def _audit_words(audit: Mapping[str, int]) -> str:
    """Return a line on the evaluations repeated at the end of a run, and their results."""
    repeated = (
        f"{format_count(audit['evaluations'], 'evaluation')} ({format_count(audit['episodes'], 'episode')})"
    )
    where = f", {audit['elsewhere']} of the episodes on another server" if audit["elsewhere"] else ""
    failed = f", {format_count(audit['failed'], 'episode')} failed" if audit["failed"] else ""
    differ = audit["differ"]
    came_out = f"{differ} differ" if differ else "all results are identical"
    return f"audit: {repeated} repeated{where}{failed}: {came_out}"


def _controller(specification: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of a state machine or behaviour tree; for a team, those of each group."""
    from swarmwright.controllers.kinds import describe_controller
    from swarmwright.controllers.modules.grammar import is_modules
    from swarmwright.controllers.modules.machine_texts import controller_text
    from swarmwright.controllers.teams import parts_of

    if is_modules(specification):
        yield from controller_text(specification).splitlines()
    for name, part in parts_of(specification).items():
        yield f"{escape_line(name)}: {describe_controller(part)}"
        yield from (f"  {row}" for row in _controller(part))


def extra_lines(run: "Run") -> Iterator[str]:
    """Yield lines on constraints, elites, episodes saved by races, and evaluations in a slow simulation."""
    from swarmwright.experiment.targets import slow_of
    from swarmwright.methods.rankings.race import RaceOptions
    from swarmwright.runs.elites import has_elites
    from swarmwright.runs.feasibility import describe_feasibility

    yield from describe_feasibility(run)
    if run.generations and has_elites(run):
        command = f"swarmwright runs elites {shlex.quote(str(run.path))}"
        yield f"{elites_line(run.elites)[:-1]}: `{command}` lists them."
        yield from run.elites.notes
    if isinstance(run.experiment.ranking, RaceOptions):
        every, saved = run.evaluations * run.experiment.ranking.episodes, run.episodes_saved
        share = 100 * saved / max(every, 1)
        yield f"Races saved {saved:,} of {every:,} episodes ({share:.0f} %), of clearly worse candidates."
    slow = slow_of(run.experiment)
    if slow is not None:
        evaluations, name = run.slow_evaluations, escape_line(slow.name)
        yield f"{evaluations:,} of {run.evaluations:,} candidates were also evaluated in {name}."


def print_verification(output: Output, run: "Path", verification: "Verification") -> None:
    """Print whether the content of a run is intact."""
    good = _numbers(verification.good)
    output.json(
        {
            "run": str(run),
            "ok": not verification.problems,
            "problems": [
                {"what": problem.message, "generations": problem.generations}
                for problem in verification.problems
            ],
            "good_generations": verification.good,
            "evaluations": verification.evaluations,
            "not_compared": verification.not_compared,
        }
    )
    for difference in verification.not_compared:
        output.text(f"{run}: not compared: {escape_line(difference)}")
    if not verification.problems:
        whole = f"{len(verification.good)} generations, {verification.evaluations} evaluations"
        output.text(f"{run}: ok, {whole}")
        return
    for problem in verification.problems:
        several = "s" if len(problem.generations) > 1 else ""
        where = f"generation{several} {_numbers(problem.generations)}: " if problem.generations else ""
        output.text(f"{run}: damaged: {where}{problem.message}")
    output.text(f"{run}: {f'generations {good} are intact' if good else 'no generation is intact'}")


def _numbers(numbers: list[int]) -> str:
    """Return sorted numbers with ranges: 0 to 4, 6."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and parts[-1][-1] == number - 1:
            parts[-1][1:] = [number]
        else:
            parts.append([number])
    return ", ".join(" to ".join(map(str, part)) for part in parts)
