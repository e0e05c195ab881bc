"""What mkdocs does to Swarmwright's pages, which are written so that a code host shows them too.

- A link that leaves docs/ leads to a page of its own, made of the file in the repository.
- Words behind a fenced block's language are for `tests/docs/test_snippets.py`; only a file's name is shown.
- Lists and tables may follow a paragraph without an empty line, which Python's Markdown asks for.
- `<!-- docstring: NAME -->` becomes what mkdocstrings makes of that name.
- The finished pages must need nothing from the network; the build fails where one does.
"""

import posixpath
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

FENCE = re.compile(r"^```(\S*)[ ]*(.*?)\n(.*?)^```[ ]*$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(\]\()([^)#\s]+)((?:#[^)\s]*)?\))")
TIGHT = re.compile(r"^(?![ |>#]|[-*] |\d+\. )(.+)\n(?=[-*] |1\. |\|)", re.MULTILINE)
DOCSTRING = re.compile(r"^<!-- docstring: (\S+) -->$", re.MULTILINE)
REPOSITORY = "repository/"
LANGUAGES = {
    ".go": "go",
    ".json": "json",
    ".mjs": "javascript",
    ".py": "python",
    ".rs": "rust",
    ".yaml": "yaml",
}
SCRIPTS = ("iframe-worker.js", "mermaid.min.js")
LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "video": "src"}
STYLE = re.compile(r"(?:url\(|@import)\s*['\"]?((?:https?:)?//[^)'\"\s]+)")


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add pages for what is linked outside docs/, and the scripts that `make docs` has fetched."""
    root = _root(config)
    known: set[str] = set()
    waiting = [f"docs/{file.src_uri}" for file in files.documentation_pages()]
    while waiting:
        origin = waiting.pop()
        for target in _outside((root / origin).read_text(encoding="utf-8"), origin, root):
            if target not in known:
                known.add(target)
                files.append(_page_of(target, config))
                waiting += [target] if target.endswith(".md") else []
    for name in SCRIPTS:
        script = root / "build" / "site-scripts" / name
        if not script.is_file():
            raise PluginError(f"{script} is missing: `make docs` fetches it")
        files.append(File.generated(config, f"assets/{name}", abs_src_path=str(script)))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrite links, fenced blocks and docstrings of a page."""
    uri = page.file.src_uri
    origin = uri.removeprefix(REPOSITORY) if uri.startswith(REPOSITORY) else f"docs/{uri}"
    if not origin.endswith(".md") or not (_root(config) / origin).is_file():
        return markdown  # made of a source file
    text, end = "", 0
    for fence in FENCE.finditer(markdown):
        text += _rewritten(markdown[end : fence.start()], uri, origin, _root(config)) + _fence(fence)
        end = fence.end()
    return text + _rewritten(markdown[end:], uri, origin, _root(config))


def on_post_page(output: str, *, page: Page, config: MkDocsConfig) -> str:
    """Load the script for diagrams where there are any, before the theme looks for it elsewhere."""
    if '<pre class="mermaid">' not in output:
        return output
    source = posixpath.relpath("assets/mermaid.min.js", posixpath.dirname(page.file.dest_uri) or ".")
    return output.replace("</head>", f'<script src="{source}"></script></head>', 1)


def on_post_template(output: str, *, template_name: str, config: MkDocsConfig) -> str:
    """Leave out the page for wrong addresses where the site's own is unknown: its links are absolute."""
    return "" if template_name == "404.html" and not config.site_url else output


def on_post_build(*, config: MkDocsConfig) -> None:
    """Fail where a page would load something from the network."""
    site = Path(config.site_dir)
    found = [
        f"{file.relative_to(site)}: {address}"
        for file in sorted(site.rglob("*"))
        if file.suffix in {".html", ".css"}
        for address in remote(file.read_text(encoding="utf-8"), file.suffix)
    ]
    if found:
        raise PluginError("pages would load from the network:\n" + "\n".join(found))


def remote(text: str, suffix: str) -> list[str]:
    """Addresses in the network from which a page or a style sheet loads something."""
    found = STYLE.findall(text)
    if suffix == ".html":
        reader = _Loads()
        reader.feed(text)
        found += reader.found
    return found


class _Loads(HTMLParser):
    """Collects what a page loads from the network; links that people may follow do not count."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        address = dict(attrs).get(LOADED.get(tag, "")) or ""
        if address.startswith(("http:", "https:", "//")) and dict(attrs).get("rel") != "canonical":
            self.found.append(address)


def _root(config: MkDocsConfig) -> Path:
    return Path(config.config_file_path).parent


def _resolved(target: str, origin: str) -> str:
    """The path in the repository to which a link of the file `origin` leads."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(origin), target))


def _outside(markdown: str, origin: str, root: Path) -> Iterator[str]:
    """Files of the repository outside docs/ to which a page links."""
    for _, target, _ in LINK.findall(FENCE.sub("", markdown)):
        path = _resolved(target, origin)
        if "://" not in target and not path.startswith(("docs/", "..")) and (root / path).is_file():
            yield path


def _uri(path: str) -> str:
    """Where the site has a file of the repository."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    return REPOSITORY + (path if path.endswith(".md") else f"{path}.md")


def _page_of(path: str, config: MkDocsConfig) -> File:
    """The page of a file outside docs/: Markdown as it is, anything else as a listing."""
    source = (_root(config) / path).read_text(encoding="utf-8")
    if not path.endswith(".md"):
        language = LANGUAGES.get(Path(path).suffix, "text")
        source = f"---\nsearch:\n  exclude: true\n---\n\n# {path}\n\n``````{language}\n{source}\n``````\n"
    return File.generated(config, _uri(path), content=source)


def _rewritten(text: str, uri: str, origin: str, root: Path) -> str:
    def link(match: re.Match[str]) -> str:
        path = _resolved(match[2], origin)
        if "://" in match[2] or path.startswith("..") or not (root / path).is_file():
            return match[0]
        return match[1] + posixpath.relpath(_uri(path), posixpath.dirname(uri) or ".") + match[3]

    return DOCSTRING.sub(_docstring, TIGHT.sub(r"\1\n\n", LINK.sub(link, text)))


def _docstring(match: re.Match[str]) -> str:
    name = match[1].removeprefix("swarmwright.")
    return f'??? abstract "`{name}`: all of its docstrings"\n\n    ::: {match[1]}\n'


def _fence(match: re.Match[str]) -> str:
    """A fenced block without what is meant for the tests."""
    words = match[2].split()
    file = next((word.removeprefix("file=") for word in words if word.startswith("file=")), "")
    head = f'{match[1]} title="{file}"' if file else match[1]
    if "output" in words:
        return f"```{{ .{match[1]} .output }}\n{match[3]}```"
    # The title says what the first line says where Markdown is shown without titles.
    text = match[3].removeprefix(f"# {file}\n").removeprefix(f"// {file}\n") if file else match[3]
    return f"```{head}\n{text}```"
