"""A page of a swarm of robots: zoom, an agent that is followed, its controller, several episodes."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium.webdriver import ActionChains, Chrome, Keys
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import Select

from swarmwright.common.groups import Kind
from swarmwright.controllers.machines import machines_of
from swarmwright.controllers.modules.grammar import State, Transition, weights_of
from swarmwright.display import (
    Bodies,
    Body,
    Caption,
    Light,
    Part,
    Patch,
    Ray,
    Recording,
    Scale,
    Scene,
    Shown,
    Style,
    Trace,
    Wall,
)  # fmt: skip
from swarmwright.display._look import STATES
from swarmwright.display.files import save
from tests.python.display.browser import chromium
from tests.python.display.test_page import eventually, log, pixels, press, text
from tests.python.export.specifications import modules

STEPS = 40
MACHINE = (
    State("exploration", {"rwm": 3}, (Transition(1, "black_floor", {"probability": 0.5}),)),
    State("stop", {}, (Transition(0, "fixed_probability", {"probability": 0.1}),)),
)
MODULES: dict[str, Any] = {
    "kind": "modules", "sensors": 9, "actuators": 2, "states": 4, "transitions": 4,
    "weights": weights_of(MACHINE, 4, 4),
}  # fmt: skip
TREE: dict[str, Any] = {
    **MODULES, "form": "tree", "transitions": 1, "weights": weights_of(MACHINE, 4, 1),
}  # fmt: skip
NETWORK: dict[str, Any] = {
    "kind": "layered", "sensors": 9, "actuators": 2, "hidden": [], "activation": "tanh",
    "output_range": [-1, 1], "weights": [0.5] * 20,
}  # fmt: skip


def _group(name: str, agents: int | None, controller: dict[str, Any]) -> dict[str, Any]:
    without = {key: value for key, value in controller.items() if key != "weights"}
    return {
        "name": name,
        "controller": {"version": 1, **without},
        **({} if agents is None else {"agents": agents}),
    }


TEAM: dict[str, Any] = {
    "kind": "team",
    "groups": [
        _group("scouts", 2, MODULES),
        _group("guards", 3, NETWORK),
        _group("carriers", None, TREE),
    ],
    "weights": MODULES["weights"] + NETWORK["weights"] + TREE["weights"],
}
"""Of machines, networks and trees."""


def swarm(robots: int = 6, *, steps: int = STEPS, values: bool = False) -> Recording:
    """Robots that drive to the right on rows of their own; each is in state 1 in every other ten steps."""
    y = np.linspace(0.2, 1.8, robots)
    scenes = []
    for step in range(steps + 1):
        bodies = Bodies(
            np.full(robots, 0.2 + 1.4 * step / steps), y, radius=0.05, heading=np.zeros(robots),
            value=np.linspace(0, 1, robots) if values else None, labels=[f"R{i}" for i in range(robots)],
        )  # fmt: skip
        if robots <= 100:
            bodies.ray_body = np.arange(robots, dtype=np.uint32)
            bodies.ray_numbers = np.tile(np.array([0, 0.05, 0.2, 1], np.float32), (robots, 1))
        scenes.append(
            Scene(
                2, 2, step, "Rows", bodies, floor=0.5, patches=[Patch.circle(1.5, 1, 0.2, 0, "goal")],
                walls=[Wall([(0, 0), (2, 0), (2, 2), (0, 2), (0, 0)])], lights=[Light(1, 1.9)],
                links=[(0, 1)], scale=Scale("load, kg", 0, 1) if values else None,
            )
        )  # fmt: skip
    sensors = np.zeros((steps, min(robots, 100), 9), np.float32)
    sensors[:, :, 4] = np.linspace(0, 1, steps)[:, None]
    states = np.repeat(np.arange(steps + 1)[:, None] // 10 % 2, robots, axis=1).astype(np.int16)
    trace = Trace(
        sensors, np.ones((*sensors.shape[:2], 2), np.float32), states, {"on_goal": np.arange(steps + 1.0)}
    )
    return Recording(tuple(scenes), tuple(float(step) for step in range(steps + 1)), 0.1, trace)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with chromium(tmp_path_factory.mktemp("browser")) as running:
        yield running


def open_page(browser: Chrome, folder: Path, *parts: Part, **how: Any) -> None:
    save(list(parts), folder / "swarm.html", caption=Caption("rows"), **how)
    log(browser, "browser")
    browser.get((folder / "swarm.html").as_uri())


@pytest.fixture
def opened(browser: Chrome, tmp_path: Path) -> Chrome:
    open_page(browser, tmp_path, Part(swarm(), "", machines_of(MODULES), ["proximity x"]))
    return browser


def errors(browser: Chrome) -> list[dict[str, Any]]:
    """Of the script, since it was opened."""
    return [entry for entry in log(browser, "browser") if entry["level"] == "SEVERE"]


def camera(browser: Chrome) -> dict[str, float]:
    found: dict[str, float] = browser.execute_script(
        "const { zoom, x, y } = player.world.camera; return { zoom, x, y };"
    )
    return found


def place_of(browser: Chrome, agent: int) -> tuple[int, int]:
    """Where an agent is, in pixels from the middle of the map."""
    found: list[float] = browser.execute_script(
        "const c = player.world.canvas; return [player.world.px[arguments[0]] - c.clientWidth / 2, "
        "player.world.py[arguments[0]] - c.clientHeight / 2];",
        agent,
    )
    return round(found[0]), round(found[1])


@pytest.mark.journey
def test_wheel_keys_and_buttons_zoom_and_drags_move(opened: Chrome) -> None:
    world = opened.find_element(By.ID, "world")
    assert camera(opened) == {"zoom": 1, "x": 1, "y": 1}
    before = place_of(opened, 0)
    ActionChains(opened).scroll_from_origin(
        ScrollOrigin.from_element(world, *before),
        0, -400,
    ).perform()  # fmt: skip
    eventually(lambda: camera(opened)["zoom"] > 1.5, "the wheel zooms")
    near = place_of(opened, 0)
    assert abs(near[0] - before[0]) <= 2, "what is below the pointer stays there"
    assert opened.execute_script("return window.scrollY") == 0, "the page does not scroll"
    x = camera(opened)["x"]
    ActionChains(opened).drag_and_drop_by_offset(world, -120, 0).perform()
    assert camera(opened)["x"] > x
    nearer, farther, whole = opened.find_elements(By.CSS_SELECTOR, ".zoom button")
    zoom = camera(opened)["zoom"]
    nearer.click()
    assert camera(opened)["zoom"] == pytest.approx(zoom * 1.5)
    farther.click()
    farther.click()
    assert camera(opened)["zoom"] == pytest.approx(max(zoom / 1.5, 1))
    whole.click()
    assert camera(opened) == {"zoom": 1, "x": 1, "y": 1}
    press(opened, "i", "i", "d")
    moved = camera(opened)
    assert moved["zoom"] == pytest.approx(1.25**2)
    assert moved["x"] > 1
    press(opened, "0")
    assert camera(opened) == {"zoom": 1, "x": 1, "y": 1}
    assert errors(opened) == []


def test_a_click_follows_an_agent_with_its_sensors(opened: Chrome) -> None:
    world = opened.find_element(By.ID, "world")
    assert not opened.find_element(By.ID, "agent").is_displayed()
    rays = pixels(opened, "world", "accent")[0]
    ActionChains(opened).move_to_element_with_offset(world, *place_of(opened, 2)).click().perform()
    assert text(opened, "who") == "Agent 2"
    assert opened.find_element(By.ID, "timeline").is_displayed()
    assert pixels(opened, "world", "accent")[0] > rays, "a ring, and its messages"
    press(opened, "i", "i", "i", "i", "i", "i", Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    for _ in range(2):
        press(opened, *[Keys.ARROW_RIGHT] * 10)
    assert abs(place_of(opened, 2)[0]) < 30, "the map moves with it"
    rows = opened.execute_script("return player.inspector.rows.map(({ name }) => name)")
    assert rows[:2] == ["proximity x", "sensor 1"]
    assert rows[-2:] == ["actuator 0", "actuator 1"]
    shown = opened.execute_script(
        "const { rows, episode } = player.inspector; return rows[4].values[episode.moment(player.time)[0]];"
    )
    assert shown == pytest.approx(22 / (STEPS - 1), abs=1e-3)
    press(opened, "n")
    assert text(opened, "who") == "Agent 3"
    press(opened, "p", "p")
    assert text(opened, "who") == "Agent 1"
    press(opened, Keys.ESCAPE)
    assert not opened.find_element(By.ID, "agent").is_displayed()
    assert errors(opened) == []


def test_an_agent_that_is_not_there_is_told(opened: Chrome) -> None:
    base = opened.current_url.partition("#")[0]
    opened.get(f"{base}#agent=999")
    eventually(lambda: text(opened, "who") == "Agent 999", "the agent of the address")
    assert text(opened, "missing") == "No such agent. Agents are 0 to 5."
    opened.get(f"{base}#agent=4")
    eventually(lambda: text(opened, "who") == "Agent 4", "the agent of the address")
    assert not opened.find_element(By.ID, "missing").is_displayed()
    assert errors(opened) == []


def test_an_agent_has_rows_of_what_its_kind_has(browser: Chrome, tmp_path: Path) -> None:
    long = f"{'scouts and ' * 12}light 7"
    left, right = (None,) * 5, ("left wheel", "right wheel")
    kinds = [
        Kind("scouts", 2, (*left, long, "ground 0", "ground 1", None), right),
        Kind("guards", 4, (*("proximity",) * 5, *(None,) * 4), (None, "lamp")),
    ]
    open_page(browser, tmp_path, Part(swarm(), "", machines_of(MODULES), kinds=kinds))
    rows = "return player.inspector.rows.map(({ name, actuator }) => [name, actuator]);"
    press(browser, "n")
    assert text(browser, "who") == "Agent 0, scouts"
    assert browser.execute_script(rows) == [
        [long, False], ["ground 0", False], ["ground 1", False], ["left wheel", True], ["right wheel", True],
    ]  # fmt: skip
    hint = "player.inspector.hint(arguments[0]); return player.part.timeline.title;"
    state = "return player.inspector.hasStates() ? 26 : 0;"
    above = browser.execute_script(state)
    assert [browser.execute_script(hint, above + y) for y in (5, 25)] == [f"{long}: 0", "ground 0: 0"]
    press(browser, "n", "n")
    found = browser.execute_script(rows)
    assert found == [["proximity", False]] * 5 + [["lamp", True]]
    # Values are those of the rows, not of their places on the page.
    assert browser.execute_script("return player.inspector.rows[4].values[39] > 0.9;")
    assert errors(browser) == []


def test_numbers_beside_the_map_are_whole_and_buttons_beside_it(browser: Chrome, tmp_path: Path) -> None:
    recording = swarm()
    around = tuple(replace(scene, origin=(-1, -1)) for scene in recording.scenes)
    open_page(browser, tmp_path, Part(replace(recording, scenes=around)))
    room = (
        "const w = player.world; const c = w.canvas.getContext('2d'); c.font = FONT;"
        "return [...new Ground(w).inside(1, 2, w.spacing())].every("
        "(y) => c.measureText(words(y)).width + 6 <= w.box.left);"
    )
    assert browser.execute_script(room)
    below = (
        "const box = (one) => document.querySelector(one).getBoundingClientRect();"
        "return box('.zoom').bottom <= box('#world').top;"
    )
    assert browser.execute_script(below)


def test_the_active_state_lights_up(opened: Chrome) -> None:
    def active() -> list[int]:
        states = opened.find_elements(By.CSS_SELECTOR, "#diagram .state")
        return [i for i, one in enumerate(states) if "active" in (one.get_attribute("class") or "")]

    def number(state: int) -> str:
        return opened.find_elements(By.CSS_SELECTOR, "#diagram .number")[state].text

    assert active() == [0]
    assert (number(0), number(1)) == ("6", "0"), "all agents are in state 0"
    assert text(opened, "which") == "agents in each state"
    rows = [row.text for row in opened.find_elements(By.CSS_SELECTOR, "#states > li")]
    assert rows[0].startswith("0 exploration (rwm 3)\nto 1: black floor (probability 0.5)")
    base = opened.current_url.partition("#")[0]
    opened.get(f"{base}#step=10&agent=4")
    eventually(lambda: text(opened, "which") == "of agent 4", "the agent of the address")
    assert active() == [1]
    assert "active" in (opened.find_elements(By.CSS_SELECTOR, "#states > li")[1].get_attribute("class") or "")
    assert len(opened.find_elements(By.CSS_SELECTOR, "#diagram .arrow.taken")) == 1
    press(opened, Keys.ARROW_RIGHT)
    assert active() == [1]
    assert opened.find_elements(By.CSS_SELECTOR, "#diagram .arrow.taken") == []


def test_a_tree_is_drawn_as_one(browser: Chrome, tmp_path: Path) -> None:
    open_page(browser, tmp_path, Part(swarm(), "", machines_of(TREE)))
    leaves = [leaf.text.split("\n") for leaf in browser.find_elements(By.CSS_SELECTOR, "#diagram .leaf")]
    assert leaves == [
        ["black floor", "(probability 0.5)"],
        ["exploration", "(rwm 3)"],
        ["fixed probability", "(probability 0.1)"],
        ["stop"],
        ["sequence*"],
    ]
    assert browser.find_elements(By.CSS_SELECTOR, "#diagram .head") == [], "nothing is a transition"
    numbers = [number.text for number in browser.find_elements(By.CSS_SELECTOR, "#diagram .number")]
    assert numbers == ["6", "0"], "agents in each subtree"
    rows = [row.text for row in browser.find_elements(By.CSS_SELECTOR, "#states > li")]
    assert rows[0] == "0 next subtree if black floor (probability 0.5)\nelse exploration (rwm 3)"
    inside = (
        "const all = player.machine.svg.getBoundingClientRect();"
        "return [...document.querySelectorAll('#diagram rect')].map((one) => one.getBoundingClientRect())"
        ".every((one) => one.left >= all.left && one.right <= all.right);"
    )
    assert browser.execute_script(inside)
    assert errors(browser) == []


def test_groups_of_a_team_have_their_machines(browser: Chrome, tmp_path: Path) -> None:
    recording = swarm(7)
    assert recording.trace is not None
    without = replace(recording, trace=replace(recording.trace, states=None))
    open_page(browser, tmp_path, Part(without, "", machines_of(TEAM)))
    group = Select(browser.find_element(By.ID, "group"))
    assert [option.text for option in group.options] == ["scouts", "carriers"]
    assert text(browser, "which") == "the states of agents are not recorded"

    def shown() -> tuple[int, int]:
        numbers = browser.find_elements(By.CSS_SELECTOR, "#diagram .number")
        assert [number.text for number in numbers] == ["0", "1"]
        arrows = browser.find_elements(By.CSS_SELECTOR, "#diagram .head")
        return len(arrows), len(browser.find_elements(By.CSS_SELECTOR, "#diagram .leaf"))

    assert shown() == (2, 0), "a machine"
    group.select_by_value("carriers")
    assert shown() == (0, 5), "a tree"
    browser.execute_script("player.follow(0, 1)")
    assert browser.find_element(By.ID, "group").get_attribute("value") == "scouts"
    assert shown() == (2, 0)
    browser.execute_script("player.follow(0, 3)")
    assert shown() == (2, 0), "agent 3 has a network"
    browser.execute_script("player.follow(0, 6)")
    assert shown() == (0, 5)
    assert [
        option.get_attribute("value") for option in Select(browser.find_element(By.ID, "colors")).options
    ] == ["state"]
    assert errors(browser) == []


def test_states_of_a_team_are_those_of_each_group(browser: Chrome, tmp_path: Path) -> None:
    recording = swarm(7)
    assert recording.trace is not None
    assert recording.trace.states is not None
    states = recording.trace.states.copy()
    states[:, 2:5] = -1
    recording = replace(recording, trace=replace(recording.trace, states=states))
    open_page(browser, tmp_path, Part(recording, "", machines_of(TEAM)))

    def numbers() -> list[str]:
        return [number.text for number in browser.find_elements(By.CSS_SELECTOR, "#diagram .number")]

    browser.execute_script("player.go(0)")
    assert (text(browser, "which"), numbers()) == ("agents in each state", ["2", "0"])
    browser.execute_script("player.go(10)")
    assert numbers() == ["0", "2"]
    Select(browser.find_element(By.ID, "group")).select_by_value("carriers")
    assert numbers() == ["0", "2"]
    browser.execute_script("player.follow(0, 1)")
    assert text(browser, "which") == "of agent 1"
    assert numbers() == ["0", "1"], "the number of the state that it is in"
    assert browser.execute_script("return player.inspector.hasStates();")
    browser.execute_script("player.follow(0, 3)")
    assert not browser.execute_script("return player.inspector.hasStates();"), "a network"
    assert text(browser, "which") == "agents in each state", "of the group that is shown"
    colors = Select(browser.find_element(By.ID, "colors"))
    assert [option.get_attribute("value") for option in colors.options] == ["state", "controller"]
    colors.select_by_value("controller")
    counts = browser.execute_script("return player.legend.states.map(({ count }) => count.textContent);")
    assert counts == ["0", "2", "0", "2"], "not the network's agents"
    assert [line for line in text(browser, "legend").splitlines() if "in state" in line] == [
        "scouts in state 0, exploration", "scouts in state 1, stop",
        "carriers in state 0, exploration", "carriers in state 1, stop",
    ]  # fmt: skip
    assert browser.execute_script("return [1, 6].map((body) => player.world.colorOf(body));") == [
        browser.execute_script(f"return theme()('{STATES[color]}')") for color in (1, 3)
    ]
    mark = "return getComputedStyle(document.querySelector('#states .swatch')).backgroundColor"
    drawn = set()
    for group in ("scouts", "carriers"):
        Select(browser.find_element(By.ID, "group")).select_by_value(group)
        drawn.add(browser.execute_script(mark))
    assert len(drawn) == 2, "as on the map"
    assert errors(browser) == []


def test_sixteen_states_have_colours_of_their_own(browser: Chrome, tmp_path: Path) -> None:
    recording = swarm(16)
    assert recording.trace is not None
    states = np.tile(np.arange(16, dtype=np.int16), (STEPS + 1, 1))
    recording = replace(recording, trace=replace(recording.trace, states=states))
    open_page(
        browser, tmp_path, Part(recording, "", machines_of(modules(16, 4, 16))), shown=Shown(labels=False)
    )
    colors = browser.execute_script(
        "return [...document.querySelectorAll('#diagram circle')].map((one) => getComputedStyle(one).stroke);"
    )
    assert len(set(colors)) == 16
    legend = browser.execute_script(
        "return player.legend.states.map(({ item }) => getComputedStyle(item.querySelector('path')).fill);"
    )
    assert legend == colors
    for name in STATES[:16]:
        assert pixels(browser, "world", name)[0] > 20, name
    assert errors(browser) == []


def test_colours_and_the_legend_say_the_same(browser: Chrome, tmp_path: Path) -> None:
    open_page(
        browser, tmp_path, Part(swarm(values=True), "", machines_of(MODULES)), shown=Shown(labels=False)
    )
    colors = Select(browser.find_element(By.ID, "colors"))
    assert [option.text for option in colors.options] == [
        "state of the controller",
        "load, kg",
        "kind and state",
    ]
    press(browser, Keys.END)

    def legend() -> list[str]:
        return [
            item.text for item in browser.find_elements(By.CSS_SELECTOR, "#legend li") if item.is_displayed()
        ]

    ground = ["black floor (goal)", "grey floor", "wall", "lamp"]
    assert legend() == [
        "agent\n6",
        "controller in state 0, exploration\n6",
        "controller in state 1, stop\n0",
        *ground,
    ]
    assert pixels(browser, "world", "state-0")[0] > 100
    press(browser, *[Keys.ARROW_LEFT] * 5)
    assert pixels(browser, "world", "state-1")[0] > 100, "state 1"
    colors.select_by_value("value")
    assert legend() == ["agent\n6", "load, kg\n0\n1", *ground]
    assert pixels(browser, "world", "value-4")[0] > 50
    colors.select_by_value("state")
    assert legend() == ["agent\n6", *ground]
    assert pixels(browser, "world", "value-4")[0] == 0
    assert errors(browser) == []


def lit() -> Recording:
    """Two robots, of which the first one shows red in the second half, before a wall with a green part."""
    scenes = []
    for step in range(3):
        x = [0.5 + 0.1 * step, 1.5]
        bodies = Bodies(
            [*x, 1, *x], [1, 1, 1.6, 1, 1], ["agent", "agent", "wall", "led", "led"],
            ["scout", "base, stopped", "green", "red" if step else "", ""],
            [0.1, 0.1, 0.4, 0.045, 0.045], [0.0, 1.0, 0.0, np.nan, np.nan],
        )  # fmt: skip
        styles = [
            Style("led", "red", "#e01010", "circle"), Style("led", "", "#123456", "circle"),
            Style("wall", "green", "#10a010", "square"),
        ]  # fmt: skip
        scenes.append(Scene(2, 2, step, "Lit", bodies, floor=0.5, styles=styles))
    return Recording(tuple(scenes), (0.0, 0.0, 0.0), 0.1)


def test_leds_are_marks_on_robots_and_coloured_walls_are_lines(browser: Chrome, tmp_path: Path) -> None:
    open_page(browser, tmp_path, Part(lit()))
    entries = [item.text for item in browser.find_elements(By.CSS_SELECTOR, "#legend li")]
    assert entries == [
        "agent, scout\n1", "agent, base, stopped\n1", "wall, green", "led, red\n0", "grey floor",
    ]  # fmt: skip
    press(browser, Keys.END)
    legend = browser.find_element(By.ID, "legend")
    eventually(lambda: "led, red\n1" in legend.text, "the lit LED")
    colors = """
        const { world } = player;
        const at = (x, y) => {
          const [px, py] = world.camera.pixels(x, y);
          const ratio = window.devicePixelRatio || 1;
          return [...world.context.getImageData(px * ratio, py * ratio, 1, 1).data].slice(0, 3);
        };
        return [at(0.7, 1), at(0.7, 1.07), at(1.3, 1.6), at(0.5, 1.6)];
    """
    led, robot, wall, beside = browser.execute_script(colors)
    assert led == [0xE0, 0x10, 0x10]
    assert wall == [0x10, 0xA0, 0x10]
    assert robot not in (led, beside)
    assert beside != wall
    assert errors(browser) == []


def test_what_is_drawn_can_be_chosen(browser: Chrome, tmp_path: Path) -> None:
    open_page(
        browser, tmp_path, Part(swarm()), shown=Shown(trails=False, rays=True, links=True, labels=False)
    )
    values = [browser.find_element(By.ID, name).get_attribute("value") for name in ("trail", "rays", "links")]
    assert values == ["0", "all", "all"]
    with_rays = pixels(browser, "world", "defender")[0]
    assert with_rays > 50
    legend = browser.find_element(By.ID, "legend")
    assert {"sensor ray", "message heard"} <= set(legend.text.splitlines())
    Select(browser.find_element(By.ID, "rays")).select_by_value("none")
    assert pixels(browser, "world", "defender")[0] == 0
    assert "sensor ray" not in legend.text
    Select(browser.find_element(By.ID, "links")).select_by_value("selected")
    assert "message heard" not in legend.text, "no agent is followed"
    browser.execute_script("player.next(1)")
    assert "message heard" in legend.text
    drawn = """
        const found = [];
        const signals = new Signals(player.world);
        signals.haloed = (width, color) => found.push(color);
        signals.links();
        return found;
    """
    mark = browser.execute_script("return player.legend.signals.links.querySelector('line').style.stroke")
    assert [f"var(--{color})" for color in browser.execute_script(drawn)] == [mark]


@pytest.mark.parametrize("kind", ["rays", "links"])
def test_thin_lines_are_seen_on_a_black_floor(browser: Chrome, tmp_path: Path, kind: str) -> None:
    ray = Ray(angle=0.0, length=0.8, reading=0.0)
    bodies = [Body("agent", 0.5, 1.0, heading=0.0, radius=0.1, rays=[ray]), Body("agent", 1.5, 1.0)]
    scene = Scene(2, 2, 0, "", bodies, floor=0.0, links=[(0, 1)])
    shown = Shown(rays=kind == "rays", links=kind == "links")
    open_page(browser, tmp_path, Part(Recording((scene,), (0.0,), 0.1)), shown=shown)
    brightest = """
        const { world } = player;
        const [x, y] = world.camera.pixels(0.9, 1).map((at) => at * (window.devicePixelRatio || 1));
        const { data } = world.context.getImageData(x, y - 4, 1, 8);
        return Math.max(...data.filter((_, i) => i % 4 < 3));
    """
    assert browser.execute_script(brightest) > 0x2E + 70


def test_labels_of_many_are_not_drawn_at_first(browser: Chrome, tmp_path: Path) -> None:
    for robots, checked in ((100, True), (101, False)):
        open_page(browser, tmp_path, Part(swarm(robots, steps=2)))
        assert browser.find_element(By.ID, "labels").is_selected() == checked
    open_page(browser, tmp_path, Part(swarm(101, steps=2)), shown=Shown(labels=True))
    assert browser.find_element(By.ID, "labels").is_selected(), "as it is wanted"


def test_sensors_of_one_kind_have_the_same_limits(browser: Chrome, tmp_path: Path) -> None:
    names = [*(f"proximity {number}" for number in range(6)), "ground 0", "ground 1", "message"]
    recording = swarm()
    assert recording.trace is not None
    sensors = recording.trace.sensors.copy()
    sensors[:, :, 2] = 0.05
    sensors[:, :, 6] = 0.5
    sensors[:, :, 8] = -2
    recording = replace(recording, trace=replace(recording.trace, sensors=sensors))
    open_page(browser, tmp_path, Part(recording, "", machines_of(MODULES), names))
    press(browser, "n")
    limits = "return player.inspector.rows.map(({ low, high }) => [low, high]);"
    assert browser.execute_script(limits)[:9] == [[0, 1]] * 6 + [[0, 0.5]] * 2 + [[-2, 0]]
    hint = "player.inspector.hint(26 + 2 * 20 + 5); return player.part.timeline.title;"
    assert browser.execute_script(hint) == "proximity 2: 0 to 1"
    open_page(browser, tmp_path, Part(recording, "", machines_of(MODULES)))
    press(browser, "n")
    assert browser.execute_script(limits)[2][1] == pytest.approx(0.05), "numbers alone tell of no kind"


def written(browser: Chrome, canvas: str) -> list[str]:
    """What is written on a canvas."""
    found: list[str] = browser.execute_script(
        """
        const context = document.querySelector(arguments[0]).getContext('2d');
        const texts = [];
        context.fillText = (text) => texts.push(text);
        player.show(true);
        delete context.fillText;
        return texts;
        """,
        canvas,
    )
    return found


def test_small_charts_say_the_least_and_the_greatest_number(browser: Chrome, tmp_path: Path) -> None:
    recording = swarm()
    assert recording.trace is not None
    values = np.arange(STEPS + 1.0)
    metrics = {"still": 0 * values + 3, "close": 1000 + 1e-3 * values, "wide": 0.7 * values - 3}
    recording = replace(recording, trace=replace(recording.trace, metrics=metrics))
    open_page(browser, tmp_path, Part(recording))
    browser.execute_script(
        "document.querySelectorAll('.metric').forEach((one, index) => (one.id = `chart-${index}`))"
    )
    assert written(browser, "#chart-0") == ["3"]
    assert written(browser, "#chart-1") == ["1000", "1000.04"]
    assert written(browser, "#chart-2") == ["−3", "25"]


def test_further_metrics_are_a_click_away(browser: Chrome, tmp_path: Path) -> None:
    recording = swarm()
    assert recording.trace is not None
    metrics = {f"metric_{number}": np.arange(STEPS + 1.0) for number in range(30)}
    recording = replace(recording, trace=replace(recording.trace, metrics=metrics))
    open_page(browser, tmp_path, Part(recording))
    charts = "return document.querySelectorAll('.metric').length"
    assert browser.execute_script(charts) == 8
    more = browser.find_element(By.ID, "more")
    assert more.text == "Show 22 more"
    more.click()
    assert browser.execute_script(charts) == 30
    assert not browser.find_elements(By.ID, "more")
    press(browser, Keys.END)
    assert "metric 29\n40" in browser.find_element(By.ID, "metrics").text
    assert errors(browser) == []


def test_the_keyboard_goes_on_at_the_first_of_the_further_metrics(browser: Chrome, tmp_path: Path) -> None:
    recording = swarm()
    assert recording.trace is not None
    metrics = {f"metric_{number}": np.arange(STEPS + 1.0) for number in range(30)}
    recording = replace(recording, trace=replace(recording.trace, metrics=metrics))
    focused = "return document.activeElement.textContent"
    open_page(browser, tmp_path, Part(recording))
    browser.find_element(By.ID, "more").send_keys(Keys.ENTER)
    assert browser.execute_script(focused).startswith("metric 8")
    open_page(browser, tmp_path, Part(recording))
    browser.find_element(By.ID, "more").click()
    assert not browser.execute_script(focused).startswith("metric 8")


@pytest.mark.parametrize("grid", [False, True])
def test_metres_have_their_unit(browser: Chrome, tmp_path: Path, grid: bool) -> None:
    recording = swarm()
    scenes = tuple(replace(scene, grid=grid) for scene in recording.scenes)
    open_page(browser, tmp_path, Part(replace(recording, scenes=scenes)))
    assert written(browser, "#world").count("m") == (not grid)


def test_colours_of_episodes_are_those_of_their_curves(browser: Chrome, tmp_path: Path) -> None:
    count = 13
    parts = [Part(swarm(2, steps=10), f"0:{number}") for number in range(count)]
    open_page(browser, tmp_path, *parts)
    marks = browser.execute_script(
        "return [...document.querySelectorAll('figcaption .swatch')].map((one) => one.style.background);"
    )
    curves = browser.execute_script(
        "return player.charts.map(({ curve }) => player.episodes.map((_, index) => "
        "`var(--${curve.colors[index]})`));"
    )
    assert len(set(marks)) == count
    assert curves == [marks, marks]
    numbers = written(browser, "#curve")
    assert set(map(str, range(1, count + 1))) <= set(numbers)
    captions = [caption.text.split("\n")[:2] for caption in browser.find_elements(By.TAG_NAME, "figcaption")]
    assert captions == [[str(number + 1), f"0:{number}"] for number in range(count)]


def test_long_names_of_episodes_are_not_cut(browser: Chrome, tmp_path: Path) -> None:
    name = f"{'compare/a_method_with_a_long_name' * 3} 19:1"
    open_page(browser, tmp_path, *(Part(swarm(2, steps=3), name) for _ in range(6)))
    cut = (
        "return [...document.querySelectorAll('figcaption *')]"
        ".some((one) => one.scrollWidth > one.offsetWidth + 1)"
    )
    assert not browser.execute_script(cut)
    tops = (
        "return [...document.querySelectorAll('.map')].slice(0, 3)"
        ".map((one) => one.getBoundingClientRect().top)"
    )
    assert len(set(browser.execute_script(tops))) == 1


def test_keys_play_after_a_choice_with_the_mouse(opened: Chrome) -> None:
    focus = "return document.activeElement.id"
    speed = opened.find_element(By.ID, "speed")
    speed.click()
    Select(speed).select_by_value("4")
    assert opened.execute_script(focus) == ""
    press(opened, Keys.ARROW_RIGHT)
    assert text(opened, "now").startswith("step 1 of")
    assert speed.get_attribute("value") == "4"
    labels = opened.find_element(By.ID, "labels")
    labels.click()
    press(opened, " ")
    assert text(opened, "play") == "Pause"
    # With the keyboard it stays there.
    opened.execute_script("arguments[0].focus()", speed)
    press(opened, Keys.ARROW_DOWN)
    assert (speed.get_attribute("value"), opened.execute_script(focus)) == ("8", "speed")
    press(opened, Keys.ESCAPE)
    assert opened.execute_script(focus) == ""


def test_what_can_be_chosen_is_seen_with_the_map(opened: Chrome) -> None:
    lowest = "return document.querySelector('.settings').getBoundingClientRect().bottom - window.innerHeight"
    assert opened.execute_script(lowest) <= 0


def test_several_episodes_stand_beside_each_other(browser: Chrome, tmp_path: Path) -> None:
    short = swarm(3, steps=20)
    parts = [
        Part(swarm(), "first", machines_of(MODULES)),
        Part(short, "second", machines_of(MODULES)),
        Part(swarm(2), "third"),
    ]
    open_page(browser, tmp_path, *parts)
    captions = [caption.text for caption in browser.find_elements(By.TAG_NAME, "figcaption")]
    assert captions == ["1\nfirst\n0", "2\nsecond\n0", "3\nthird\n0"]
    assert text(browser, "counted") == "counts of all 3 maps"
    press(browser, Keys.END)
    captions = [caption.text for caption in browser.find_elements(By.TAG_NAME, "figcaption")]
    assert captions == ["1\nfirst\n40", "2\nsecond\n20", "3\nthird\n40"], "the shorter one has ended"
    second = browser.find_elements(By.CSS_SELECTOR, ".map canvas")[1]
    at = browser.execute_script(
        "const { px, py, canvas } = player.worlds[1]; "
        "return [px[1] - canvas.clientWidth / 2, py[1] - canvas.clientHeight / 2];"
    )
    ActionChains(browser).move_to_element_with_offset(second, round(at[0]), round(at[1])).click().perform()
    assert text(browser, "who") == "Agent 1 of second"
    assert browser.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
    assert errors(browser) == []


@pytest.mark.slow
def test_ten_thousand_robots(browser: Chrome, tmp_path: Path) -> None:
    recording = swarm(10_000, steps=450)
    open_page(browser, tmp_path, Part(recording, "", machines_of(MODULES)))
    data = json.loads(browser.execute_script("return document.getElementById('episode').textContent"))
    (episode,) = data["episodes"]
    assert episode["stride"] == 2, "scenes are left out"
    press(browser, Keys.ARROW_RIGHT)
    assert text(browser, "now") == "step 1 of 450", "but not steps"
    x = browser.execute_script("return player.world.worldPosition(0)[0]")
    assert x == pytest.approx(0.2 + 1.4 / 450, abs=1e-4)
    assert pixels(browser, "world", "free")[0] > 200
    press(browser, "n")
    assert text(browser, "who") == "Agent 0"
    press(browser, *["i"] * 12)
    assert pixels(browser, "world", "free")[0] > 200
    assert errors(browser) == []
