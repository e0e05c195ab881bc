"""Text of a peer decides neither what a command runs nor which files it opens, wherever it is put."""

import json
import sys
from typing import Any

import pytest

from swarmwright import Experiment, InputError
from swarmwright.common.errors import engine_errors
from swarmwright.simulations.command import placeholders
from swarmwright.simulations.command.placeholders import Position, Template, Values
from swarmwright.simulations.command.simulation import CommandSimulation
from swarmwright.simulations.host import Host
from tests.python.simulations.command.processes import Traced

HOSTILE = [
    "1; touch TOUCHED",
    "$(touch TOUCHED)",
    "`touch TOUCHED`",
    "x' ; touch TOUCHED ; '",
    'x" ; touch TOUCHED ; "',
    "x\ntouch TOUCHED\n",
    "| touch TOUCHED",
    "--output=TOUCHED",
    "-oProxyCommand=touch TOUCHED",
    "-c",
    "@TOUCHED",
    "../../TOUCHED",
    "maps/../../TOUCHED",
    "/etc/passwd",
    "~/.ssh/id_rsa",
    "gui:=$(eval 1)",
    "{folder}",
    "</uri><plugin filename='TOUCHED.so'/>",
    "zero\0byte",
]
ODD_VALUES = [["$(touch TOUCHED)"], {"$(touch TOUCHED)": 1}, [[1, "a"]]]
NUMBERS = [1, -0.5, 1e-9, True, None, [1, 2.5], 2**70]

CODE = [
    ["sh", "-c", "sim --gain {text}"],
    ["/bin/bash", "-lc", "{text}"],
    ["dash", "-e", "-c", "true", "sh", "{text}"],
    ["zsh", "-ic", "{text}"],
    ["ksh", "-c", "{text}"],
    ["fish", "--command={text}"],
    ["busybox", "sh", "-c", "{text}"],
    ["env", "A=1", "sh", "-c", "{text}"],
    ["env", "-S", "sh {text}"],
    ["timeout", "5", "bash", "-c", "{text}"],
    ["nice", "-n", "5", "xvfb-run", "-a", "sh", "-c", "{text}"],
    ["docker", "run", "image", "sh", "-c", "{text}"],
    ["python3", "-c", "print({text})"],
    [sys.executable, "-Ic", "{text}"],
    ["python3.12", "-u", "-c", "import sys", "{text}"],
    ["perl", "-ne", "{text}"],
    ["ruby", "-e", "{text}"],
    ["node", "--eval", "{text}"],
    ["node", "-p", "{text}"],
    ["lua5.4", "-e", "{text}"],
    ["php", "-r", "{text}"],
    ["Rscript", "-e", "{text}"],
    ["julia", "-E", "{text}"],
    ["awk", "{text}"],
    ["sed", "s/a/{text}/"],
    ["find", ".", "-name", "{text}"],
    ["xargs", "{text}"],
    ["ssh", "host", "{text}"],
    ["timeout", "5", "awk", "{text}"],
    ["make", "{text}"],
]
PROGRAMS = [
    ["{text}"],
    ["{text}/sim"],
    ["env", "{text}"],
    ["timeout", "5", "{text}"],
    ["xvfb-run", "-a", "{text}", "x"],
    ["sudo", "-u", "joe", "{text}"],
    ["python3", "{text}"],
    ["python3", "-W", "ignore", "{text}"],
    ["sh", "{text}"],
    ["java", "{text}"],
]
PARTS = [
    ["./sim", "--gain={text}"],
    ["./sim", "{text}.png"],
    ["./sim", "{text}{text}"],
    ["./sim", "maps/{text}"],
]
ARGUMENTS = [
    ["./sim", "{text}"],
    ["python3", "sim.py", "{text}"],
    ["python3", "-u", "-m", "sim", "{text}"],
    ["python3", "sim.py", "-c", "{text}"],
    ["sh", "run.sh", "{text}"],
    ["java", "-jar", "sim.jar", "{text}"],
    ["argos3", "-c", "{text}"],
]


def last(words: list[str]) -> Template:
    """The word with the placeholder."""
    return next(word for word in placeholders.command(tuple(words)) if word.names)


