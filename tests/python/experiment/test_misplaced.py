"""Keys in the wrong section are told with their place."""

from pathlib import Path

import pytest

from swarmwright import Experiment, InputError

BASE = "simulation: minisim\nmethod: {kind: nnga, population: 6}\n"


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("population=30", "did you mean 'populations'? Another section has method.population"),
        ("numAgents=3", "unknown key; it belongs to another section: parameters.numAgents"),
        ("episodes=3", "it belongs to another section: ranking.episodes or validate.episodes"),
        ("hidden=[4]", "it belongs to another section: controller.hidden"),
        ("method.seed=4", "unknown key; it belongs to another section: seed (at the top of the file)"),
        ("method.numAgents=4", "it belongs to another section: parameters.numAgents"),
        ("timeouts.attempts=4", "it belongs to another section: faults.attempts"),
        (
            "parameters.generations=4",
            "unknown parameter of minisim; it belongs to another section: method.generations",
        ),
        ("method.inertia=1", "unknown key; it is an option of other kinds: pso"),
        ("controller.weights=1", "unknown key; did you mean 'weight_range'?"),
        ("methd=nnga", "unknown key; did you mean 'method'?"),
        (
            "ranking.episode=3",
            "unknown key; did you mean 'episodes'? Another section has timeouts.episode",
        ),
        ("seeds=3", "did you mean 'seed'? Another section has ranking.seeds or validate.seeds"),
        ("parameters.maxStep=3", "unknown parameter of minisim; did you mean 'maxSteps'?"),
    ],
)
def test_where_a_key_belongs(setting: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text(BASE)
    with pytest.raises(InputError) as raised:
        Experiment.load(tmp_path / "one.yaml", [setting])
    assert str(raised.value).startswith(f"--set {setting}: unknown ")
    assert words in str(raised.value)


def test_keys_of_a_file_have_their_lines(tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text(f"{BASE}numAgents: 3\nranking: {{population: 4}}\n")
    with pytest.raises(InputError) as raised:
        Experiment.load(tmp_path / "one.yaml")
    words = "unknown key; it belongs to another section:"
    assert str(raised.value).splitlines() == [
        f"{tmp_path}/one.yaml:3: numAgents: {words} parameters.numAgents",
        f"{tmp_path}/one.yaml:4: ranking.population: {words} method.population",
    ]


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("numAgents=3", "unknown key; it belongs to another section: parameters.numAgents"),
        ("population=3", "unknown key; it belongs to another section: method.population"),
        ("seed=3", "seed: stays"),
        ("methd=3", "methd: stays"),
    ],
)
def test_where_a_key_belongs_that_cannot_be_set(setting: str, words: str) -> None:
    one = Experiment.from_mapping({"simulation": "minisim"})
    with pytest.raises(InputError) as raised:
        one.with_settings([setting], only=["parameters"], reason="stays")
    assert str(raised.value) == f"--set {setting}: {words}"
