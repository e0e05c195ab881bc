"""An experiment that is made by the form, beside its YAML, in a real browser."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.select import Select

from swarmwright import Run
from tests.python.display.browser import chromium
from tests.python.ui.test_browser import eventually, find, page_text, window

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with chromium(tmp_path_factory.mktemp("browser")) as running:
        running.set_page_load_timeout(60)
        yield running


def field(browser: Chrome, path: str) -> WebElement:
    """Return the input of a field: its label is bound to it."""
    parts = path.split(".")
    key = "[" + ",".join(f'"{part}"' for part in parts) + "]"
    element = find(browser, f"[data-key='{key}']")
    label = browser.find_element(By.CSS_SELECTOR, f"label[for='{element.get_attribute('id')}']")
    assert label.get_attribute("textContent") == ".".join(parts[1:] or parts)
    return element


def message(browser: Chrome, path: str) -> str:
    described = (field(browser, path).get_attribute("aria-describedby") or "").split()[0]
    return browser.find_element(By.ID, described).text


def enter(browser: Chrome, path: str, text: str) -> None:
    element = field(browser, path)
    element.send_keys(Keys.CONTROL, "a")
    element.send_keys(text, Keys.TAB)


def start_at_once(browser: Chrome, path: str, text: str) -> None:
    """Type into a field that keeps the focus, and start in the same moment."""
    browser.execute_script(
        "const [field, text] = arguments; field.focus(); field.value = text;"
        "field.dispatchEvent(new Event('input')); document.querySelector('form').requestSubmit()",
        field(browser, path),
        text,
    )


def test_form_and_text_follow_each_other_and_a_sweep_is_started(browser: Chrome, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()

    def text() -> str:
        return find(browser, "textarea.editor").get_attribute("value") or ""

    with window(tmp_path / "runs") as address:
        browser.get(address)
        find(browser, "header a[href='#/new']").click()
        eventually(lambda: "Nothing is wrong" in page_text(browser), "the first template is right")
        Select(find(browser, "select[aria-label=Template]")).select_by_value("minisim")
        eventually(lambda: field(browser, "parameters.mapWidth").get_attribute("value") == "13", "its fields")
        comments = text().count("#")

        # The form changes the text.
        enter(browser, "method.population", "12")
        eventually(lambda: "\n  population: 12\n" in text(), "the population is in the text")
        enter(browser, "parameters.speedDefenders", "0.25")
        eventually(lambda: "\n  speedDefenders: 0.25 " in text(), "the parameter is in the text")
        enter(browser, "method.generations", "2")
        eventually(lambda: "\n  generations: 2\n" in text(), "the budget is in the text")
        enter(browser, "servers", "in-process")
        eventually(lambda: "\nservers: in-process " in text(), "the place is in the text")
        assert text().count("#") == comments

        # The text changes the form.
        editor = find(browser, "textarea.editor")
        browser.execute_script(
            "arguments[0].value = arguments[0].value.replace('[8]', '[5, 3]');"
            "arguments[0].dispatchEvent(new Event('input'))",
            editor,
        )
        eventually(lambda: field(browser, "controller.hidden").get_attribute("value") == "[5, 3]", "a list")
        editor.send_keys(Keys.CONTROL, Keys.END)
        editor.send_keys("faults: {attempts: 2")
        eventually(lambda: "shows the last text" in page_text(browser), "an unreadable text is told")
        assert field(browser, "controller.hidden").get_attribute("value") == "[5, 3]"
        editor.send_keys("}")
        eventually(lambda: field(browser, "faults.attempts").get_attribute("value") == "2", "a new section")

        # Mistakes are told at their field, and change nothing that they should not.
        before = text()
        enter(browser, "controller.hidden", "5, 3]\nmethod: [1")
        eventually(lambda: "not valid YAML" in message(browser, "controller.hidden"), "a wrong list")
        assert text() == before
        enter(browser, "controller.hidden", "5")
        eventually(lambda: "hidden: [5]" in text(), "a right one")
        enter(browser, "method.population", "1")
        eventually(lambda: "must be at least 2" in message(browser, "method.population"), "out of range")
        assert "line " in find(browser, ".problems").text
        enter(browser, "method.population", "10")
        eventually(lambda: message(browser, "method.population") == "", "it is repaired")
        enter(browser, "parameters.helloMessage", "<b>: #x")
        eventually(lambda: 'helloMessage: "<b>: #x"' in text(), "markup and YAML are text")

        # Another kind has other fields.
        Select(field(browser, "method.kind")).select_by_value("pso")
        eventually(lambda: "\n  kind: pso " in text(), "the kind is in the text")
        search = find(browser, "input[aria-label='Find a field']")
        search.send_keys("swarm moves inertia")
        eventually(
            lambda: not browser.find_elements(By.CSS_SELECTOR, ".section:not([hidden])"), "no such field"
        )
        search.send_keys(Keys.CONTROL, "a")
        search.send_keys("method.inertia")
        eventually(
            lambda: field(browser, "method.inertia").is_displayed(), "an option that is not set is shown"
        )
        search.send_keys(Keys.CONTROL, "a", Keys.DELETE)
        enter(browser, "method.generations", "2")

        # A field is varied.
        find(browser, "button[aria-label='Vary parameters.speedDefenders']").send_keys(Keys.ENTER)
        values = find(browser, "input[aria-label='Values of parameters.speedDefenders']")
        values.send_keys(Keys.CONTROL, "a")
        values.send_keys("0.1, x")
        eventually(lambda: "must be a number" in find(browser, ".sweep").text, "a wrong value is told")
        assert not find(browser, "button[type=submit]").is_enabled()
        values.send_keys(Keys.BACKSPACE, "0.3")
        find(browser, "button[aria-label='Vary parameters.helloMessage']").send_keys(Keys.ENTER)
        message_values = find(browser, "input[aria-label='Values of parameters.helloMessage']")
        assert message_values.get_attribute("value") == '"<b>: #x"'
        find(browser, "button[aria-label='Do not vary parameters.helloMessage']").click()
        focused = browser.switch_to.active_element.get_attribute("aria-label")
        assert focused == "Vary parameters.helloMessage"
        seeds = find(browser, "input[aria-label='Number of seeds']")
        seeds.send_keys(Keys.CONTROL, "a")
        seeds.send_keys("2")
        eventually(lambda: "4 runs" in find(browser, ".sweep").text, "the runs are counted")
        name = find(browser, "input[aria-label=Name]")
        name.clear()
        name.send_keys("speeds")
        eventually(lambda: find(browser, "button[type=submit]").is_enabled(), "it can be started")
        before = text()
        start_at_once(browser, "controller.hidden", "5, 3]")
        eventually(
            lambda: "controller.hidden: is not valid YAML" in find(browser, "[role=alert]").text,
            "what a field does not take is not left out",
        )
        assert browser.switch_to.active_element == field(browser, "controller.hidden")
        assert text() == before
        enter(browser, "controller.hidden", "[5]")
        eventually(lambda: find(browser, "button[type=submit]").is_enabled(), "it can be started")
        start_at_once(browser, "method.population", "11")
        assert not find(browser, "button[type=submit]").is_enabled()
        job = eventually(lambda: browser.find_element(By.CSS_SELECTOR, ".job code"), "the job is listed", 120)
        assert "sweep speeds-sweep.yaml --out speeds" in job.text
        eventually(lambda: find(browser, ".job .state").text == "done", "the sweep is done", 120)
        severe = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]  # type: ignore[no-untyped-call]
        assert [entry for entry in severe if "422" not in entry["message"]] == []
    assert "population: 11" in (tmp_path / "runs" / "speeds.yaml").read_text()
    runs = [Run(file.parent) for file in (tmp_path / "runs" / "speeds").glob("*/run.sqlite")]
    assert sorted((run.experiment.parameters["speedDefenders"], run.experiment.seed) for run in runs) == [
        (0.1, 1), (0.1, 2), (0.3, 1), (0.3, 2),
    ]  # fmt: skip
