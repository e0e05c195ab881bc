"""Placeholders in commands, environments and files: {seed}, {parameters}, {speed}, ..

Parameters come from optimization tools, which a server need not trust. Numbers and booleans are allowed
anywhere. Text could name another program, be an option, or end a string in a shell's code, so it is allowed
only where it cannot; see `Template.problem`. Therefore this module knows programs that run code from, or
programs named by, their arguments.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import lru_cache
from pathlib import PurePath
from typing import Any

from swarmwright.common.errors import InputError
from swarmwright.common.problems import format_value
from swarmwright.common.suggestions import suggest_or_list
from swarmwright.common.untrusted import leads_elsewhere

_CODE_OPTIONS = (
    (
        re.compile(r"(?:r?ba|da|a|z|k|mk|tc|c|fi|o|ya)?sh|ksh93|xonsh|nu"),
        re.compile(r"-[A-Za-z]*c[A-Za-z]*|--command.*"),
    ),
    (re.compile(r"(?:python|pypy)[\d.]*t?"), re.compile(r"-[bBdEhiIOPqsSuvx]*c.*")),
    (
        re.compile(
            r"(?:perl|ruby|lua|luajit|node|nodejs|deno|bun|Rscript|R|julia|php|groovy|scala|guile|racket|elixir|erl"
            r"|ocaml|swipl|sbcl|raku|jshell|pwsh|powershell)[\d.]*"
        ),
        re.compile(r"-[A-Za-z]*[cCeEpPrRB].*|--(?:eval|print|execute|expression|run|require|import).*|eval"),
    ),
)
"""Shells and interpreters, and their options that take code: -c, -lc, -e, -ne, --eval, .."""
_CODE = re.compile(
    r"awk|gawk|mawk|nawk|busybox|toybox|sed|gsed|find|fd|xargs|parallel|ssh|rsh|su|runuser|watch"
    r"|script|make|gmake|gdb|lldb|tmux|screen|expect|tclsh|wish|octave|octave-cli|matlab|gnuplot"
    r"|sqlite3|psql|mysql|jq|m4|ed|ex|vi|vim|nvim|emacs|git|eval"
)
"""Programs that run code from their arguments without an option, or with one of many."""
_WRAPPER = re.compile(
    r"env|timeout|nice|ionice|nohup|setsid|stdbuf|time|chrt|taskset|xvfb-run|dbus-run-session"
    r"|unbuffer|sudo|doas|strace|ltrace|numactl|prlimit|unshare|nsenter|chroot|flock|firejail|bwrap"
    r"|setarch|systemd-run|mpirun|mpiexec|srun|sbatch|perf|valgrind|docker|podman|singularity"
    r"|apptainer|conda|mamba|micromamba|uv|pixi|poetry|npx|exec|command|tini|dumb-init|gosu|setpriv"
)
"""Programs that start another program named by their arguments."""
_WRAPPED_CODE = {
    "env": re.compile(r"-[A-Za-z]*S.*|--split-string.*"),
    "flock": re.compile(r"-[A-Za-z]*c|--command.*"),
}
_FLAGS = frozenset({"-u", "-O", "-OO", "-B", "-E", "-I", "-s", "-S", "-x", "-jar", "-m", "--vanilla"})
"""Options of interpreters that may be followed by the script or module."""
_SCRIPT_SUFFIX = re.compile(r".*\.(?:py|pyz|sh|bash|R|r|pl|rb|js|mjs|cjs|lua|jl|php)")


def runs_code(words: Sequence[str]) -> str:
    """Return the program of a command that runs code from its arguments, such as `sh -c`; else ""."""
    for index, word in enumerate(words):
        name = PurePath(word).name
        if index == 0 and _CODE.fullmatch(name):
            return name
        arguments = words[index + 1 :]
        option = _WRAPPED_CODE.get(name)
        if option is None:
            option = _code_option(name)
            arguments = arguments[
                : next((at for at in range(len(arguments)) if _is_script(arguments, at)), len(arguments))
            ]
        code_option = next(
            (argument for argument in arguments if option is not None and option.fullmatch(argument)), None
        )
        if code_option is not None:
            return f"{name} {code_option.split('=')[0]}"
        if index and _CODE.fullmatch(name) and _WRAPPER.fullmatch(PurePath(words[0]).name):
            return name
    return ""


def runs_others(words: Sequence[str], before: int) -> str:
    """Return the program that might run the word at an index; "" if the word is an argument."""
    name = PurePath(words[0]).name
    if before == 0:
        return "the command"
    if _WRAPPER.fullmatch(name):
        return name
    if name != "java" and _code_option(name) is None:
        return ""
    between = words[1:before]
    has_script = any(_is_script(between, at) for at in range(len(between)))
    return "" if has_script else name


def _code_option(name: str) -> re.Pattern[str] | None:
    """Return the options of an interpreter that take code; None for other programs."""
    return next((option for programs, option in _CODE_OPTIONS if programs.fullmatch(name)), None)


def _is_script(words: Sequence[str], at: int) -> bool:
    """Return whether a word after an interpreter's name is the script or module that it runs."""
    word = words[at]
    if word.startswith("-"):
        return False
    return at == 0 or words[at - 1] in _FLAGS or _SCRIPT_SUFFIX.fullmatch(word) is not None


