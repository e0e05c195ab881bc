"""From a FREVO session to the lines of an experiment."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from swarmwright.interop.frevo._components import all_of, check
from swarmwright.interop.frevo._document import Section, Session
from swarmwright.interop.frevo._mapped import Line, Mapped, not_used, one_line
from swarmwright.interop.frevo._methods import map_method
from swarmwright.interop.frevo._problem import map_problem
from swarmwright.interop.frevo._representations import leave_mutation_out, map_representation
from swarmwright.methods import METHODS

_LARGEST_SEED = 2**63 - 1


@dataclass(frozen=True)
class Instead:
    """What is taken in the place of FREVO's components; None where FREVO's is taken over.

    simulation: as experiments name it. method, controller, ranking: kinds.
    """

    simulation: str | None = None
    method: str | None = None
    controller: str | None = None
    ranking: str | None = None


def map_session(session: Session, field_file: Path | None, instead: Instead, sensors: int | None) -> Mapped:
    """Map every entry.

    Args:
        session: what FREVO was to do.
        field_file: the field of Emergency Exit; None: the one that the session names.
        instead: what is taken in the place of components.
        sensors: what an agent senses, where that is known.

    Raises:
        InputError: an entry cannot be read, or something has no counterpart here; with the problems of all
            sections, a line each.
    """
    mapped = Mapped(Line("seed", 0, ""))
    steps: list[Callable[[], None]] = [
        lambda: _map_config(session.config, mapped),
        lambda: _map_simulation(session, field_file, instead.simulation, mapped),
        lambda: _map_method(session, instead.method, mapped),
        lambda: _map_controller(session, sensors, instead.controller, mapped),
        lambda: _map_ranking(session.ranking, instead.ranking, mapped),
    ]
    all_of(*steps)
    for section, reasons in (
        (session.config, mapped.not_config),
        (session.problem, mapped.not_parameters),
        (session.method, mapped.not_method),
        (session.representation, mapped.not_controller),
        (session.ranking, mapped.not_ranking),
    ):
        for key in section.unfilled:
            value = section.entries[key].attribute("value")
            mapped.notes.append(f"{section.name}.{key} = {value}: to be filled in; FREVO's default is taken")
        for reason in not_used(section, "FREVO 1.5 has no such entry"):
            reasons.append(reason)
            mapped.notes.append(f"{section.name}.{reason}")
    return mapped


def _map_config(config: Section, mapped: Mapped) -> None:
    seed = config.take_integer("StartingSeed", 12345, 0)
    if seed > _LARGEST_SEED:
        raise config.error("StartingSeed", f"{seed} found, expected at most {_LARGEST_SEED}")
    mapped.seed = Line("seed", seed, "StartingSeed; drawn from in another way, so runs differ from FREVO's")
    if "CustomName" in config.entries:
        mapped.not_config.append(
            f"CustomName = {one_line(config.shown('CustomName'))}: `--out` names the folder of a run"
        )
    runs = config.take_integer("NumberofRuns", 1)
    reason = f"NumberofRuns = {runs}: one run at a time; `swarmwright sweep` makes several, with other seeds"
    mapped.not_config.append(reason)
    if runs > 1:
        mapped.notes.append(f"sessionconfig.{reason}")
    if "CurrentSeed" in config.entries:
        mapped.not_config.append(f"CurrentSeed = {one_line(config.shown('CurrentSeed'))}: state of FREVO")


def _map_simulation(session: Session, field_file: Path | None, instead: str | None, mapped: Mapped) -> None:
    problem = session.problem
    if instead is None:
        check(problem, replaceable=True)
        map_problem(session, field_file, mapped)
        return
    mapped.simulation = instead
    mapped.not_parameters += not_used(problem, f"an entry of {one_line(problem.class_name)}")
    mapped.notes.append(f"problem.class = {one_line(problem.class_name)}: {instead} is taken in its place")


def _map_method(session: Session, instead: str | None, mapped: Mapped) -> None:
    method = session.method
    if instead is None:
        check(method, replaceable=True)
        map_method(session, mapped)
        return
    mapped.method_kind = instead
    has = METHODS.get(instead).options_model.model_fields
    for ours, key, default in (("population", "populationsize", 50), ("generations", "generations", 200)):
        if ours in has and key in method.entries:
            mapped.method.append(Line(ours, method.take_integer(key, default, 1), key))
    mapped.not_method += not_used(method, f"an entry of {one_line(method.class_name)}")
    mapped.notes.append(f"method.class = {one_line(method.class_name)}: {instead} is taken in its place")


def _map_controller(session: Session, sensors: int | None, instead: str | None, mapped: Mapped) -> None:
    section = session.representation
    if instead is None:
        check(section, replaceable=True)
        map_representation(session, sensors, mapped)
        return
    mapped.controller_kind = instead
    leave_mutation_out(mapped)
    mapped.not_controller += not_used(section, f"an entry of {one_line(section.class_name)}")
    mapped.notes.append(
        f"representation.class = {one_line(section.class_name)}: {instead} is taken in its place"
    )


def _map_ranking(section: Section, instead: str | None, mapped: Mapped) -> None:
    threads = one_line(section.shown("parallelthreads", "1"))
    mapped.not_ranking.append(f"parallelthreads = {threads}: servers and processors are found by themselves")
    if instead is None:
        check(section, replaceable=True)
        return
    mapped.ranking_kind = instead
    mapped.not_ranking += not_used(section, f"an entry of {one_line(section.class_name)}")
    mapped.notes.append(f"ranking.class = {one_line(section.class_name)}: {instead} is taken in its place")
