"""Programs that run what their arguments hold or name, so that text among these would decide what is run."""

import re
from collections.abc import Sequence
from pathlib import PurePath

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
"""Shells and interpreters, and their options that are followed by code: -c, -lc, -e, -ne, --eval, .."""
_CODE = re.compile(
    r"awk|gawk|mawk|nawk|busybox|toybox|sed|gsed|find|fd|xargs|parallel|ssh|rsh|su|runuser|watch"
    r"|script|make|gmake|gdb|lldb|tmux|screen|expect|tclsh|wish|octave|octave-cli|matlab|gnuplot"
    r"|sqlite3|psql|mysql|jq|m4|ed|ex|vi|vim|nvim|emacs|git|eval"
)
"""Programs that run code from their arguments without an option that says so, or by one of many."""
_WRAPPER = re.compile(
    r"env|timeout|nice|ionice|nohup|setsid|stdbuf|time|chrt|taskset|xvfb-run|dbus-run-session"
    r"|unbuffer|sudo|doas|strace|ltrace|numactl|prlimit|unshare|nsenter|chroot|flock|firejail|bwrap"
    r"|setarch|systemd-run|mpirun|mpiexec|srun|sbatch|perf|valgrind|docker|podman|singularity"
    r"|apptainer|conda|mamba|micromamba|uv|pixi|poetry|npx|exec|command|tini|dumb-init|gosu|setpriv"
)
"""Programs that start the one that their arguments name."""
_WRAPPED_CODE = {
    "env": re.compile(r"-[A-Za-z]*S.*|--split-string.*"),
    "flock": re.compile(r"-[A-Za-z]*c|--command.*"),
}
_FLAGS = frozenset({"-u", "-O", "-OO", "-B", "-E", "-I", "-s", "-S", "-x", "-jar", "-m", "--vanilla"})
"""Options of interpreters behind which the script or module stands."""
_SCRIPT_SUFFIX = re.compile(r".*\.(?:py|pyz|sh|bash|R|r|pl|rb|js|mjs|cjs|lua|jl|php)")


def runs_code(words: Sequence[str]) -> str:
    """Return the program of a command that runs code from its arguments, such as `sh -c`, or ""."""
    for index, word in enumerate(words):
        name = PurePath(word).name
        if index == 0 and _CODE.fullmatch(name):
            return name
        after = words[index + 1 :]
        option = _WRAPPED_CODE.get(name)
        if option is None:
            option = _code_option(name)
            after = after[: next((at for at in range(len(after)) if _is_script(after, at)), len(after))]
        found = next((one for one in after if option is not None and option.fullmatch(one)), None)
        if found is not None:
            return f"{name} {found.split('=')[0]}"
        if index and _CODE.fullmatch(name) and _WRAPPER.fullmatch(PurePath(words[0]).name):
            return name
    return ""


def runs_others(words: Sequence[str], before: int) -> str:
    """Return the program that might run what the word at an index names, or "" for an argument."""
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
    """Return which options of a program are followed by code; None for one that is no interpreter."""
    return next((option for programs, option in _CODE_OPTIONS if programs.fullmatch(name)), None)


def _is_script(words: Sequence[str], at: int) -> bool:
    """Return whether a word behind an interpreter's name is the script or module that it runs."""
    word = words[at]
    if word.startswith("-"):
        return False
    return at == 0 or words[at - 1] in _FLAGS or _SCRIPT_SUFFIX.fullmatch(word) is not None
