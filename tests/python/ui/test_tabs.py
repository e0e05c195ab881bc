"""The tabs of a run in a real browser: what is clicked is what is played."""

import re
from pathlib import Path
from typing import Any

import pytest
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from swarmwright import Experiment, Run, optimize
from swarmwright.runs.races import entrants
from tests.python.records import write_attempts
from tests.python.ui.test_browser import browser, eventually, find, page_text, window

__all__ = ["browser"]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

BASE: dict[str, Any] = {
    "simulation": "minisim",
    "parameters": {"numAgents": 2, "placement": "random", "maxSteps": 10},
    "fitness": "arrived - caught",
    "servers": "in-process",
    "validate": False,
}
SIZE = {"population": 12, "generations": 6}
RUNS: dict[str, dict[str, Any]] = {
    "front": {"method": {"kind": "nsga2", "objectives": {"steps": "minimize"}, **SIZE}},
    "archive": {
        "method": {
            "kind": "map_elites",
            "measures": {"steps": {"range": [0, 10], "bins": 4}, "distance": {"range": [0, 20], "bins": 5}},
            **SIZE,
        }
    },
    "race": {
        "ranking": {"kind": "race", "episodes": 6, "first_test": 3},
        "method": {"kind": "random_search", **SIZE},
    },
}


def open_tab(browser: Chrome, address: str, run: str, title: str) -> None:
    browser.get(f"{address.partition('?')[0]}#/run/{run}")
    browser.refresh()
    eventually(lambda: browser.find_element(By.XPATH, f"//button[@role='tab'][.='{title}']"), title).click()
    eventually(lambda: browser.find_element(By.CSS_SELECTOR, "canvas.plot"), f"the picture of {title}")


def is_played(browser: Chrome, generation: int, candidate: int) -> None:
    name = f"Replay of candidate {candidate} of generation {generation}"
    frame = eventually(lambda: browser.find_element(By.CSS_SELECTOR, f"iframe[title='{name}']"), name)
    browser.switch_to.frame(frame)
    eventually(lambda: f"candidate {candidate}" in page_text(browser), f"{name} is shown")
    browser.switch_to.default_content()


def pick_by_keys(browser: Chrome, *keys: str, plot: int = 0) -> tuple[int, int]:
    """Press keys on a picture, and Enter; return the generation and the candidate that it names."""
    canvas = browser.find_elements(By.CSS_SELECTOR, "canvas.plot")[plot]
    canvas.send_keys(*keys)
    words = browser.find_elements(By.CSS_SELECTOR, ".words")[plot]
    eventually(lambda: "candidate" in words.text, "what is picked is said")
    generation = re.search(r"generation (\d+)", words.text)
    candidate = re.search(r"candidate (\d+)", words.text)
    assert generation is not None
    assert candidate is not None
    canvas.send_keys(Keys.ENTER)
    return int(generation[1]), int(candidate[1])


def test_each_tab_plays_what_is_clicked(browser: Chrome, tmp_path: Path) -> None:
    for name, values in RUNS.items():
        optimize(Experiment.from_mapping({**BASE, **values}), out=tmp_path / "runs" / name)
    runs = {name: Run(tmp_path / "runs" / name) for name in RUNS}
    write_attempts(tmp_path / "runs" / "race")
    with window(tmp_path / "runs") as address:
        browser.get(address)
        eventually(lambda: "3 runs" in page_text(browser), "all runs are listed")

        open_tab(browser, address, "race", "Genes")
        eventually(lambda: "shift-click to watch it beside" in find(browser, ".tab").text, "genes are drawn")
        picked = pick_by_keys(browser, Keys.ARROW_RIGHT, Keys.ARROW_LEFT)
        assert picked == (4, runs["race"].evaluation(generation=4).candidate)
        is_played(browser, *picked)

        open_tab(browser, address, "front", "Front")
        eventually(lambda: "after generation 5 of 5" in page_text(browser), "the final front")
        eventually(lambda: browser.find_element(By.CSS_SELECTOR, ".line canvas"), "hypervolume is drawn")
        picked = pick_by_keys(browser, Keys.ARROW_RIGHT)
        elites = runs["front"].elites.candidates
        last = max(elites, key=lambda elite: elite.metrics["steps"])
        assert picked == (last.generation, last.candidate)
        is_played(browser, *picked)

        open_tab(browser, address, "archive", "Archive")
        eventually(lambda: "after generation 5 of 5" in page_text(browser), "the final archive")
        canvas = find(browser, "canvas.plot")
        cells = {(elite.generation, elite.candidate) for elite in runs["archive"].elites.candidates}
        for row in range(5):
            browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
            ActionChains(browser).move_to_element_with_offset(canvas, 200, 150 - 70 * row).perform()
            words = find(browser, ".words").text
            if "candidate" in words:
                break
        match = re.search(r"generation (\d+), candidate (\d+)", words)
        assert match is not None, words
        ActionChains(browser).click().perform()
        picked = int(match[1]), int(match[2])
        assert picked in cells
        is_played(browser, *picked)

        open_tab(browser, address, "race", "Races")
        eventually(lambda: "generation 5: 12 candidates" in page_text(browser), "the last race")
        first = entrants(runs["race"], 5)[0]
        browser.find_element(By.XPATH, "//td/button[.='Watch']").click()
        is_played(browser, first.generation, first.candidate)

        open_tab(browser, address, "race", "Timeline")
        eventually(lambda: "Crosses are failed attempts" in page_text(browser), "failures are marked")
        eventually(lambda: "25 s in 1 generation" in page_text(browser), "who was waited for")
        canvas = find(browser, "canvas.plot")
        canvas.send_keys(Keys.ARROW_RIGHT)
        eventually(lambda: "server 7 after" in find(browser, ".words").text, "what a lane holds is said")
        canvas.send_keys(Keys.ENTER)
        eventually(
            lambda: browser.find_element(By.XPATH, "//button[.='Whole session']").is_enabled(), "it zooms in"
        )
        severe = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]  # type: ignore[no-untyped-call]
        assert severe == []