@pytest.mark.parametrize("value", [*HOSTILE, *ODD_VALUES, "harmless"], ids=repr)
def test_text_is_refused_where_it_could_decide_something(value: Any) -> None:
    undeclared = Values(parameters={"text": value})
    declared = Values(parameters={"text": value}, declared={"text": "default"})
    for words in [*CODE, *PROGRAMS, *PARTS]:
        for values in (undeclared, declared):
            with pytest.raises(InputError, match=r"^text: "):
                last(words).fill(values)
    for template in (
        placeholders.file("world.sdf", "<a>{text}</a>"),
        placeholders.variable("LD_PRELOAD", "{text}"),
    ):
        with pytest.raises(InputError, match=r"^text: "):
            template.fill(declared)
    for words in ARGUMENTS:
        with pytest.raises(InputError, match=r"^text: "):
            last(words).fill(undeclared)


@pytest.mark.parametrize("value", [one for one in HOSTILE if one[0] in "-@/~." or ".." in one or ":=" in one])
def test_a_declared_argument_is_no_option_and_no_path_elsewhere(value: str) -> None:
    values = Values(parameters={"text": value}, declared={"text": "default"})
    for words in ARGUMENTS:
        with pytest.raises(
            InputError, match=r"could be taken for an option, or for a path elsewhere; declare"
        ):
            last(words).fill(values)


@pytest.mark.parametrize(
    ("commands", "position"), [(CODE, Position.CODE), (PROGRAMS, Position.PROGRAM), (PARTS, Position.PART)]
)
def test_numbers_and_declared_choices(commands: list[list[str]], position: Position) -> None:
    choices = {"text": ["--fast", "a b"]}
    for words in commands:
        template = last(words)
        assert template.position is position, words
        for number in NUMBERS:
            assert template.fill(Values(parameters={"text": number}))
        chosen = Values(parameters={"text": "--fast"}, choices=choices)
        if position is Position.CODE:
            with pytest.raises(InputError, match=r"may only be a number, since .* runs its arguments as"):
                template.fill(chosen)
        else:
            assert "--fast" in template.fill(chosen)


def test_arguments_take_declared_text_as_it_is() -> None:
    for words in ARGUMENTS:
        template = last(words)
        assert template.position is Position.ARGUMENT, words
        for text in ("two words; $(touch x)", "maps/a.png", "'"):
            assert template.fill(Values(parameters={"text": text}, declared={"text": ""})) == text


def test_own_values_go_before_those_of_a_peer() -> None:
    values = Values({"here": "/ours", "port": 5}, {"here": "/theirs", "port": "1; x"})
    assert [word.fill(values) for word in placeholders.command(("{here}/sim", "{port}"))] == [
        "/ours/sim",
        "5",
    ]


def test_a_file_has_only_known_placeholders() -> None:
    text = placeholders.file("a", "{speed} {other} {{speed}} ${speed} {x,y}")
    assert text.fill(Values(parameters={"speed": 2})) == "2 {other} {{speed}} ${speed} {x,y}"


RECORD = (
    "import json, os, sys\n"
    "seen = [sys.argv[1:], os.environ.get('TEXT'), open('parameters.json').read()]\n"
    "json.dump(seen, open(sys.argv[1], 'w'))\n"
    "open('log.csv', 'w').write('fitness\\n1\\n')\n"
)


def host(definition: dict[str, Any]) -> Host:
    class Command(CommandSimulation):
        title = "command"

    Command.definition = definition
    return Host(Command)


@pytest.mark.slow
@pytest.mark.parametrize("value", [one for one in HOSTILE if "\0" not in one])
def test_a_server_passes_hostile_text_as_data_alone(traced: Traced, value: str) -> None:
    """Over the path that a message of a peer takes, with a real process."""
    folder = traced.folder
    (folder / "record.py").write_text(RECORD)
    (folder / "own.json").write_text('{"text": "map", "gain": 1}')
    server = host(
        {
            "command": [sys.executable, "record.py", "{here}/seen", "{gain}"],
            "parameters": "own.json",
            "parameters_format": "json",
            "environment": {"TEXT": "{text}"},
            "files": {},
            "folder": str(folder),
            "work": str(folder / "work"),
            "log": "log.csv",
        }
    )
    server.reset({"text": value, "gain": 2, "seed": 1, "unknown": value, "here": "/etc"})
    arguments, variable, parameters = json.loads((folder / "seen").read_text())
    assert arguments == [str(folder / "seen"), "2"]
    assert variable == value
    assert json.loads(parameters) == {"text": value, "gain": 2, "seed": 1}  # nothing undeclared
    with pytest.raises(InputError, match=r"^gain: .* found, expected an integer"), engine_errors():
        server.reset({"gain": value})
    assert not list(folder.rglob("TOUCHED*"))
    assert traced.left() == []


