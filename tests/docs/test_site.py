"""What mkdocs makes of pages that are written for a code host too, and what it refuses."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = """# Small

Links: [security](../SECURITY.md#limits), [a schema](../protocol/small.json), [the second part](#second-part).
A list without an empty line before it:
- first
- second

## Second part

```yaml file=small.yaml
# small.yaml
simulation: minisim
```

```bash background ready="listens on"
swarmwright broker
```

```text output
listens
```

```mermaid
flowchart LR
    a --> b
```

<!-- docstring: small.add -->
"""

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mkdocs") is None, reason="needs `pip install --group docs`"
)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A repository with one page, the hooks and the settings of this one."""
    shutil.copytree(ROOT / "docs" / "site", tmp_path / "docs" / "site")
    files = {
        "docs/index.md": PAGE,
        "SECURITY.md": "# Security\n\nBack to [the page](docs/index.md).\n\n## Limits\n\n64 MiB.\n",
        "protocol/small.json": '{"title": "Small"}\n',
        "python/small.py": '"""Small."""\n\n\ndef add(a: int, b: int) -> int:\n    """Add two numbers."""\n',
        "build/site-scripts/mermaid.min.js": "mermaid = {}\n",
        "build/site-scripts/iframe-worker.js": "\n",
        "mkdocs.yml": f"INHERIT: {ROOT / 'mkdocs.yml'}\nnav: [index.md, repository/SECURITY.md]\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def build(project: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict"], cwd=project, capture_output=True, text=True,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, timeout=50, check=False,
    )  # fmt: skip


def test_the_site_has_what_a_code_host_shows(project: Path) -> None:
    made = build(project)
    assert made.returncode == 0, made.stdout + made.stderr
    site = project / "build" / "site"
    page = (site / "index.html").read_text(encoding="utf-8")
    assert 'href="repository/SECURITY.html#limits"' in page
    assert 'href="repository/protocol/small.json.html"' in page
    assert 'href="../index.html"' in (site / "repository" / "SECURITY.html").read_text(encoding="utf-8")
    assert "Small" in (site / "repository" / "protocol" / "small.json.html").read_text(encoding="utf-8")
    assert "<li>first</li>" in page
    assert '<span class="filename">small.yaml</span>' in page
    assert page.count("small.yaml") == 1, "the title only"
    assert "ready=" not in page
    assert 'class="output' in page or "output highlight" in page
    assert '<script src="assets/mermaid.min.js"></script></head>' in page
    assert "Add two numbers." in page
    assert not (site / "site").exists()
    assert not (site / "404.html").exists(), "it finds its styles at the root of a server alone"


@pytest.mark.parametrize(
    ("file", "addition", "complaint"),
    [
        ("docs/index.md", "\n[gone](gone.md)\n", "gone.md"),
        ("docs/index.md", "\n[gone](../gone.rs)\n", "gone.rs"),
        ("docs/index.md", "\n[gone](#third-part)\n", "third-part"),
        ("docs/index.md", "\n[gone](../SECURITY.md#third-part)\n", "third-part"),
        ("docs/orphan.md", "# Orphan\n", "orphan.md"),
        ("docs/index.md", "\n<!-- docstring: small.gone -->\n", "small.gone"),
        (
            "docs/index.md",
            '\n<img src="https://example.org/a.png">\n',
            "index.html: https://example.org/a.png",
        ),
        (
            "docs/site/theme/assets/site.css",
            '\n@import "https://example.org/a.css";\n',
            "assets/site.css: https://example.org/a.css",
        ),
    ],
)
def test_what_is_wrong_fails_the_build(project: Path, file: str, addition: str, complaint: str) -> None:
    with (project / file).open("a", encoding="utf-8") as page:
        page.write(addition)
    made = build(project)
    assert made.returncode != 0
    assert complaint in made.stdout + made.stderr


def test_without_the_scripts_it_says_how_to_get_them(project: Path) -> None:
    (project / "build" / "site-scripts" / "mermaid.min.js").unlink()
    made = build(project)
    assert made.returncode != 0
    assert "mermaid.min.js is missing: `make docs` fetches it" in made.stdout + made.stderr
