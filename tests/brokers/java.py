"""The configurations of brokers in Java; two are started by programs beside this file."""

from pathlib import Path

HERE = Path(__file__).parent
HIVEMQ = """\
<hivemq>
  <listeners><tcp-listener><port>{port}</port><bind-address>127.0.0.1</bind-address></tcp-listener></listeners>
  <anonymous-usage-statistics><enabled>false</enabled></anonymous-usage-statistics>
</hivemq>
"""


def moquette(home: Path, folder: Path, port: int) -> list[str]:
    """Its own program."""
    (folder / "config").mkdir()
    (folder / "config" / "moquette.conf").write_text(
        f"port {port}\nhost 127.0.0.1\nallow_anonymous true\ndata_path {folder}/\ntelemetry_enabled false\n"
    )
    return ["java", f"-Dmoquette.path={folder}", "-cp", f"{home}/jars/*", "io.moquette.broker.Server"]


def hivemq(home: Path, folder: Path, port: int) -> list[str]:
    """HivemqBroker.java."""
    for name in ("conf", "data", "extensions"):
        (folder / name).mkdir()
    (folder / "conf" / "config.xml").write_text(HIVEMQ.format(port=port))
    return ["java", "-cp", f"{home}/jars/*", str(HERE / "HivemqBroker.java"), str(folder)]


def artemis(home: Path, folder: Path, port: int) -> list[str]:
    """ArtemisBroker.java."""
    return ["java", "-cp", f"{home}/jars/*", str(HERE / "ArtemisBroker.java"), str(folder), str(port)]
