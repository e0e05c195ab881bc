"""Servers, frames, proxies and passwords in a real browser."""

import contextlib
import http.server
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By

import swarmwright
from swarmwright import Run, _engine
from tests.conftest import free_port
from tests.python.display.browser import chromium
from tests.python.ui.test_browser import eventually, find, page_text, window
from tests.python.ui.test_server import PASSWORD, serving

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

NGINX = """\
daemon off;
pid nginx.pid;
error_log error.log;
events {{}}
http {{
  access_log off;
  client_body_temp_path body; proxy_temp_path proxy; fastcgi_temp_path f; uwsgi_temp_path u; scgi_temp_path s;
  server {{
    listen 127.0.0.1:{port};
    location /swarm/ {{
      proxy_pass http://127.0.0.1:{window}/;
      proxy_set_header Host $http_host;
      proxy_set_header X-Forwarded-Proto $scheme;
      proxy_buffering off;
    }}
  }}
}}
"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with chromium(tmp_path_factory.mktemp("browser"), "ignore-certificate-errors") as running:
        running.set_page_load_timeout(60)
        yield running


def click(browser: Chrome, name: str) -> None:
    eventually(lambda: browser.find_element(By.XPATH, f"//button[text()='{name}']"), name).click()


def fill(browser: Chrome, selector: str, text: str) -> None:
    field = find(browser, selector)
    field.clear()
    field.send_keys(text)


def test_a_run_on_servers_that_were_started_from_the_window(browser: Chrome, tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    broker = f"mqtt://127.0.0.1:{free_port()}"
    with window(tmp_path / "runs", "--broker", broker) as address:
        browser.get(address)
        find(browser, "header a[href='#/servers']").click()
        eventually(
            lambda: "no broker answers" in page_text(browser).lower(), "that there is no broker is told"
        )
        click(browser, "Start a broker here")
        eventually(lambda: "No server has announced itself" in page_text(browser), "the broker is there")
        fill(browser, "input[aria-label=Simulation]", "nonsense")
        click(browser, "Start")
        eventually(lambda: "unknown simulation 'nonsense'" in page_text(browser), "a mistake is told")
        fill(browser, "input[aria-label=Simulation]", "minisim")
        fill(browser, "input[aria-label='Number of servers']", "2")
        click(browser, "Start")
        ready = ".servers .state.ready"
        eventually(lambda: len(browser.find_elements(By.CSS_SELECTOR, ready)) == 2, "two servers are ready")

        text = f"simulation: minisim\\nbroker: {broker}\\nmethod: {{population: 200, generations: 20000}}\\n"
        start = f"""
            fetch('api/start', {{method: 'POST', headers: {{'Content-Type': 'application/json'}},
                body: JSON.stringify({{name: 'mine', seeds: [], text: '{text}'}})}})
        """
        browser.execute_script(start)
        eventually(
            lambda: any("mine" in row.text for row in browser.find_elements(By.CSS_SELECTOR, ".servers tr")),
            "what they work for is told",
        )
        find(browser, "header a[href='#/jobs']").click()
        eventually(lambda: "optimize mine.yaml" in page_text(browser), "the run is a job")
        eventually(lambda: Run(tmp_path / "runs" / "mine").state == "done", "it is done", 120)
        assert {share.server for share in Run(tmp_path / "runs" / "mine").servers() if share.evaluations} != {
            -1
        }

        find(browser, "header a[href='#/servers']").click()
        eventually(lambda: "last: mine" in page_text(browser), "what they did is told")
        for _ in range(2):  # the servers, which are the newest, then the broker
            before = len(browser.find_elements(By.XPATH, "//button[text()='Stop']"))
            click(browser, "Stop")
            eventually(
                lambda: len(browser.find_elements(By.XPATH, "//button[text()='Stop']")) < before,  # noqa: B023
                "it is stopped",
            )
        eventually(lambda: "is lost" in page_text(browser), "all have ended")
        severe = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]  # type: ignore[no-untyped-call]
        assert severe == []


@contextlib.contextmanager
def notebook(frame: str) -> Iterator[int]:
    """Serve a page of another port that has a frame."""

    class Page(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(f"<!doctype html><title>Notebook</title>{frame}".encode())

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_port
        server.shutdown()


def test_a_notebook_shows_a_run_in_a_frame(browser: Chrome, two_runs: Path) -> None:
    shown = Run(two_runs / "run-1").ui()
    by_cookie = f'<iframe src="{shown.address.replace("127.0.0.1", "localhost")}"></iframe>'
    refusing = swarmwright.ui.show(two_runs / "run-1", frame_ancestors="https://hub.example")
    try:
        by_path = shown._repr_html_()
        # For the first host, the frame is on another site, which has no cookies.
        for host, frame in (("localhost", by_path), ("127.0.0.1", by_path), ("localhost", by_cookie)):
            with notebook(frame) as other:
                browser.get(f"http://{host}:{other}/")
                browser.switch_to.frame(find(browser, "iframe"))
                eventually(lambda: find(browser, "#connection").text == "live", "the window is live")
                find(browser, ".u-over")
                find(browser, ".facts")
                eventually(
                    lambda: browser.find_element(By.XPATH, "//button[contains(., 'the best')]"), "a replay"
                ).click()
                browser.switch_to.frame(find(browser, "iframe"))
                eventually(
                    lambda: "candidate" in page_text(browser), "a candidate is played in a frame of the frame"
                )
                browser.switch_to.default_content()
        with notebook(refusing._repr_html_()) as other:
            browser.get(f"http://localhost:{other}/")
            browser.switch_to.frame(find(browser, "iframe"))
            assert "Swarmwright" not in browser.title + page_text(browser)
            browser.switch_to.default_content()
    finally:
        shown.close()
        refusing.close()


def test_it_works_below_the_path_of_a_proxy(browser: Chrome, two_runs: Path, tmp_path: Path) -> None:
    program = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
    assert program, "nginx is missing; `make test-peers` installs it"
    with serving(two_runs) as served:
        port = free_port()
        (tmp_path / "nginx.conf").write_text(NGINX.format(port=port, window=served.port))
        proxy = subprocess.Popen(
            [program, "-p", str(tmp_path), "-c", str(tmp_path / "nginx.conf")], stderr=subprocess.DEVNULL
        )
        try:
            base = f"http://127.0.0.1:{port}/swarm/"

            def is_opened() -> bool:
                browser.get(f"{base}?token={served.token}")
                return True

            eventually(is_opened, "the proxy answers")
            eventually(lambda: "2 runs" in page_text(browser), "the runs are listed")
            assert browser.current_url == base
            [cookie] = [each for each in browser.get_cookies() if each["path"] != "/"]
            assert (cookie["path"], cookie["httpOnly"], cookie["sameSite"]) == ("/swarm", True, "Strict")
            status = """
                const [name, done] = arguments;
                fetch('api/' + name, {method: 'POST', headers: {'Content-Type': 'application/json'},
                    body: JSON.stringify({job: 'x'})}).then((answer) => done(answer.status))
            """
            assert browser.execute_async_script(status, "stop") == 422, "what changes something gets through"
            find(browser, "tbody a").click()
            find(browser, ".u-over")
        finally:
            proxy.terminate()
            proxy.wait(10)


def test_a_password_is_asked_for(browser: Chrome, two_runs: Path, tmp_path: Path) -> None:
    _, _, certificate, key = _engine.certificates(["localhost"], 2)
    for name, text in (("password", f"{PASSWORD}\n"), ("certificate", certificate), ("key", key)):
        (tmp_path / name).touch(0o600)
        (tmp_path / name).write_text(text)
    files = {"password_file": tmp_path / "password", "certificate": tmp_path / "certificate"}
    with serving(two_runs, host="0.0.0.0", key=tmp_path / "key", **files) as served:
        browser.get(f"https://localhost:{served.port}/")
        fill(browser, "input[type=password]", "battery staple")
        click(browser, "Log in")
        eventually(lambda: "That is not the password." in page_text(browser), "a wrong one is refused")
        fill(browser, "input[type=password]", PASSWORD)
        click(browser, "Log in")
        eventually(lambda: "2 runs" in page_text(browser), "the runs are listed")
        # Cookies of the other windows on this host are there, too.
        [cookie] = [each for each in browser.get_cookies() if each["name"] == f"swarmwright-{served.port}"]
        assert (cookie["secure"], cookie["httpOnly"], cookie["sameSite"]) == (True, True, "Strict")
