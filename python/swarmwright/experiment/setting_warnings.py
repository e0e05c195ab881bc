"""Keys of an experiment that were set and have no effect, or an undesired one, with its other keys."""

from collections.abc import Iterator

from swarmwright.core.options import Options
from swarmwright.experiment.experiment import Experiment


def setting_warnings(experiment: Experiment) -> list[str]:
    """Return sentences on keys that are not at their defaults and have no effect, or an undesired one."""
    method, validate = experiment.method, experiment.validate
    found = []
    if method.operation != "steady_state":
        found += [
            f"method.{key} has no effect with operation: {method.operation}"
            for key in _set_in(method, "in_flight")
        ]
    if not validate.transfers:
        found += [
            f"validate.{key} has no effect without validate.to, validate.vary or validate.pseudo_reality"
            for key in _set_in(validate, "seeds", "random")
        ]
    ranking = experiment.ranking
    if method.needed_metrics and ranking.seeds == "new":
        episodes = ranking.episodes
        found.append(
            f"ranking.seeds: new lets {method.kind} compare candidates that were evaluated on different "
            "seeds, and those with easy seeds stay to the end; take seeds: same with more episodes "
            f"(ranking.episodes is {episodes}), and evaluate the result on held-out seeds"
        )
    return found


def _set_in(options: Options, *keys: str) -> Iterator[str]:
    """Yield the keys with other values than the defaults, which files of runs have written out."""
    fields = type(options).model_fields
    return (key for key in keys if getattr(options, key) != fields[key].default)
