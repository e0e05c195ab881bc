"""XML with line numbers, read without external access and with bounded memory.

An external DTD is not fetched. Declarations in an internal DTD are refused: entities, which expand to text of
any length, and default attributes, which every element then has.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from swarmwright.common.errors import InputError
from swarmwright.common.files import first_character_of, read_contents

_MOST_NODES = 2_000_000
"""Largest number of elements and attributes of a file; each takes about 400 bytes."""
_DEEPEST_NESTING = 50
"""Largest number of nesting levels."""


@dataclass
class Element:
    """An element: position, name, attributes, children and text."""

    file: str
    line: int
    tag: str
    attributes: dict[str, str]
    children: list["Element"] = field(default_factory=list)
    text: str = ""

    def error(self, message: str) -> InputError:
        """Return an error on this element, for the caller to raise."""
        return InputError(f"{self.file}:{self.line}: <{self.tag}>: {message}")

    def find_all(self, tag: str) -> list["Element"]:
        """Return the children with this name."""
        return [child for child in self.children if child.tag == tag]

    def find_one(self, tag: str) -> "Element":
        """Return the only child with this name; raise InputError unless there is exactly one."""
        matches = self.find_all(tag)
        if len(matches) != 1:
            raise self.error(f"{len(matches) or 'no'} <{tag}> inside; expected one")
        return matches[0]

    def attribute(self, name: str) -> str:
        """Return an attribute; raise InputError if it is missing."""
        if name not in self.attributes:
            raise self.error(f"the attribute {name} is missing")
        return self.attributes[name]

    def walk(self) -> Iterator["Element"]:
        """Yield this element and all descendants, in the file's order."""
        yield self
        for child in self.children:
            yield from child.walk()


class _RootFoundError(Exception):
    """The root element has begun."""


class _Builder:
    def __init__(self, name: str, most: int, deepest: int) -> None:
        self.name, self.most, self.deepest = name, most, deepest
        self.open: list[Element] = []
        self._texts: list[list[str]] = []
        self._count = 0
        self.root: Element | None = None
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.parser.EntityDeclHandler = self._refuse_entity
        self.parser.SkippedEntityHandler = self._refuse_entity
        self.parser.AttlistDeclHandler = self._refuse_attribute
        # Without a handler for external entities, expat ignores the DTD and its declarations.
        self.parser.SetParamEntityParsing(expat.XML_PARAM_ENTITY_PARSING_NEVER)

    def begin(self, tag: str, attributes: dict[str, str]) -> None:
        """Store the root element, and stop reading."""
        self.root = Element(self.name, self.parser.CurrentLineNumber, tag, attributes)
        raise _RootFoundError

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        element = Element(self.name, self.parser.CurrentLineNumber, tag, attributes)
        self._count += 1 + len(attributes)
        if self._count > self.most:
            raise element.error(f"the file has more than {self.most} elements and attributes")
        if len(self.open) >= self.deepest:
            raise element.error(f"nested more than {self.deepest} deep")
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)
        self._texts.append([])

    def _end(self, _tag: str) -> None:
        self.open.pop().text = "".join(self._texts.pop())

    def _text(self, text: str) -> None:
        self._texts[-1].append(text)

    def _refuse_attribute(self, element: str, attribute: str, *_rest: object) -> None:
        line = self.parser.CurrentLineNumber
        raise InputError(
            f"{self.name}:{line}: declares the attribute {attribute} of <{element}> in a DTD, which is not "
            "supported; write the attribute where it is used"
        )

    def _refuse_entity(self, entity: str, *_rest: object) -> None:
        line = self.parser.CurrentLineNumber
        raise InputError(
            f"{self.name}:{line}: uses the entity {entity} of a DTD, which is not supported; write its text"
        )


class _Counter(_Builder):
    """Keeps only the open elements, without their content."""

    def __init__(self, name: str, most: int, deepest: int) -> None:
        super().__init__(name, most, deepest)
        self.parser.CommentHandler = self._count_node
        self.parser.ProcessingInstructionHandler = self._count_node

    def _end(self, tag: str) -> None:
        super()._end(tag)
        if self.open:
            self.open[-1].children.clear()

    def _text(self, text: str) -> None:
        """Ignore the text."""

    def _count_node(self, *_: object) -> None:
        self._count += 1


def check(data: bytes, name: str, most: int, deepest: int) -> None:
    """Check XML before other parsers read it, which keep all of it and may expand or fetch entities.

    Args:
        data: the file's content.
        name: name of the file, for messages.
        most: largest number of elements, attributes, comments and processing instructions.
        deepest: largest number of nesting levels.

    Raises InputError, with file and line, for invalid or too large files, and for declarations in a DTD.
    """
    _feed(_Counter(name, most, deepest), data)


def read(path: Path) -> Element:
    """Return the root element of an XML file.

    Raises InputError, with file and line, if it cannot be read or is not valid XML.
    """
    builder = _parse(path)
    assert builder.root is not None  # expat requires a root
    return builder.root


def root_of(path: Path) -> Element:
    """Return the root element of an XML file without its content, which need not be valid.

    Raises InputError, with file and line, if the file cannot be read or has no root.
    """
    root = _parse(path, stop=True).root
    assert root is not None  # as above
    return root


def _parse(path: Path, *, stop: bool = False) -> _Builder:
    """Read a file, and return the builder; stop: only up to the start of the root element."""
    data = read_contents(path)
    first = first_character_of(data)
    if first not in {"", "<"}:
        raise InputError(f"{path}: is not XML, which begins with '<', not with {first!r}")
    builder = _Builder(str(path), _MOST_NODES, _DEEPEST_NESTING)
    if stop:
        builder.parser.StartElementHandler = builder.begin
    with suppress(_RootFoundError):
        _feed(builder, data)
    return builder


def _feed(builder: _Builder, data: bytes) -> None:
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.errors.messages[error.code]
        raise InputError(f"{builder.name}:{error.lineno}: is not valid XML: {reason}") from None
    except (LookupError, ValueError) as error:  # an unknown encoding
        raise InputError(f"{builder.name}:1: is not valid XML: {error}") from None
