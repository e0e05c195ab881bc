"""Files of one's own in ARGoS: the plug-in in the real simulator."""

from contextlib import ExitStack
from pathlib import Path

import pytest

from tests import attached_checks
from tests.attached import ARGOS, INSTALLED, Attached, build
from tests.conftest import ROOT, Run
from tests.cpp import run
from tests.system.brokers import BrokerProcess
from tests.system.conftest import Experiment, Launch
from tests.system.runs import evaluations

pytestmark = [ARGOS.needed, pytest.mark.timeout(600)]  # the first of them builds the plug-in


def test_every_mode_and_two_servers_give_the_same_record(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    attached_checks.modes_agree(ARGOS, embedded, launch, experiment, cleanup)


def test_the_loss_of_one_of_two_servers_changes_nothing(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    attached_checks.loss_changes_nothing(ARGOS, embedded, launch, experiment, cleanup)


def test_it_conforms(program: Run, tmp_path: Path) -> None:
    attached_checks.conforms(ARGOS, program, tmp_path)


def test_a_thousand_episodes_need_no_more_memory(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack
) -> None:
    attached_checks.memory_is_flat(ARGOS, embedded, launch, experiment, cleanup)


def test_without_a_broker_it_ends(tmp_path: Path, unused_port: int) -> None:
    attached_checks.without_a_broker_it_ends(ARGOS, tmp_path, unused_port)


MISTAKES = {
    "no sensors": (
        '<footbot_proximity implementation="default" show_rays="false"/>',
        "",
        "has no sensor that",
    ),
    "no wheels": ('<differential_steering implementation="default"/>', "", "has no wheels"),
    "no robots": ('<controller config="steered"/>', '<controller config="other"/>', "other"),
    "broken": ("</arena>", "", "bad.argos"),
    "no speed": ("<params/>", '<params max_speed="-4"/>', "max_speed: -4 found, expected a number above 0"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_reported(embedded: BrokerProcess, tmp_path: Path, mistake: str) -> None:
    before, after, expected = MISTAKES[mistake]
    text = ARGOS.file.read_text()
    assert before in text
    text = text.replace(before, after)
    if mistake == "no sensors":
        text = text.replace('<range_and_bearing implementation="medium" medium="rab"/>', "")
    said = attached_checks.a_bad_file(ARGOS, tmp_path, text, url=embedded.url)
    assert expected in said, said


def test_robots_with_different_sensors_are_reported(embedded: BrokerProcess, tmp_path: Path) -> None:
    text = ARGOS.file.read_text()
    begin, end = text.index("    <swarmwright_controller"), text.index("  </controllers>")
    other = text[begin:end].replace('id="steered"', 'id="blind"')
    other = other.replace('<footbot_proximity implementation="default" show_rays="false"/>', "")
    text = text[:end] + other + text[end:]
    text = text.replace(
        'orientation="270,0,0"/><controller config="steered"',
        'orientation="270,0,0"/><controller config="blind"',
    )
    said = attached_checks.a_bad_file(ARGOS, tmp_path, text, url=embedded.url)
    assert "robots have different sensors: a gets 29 numbers" in said, said


ARENA = '<arena size="4,4,1" center="0,0,0.5">'
FLOOR = '<floor id="floor" source="loop_functions" pixels_per_meter="10"/>'


def test_e_pucks_are_steered_where_their_plug_in_is(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack, tmp_path: Path
) -> None:
    if "SWARMWRIGHT_EPUCK" not in (build(ARGOS) / "CMakeFiles/swarmwright_argos.dir/flags.make").read_text():
        pytest.skip("ARGoS has no plug-in for the e-puck")
    text = ARGOS.file.read_text()
    for before, after in {
        '<differential_steering implementation="default"/>': '<epuck_wheels implementation="default"/>',
        '<footbot_proximity implementation="default" show_rays="false"/>': (
            '<epuck_proximity implementation="default" show_rays="false"/>'
            '<epuck_ground implementation="rot_z_only"/>'
        ),
        '<range_and_bearing implementation="default"/>': "",
        '<range_and_bearing implementation="medium" medium="rab"/>': "",
        "foot-bot": "e-puck",
    }.items():
        assert before in text
        text = text.replace(before, after)
    text = text.replace(
        '<range_and_bearing id="rab"/>',
        '<range_and_bearing id="rab"/><range_and_bearing id="ircom"/><led id="leds"/>',
    )
    text = text.replace(ARENA, f"{ARENA}{FLOOR}")
    path = tmp_path / "epucks.argos"
    path.write_text(text)
    cleanup.callback(Attached(ARGOS, embedded.url, 1, cwd=tmp_path, file=path).stop)
    program = launch(
        "optimize", experiment(attached_checks.EXPERIMENT), "--broker", embedded.url, "--out", "run"
    )
    assert program.wait() == 0, program.stderr


def test_loop_functions_of_ones_own_give_fitness_and_metrics(
    embedded: BrokerProcess, launch: Launch, experiment: Experiment, cleanup: ExitStack, tmp_path: Path
) -> None:
    """The example, compiled as the documentation shows."""
    folder = build(ARGOS)
    source = ROOT / "wrappers" / "argos" / "examples" / "gathering.cpp"
    library = tmp_path / "libgathering.so"
    includes = [ROOT / "wrappers" / "argos" / "include", INSTALLED / "include", f"{ARGOS.prefix}/include"]
    lua = run(["pkg-config", "--cflags-only-I", "lua5.3"]).split()
    options = [*(f"-I{path}" for path in includes), *lua, f"-L{folder}", "-lswarmwright_argos"]
    links = [f"-L{INSTALLED / 'lib'}", "-lswarmwright", f"-Wl,-rpath,{folder}:{INSTALLED / 'lib'}"]
    run(["g++", "-std=c++17", "-shared", "-fPIC", source, "-o", library, *options, *links])
    before = 'library="libswarmwright_argos" label="swarmwright"'
    text = ARGOS.file.read_text()
    assert before in text
    path = tmp_path / "gathering.argos"
    path.write_text(text.replace(before, f'library="{library}" label="gathering"'))
    cleanup.callback(Attached(ARGOS, embedded.url, 1, cwd=tmp_path, file=path).stop)
    own = attached_checks.EXPERIMENT.replace('fitness: "way - distance_to_center"\n', "")
    fitness = []
    for name, more in (("own", ""), ("metric", 'fitness: "-distance"\n')):
        program = launch("optimize", experiment(own + more), "--broker", embedded.url, "--out", name)
        assert program.wait() == 0, program.stderr
        fitness.append([value for value, _ in evaluations(tmp_path / name)])
    assert fitness[0] == fitness[1]
    assert len(set(fitness[0])) > 5
    program = launch(
        "optimize", experiment(own), "--broker", embedded.url, "--set", "parameters.x=7", "--out", "refused"
    )
    assert program.wait() != 0
    assert "parameter x: 7 found" in program.stderr or "x: 7" in program.stderr