_NAME = r"[A-Za-z_][\w.\-/]*"
_PATTERN = re.compile(rf"\{{\{{{_NAME}\}}\}}|(?<!\$)\{{({_NAME})\}}")
"""{{name}}, which stands for {name}, or a placeholder; ${name} is a shell variable."""
IN_A_COMMAND = {
    "parameters": "the path of the parameter file",
    "controller": "the path of the controller's file",
    "weights": "the path of the file with the controller's weights",
    "log": "the path of the log",
    "folder": "the work folder",
    "build": "the folder of compiled files",
    "here": "the folder of the experiment file",
    "seed": "the episode's seed",
    "episode": "the number of the episode",
    "instance": "the number of the instance",
    "port": "a free TCP port",
}
"""Swarmwright's own placeholders in commands, and their meaning."""
_LOADS_CODE = re.compile(
    r"(?:LD_|DYLD_|PYTHON|PERL5|RUBY|NODE_|BASH_|JAVA_|_JAVA|JDK_|LUA_|JULIA_|GIT_|GCONV_|GTK_|QT_).*"
    r"|.*(?:LIBRARY|PLUGIN|PACKAGE|PREFIX|RESOURCE)\w*PATH|.*PLUGINS?|PATH|CLASSPATH|CDPATH|ZDOTDIR|ENV|IFS|PS4|HOME"
    r"|SHELL|SHELLOPTS|BASHOPTS|EDITOR|VISUAL|PAGER|BROWSER|.*_COMMAND"
)
"""Environment variables that name programs or libraries to run, or folders of these."""
_UNUSABLE = re.compile("[\0\ud800-\udfff]")
"""NUL and lone surrogates."""


class Position(Enum):
    """Position of a placeholder."""

    ARGUMENT = auto()
    """A whole word of a command."""
    PART = auto()
    """A part of a word."""
    PROGRAM = auto()
    """A word that names, or might name, the program or script."""
    CODE = auto()
    """A command whose program runs code from its arguments."""
    VARIABLE = auto()
    """An environment variable."""
    LOADER = auto()
    """An environment variable that decides what programs load or run."""
    FILE = auto()
    """A file that is copied into the work folder."""


@dataclass(frozen=True)
class Placeholder:
    """The name between braces."""

    name: str


@dataclass(frozen=True)
class Values:
    """Values of placeholders."""

    built_in: Mapping[str, object] = field(default_factory=dict)
    """Swarmwright's own values: paths, the seed, a port. They override parameters with the same names."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """Parameters of the experiment, sent by a peer."""
    choices: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    """All permitted values of a parameter, if the definition declares them."""
    declared: Mapping[str, Any] = field(default_factory=dict)
    """Parameters of the program's parameter file, with their defaults."""

    def __contains__(self, name: str) -> bool:
        return name in self.built_in or name in self.parameters

    def __or__(self, built_in: Mapping[str, object]) -> "Values":
        """Return a copy with more of Swarmwright's own values."""
        return Values({**self.built_in, **built_in}, self.parameters, self.choices, self.declared)


