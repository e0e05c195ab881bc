"""The archive of elites in a real browser."""

from pathlib import Path

import pytest
from selenium.webdriver import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from swarmwright import Experiment, optimize
from tests.python.display.browser import chromium
from tests.python.ui.test_browser import eventually, find, page_text, tab, window

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

NOISY = {
    "simulation": "minisim",
    "parameters": {"numAgents": 2, "placement": "random", "maxSteps": 10},
    "ranking": {"seeds": "new"},
    "fitness": "arrived - caught",
    "validate": False,
    "servers": "in-process",
    "method": {
        "kind": "map_elites",
        "measures": {"steps": {"range": [0, 10]}, "distance": {"range": [0, 30]}},
        "archive": {"kind": "cvt", "cells": 16},
        "reevaluate": 0.5,
        "population": 30,
        "generations": 8,
    },
}


def test_the_elites_of_voronoi_cells_are_shown_and_watched(tmp_path: Path) -> None:
    run = optimize(Experiment.from_mapping(NOISY), out=tmp_path / "runs" / "noisy")
    with chromium(tmp_path / "browser") as browser, window(tmp_path / "runs") as address:
        browser.get(address)
        find(browser, "tbody a").click()
        eventually(lambda: tab(browser, "Archive"), "the tab is offered").click()
        eventually(lambda: "after generation 7 of 7" in page_text(browser), "the last generation is shown")
        canvas = find(browser, "canvas.plot")
        width, height = canvas.size["width"], canvas.size["height"]
        browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)

        def words(x: float, y: float) -> str:
            mouse = ActionChains(browser).move_to_element_with_offset(canvas, int(x * width), int(y * height))
            mouse.perform()
            return find(browser, ".words").text

        points = [(x / 10, y / 10) for x in range(3, -4, -1) for y in range(3, -4, -1)]
        place = next(point for point in points if "candidate" in words(*point))
        assert "evaluations" in words(*place)

        find(browser, "summary").click()
        count = len(run.elites.candidates)
        rows = "details tbody tr"
        eventually(lambda: len(browser.find_elements(By.CSS_SELECTOR, rows)) == count, "a row for each")
        find(browser, "input[type=range][aria-label=generation]").send_keys(Keys.HOME)
        eventually(lambda: "after generation 0 of 7" in page_text(browser), "the first generation is shown")
        find(browser, "details tbody button").click()
        frame = find(browser, "iframe")
        browser.switch_to.frame(frame)
        eventually(lambda: "candidate" in page_text(browser), "the elite is played")
        browser.switch_to.default_content()
        severe = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]  # type: ignore[no-untyped-call]
        assert severe == []
