"""Options that name a broker and the prefix of its topics, and which of several names counts."""

import json
import os

import click

from swarmwright.cli._options import Decorator
from swarmwright.cli._parameter_types import (
    BrokerUrl,
    Prefix,
    RealNumber,
)
from swarmwright.experiment.broker_address import PREFIX_VARIABLE, environment_prefix

DEFAULT_BROKER = "mqtt://localhost:1883"
BROKER_VARIABLE = "SWARMWRIGHT_BROKER"


def broker_option(*, default: str | None, text: str) -> Decorator:
    """`--broker URL`. The environment's SWARMWRIGHT_BROKER comes before a default.

    Commands without a default read it themselves, after the experiment file: see `experiment_broker`.
    """
    return click.option(
        "--broker",
        type=BrokerUrl(),
        metavar="URL",
        default=default,
        envvar=BROKER_VARIABLE if default else None,
        show_envvar=bool(default),
        show_default=bool(default),
        help=text,
    )


peer_prefix_option: Decorator = click.option(
    "--prefix",
    type=Prefix(),
    metavar="P",
    help=f"Prefix of all topics, such as lab/1. Default: {PREFIX_VARIABLE}'s on a broker that is named, or "
    "none.",
)
prefix_option: Decorator = click.option(
    "--prefix",
    type=Prefix(),
    default="",
    metavar="P",
    envvar=PREFIX_VARIABLE,
    show_envvar=True,
    help="Prefix of all topics, such as lab/1. Default: none.",
)


def _without_environment(
    _context: click.Context, _parameter: click.Parameter, prefix: str | None
) -> str | None:
    """Let an empty prefix, which an experiment cannot distinguish from none, win over the environment's."""
    if prefix == "":
        os.environ.pop(PREFIX_VARIABLE, None)
    return prefix


def experiment_prefix_option(whose: str) -> Decorator:
    """`--prefix P` of commands that have an experiment, which names a prefix itself.

    whose: experiment, `FILE's`. The environment's prefix is used where neither names one, see
    `swarmwright.experiment.derived.with_environment`.
    """
    return click.option(
        "--prefix",
        type=Prefix(),
        metavar="P",
        callback=_without_environment,
        help=f"Prefix of all topics on the broker. Default: {whose}, {PREFIX_VARIABLE}'s, or none.",
    )


def prefix_settings(prefix: str | None) -> tuple[str, ...]:
    """The setting of an experiment that `--prefix` stands for, as `--set` takes it."""
    return () if prefix is None else (f"prefix={json.dumps(prefix)}",)


wait_option: Decorator = click.option(
    "--wait",
    type=RealNumber(0, 31 * 86400.0),
    metavar="SECONDS",
    help="How long to wait for a broker that does not answer yet. Default: timeouts.connect of the "
    "experiment, or 0.",
)


def experiment_broker(broker: str | None, of_experiment: str | None, servers: object) -> str | None:
    """The broker of an experiment: the option, then the experiment file, then the environment.

    None when none is named or the experiment is evaluated in this process: then nothing is connected to.
    """
    if broker is not None or of_experiment is not None or servers in ("local", "in-process"):
        return broker
    return _environment_broker()


def peer_broker(broker: str | None, command: str | None) -> str | None:
    """The broker on which a peer is tried: the option; for one without `command`, the environment.

    None when none is named: then the kit starts one.
    """
    chosen = _environment_broker() if broker is None and command is None else broker
    if chosen is not None and "," in chosen:
        raise click.BadParameter("names several brokers; a peer is tried on one.", param_hint="'--broker'")
    return chosen


def peer_prefix(prefix: str | None, broker: str | None) -> str:
    """The prefix under which a peer is tried: the option; on a broker that is named, the environment's.

    A peer that the kit starts inherits it.
    """
    if prefix is None:
        prefix = "" if broker is None else environment_prefix()
    os.environ[PREFIX_VARIABLE] = prefix
    return prefix


def _environment_broker() -> str | None:
    named = os.environ.get(BROKER_VARIABLE)
    try:
        return BrokerUrl().convert(named, None, None) if named else None
    except click.BadParameter as error:
        error.param_hint = f"'{BROKER_VARIABLE}' (environment)"
        raise
