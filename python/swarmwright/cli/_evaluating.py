"""What commands that evaluate controllers share: options, settings and output."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from swarmwright.cli import _options as options
from swarmwright.cli._output import Output

if TYPE_CHECKING:
    from swarmwright import Experiment
    from swarmwright.runs.post_evaluation import EvaluationOptions

_NOT_EVALUATED = (
    "it does not affect how a candidate is evaluated; set parameters, fitness, ranking, or where it is "
    "evaluated"
)
_REPEATED = "--set changes the conditions, so the result cannot be compared with the record; add --episodes N"


@dataclass(frozen=True)
class Evaluating:
    """Where and with which settings a command evaluates controllers."""

    output: Output
    broker: str | None
    prefix: str | None
    servers: options.Servers | None = None
    settings: tuple[str, ...] = ()
    """Values of `--set`."""

    @property
    def changes(self) -> tuple[str, ...]:
        """`--set` and `--prefix`, in the form of `--set`."""
        return (*self.settings, *options.prefix_settings(self.prefix))

    def change(self, experiment: "Experiment", *, repeats: bool = False) -> "Experiment":
        """Return the experiment of a run with the settings.

        repeats: whether recorded episodes are repeated, so that nothing may change their results.

        Raises InputError for settings that have no effect here.
        """
        from swarmwright.experiment.experiment import KEYS_OUTSIDE_RECORD

        self.refuse_seed()
        allowed, reason = frozenset(KEYS_OUTSIDE_RECORD - {"validate"}), _REPEATED
        if not repeats:
            allowed, reason = allowed | {"parameters", "fitness", "ranking", "simulation"}, _NOT_EVALUATED
        return experiment.with_settings(self.changes, only=allowed, reason=reason)

    def refuse_seed(self) -> None:
        """Raise InputError if a seed is set, for which there is `--seed`."""
        from swarmwright.experiment.settings import refuse_seed

        refuse_seed(self.settings)

    def broker_of(self, experiment: "Experiment") -> str | None:
        """Return the broker: the option's, the experiment's, or the environment's; None without one."""
        return options.experiment_broker(experiment, self.broker, self.servers)

    @contextmanager
    def episodes(
        self, experiment: "Experiment", count: int, seed: int | None
    ) -> "Iterator[EvaluationOptions]":
        """Yield options of a post-evaluation that shows its progress.

        Args:
            experiment: in which controllers are evaluated.
            count: number of episodes.
            seed: of the first episode; None for held-out seeds.
        """
        from swarmwright.cli._progress import episodes
        from swarmwright.runs.post_evaluation import EvaluationOptions

        with episodes(self.output) as on_progress:
            yield EvaluationOptions.of(count, seed, self.broker_of(experiment), self.servers, on_progress)

    def show(self, result: Any) -> None:  # noqa: ANN401 - a result with `to_mapping`
        """Print a result, below the settings on which it depends."""
        self.show_settings()
        self.output.block(str(result))
        self.output.json({"settings": list(self.settings), **result.to_mapping()})

    def show_settings(self) -> None:
        """Print the settings, on which a result depends."""
        if self.settings:
            self.output.text(f"Settings: {', '.join(self.settings)}")


def evaluation_options(
    broker: str = options.SERVERS_OF_EXPERIMENT,
    settings: str | None = "Override a value of the experiment: parameters.maxSteps=40.",
    *,
    servers: bool = True,
    server_output: bool = True,
) -> options.Decorator:
    """Add `--set`, `--broker`, `--prefix`, `--servers`, `--server-output`, `--trust` and `--json`.

    The command gets `evaluating`, an `Evaluating`.

    Args:
        broker: help of `--broker`.
        settings: help of `--set`; None without this option.
        servers: whether the command can start servers.
        server_output: whether it can show what servers print.
    """
    return options.gather(
        lambda **values: {"evaluating": Evaluating(**values)},
        *([] if settings is None else [options.set_option(settings)]),
        options.experiment_broker_options(broker),
        *([options.servers_option] if servers else []),
        *([options.server_output_option] if server_output else []),
        options.trust_option,
        options.json_option,
    )
