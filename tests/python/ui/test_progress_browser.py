"""The progress of competitions in a real browser: what is clicked is what is played."""

from pathlib import Path

import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select

from swarmwright import Run, optimize
from swarmwright.analysis.competition import measure_progress
from tests.python.runs.optimization.test_competing import POPULATIONS
from tests.python.ui.test_browser import browser, eventually, find, page_text, tab, window
from tests.python.ui.test_replays_in_browser import press

__all__ = ["browser"]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
HOSTILE = """
import numpy as np
from swarmwright import Group, Side, Simulation

NAMES = ["<img src=x onerror=document.title='hacked'>", "\\"'&</script>" + "W" * 80]

class Duel(Simulation):
    title = "duel"
    groups = {name: Group(1, 1, 1) for name in NAMES}
    metrics = {"first": "Pull of the first.", "second": "Pull of the second."}
    sides = {name: Side(fitness=metric) for name, metric in zip(NAMES, ("first", "second"))}

    def reset(self, parameters, seed):
        self.pulls = np.random.default_rng(seed).uniform(-1, 1, 2)
        self.steps = 0
        return np.ones((2, 1))

    def step(self, actions):
        self.pulls += actions[:, 0]
        self.steps += 1
        return np.ones((2, 1))

    def done(self):
        return self.steps == 3

    def fitness(self):
        return float(self.pulls[0] - self.pulls[1])

    def measure(self):
        return {"first": self.pulls[0], "second": self.pulls[1]}
"""


def open_progress(browser: Chrome, address: str, run: str) -> None:
    browser.get(f"{address.partition('?')[0]}#/run/{run}")
    browser.refresh()
    eventually(lambda: tab(browser, "Progress"), "the tab").click()


def is_wide(browser: Chrome) -> bool:
    """Return whether the page is wider than the screen."""
    return bool(
        browser.execute_script("return document.documentElement.scrollWidth > document.body.clientWidth")
    )


def choose(browser: Chrome, label: str, text: str) -> None:
    element = browser.find_element(By.XPATH, f"//label[starts-with(., '{label}')]/select")
    Select(element).select_by_visible_text(text)


def test_champions_meet_and_each_cell_is_played(browser: Chrome, tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    run = optimize(POPULATIONS, servers="in-process", out=folder / "race")
    with window(folder, "--read-only") as address:
        browser.get(address)
        eventually(lambda: "1 run" in page_text(browser), "the run is listed")
        open_progress(browser, address, "race")
        press(browser, "Play 16 matches")
        eventually(lambda: len(browser.find_elements(By.CSS_SELECTOR, ".sides section")) == 2, "results")
        expected = measure_progress(Run(run.path), champions=20, servers="in-process")
        text = find(browser, ".sides").text
        for side in expected.sides:
            assert f"{side.side}: {side.verdict}" in text
        assert "16 matches" in page_text(browser)

        canvas = find(browser, "canvas.plot")
        canvas.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_LEFT)
        words = find(browser, ".words").text
        assert words.startswith("agents of generation 3 against defenders of generation 2: "), words
        value = float(words.rpartition(" ")[2].replace(",", ""))
        assert value == pytest.approx(expected.sides[0].outcomes[3, 2], rel=1e-3)
        canvas.send_keys(Keys.ENTER)
        frame = find(browser, ".panes iframe[title='Replay of generations 3 against 2']")
        browser.switch_to.frame(frame)
        title = "agents of generation 3 against defenders of generation 2"
        eventually(lambda: title in page_text(browser), "the match is played")
        browser.switch_to.default_content()

        choose(browser, "fitness of", "defenders")
        choose(browser, "matches", "against earlier opponents (CIAO)")
        choose(browser, "over generations", "mean fitness")
        canvas.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_LEFT, Keys.ENTER)
        find(browser, ".panes iframe[title='Replay of generations 2 against 3']")
        canvas.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_DOWN)
        assert ":" not in find(browser, ".words").text, "later opponents are left out"

        browser.execute_script("scrollTo(0, 0)")
        press(browser, "Export…")
        press(browser, "Python")
        eventually(lambda: "controllers of several generations" in find(browser, ".export").text, "refusal")
        find(browser, "details summary").click()
        eventually(lambda: len(browser.find_elements(By.CSS_SELECTOR, "details tbody tr")) == 4, "the table")
        for size in ((390, 900), (1280, 900)):
            browser.set_window_size(*size)
            find(browser, "#theme").click()
            eventually(lambda: not is_wide(browser), f"{size}: nothing is beside the screen")
        severe = [
            entry["message"]
            for entry in browser.get_log("browser")  # type: ignore[no-untyped-call]
            if entry["level"] == "SEVERE" and "/api/export" not in entry["message"]
        ]
        assert severe == []


def test_names_of_sides_are_text(browser: Chrome, tmp_path: Path) -> None:
    (tmp_path / "duel.py").write_text(HOSTILE)
    optimize(
        {
            "simulation": f"{tmp_path / 'duel.py'}:Duel",
            "ranking": {"kind": "tournament", "pairing": "round_robin"},
            "method": {"population": 4, "generations": 3},
            "validate": False,
        },
        servers="in-process",
        out=tmp_path / "runs" / "hostile",
    )
    with window(tmp_path / "runs") as address:
        browser.get(address)
        open_progress(browser, address, "hostile")
        press(browser, "Play 9 matches")
        eventually(lambda: len(browser.find_elements(By.CSS_SELECTOR, ".sides section")) == 2, "results")
        canvas = find(browser, "canvas.plot")
        canvas.send_keys(Keys.ARROW_RIGHT)
        assert "<img src=x onerror=document.title='hacked'> of generation 2" in find(browser, ".words").text
        canvas.send_keys(Keys.ENTER)
        find(browser, ".panes .problem")  # the class draws nothing
        browser.set_window_size(390, 900)
        eventually(lambda: not is_wide(browser), "nothing is beside the screen")
        browser.set_window_size(1280, 900)
        assert "hacked" not in browser.title
        assert browser.find_elements(By.CSS_SELECTOR, "img") == []