@dataclass(frozen=True)
class Template:
    """A parsed word, variable's value or file's text: text and placeholders."""

    parts: tuple[str | Placeholder, ...]
    where: str
    """Beginning of messages: command, environment.DISPLAY, files: world.sdf."""
    position: Position
    program: str = ""
    """For PROGRAM and CODE: the program that runs the text."""

    @property
    def names(self) -> list[str]:
        """The names of the placeholders."""
        return [part.name for part in self.parts if isinstance(part, Placeholder)]

    def fill(self, values: Values) -> str:
        """Return the text with its placeholders filled in.

        Raises InputError for a placeholder without a value, except in a file, and for text that is not
        allowed in this position.
        """
        return "".join(
            part if isinstance(part, str) else self._value(part.name, values) for part in self.parts
        )

    def check(self, values: Values) -> None:
        """Raise InputError for a parameter whose value is not allowed in this position."""
        for name in self.names:
            if name not in values.built_in and name in values.parameters:
                problem = self.problem(name, values)
                if problem is not None:
                    raise InputError(f"{name}: {problem}")

    def _value(self, name: str, values: Values) -> str:
        if name in values.built_in:
            return plain(values.built_in[name])
        if name not in values.parameters:
            if self.position is Position.FILE:
                return f"{{{name}}}"
            names = [*values.built_in, *values.parameters]
            hint = suggest_or_list(name, names)
            raise InputError(
                f"{self.where}: {{{name}}} is not a placeholder, and no parameter has this name{hint}"
            )
        problem = self.problem(name, values)
        if problem is not None:
            raise InputError(f"{name}: {problem}")
        return plain(values.parameters[name])

    def problem(self, name: str, values: Values) -> str | None:
        """Return why a parameter's value is not allowed in this position; None if it is.

        Numbers and booleans are always allowed. Text with declared choices is allowed except in code; other
        text only as an environment variable, or as a whole word if the program's parameter file declares it.
        """
        value = values.parameters[name]
        if _is_number(value):
            return None
        reason = self._reason(name, value, values)
        return (
            None if reason is None else f"{format_value(value)} found, but {self.where}: {{{name}}} {reason}"
        )

    def _reason(self, name: str, value: Any, values: Values) -> str | None:  # noqa: ANN401 - any JSON value
        if isinstance(value, str) and _UNUSABLE.search(value):
            return "cannot hold a zero byte or half a character"
        by_variable = _suggest_variable(name)
        if self.position is Position.CODE:
            return f"may only be a number, since {self.program} runs its arguments as code; {by_variable}"
        if name in values.choices:
            return (
                None if is_choice(value, values.choices[name]) else "has other choices (simulation.choices)"
            )
        if self.position is Position.VARIABLE and isinstance(value, str):
            return None
        declare = f"declare simulation.choices: {{{name}: [..]}}, all values that it may have, or "
        if not isinstance(value, str):
            return "may only be a number or text; have the program read it from the file {parameters}"
        if self.position is Position.LOADER:
            return f"decides what programs load or run; {declare}use a variable of another name"
        if self.position is Position.FILE:
            return (
                f"may only be a number, since text could change the rest of the file; {declare}have the "
                "program read it from the file {parameters}"
            )
        if self.position is Position.PART:
            return f"is part of a word, so it may only be a number; {declare}{by_variable}"
        if self.position is Position.PROGRAM:
            return f"could name what {self.program} runs; {declare}{by_variable}"
        if not isinstance(values.declared.get(name), str):
            return f"is not declared as text; {declare}{by_variable}"
        if value.startswith(("-", "@")) or ":=" in value or leads_elsewhere(value):
            return f"could be taken for an option, or for a path elsewhere; {declare}{by_variable}"
        return None


def is_choice(value: object, choices: Sequence[Any]) -> bool:
    """Return whether a value is one of several; true is not 1."""
    return any(value == choice and isinstance(value, bool) == isinstance(choice, bool) for choice in choices)


def _suggest_variable(name: str) -> str:
    variable = re.sub(r"\W", "_", name).upper()
    return (
        f'pass it as a variable, simulation.environment: {{{variable}: "{{{name}}}"}}, or in the file '
        "{parameters}"
    )


def _is_number(value: object) -> bool:
    """Return whether a value has no text of a peer: numbers, booleans, null, and lists of these."""
    if isinstance(value, list | tuple):
        return all(map(_is_number, value))
    return value is None or isinstance(value, bool | int | float)


def names_in(text: str) -> list[str]:
    """Return the names of the placeholders in a text."""
    return [match[1] for match in _PATTERN.finditer(text) if match[1] is not None]


@lru_cache(maxsize=64)
def command(words: tuple[str, ...], where: str = "command") -> tuple[Template, ...]:
    """Return the words of a command, parsed."""
    code = runs_code(words)
    templates = []
    for index, word in enumerate(words):
        parts = _parts(word)
        program = code or runs_others(words, index)
        if code:
            position = Position.CODE
        elif program:
            position = Position.PROGRAM
        else:
            position = Position.ARGUMENT if len(parts) == 1 else Position.PART
        templates.append(Template(parts, where, position, program))
    return tuple(templates)


def variable(name: str, text: str) -> Template:
    """Return the value of a variable of the environment, parsed."""
    position = Position.LOADER if _LOADS_CODE.fullmatch(name) else Position.VARIABLE
    return Template(_parts(text), f"environment.{name}", position)


def file(name: str, text: str) -> Template:
    """Return the text of a file, parsed; only known placeholders are filled in, and {{name}} stays."""
    return Template(_parts(text, keep_double=True), f"files: {name}", Position.FILE)


def _parts(text: str, *, keep_double: bool = False) -> tuple[str | Placeholder, ...]:
    parts: list[str | Placeholder] = []
    at = 0
    for match in _PATTERN.finditer(text):
        plain_text = text[at : match.start()]
        if match[1] is None:
            plain_text += match[0] if keep_double else match[0][1:-1]
        if plain_text:
            parts.append(plain_text)
        if match[1] is not None:
            parts.append(Placeholder(match[1]))
        at = match.end()
    if at < len(text):
        parts.append(text[at:])
    return tuple(parts)


def plain(value: object) -> str:
    """Return a value as programs read it: true, 0.25, text."""
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)
