"""Views: our own, and those that other packages announce."""

import sys
from pathlib import Path

import pytest

import swarmwright
from swarmwright import InputError
from swarmwright.ui.app import create_app
from swarmwright.ui.views import load_views
from swarmwright.ui.views._base import STATIC
from tests.python.records import EXPERIMENT
from tests.python.ui.client import call

CODE = """
from pathlib import Path
from swarmwright.ui.views import View

VIEW = View(
    {name!r},
    Path(__file__).parent / "ui_plug_in_files" / "view.js",
    "Plug-in",
    tab_of=lambda run: run.generations > 1,
    answers={{{request!r}: lambda window, request: {{"runs": len(window.index._rows)}}}},
)
"""


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    site = tmp_path / "site"
    (site / "ui_plug_in_files").mkdir(parents=True)
    (site / "ui_plug_in_files" / "view.js").write_text("export function show() {}\n")
    monkeypatch.syspath_prepend(site)
    return site


def announce(site: Path, code: str, name: str = "plug_in", member: str = "VIEW") -> None:
    """Lay out an installed package that announces a view."""
    (site / "ui_plug_in.py").write_text(code)
    information = site / "ui_plug_in-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: ui_plug_in\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(f"[swarmwright.views]\n{name} = ui_plug_in:{member}\n")


@pytest.fixture(autouse=True)
def forget() -> None:
    sys.modules.pop("ui_plug_in", None)


def test_each_view_has_its_module_and_its_address() -> None:
    views = load_views()
    assert all(view.script.is_file() and view.script.parent == STATIC for view in views)
    assert len({view.name for view in views}) == len(views)


def test_a_view_of_a_package_is_served_as_a_tab(install: Path, tmp_path: Path) -> None:
    announce(install, CODE.format(name="plug_in", request="plug_in_count"))
    swarmwright.optimize(EXPERIMENT, servers="in-process", seed=1, out=tmp_path / "runs" / "run-1")
    app = create_app(tmp_path / "runs", token=None)
    views = {view["name"]: view for view in call(app, "/api/window").values["views"]}
    assert views["plug_in"]["is_tab"]
    assert call(app, f"/{views['plug_in']['script']}").body == b"export function show() {}\n"
    assert call(app, "/views/plug_in/../../ui_plug_in.py").status == 404
    assert call(app, "/api/plug_in_count").values == {"runs": 0}


@pytest.mark.parametrize(
    ("name", "code", "member", "message"),
    [
        ("plug_in", "1 / 0", "VIEW", "cannot be imported: ZeroDivisionError"),
        ("plug_in", "VIEW = 3", "VIEW", "is not a swarmwright.ui.views.View"),
        ("plug_in", CODE.format(name="other", request="x"), "VIEW", "its name is 'other'"),
        ("Plug-in", CODE.format(name="Plug-in", request="x"), "VIEW", "lower-case letters"),
        ("run", CODE.format(name="run", request="x"), "VIEW", "#/run is taken by another view"),
        ("plug_in", CODE.format(name="plug_in", request="density"), "VIEW", "/api/density is taken"),
        (
            "plug_in",
            CODE.format(name="plug_in", request="x").replace("view.js", "no.js"),
            "VIEW",
            "does not exist",
        ),
    ],
)
def test_broken_views_are_refused(install: Path, name: str, code: str, member: str, message: str) -> None:
    announce(install, code, name, member)
    with pytest.raises(InputError, match=message) as error:
        load_views()
    assert "ui_plug_in" in str(error.value)
