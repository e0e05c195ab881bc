"""The window in a real browser, beside runs that are made meanwhile."""

import contextlib
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement

import swarmwright
from swarmwright.cli.ui import write_opening_page
from tests.python.display.browser import chromium
from tests.python.records import EXPERIMENT

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with chromium(tmp_path_factory.mktemp("browser")) as running:
        running.set_page_load_timeout(60)
        yield running


@contextlib.contextmanager
def window(folder: Path, *options: str, port: int = 0) -> Iterator[str]:
    """Run `swarmwright ui` on a folder; the address that it prints."""
    options = ("--no-browser", "--port", str(port), *options)
    command = [sys.executable, "-m", "swarmwright", "ui", str(folder), *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert "http://127.0.0.1:" in line, line + (
            process.stdout.read() if process.poll() is not None else ""
        )
        yield line[line.index("http") :].strip()
        assert process.poll() is None
    finally:
        process.terminate()
        process.wait(10)
        if process.stdout is not None:
            with process.stdout:
                assert "Traceback" not in process.stdout.read()


def eventually(ask: Callable[[], WebElement | bool | None], what: str, seconds: float = 40) -> WebElement:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        with contextlib.suppress(Exception):
            answer = ask()
            if answer:
                return answer  # type: ignore[return-value]
        time.sleep(0.1)
    pytest.fail(f"did not happen: {what}")


def find(browser: Chrome, selector: str) -> WebElement:
    return eventually(lambda: browser.find_element(By.CSS_SELECTOR, selector), selector)


def tab(browser: Chrome, title: str) -> WebElement:
    return browser.find_element(By.XPATH, f"//button[@role='tab'][.='{title}']")


def page_text(browser: Chrome) -> str:
    return browser.find_element(By.TAG_NAME, "body").text


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for seed in (1, 2):
        swarmwright.optimize(
            EXPERIMENT, servers="in-process", seed=seed, out=tmp_path / "runs" / f"run-{seed}"
        )
    return tmp_path / "runs"


def test_from_the_list_to_a_replay_and_a_comparison(browser: Chrome, folder: Path, tmp_path: Path) -> None:
    with window(folder) as address:
        browser.get(write_opening_page(tmp_path, address).as_uri())
        eventually(lambda: "2 runs" in page_text(browser), "both runs are listed")
        assert "token" not in browser.current_url

        shutil.copytree(folder / "run-1", folder / "late <b>run</b>")
        eventually(lambda: "late <b>run</b>" in page_text(browser), "a new run is listed as text")

        search = find(browser, "input[type=search]")
        search.send_keys("seed:2 best>-100")
        eventually(lambda: "1 of 3 runs" in page_text(browser), "the filter works")
        search.clear()
        search.send_keys("run-2")
        find(browser, "tbody a").click()
        find(browser, ".u-over")
        seed = find(browser, "input[name=seed]")
        seed.send_keys("7")
        find(browser, "#theme").click()
        assert seed.get_attribute("value") == "7"  # charts are drawn anew, the page is not
        chart = find(browser, ".u-over")
        ActionChains(browser).move_to_element_with_offset(chart, 30, 10).click().perform()
        frame = find(browser, "iframe")
        assert frame.get_attribute("sandbox") == "allow-scripts"
        browser.switch_to.frame(frame)
        eventually(lambda: "candidate" in page_text(browser), "the candidate is played")
        browser.switch_to.default_content()
        assert browser.execute_script("return document.querySelector('iframe').contentDocument") is None

        # Of two tabs the one that was chosen last is shown, however long the other takes to load.
        browser.execute_script(
            "arguments[0].click(); arguments[1].click()", tab(browser, "Timeline"), tab(browser, "Notes")
        )
        note = find(browser, "textarea")
        note.send_keys("an idea")
        assert browser.find_elements(By.CSS_SELECTOR, "canvas.plot") == []
        for answer in ("Stay", "Leave"):
            assert note.is_displayed()
            find(browser, ".brand").click()
            find(browser, "dialog").find_element(By.XPATH, f".//button[.='{answer}']").click()
        search = find(browser, "input[type=search]")
        search.clear()
        search.send_keys("late")
        eventually(lambda: "1 of 3 runs" in page_text(browser), "the new run alone is listed")
        find(browser, "tbody input[type=checkbox]").click()
        browser.find_element(By.XPATH, "//button[.='Tag']").click()
        find(browser, "dialog input").send_keys("thesis" + Keys.ENTER)
        eventually(lambda: "thesis" in find(browser, "tbody").text, "the run has its tag")
        for answer in ("Cancel", "Delete"):
            assert (folder / "late <b>run</b>").exists()
            browser.find_element(By.XPATH, "//button[.='Delete']").click()
            find(browser, "dialog").find_element(By.XPATH, f".//button[.='{answer}']").click()
        eventually(lambda: "of 2 runs" in page_text(browser), "the run is deleted")

        browser.get(address.split("?")[0] + "#/compare?run=run-1&run=run-2")
        eventually(lambda: "median" in page_text(browser), "the table of the comparison")
        eventually(lambda: browser.find_element(By.CSS_SELECTOR, ".figure img"), "its figure")
        severe = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]  # type: ignore[no-untyped-call]
        assert severe == []


