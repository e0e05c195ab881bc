"""A mission is drawn from scratch in a real browser: shapes, robots, objective, an episode, and the file."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select

from swarmwright.common import yaml
from tests.python.display.browser import chromium
from tests.python.ui.test_browser import eventually, find, page_text, window

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with chromium(tmp_path_factory.mktemp("browser"), size=(1400, 1800)) as running:
        running.set_page_load_timeout(60)
        yield running


def has_text(browser: Chrome, words: str) -> None:
    editor = find(browser, "textarea")
    eventually(lambda: words in (editor.get_attribute("value") or ""), f"the text has {words!r}")


def act(what: str, do: Callable[[], object]) -> None:
    """Do something with an element, which may be drawn anew meanwhile."""
    eventually(lambda: do() is None, what)


def button(browser: Chrome, label: str) -> None:
    act(label, lambda: browser.find_element(By.XPATH, f"//button[text()='{label}']").click())


def choose(browser: Chrome, selector: str, value: str) -> None:
    act(value, lambda: Select(browser.find_element(By.CSS_SELECTOR, selector)).select_by_value(value))


def fill(browser: Chrome, key: str, value: str) -> None:
    """Type into the field with a key, and leave it."""

    def enter() -> None:
        entry = browser.find_element(By.CSS_SELECTOR, f"[data-key='{key}']")
        entry.send_keys(Keys.CONTROL, "a")
        entry.send_keys(value, Keys.TAB)

    act(key, enter)


def test_a_mission_is_drawn_from_scratch(browser: Chrome, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    with window(tmp_path / "runs") as address:
        browser.get(f"{address}#/draw?mission=dispersion")
        eventually(lambda: "Nothing is wrong" in page_text(browser), "a mission is opened")
        board = find(browser, ".board")

        button(browser, "polygon")
        for x, y in ((100, 60), (200, 60), (200, 160), (100, 160)):
            ActionChains(browser).move_to_element_with_offset(board, x, y).click().perform()
        ActionChains(browser).send_keys(Keys.ENTER).perform()
        has_text(browser, "area_1")
        for keys in (Keys.ARROW_LEFT, Keys.ARROW_UP):
            board.send_keys(keys)
        ActionChains(browser).key_down(Keys.CONTROL).send_keys("d").key_up(Keys.CONTROL).perform()
        has_text(browser, "area_2")
        board.send_keys(Keys.DELETE)
        eventually(
            lambda: "area_2" not in (find(browser, "textarea").get_attribute("value") or ""), "Delete removes"
        )

        button(browser, "start rectangle")
        ActionChains(browser).move_to_element_with_offset(board, -60, 0).click().perform()
        has_text(browser, "rectangle: {x:")
        choose(browser, "[aria-label=Selected]", "start,disc")
        button(browser, "Remove")
        eventually(
            lambda: "disc" not in (find(browser, "textarea").get_attribute("value") or ""), "one area is left"
        )

        for summary in browser.find_elements(By.XPATH, "//summary[contains(., 'Robots')]"):
            summary.click()
        button(browser, "Add a kind of robots")
        has_text(browser, "robot_2")
        choose(browser, "[data-key='kind.1.model']", "a robot of your own")
        choose(browser, "[data-key='kind.1.sensors.add']", "camera")
        has_text(browser, "kind: camera")
        fill(browser, "kind.0.count", "4")
        has_text(browser, "count: 4")

        choose(browser, "[data-key='metrics.add']", "robots_on")
        has_text(browser, "patch: area_1")
        fill(browser, "weight.robots_on", "2.5")
        eventually(
            lambda: "2.5 * robots_on" in (find(browser, "[data-key=fitness]").get_attribute("value") or ""),
            "the fitness is composed",
        )
        fill(browser, "fitness", "apart - 0.01 * robots_on")
        has_text(browser, "robots_on: -0.01")

        eventually(lambda: "Nothing is wrong" in page_text(browser), "it is right")
        button(browser, "Try")
        eventually(lambda: find(browser, "output[data-metric=robots_on]").text != "", "its value is shown")
        browser.switch_to.frame(find(browser, "iframe"))
        find(browser, "#last").click()
        eventually(lambda: "step 1199 of 1199" in page_text(browser), "the end is shown")
        shown = eventually(lambda: browser.find_element(By.ID, "fitness"), "the fitness in the player").text
        browser.switch_to.default_content()
        eventually(
            lambda: find(browser, "output[data-metric=fitness]").text[:5] == shown[:5], "both agree in step"
        )

        file = find(browser, "[aria-label='Name of the file']")
        file.clear()
        file.send_keys("drawn")
        button(browser, "Save")
        find(browser, "a[href^='#/new?mission=drawn.yaml']")
        severe = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]  # type: ignore[no-untyped-call]
        assert severe == []
    mission = yaml.read(tmp_path / "runs" / "drawn.yaml").values
    (area,) = mission["floor"]["patches"]
    assert len(area["polygon"]) == 4
    assert list(mission["start"]) == ["rectangle"]
    assert [kind["count"] for kind in mission["robots"]] == [4, 5]
    assert "camera" in [sensor["kind"] for sensor in mission["robots"][1]["robot"]["sensors"]]
    assert mission["fitness"] == {"factors": {"apart": 1, "robots_on": -0.01}}


SHAPES = [
    "", "3", "[1, 2]", "walls: [", "walls: 5", "walls: {rectangle: 2}\nstart: 3",
    "walls: {corners: [[1], 2]}",
    "walls: {rectangle: [2, 2]}\nfloor: {patches: [null]}", "walls: {rectangle: [2, 2]}\nrobots: {a: 1}",
    "walls: {rectangle: [2, 2]}\nrobot: {sensors: [{kind: proximity, angles: 3}]}", "a: &a [*a]",
    "walls: {rectangle: [2, 2]}\nmetrics: [1]", "walls: {rectangle: [2, .nan]}\nstart: null",
]  # fmt: skip
MISTAKES = """\
walls: {sides: -5, height: [1], colors: [{side: 99, color: constructor}]}
floor: {color: [1], patches: [{name: {a: 1}, circle: {radius: -1}, color: [2]}, {polygon: []}]}
start: {disc: {radius: -1}}
robots:
  - {robot: constructor, count: -3}
  - {robot: {preset: none}}
  - {robot: {sensors: [{kind: light, count: 1e9}]}}
