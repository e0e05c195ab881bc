"""A mission is drawn from scratch in a real browser: shapes, robots, objective, an episode, and the file."""

from collections.abc import Iterator
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


def button(browser: Chrome, label: str) -> None:
    eventually(
        lambda: browser.find_element(By.XPATH, f"//button[text()='{label}']"), f"a button {label}"
    ).click()


def fill(browser: Chrome, key: str, value: str) -> None:
    """Type into the field with a key, and leave it."""
    entry = eventually(lambda: browser.find_element(By.CSS_SELECTOR, f"[data-key='{key}']"), f"a field {key}")
    entry.send_keys(Keys.CONTROL, "a")
    entry.send_keys(value, Keys.TAB)


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
        has_text(browser, "rectangle:\n    x:")
        Select(find(browser, "[aria-label=Selected]")).select_by_value("start,disc")
        button(browser, "Remove")
        eventually(
            lambda: "disc" not in (find(browser, "textarea").get_attribute("value") or ""), "one area is left"
        )

        for summary in browser.find_elements(By.XPATH, "//summary[contains(., 'Robots')]"):
            summary.click()
        button(browser, "Add a kind of robots")
        has_text(browser, "robot_2")
        Select(find(browser, "[data-key='kind.1.model']")).select_by_visible_text("a robot of your own")
        adding = eventually(
            lambda: browser.find_element(By.CSS_SELECTOR, "[data-key='kind.1.sensors.add']"),
            "sensors are offered",
        )
        Select(adding).select_by_value("camera")
        has_text(browser, "kind: camera")
        fill(browser, "kind.0.count", "4")
        has_text(browser, "count: 4")

        Select(find(browser, "[data-key='metrics.add']")).select_by_value("robots_on")
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