def test_a_run_is_watched_while_it_goes_on(browser: Chrome, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    with window(tmp_path / "runs") as address:
        browser.get(address)
        eventually(lambda: "no runs below" in page_text(browser), "an empty folder says so")
        program = "import sys, swarmwright; swarmwright.optimize(sys.argv[1], out=sys.argv[2])"
        experiment = tmp_path / "long.yaml"
        experiment.write_text(
            "simulation: minisim\nservers: in-process\nparameters: {maxSteps: 200}\n"
            "method: {population: 200, generations: 100000}\n"
        )
        target = tmp_path / "runs" / "long"
        process = subprocess.Popen([sys.executable, "-c", program, str(experiment), str(target)])
        try:
            eventually(lambda: "running" in page_text(browser), "the run is listed as running")
            find(browser, "tbody a").click()
            find(browser, ".u-over")
            generations = ".facts div:nth-child(5) dd"

            def count_generations() -> str:
                return browser.execute_script(f"return document.querySelector('{generations}').textContent")  # type: ignore[no-any-return]

            first = count_generations()
            eventually(lambda: count_generations() != first, "it goes on")
            eventually(lambda: tab(browser, "Genes"), "the tabs are offered").click()
            canvas = find(browser, "canvas.plot")

            def last_generation() -> int:
                canvas.send_keys(Keys.ARROW_RIGHT)
                words = re.search(r"generation (\d+)", find(browser, ".words").text)
                return int(words[1]) if words else -1

            generation = last_generation()
            eventually(lambda: last_generation() > max(generation, 0), "the tab goes on, too")
        finally:
            process.kill()
            process.wait()
        eventually(lambda: find(browser, ".state").text == "killed", "that it was killed is said")


def test_an_experiment_is_written_checked_and_started(browser: Chrome, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    with window(tmp_path / "runs") as address:
        browser.get(address)
        find(browser, "header a[href='#/new']").click()
        editor = find(browser, "textarea.editor")
        eventually(lambda: "Nothing is wrong" in page_text(browser), "the template is right")
        editor.clear()
        editor.send_keys("simulation: minisim\nservers: in-process\nmethod: {population: -1, generations: 3}")
        eventually(lambda: "must be at least 2, not -1" in page_text(browser), "the mistake is told")
        assert not find(browser, "button[type=submit]").is_enabled()
        editor.clear()
        editor.send_keys("simulation: minisim\nservers: in-process\nmethod: {population: 9, generations: 3}")
        eventually(lambda: "Nothing is wrong" in page_text(browser), "it is repaired")
        name = find(browser, "input[aria-label=Name]")
        name.clear()
        name.send_keys("mine")
        find(browser, "button[type=submit]").click()
        eventually(lambda: "optimize mine.yaml" in page_text(browser), "the job is listed")
        eventually(lambda: find(browser, ".job .state").text == "done", "it is done")
        assert find(browser, ".job pre").get_attribute("textContent") == ""
        find(browser, ".job summary").click()
        eventually(
            lambda: find(browser, ".job pre").text.startswith("$ swarmwright optimize"),
            "its output is opened",
        )
    assert swarmwright.Run.open(tmp_path / "runs" / "mine").generations == 3


def test_a_mission_is_drawn_tried_saved_and_evolved_on(browser: Chrome, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    with window(tmp_path / "runs") as address:
        browser.get(address)
        find(browser, "header a[href='#/draw']").click()
        eventually(lambda: "Nothing is wrong" in page_text(browser), "a mission is opened")
        for button in browser.find_elements(By.CSS_SELECTOR, "[aria-label=Add] button"):
            if button.text == "obstacle":
                button.click()
        board = find(browser, ".board")
        ActionChains(browser).move_to_element_with_offset(board, 60, 30).click().perform()
        yaml = find(browser, "textarea")
        eventually(lambda: "obstacles" in (yaml.get_attribute("value") or ""), "the obstacle is in the text")
        before = yaml.get_attribute("value")
        ActionChains(browser).move_to_element_with_offset(board, 60, 30).click_and_hold().move_by_offset(
            -50, 0
        ).release().perform()
        eventually(lambda: yaml.get_attribute("value") != before, "the text follows the board")
        browser.execute_script("scrollTo(0, 0)")
        browser.find_element(By.XPATH, "//button[text()='Undo']").click()
        eventually(lambda: yaml.get_attribute("value") == before, "undo is told to the text")
        browser.find_element(By.XPATH, "//button[text()='Try']").click()
        browser.switch_to.frame(find(browser, "iframe"))
        eventually(lambda: "of 1199" in page_text(browser), "an episode is played")
        browser.switch_to.default_content()
        browser.find_element(By.XPATH, "//button[text()='Save']").click()
        find(browser, "a[href^='#/new?mission=']").click()
        editor = find(browser, "textarea[aria-label='Experiment (YAML)']")
        eventually(
            lambda: 'mission: "my_aggregation.yaml"' in (editor.get_attribute("value") or ""),
            "the experiment names the mission",
        )
        eventually(lambda: "Nothing is wrong" in page_text(browser), "the experiment with it is right")
    assert (tmp_path / "runs" / "my_aggregation.yaml").read_text().count("obstacles") == 1


def test_the_page_comes_back_with_the_server(browser: Chrome, folder: Path) -> None:
    with window(folder, "--read-only") as address:
        browser.get(address)
        eventually(lambda: "2 runs" in page_text(browser), "both runs are listed")
    eventually(lambda: "connection lost" in page_text(browser), "a lost connection is said")
    swarmwright.optimize(EXPERIMENT, servers="in-process", seed=3, out=folder / "run-3")
    with window(folder, port=urlsplit(address).port or 0) as again:
        assert again == address
        eventually(lambda: "3 runs" in page_text(browser), "the page comes back by itself")