@pytest.mark.slow
def test_a_server_refuses_text_that_is_none_of_the_choices(traced: Traced) -> None:
    server = host(
        {
            "command": [sys.executable, "-c", "open('log.csv', 'w').write('fitness\\n1\\n')"],
            "choices": {"mode": ["fast", 2, False]},
            "folder": str(traced.folder),
            "work": str(traced.folder / "work"),
            "log": "log.csv",
        }
    )
    for value in ("fast", 2, 2.0, False):
        server.reset({"mode": value})
    for wrong in ("slow", "fast; touch x", 0, True, None, ["fast"]):
        with pytest.raises(InputError, match=r"^mode: .* expected one of 'fast', 2, False"), engine_errors():
            server.reset({"mode": wrong})


@pytest.mark.parametrize(
    ("definition", "parameters", "said"),
    [
        (
            {"command": ["sh", "-c", "sim {mode}"]},
            {"mode": "a"},
            r"^parameters\.mode: 'a' found, but command: \{mode\} may only be a number, since sh -c runs ",
        ),
        (
            {"command": ["./sim", "--mode={mode}"]},
            {"mode": "a"},
            r"^parameters\.mode: .* is part of a word, .* declare simulation\.choices: \{mode: \[\.\.\]\}",
        ),
        (
            {"command": ["./sim", "{mode}"]},
            {"mode": "a"},
            r"is not declared as text; declare simulation\.choices",
        ),
        (
            {"command": "./sim", "files": ["world.sdf"]},
            {"mode": "a"},
            r"files: world\.sdf: \{mode\} may only be",
        ),
        (
            {"command": ["./sim", "{mode}"], "choices": {"mode": ["b", "c"]}},
            {"mode": "a"},
            r"^parameters\.mode: must be one of 'b', 'c' \(simulation\.choices\.mode\), not 'a'",
        ),
        ({"command": ["./sim", "--mode={mode}"], "choices": {"mode": ["a", "b"]}}, {"mode": "a"}, None),
        ({"command": ["./sim", "--mode={mode}"]}, {"mode": 1.5}, None),
        ({"command": "./sim", "environment": {"MODE": "{mode}"}}, {"mode": "a"}, None),
        (
            {"command": "./sim", "environment": {"PATH": "{mode}"}},
            {"mode": "a"},
            r"decides what programs load",
        ),
    ],
)
def test_an_experiment_is_refused_before_it_runs(
    traced: Traced, definition: dict[str, Any], parameters: dict[str, Any], said: str | None
) -> None:
    (traced.folder / "world.sdf").write_text("<world {mode}/>")
    mapping = traced.experiment("./sim").to_mapping()
    mapping["simulation"] |= definition
    if said is None:
        assert Experiment.from_mapping({**mapping, "parameters": parameters}).parameters == parameters
    else:
        with pytest.raises(InputError, match=said):
            Experiment.from_mapping({**mapping, "parameters": parameters})


def test_evolved_text_needs_declared_choices(traced: Traced) -> None:
    evolved = {
        "mode": {"type": "categorical", "choices": ["a", "b"]},
        "speed": {"type": "real", "range": [0, 1]},
    }

    def made(**definition: Any) -> Experiment:
        mapping = traced.experiment("./sim").to_mapping()
        mapping["simulation"] |= {"command": ["./sim", "{speed}", "{mode}"], **definition}
        return Experiment.from_mapping(
            {**mapping, "controller": {"kind": "parameter_set", "parameters": evolved}}
        )

    position = r"^controller\.parameters\.mode\.choices: "
    with pytest.raises(
        InputError, match=rf"{position}'a' found, but .* is not declared as text; declare sim"
    ):
        made()
    with pytest.raises(InputError, match=rf"{position}must be one of 'a', 'c'"):
        made(choices={"mode": ["a", "c"]})
    assert made(choices={"mode": ["a", "b", "c"]}).simulation
