"""Replays in step, other parameters and exports, in a real browser."""

import time
import zipfile
from pathlib import Path

import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement

import swarmwright
from tests.python.display.browser import chromium
from tests.python.records import EXPERIMENT
from tests.python.ui.test_browser import eventually, find, page_text, window

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
SHOWN = ".panes iframe[title^='Replay of']"


def press(browser: Chrome, label: str) -> None:
    eventually(
        lambda: next(
            button for button in browser.find_elements(By.CSS_SELECTOR, "button") if button.text == label
        ),
        f"there is a button {label}",
    ).click()


def replays(browser: Chrome, count: int) -> list[WebElement]:
    eventually(lambda: len(browser.find_elements(By.CSS_SELECTOR, SHOWN)) == count, f"{count} replays")
    return browser.find_elements(By.CSS_SELECTOR, SHOWN)


def steps(browser: Chrome) -> list[str]:
    """What each replay says of its step."""
    texts = []
    for frame in browser.find_elements(By.CSS_SELECTOR, SHOWN):
        browser.switch_to.frame(frame)
        texts.append(browser.execute_script("return document.getElementById('now').textContent"))
        browser.switch_to.default_content()
    return texts


def seek(browser: Chrome, step: int) -> None:
    browser.execute_script(
        "const scrub = document.querySelector('.in-step input[type=range]');"
        "scrub.value = arguments[0]; scrub.dispatchEvent(new Event('input'));",
        step,
    )


def downloaded(folder: Path, ending: str) -> Path:
    end = time.monotonic() + 60
    while time.monotonic() < end:
        for file in folder.glob(f"*{ending}"):
            return file
        time.sleep(0.1)
    pytest.fail(f"no {ending} was downloaded: {[*folder.iterdir()]}")


def test_two_candidates_in_step_then_another_parameter_then_an_export(tmp_path: Path) -> None:
    swarmwright.optimize(EXPERIMENT, servers="in-process", seed=1, out=tmp_path / "runs" / "a <b>run")
    with chromium(tmp_path, size=(1280, 1600)) as browser, window(tmp_path / "runs") as address:
        browser.execute_cdp_cmd(
            "Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(tmp_path / "downloads")}
        )
        browser.get(address)
        find(browser, "tbody a").click()
        find(browser, ".u-over")
        for name, value in (("generation", "0"), ("candidate", "3")):
            find(browser, f"input[name={name}]").send_keys(value)
        press(browser, "Watch")
        replays(browser, 1)
        candidate = find(browser, "input[name=candidate]")
        candidate.clear()
        candidate.send_keys("4")
        press(browser, "Beside")
        replays(browser, 2)

        seek(browser, 3)
        eventually(lambda: steps(browser) == ["step 3 of 5"] * 2, "both are at one step")
        # What a frame asks for is done in all of them, and what is no message is ignored.
        browser.switch_to.frame(replays(browser, 2)[1])
        browser.execute_script(
            "for (const message of [null, 7, 'step', {}, { player: 'asks', step: '<b>' },"
            " { player: 'ready', last: 'x', stepSeconds: -1 }, { player: 'asks', step: 2 }])"
            " parent.postMessage(message, '*');"
            "window.postMessage({ step: 5, driven: false }, '*');"
        )
        browser.switch_to.default_content()
        browser.execute_script("postMessage({ player: 'asks', step: 4 }, '*')")
        eventually(lambda: steps(browser) == ["step 2 of 5"] * 2, "one asks for a step")
        press(browser, "Play")
        eventually(lambda: steps(browser) == ["step 5 of 5"] * 2, "they play to the end")

        press(browser, "What if…")
        eventually(lambda: "seeds that evolution did not use" in page_text(browser), "the means of the run")
        speed = find(browser, "[id='what-if-maxSteps']")
        speed.clear()
        speed.send_keys("9")
        replays(browser, 3)
        eventually(lambda: "what if" in find(browser, ".panel thead").text, "the means with 9 steps")
        eventually(lambda: steps(browser)[-1].endswith("of 9"), "the replay with 9 steps")

        press(browser, "Export…")
        press(browser, "Python")
        eventually(lambda: "verified" in find(browser, ".export").text, "the export is verified")
        assert "bit-identical in 10,000 random sequences" in find(browser, ".export").text
        with zipfile.ZipFile(downloaded(tmp_path / "downloads", ".zip")) as archive:
            sources = {Path(name).name: archive.read(name).decode() for name in archive.namelist()}
        assert (
            "candidate 3" in sources["controller.py"].lower()
            or "3 of generation 0" in sources["controller.py"]
        )
        press(browser, "page")
        page = downloaded(tmp_path / "downloads", ".html")
        assert page.name == "a_b_run-0-3-seed-0.html"
        assert "maxSteps 9 (in the run 5)" in page.read_text("utf-8")
        severe = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]  # type: ignore[no-untyped-call]
        assert severe == []