metrics:
  constructor: {kind: constructor}
  b: {kind: most_robots_on, patches: 3}
  c: {kind: shape_deviation, shape: {}}
lights: [{at: [0, 0], color: {}}]
title: [[[[[]]]]]
duration: {a: b}
"""
"""What can be drawn, but never be simulated."""


def type_text(browser: Chrome, text: str) -> None:
    """Put a text into the editor as somebody does who still has the focus in it."""
    editor = find(browser, "textarea")
    browser.execute_script(
        "const [editor, text] = arguments; editor.focus(); editor.value = text;"
        "editor.dispatchEvent(new Event('input'))",
        editor,
        text,
    )


def press(browser: Chrome, label: str) -> None:
    """Press a button in the moment after what was done before."""
    browser.execute_script(
        "[...document.querySelectorAll('button')].find((each) => each.textContent === arguments[0]).click()",
        label,
    )


def text_of(browser: Chrome) -> str:
    return find(browser, "textarea").get_attribute("value") or ""


def test_what_is_typed_is_saved_with_its_comments_and_any_shape_is_survived(
    browser: Chrome, tmp_path: Path
) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    (runs / "broken.yaml").write_text("walls: 5\nstart: 3  # where\n")
    with window(runs) as address:
        browser.get(f"{address}#/draw?mission=broken.yaml")
        eventually(lambda: "This text cannot be drawn" in page_text(browser), "a broken file is told")
        assert "# where" in text_of(browser)
        type_text(browser, "walls: 6")
        missions = Select(find(browser, "[aria-label=Mission]"))
        for answer, chosen in (("Stay", "broken.yaml"), ("Open", "dispersion")):
            missions.select_by_value("dispersion")
            button(browser, answer)
            eventually(lambda name=chosen: missions.first_selected_option.text == name, chosen)  # type: ignore[misc]
        eventually(lambda: "Nothing is wrong" in page_text(browser), "a mission is opened")
        head = text_of(browser).splitlines()[0]
        assert head.startswith("# ")

        # Saved in the moment after it was typed.
        type_text(browser, text_of(browser).replace("title: ", "title: My ").rstrip() + "  # mine\n")
        press(browser, "Save")
        eventually(lambda: "saved as my_dispersion.yaml" in page_text(browser), "it is saved")
        saved = (runs / "my_dispersion.yaml").read_text()
        assert saved == text_of(browser)
        assert saved.startswith(head)
        assert "title: My" in saved
        fitness = find(browser, "[data-key=fitness]")
        browser.execute_script(
            "const [field] = arguments; field.value = '2 * apart';"
            "field.dispatchEvent(new Event('change', {bubbles: true}))",
            fitness,
        )
        press(browser, "Save")
        eventually(lambda: "apart: 2" in (runs / "my_dispersion.yaml").read_text(), "with the fitness")
        assert (runs / "my_dispersion.yaml").read_text().startswith(head)

        # Texts that are no missions leave the board as it is.
        before = text_of(browser)
        for shape in SHAPES:
            type_text(browser, shape)
            press(browser, "Try")
            eventually(lambda: "The board shows the last text" in page_text(browser), shape)
            assert browser.find_elements(By.CSS_SELECTOR, ".problems .problem"), shape
            find(browser, ".board").click()
            assert not find(browser, "[aria-label='Name of the file'] + *, .primary").is_enabled()
        assert text_of(browser) == SHAPES[-1]
        press(browser, "Undo")
        eventually(lambda: text_of(browser) == before, "the text of the board is back")
        eventually(lambda: "Nothing is wrong" in page_text(browser), "it is right")
        type_text(browser, MISTAKES)
        press(browser, "Try")
        eventually(lambda: len(browser.find_elements(By.CSS_SELECTOR, ".problems .problem")) > 5, "mistakes")
        select = Select(find(browser, "[aria-label=Selected]"))
        for option in [option.get_attribute("value") for option in select.options]:
            browser.execute_script(
                "const field = document.querySelector('[aria-label=Selected]');"
                "field.value = arguments[0]; field.dispatchEvent(new Event('change'))",
                option,
            )
            time.sleep(0.1)
        log = browser.get_log("browser")  # type: ignore[no-untyped-call]
        assert [entry for entry in log if entry["source"] != "network"] == []


IS_CHANGED = """
const [script, done] = arguments;
import(new URL(script, document.baseURI)).then(async ({ show }) => {
  const element = document.createElement("div");
  document.body.append(element);
  const until = async (isTrue) => { while (!isTrue()) await new Promise((go) => setTimeout(go, 20)); };
  const shown = show(element, new URLSearchParams());
  const editor = element.querySelector("textarea");
  await until(() => element.textContent.includes("Nothing is wrong"));
  const answers = [shown.isChanged()];
  const text = editor.value;
  editor.value = `${text}# more`;
  answers.push(shown.isChanged());
  editor.value = text;
  answers.push(shown.isChanged());
  const field = element.querySelector("input[type=number][data-key]");
  field.value = 7;
  for (const name of ["input", "change"]) field.dispatchEvent(new Event(name, { bubbles: true }));
  answers.push(shown.isChanged());
  shown.leave();
  element.remove();
  done(answers);
}).catch((error) => done(String(error)));
"""


@pytest.mark.parametrize("view", ["new", "draw"])
def test_views_say_whether_something_would_be_lost(browser: Chrome, tmp_path: Path, view: str) -> None:
    with window(tmp_path) as address:
        browser.get(address)
        find(browser, f"header a[href='#/{view}']")
        assert browser.execute_async_script(IS_CHANGED, f"static/{view}.js") == [False, True, False, True]
