"""RabbitMQ of Debian with its MQTT plugin, unpacked into a folder: there is no service then."""

import re
from pathlib import Path

from tests.brokers.installing import run
from tests.conftest import free_port

CONFIGURATION = """\
listeners.tcp = none
mqtt.listeners.tcp.1 = 127.0.0.1:{port}
mqtt.allow_anonymous = true
mqtt.default_user = guest
mqtt.default_pass = guest
"""
# It needs epmd, Erlang's daemon of names; one of its own on a port of its own ends with it.
START = """\
#!/bin/sh
export HOME={folder} PATH={home}/root/usr/lib/erlang/bin:$PATH
export ERL_EPMD_PORT={epmd} ERL_EPMD_ADDRESS=127.0.0.1
export RABBITMQ_NODENAME=swarmwright@localhost RABBITMQ_DIST_PORT={distribution}
export RABBITMQ_CONFIG_FILE={folder}/rabbitmq.conf RABBITMQ_ENABLED_PLUGINS_FILE={folder}/plugins
export RABBITMQ_MNESIA_BASE={folder}/mnesia RABBITMQ_LOGS=- RABBITMQ_CONF_ENV_FILE={folder}/none
export RABBITMQ_SERVER_ADDITIONAL_ERL_ARGS='-kernel inet_dist_use_interface {{127,0,0,1}}'
export RUNNING_UNDER_SYSTEMD=true  # without it a shell stays between this process and Erlang's
epmd -address 127.0.0.1 -port {epmd} &
epmd=$!
{home}/root/usr/lib/rabbitmq/bin/rabbitmq-server &
server=$!
trap 'kill $server' TERM
wait $server
wait $server
kill $epmd
"""


def install(home: Path) -> None:
    """Debian's packages of it and of the parts of Erlang that it names."""
    if (home / "root" / "etc").exists():
        return
    depends = run("apt-cache", "depends", "--recurse", "--important", "rabbitmq-server")
    packages = {"rabbitmq-server", *re.findall(r"Depends: (erlang-[a-z0-9-]+)", depends)}
    run("apt-get", "download", "-qq", *sorted(packages), cwd=home)
    for file in sorted(home.glob("*.deb"), key=lambda file: file.name.startswith("rabbitmq")):
        run("dpkg-deb", "-x", str(file), str(home / "root"))
        if not file.name.startswith("rabbitmq"):
            file.unlink()
    for erl in (home / "root" / "usr" / "lib" / "erlang").glob("**/bin/erl"):
        erl.write_text(erl.read_text().replace("=/usr/lib/erlang", f"={home}/root/usr/lib/erlang"))


def release(home: Path) -> str:
    """As the name of its folder says."""
    folder = next((home / "root" / "usr" / "lib" / "rabbitmq" / "lib").iterdir())
    return folder.name.rpartition("-")[2]


def command(home: Path, folder: Path, port: int) -> list[str]:
    """A shell that starts it and, told to end, ends it and its daemon."""
    (folder / "rabbitmq.conf").write_text(CONFIGURATION.format(port=port))
    (folder / "plugins").write_text("[rabbitmq_mqtt].\n")
    (folder / "start").write_text(
        START.format(home=home, folder=folder, epmd=free_port(), distribution=free_port())
    )
    return ["sh", str(folder / "start")]
