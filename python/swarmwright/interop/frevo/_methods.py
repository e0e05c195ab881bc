"""The conversion of FREVO's methods with species, novelty or cuckoos."""

from collections.abc import Collection

from swarmwright.interop.frevo._document import (
    NNGA,
    NOVELTY_RANKING,
    NOVELTY_SEARCH,
    NOVELTY_SPECIES,
    Line,
    Mapped,
    Section,
    Session,
)

_MOST_MEASURES = 8
_SPECIES = (
    ("compatibility", "initial_compatibility_threshold", 0.5),
    ("survival", "survival_threshold", 0.4),
    ("mutate", "mutate_only_probablity", 0.3),
    ("within", "interspecies_mate_rate", 0.001),
    ("crossover_only", "mate_only_prob", 0.2),
)


def map_ga_species(session: Session, mapped: Mapped) -> None:
    """Convert all entries of GASpecies. Raises InputError for an invalid entry."""
    mapped.method_kind = "ga_species"
    _map_sizes(session.method, mapped, 50)
    mapped.method += _convert_species(session.method, mapped)


def map_novelty_species(session: Session, mapped: Mapped) -> None:
    """Convert all entries of NoveltySpecies, except that `measure_all` adds the measures.

    Raises InputError for an invalid entry.
    """
    _map_sizes(session.method, mapped, 50)
    lines = _convert_species(session.method, mapped)
    values = ", ".join(f"{line.key}: {line.value!r}" for line in lines[: len(_SPECIES)])
    keys = ", ".join(line.comment for line in lines[: len(_SPECIES)])
    mapped.method += [Line("species", f"{{{values}}}", keys), *lines[len(_SPECIES) :]]
    _map_novelty(mapped, 6.0, "FREVO's initial threshold")


def map_novelty_search(session: Session, mapped: Mapped) -> None:
    """Convert all entries of NoveltySearch, except that `measure_all` adds the measures.

    Raises InputError for an invalid entry.
    """
    method, add = session.method, mapped.method.append
    _map_sizes(method, mapped, 100)
    mutated = method.take_number("mutate_only_probablity", 0.3)
    add(Line("elite", 0.5, "half of the members stay"))
    add(Line("mutate", round(mutated / 2, 9), f"of the other half, mutate_only_probablity = {mutated!r}"))
    add(Line("crossover", round(0.5 - mutated / 2, 9), "the others"))
    mapped.method += [Line(name, 0.0, "not in NoveltySearch") for name in ("random", "renew")]
    add(Line("severity", method.take_number("mutation_severity", 0.3), "mutation_severity"))
    add(Line("probability", 0.1, "fixed in FREVO"))
    number = method.take_integer("mutation_method", 1)
    name = "proportional" if number == 2 else "uniform"
    mapped.mutation = Line("mutation", name, f"mutation_method = {number}")
    mapped.notes.append(
        f"method.class = {NOVELTY_SEARCH}: FREVO archives children, but never adds them to the population; "
        "here they replace the less novel half"
    )
    threshold = method.take_number("initial_novelty_threshold", 6.0)
    _map_novelty(mapped, threshold, "initial_novelty_threshold")


def map_novelty_ranking(section: Section, mapped: Mapped) -> None:
    """Convert a NoveltyRanking to the method. Raises InputError for an invalid entry, and without NNGA."""
    if mapped.method_kind != "nnga":
        raise section.element.error(
            f"{NOVELTY_RANKING} is converted with {NNGA} only: use that, or --ranking absolute"
        )
    _map_novelty(mapped, section.take_number("initial_threshold", 10.0), "ranking initial_threshold")


def measure_all(session: Session, metrics: Collection[str], mapped: Mapped) -> None:
    """Let novelty search measure metrics of the simulation. Raises InputError if none is known."""
    if mapped.method_kind != "novelty":
        return
    ranking, method = session.ranking, session.method
    section = method if method.class_name in {NOVELTY_SEARCH, NOVELTY_SPECIES} else ranking
    if not metrics:
        raise section.element.error(
            f"{section.class_name} needs a simulation whose metrics are known here, since they describe "
            f"behaviour: name it with --simulation, or replace the {section.name} with --{section.name}"
        )
    names = sorted(metrics)[:_MOST_MEASURES]
    measures = ", ".join(f"{name}: {{range: [0, 1], bins: {2 if len(names) > 4 else 10}}}" for name in names)
    mapped.method.append(Line("measures", f"{{{measures}}}", "metrics of the simulation"))
    mapped.notes.append(
        f"{section.name}.class = {section.class_name}: in FREVO, the problem describes behaviour; here "
        "all metrics of the simulation do, unscaled: edit the measures and their ranges"
    )


def _map_sizes(method: Section, mapped: Mapped, members: int) -> None:
    population = method.take_integer("populationsize", members, 2)
    generations = method.take_integer("generations", 200, 1)
    mapped.method += [
        Line("population", population, "populationsize"),
        Line("generations", 1 + generations, f"the first, and generations = {generations}"),
    ]


def _convert_species(method: Section, mapped: Mapped) -> list[Line]:
    """Return the lines of the species, then of mutations."""
    age = method.take_integer("time_alive_minimum", 0)
    if age > 0:
        raise method.error(
            "time_alive_minimum", f"{age} found; members here can be parents at once: set it to 0"
        )
    mapped.not_method.append(f"time_alive_minimum = {age}: members can be parents at once")
    interval = method.take_integer("save_interval", 0)
    mapped.not_method.append(f"save_interval = {interval}: the record of a run contains all evaluations")
    mapped.mutation = Line("mutation", "uniform", f"the only one of {method.class_name}")
    lines = [Line(ours, method.take_number(key, default), key) for ours, key, default in _SPECIES]
    return lines + [Line(name, 1.0, "fixed in FREVO") for name in ("severity", "probability")]


def _map_novelty(mapped: Mapped, threshold: float, comment: str) -> None:
    mapped.method_kind = "novelty"
    mapped.method += [
        Line("distance", "manhattan", "FREVO's sum of differences"),
        Line("archive", f"{{kind: threshold, threshold: {threshold!r}}}", comment),
    ]


def map_cuckoo_search(session: Session, mapped: Mapped) -> None:
    """Convert all entries of CuckooSearch. Raises InputError for an invalid entry."""
    mapped.method_kind = "cuckoo_search"
    method, add = session.method, mapped.method.append
    add(Line("population", method.take_integer("number_of_nests", 50, 2), "number_of_nests"))
    generations = 1 + 2 * method.take_integer("generations", 200, 1)
    add(Line("generations", generations, "the first, and two for each of generations"))
    add(Line("discovery", method.take_number("discovery_rate", 0.25), "discovery_rate"))
    mapped.notes.append(
        "method.class = frevo.cuckoosearch.CuckooSearch: FREVO keeps flights to worse solutions, scales them "
        "by 0 to 100, and ignores discovery_rate; here the published method is used"
    )
