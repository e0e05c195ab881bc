"""Classes that AsyncAPI's modelina makes of the document: they read D6.1's examples, and drive a server."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

from swarmwright import _engine
from tests.examples import contract
from tests.protocol.conftest import PROTOCOL, TOPICS, vectors

EXAMPLES = PROTOCOL / "vectors" / "messages"
pytestmark = pytest.mark.timeout(400)  # npm may have to fetch the tools


def node(*arguments: str | Path) -> str:
    command = ["node", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def classes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the generated modules."""
    folder = tmp_path_factory.mktemp("generated")
    for language, name in (("javascript", "messages.mjs"), ("python", "generated_messages.py")):
        node(contract() / "generate.mjs", language, folder / name)
    return folder


READ_AND_WRITE = """\
import { readFileSync } from "node:fs";
const classes = await import(process.argv[1]);
for (const topic of process.argv.slice(3)) {
  const text = readFileSync(`${process.argv[2]}/${topic}.d61.json`, "utf8");
  console.log(classes[topic[0].toUpperCase() + topic.slice(1)].unmarshal(text).marshal());
}
"""


@pytest.mark.slow
def test_the_examples_of_d61_survive_in_typescript(classes: Path) -> None:
    arguments = ("--input-type=module", "-e", READ_AND_WRITE, "--")
    written = node(*arguments, classes / "messages.mjs", EXAMPLES, *TOPICS)
    for topic, line in zip(TOPICS, written.splitlines(), strict=True):
        example = json.loads((EXAMPLES / f"{topic}.d61.json").read_text(encoding="utf-8"))
        found = json.loads(line)
        # Where run and visual are left out the schema has their values.
        assert {key: found[key] for key in example} == example
        assert found.keys() - example.keys() <= {"visual"}


def test_the_examples_of_d61_survive_in_python(classes: Path) -> None:
    specification = importlib.util.spec_from_file_location(
        "generated_messages", classes / "generated_messages.py"
    )
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    try:
        specification.loader.exec_module(module)
        for topic in TOPICS:
            text = (EXAMPLES / f"{topic}.d61.json").read_text(encoding="utf-8")
            model = getattr(module, topic.capitalize()).model_validate_json(text)
            found, example = model.model_dump(by_alias=True, exclude_none=True), json.loads(text)
            assert {key: found[key] for key in example} == example
    finally:
        del sys.modules[specification.name]


@pytest.mark.slow
def test_a_generated_client_plays_d61s_episode_on_a_server(classes: Path) -> None:
    """The agent runs straight ahead, as in the conversation; every number that comes is the one there."""
    messages = vectors("conversations/published.json")["messages"]
    said = {topic: [one for one in messages if one["topic"] == topic] for topic in ("sensor", "fitness")}
    parameters = json.loads((EXAMPLES / "parameters.d61.json").read_text(encoding="utf-8"))
    flat = {key: value for key, value in parameters.items() if key not in {"server", "simulation_hash"}}
    broker = _engine.Broker()
    command = [sys.executable, "-m", "swarmwright", "serve", "minisim", "--broker", broker.url, "--id", "4"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert server.stdout is not None
        assert any("ready" in line for line in iter(server.stdout.readline, ""))
        client = PROTOCOL / "client" / "episode.mjs"
        played = json.loads(node(client, classes / "messages.mjs", broker.url, json.dumps(flat), "0"))
    finally:
        server.terminate()
        server.communicate(timeout=10)
        broker.stop()
    assert played["server"] == 4
    assert "offloaded" in played["modes"]
    assert played["sensors"] == [one["payload"]["sensor"] for one in said["sensor"]]
    assert played["fitness"] == said["fitness"][0]["payload"]["fitness"]
