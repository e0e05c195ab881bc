"""`swarmwright broker`: the embedded MQTT broker on its own."""

import ipaddress
import socket
import threading
from pathlib import Path

import click

from swarmwright.cli._commands import Command
from swarmwright.cli._options import ExistingPath, WholeNumber, json_option
from swarmwright.cli._output import Output
from swarmwright.cli._signals import Terminated

Port = WholeNumber(0, 65535)


@click.command(
    "broker",
    cls=Command,
    example="swarmwright broker --port 1883\nswarmwright broker --host 0.0.0.0 --users users.txt",
)
@click.option("--port", type=Port, default=1883, show_default=True, help="TCP port; 0 takes any free one.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--websocket-port", type=Port, metavar="PORT", help="Also listen for MQTT over websockets.")
@click.option(
    "--users", type=ExistingPath(), metavar="FILE", help="Password file; only its users are let in."
)
@click.option(
    "--certificate", type=ExistingPath(), metavar="FILE", help="Listen with TLS; certificate chain, PEM."
)
@click.option("--key", type=ExistingPath(), metavar="FILE", help="The certificate's private key, PEM.")
@json_option
def command(
    port: int,
    host: str,
    websocket_port: int | None,
    users: Path | None,
    certificate: Path | None,
    key: Path | None,
    as_json: bool,
) -> int:
    """Run the MQTT broker until Ctrl-C.

    Everybody who can reach the broker may use it, unless there is a password file. Therefore it listens to
    this machine only, and to other machines with a password file.
    """
    if (certificate is None) != (key is None):
        missing = "--key" if key is None else "--certificate"
        raise click.UsageError(f"TLS needs both --certificate and --key; {missing} is missing.")
    if users is None and not _loopback(host):
        raise click.UsageError(
            f"'{host}' can be reached from other machines, and without a password everybody there could use "
            "the broker. Give --users FILE, or listen on 127.0.0.1."
        )
    from swarmwright import _engine

    output = Output(as_json=as_json)
    broker = _engine.Broker(
        host,
        port,
        websocket_port=websocket_port,
        users=str(users) if users else None,
        certificate=str(certificate) if certificate else None,
        key=str(key) if key else None,
    )
    try:
        output.text(f"The broker listens on {broker.url} (Ctrl-C stops it)")
        output.json({"event": "listening", "url": broker.url, "port": broker.port})
        threading.Event().wait()
    except Terminated:
        return 0  # SIGTERM is how a service is asked to end
    finally:
        broker.stop()
    return 0


def _loopback(host: str) -> bool:
    """Whether every address of the host belongs to this machine alone."""
    try:
        found = socket.getaddrinfo(host or None, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        raise click.UsageError(f"'{host}' is no address of this machine ({error}); try 127.0.0.1.") from None
    return all(ipaddress.ip_address(str(address[4][0]).split("%")[0]).is_loopback for address in found)
