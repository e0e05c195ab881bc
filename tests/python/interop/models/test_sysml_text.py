"""SysML v2's and KerML's textual notation: what is one statement, and what is wrong with a text."""

import time
from contextlib import suppress
from pathlib import Path

import pytest

from swarmwright import InputError
from swarmwright.interop import models
from swarmwright.interop.models._sysml_text import Statement, parse_statements

AGENT = "part def Agent { in near; out turn; } part agents : Agent[3];"
MANY = 10_000


def many(line: str) -> str:
    return "".join(line.replace("N", str(index)) for index in range(MANY))


def shown(found: list[Statement]) -> list[object]:
    """Statements as their words in one line, bodies as lists behind them; results begin with =>."""
    result: list[object] = []
    for one in found:
        result.append("=> " * one.is_result + " ".join(word.text for word in one.words))
        if one.body is not None:
            result.append(shown(one.body))
    return result


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("//* a note\npart a; */ part b; // part c;\n///* part d;\n//", ["part b"]),
        ("/* a comment */ part /* and another */ a;;", ["part a"]),
        ("doc /* x; { */ part a { doc Name /* y */ }", ["doc", "part a", ["doc Name"]]),
        ("comment c about a, b locale \"en\" /* x */ rep r language \"ocl\" /* y */ language \"z\" /* z */",
         ['comment c about a , b locale "en"', 'rep r language "ocl"', 'language "z"']),
        ("private doc /* x */ locale \"de\" /* y */", ["private doc", 'locale "de"']),
        ("constraint { a <= 3 }", ["constraint", ["=> a <= 3"]]),
        ("calc def F { in x; return y; if x > 0 ? x else -x }",
         ["calc def F", ["in x", "return y", "=> if x > 0 ? x else - x"]]),
        ("attribute n = list->collect {in x; x + 1}->size();",
         ["attribute n = list -> collect { in x ; x + 1 } -> size ( )"]),
        ("constraint { a->forAll {in p : P { doc /* d */ } p > 0} and b.?{in q; q} }",
         ["constraint", ["=> a -> forAll { in p : P { doc } p > 0 } and b .? { in q ; q }"]]),
        ("attribute f = {in x; x} ;", ["attribute f = { in x ; x }"]),
        ("action { if a->size() > 1 { part b; } else { part c; } }",
         ["action", ["if a -> size ( ) > 1", ["part b"], "else", ["part c"]]]),
        ("part <s> 'a \\'b;' { } part d { }", ["part < s > 'a \\'b;'", [], "part d", []]),
        ("import A::*; import B::**; import C::*::**[@D];",
         ["import A :: *", "import B :: **", "import C :: * :: ** [ @ D ]"]),
        ("attribute r = 1..5; attribute s = .5e3;", ["attribute r = 1 .. 5", "attribute s = .5e3"]),
        ('attribute t = "a \\" ; }";', ['attribute t = "a \\" ; }"']),
        ("", []),
    ],
)  # fmt: skip
def test_statements(text: str, expected: list[object]) -> None:
    assert shown(parse_statements(text, Path("x.sysml"))) == expected


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("part a {\n  part b;\n", "1:8", "'{' is not closed"),
        ("part a;\n }", "2:2", "'}' has no opening bracket"),
        ("part a {\n part b[3; }", "2:12", "'}' found, expected ']' for '[' in line 2"),
        ("part a\n//* part b; *", "2:1", "a note is not closed"),
        ("part a; /* part b; *", "1:9", "a comment is not closed"),
        ('attribute a = "x;\n";', "1:15", "a text is not closed"),
        ("part 'a;\n", "1:6", "a name in quotation marks is not closed"),
        ("part a; part b", "1:14", "';' is missing after 'b'"),
        ("part a { attribute b = 5 }", "1:24", "';' is missing after '5'"),
        ("constraint { attribute b }", "1:24", "';' is missing after 'b'"),
        ("calc { b = 5 }", "1:12", "';' is missing after '5'"),
        ("part a { b }", "1:10", "';' is missing after 'b'"),
        ("part a { doc }", "1:10", "'doc' must be followed by a comment"),
        ("part a \\ b;", "1:8", r"'\\' is unexpected"),
        ("part a { " * 60 + "}" * 60, "1:458", "nesting is deeper than 50 levels"),
        ("attribute a = " + "(" * 60, "1:65", "nesting is deeper than 50 levels"),
    ],
)
def test_what_is_wrong_is_told_with_line_and_column(text: str, place: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_statements(text, Path("x.sysml"))
    assert str(caught.value).startswith(f"x.sysml:{place}: is not valid SysML: {words}")


def test_words_of_kerml_are_names_in_sysml() -> None:
    (found,) = parse_statements("class step;", Path("x.kerml"))
    assert [word.kind for word in found.words] == ["keyword", "keyword"]
    (found,) = parse_statements("part step;", Path("x.sysml"))
    assert [word.kind for word in found.words] == ["keyword", "name"]


@pytest.mark.parametrize("suffix", [".sysml", ".kerml"])
def test_what_is_not_taken_is_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"x{suffix}"
    path.write_text("class A;\nrequirement def R { doc /* d */ subject s; a > 3 }\n")
    with pytest.raises(InputError, match="has no agents"):
        models.load([path], simulation="elsewhere")
    path = tmp_path / "escape.sysml"
    path.write_text(
        "package Minisim {\n//* attribute numDefenders = 9;\n*/ attribute maxSteps = 15 { attribute unit; }\n"
        "constraint short { maxSteps <= 30 }\nenum def Colour { red; }\nitem fuel;\n"
        "@Safety { isMandatory = true; }\n"
        "perform action go;\nstate def S;\n"
        "part def Agent { in goal_x; in goal_y; in defender_x; in defender_y; out heading; }\n"
        "part agents : Agent[3]; }"
    )
    imported = models.load([path])
    assert imported.experiment.parameters == {"maxSteps": 15, "numAgents": 3}
    (note,) = imported.notes
    assert note == (
        f"{path}: not imported, including their content: attribute unit in line 3, constraint short in line "
        "4, enum def Colour in line 5, item fuel in line 6, metadata Safety in line 7, perform go in line 8, "
        "state def S in line 9"
    )


def test_of_many_elements_that_are_not_taken_the_first_are_named(tmp_path: Path) -> None:
    path = tmp_path / "x.sysml"
    path.write_text("".join(f"action a{index};\n" for index in range(130)) + AGENT)
    notes = models.load([path], simulation="elsewhere").notes
    assert any(note.endswith("action a99 in line 100, 30 more") for note in notes)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"attribute a = {'9' * 5000}; {AGENT}", "1: attribute a: its value must be a finite number"),
        (f"attribute a = 1e999; {AGENT}", "1: attribute a: its value must be a finite number"),
        (f"attribute action = 5; {AGENT}", "has a value, but no name; quote the reserved word: 'action'"),
        (f"part def A {{ in x[{'9' * 5000}]; out y; }} part agents : A[3];", "its multiplicity is 999"),
        ("".join(f"part def A{n} :> A{n + 1};" for n in range(3000)) + "part a : A0[3];",
         "1: part A100: inherits through more than 100 steps"),
        ("port def D { in z[10000]; } part def A { port p : D[10000]; out y; } part a : A[3];",
         "all parts together have more than 1000000 directed features"),
        (f"part agents : {'A::' * 5000}A[3];", "A::A::A::A::A::A::A::A::A::A::.. is not defined"),
    ],
)  # fmt: skip
def test_values_and_chains_without_end_are_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "x.sysml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        models.load([path], simulation="elsewhere")
    assert words in str(caught.value)
    assert len(str(caught.value)) < 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "part " + "a " * 20 * MANY + ";",
        "part a; //* */ /* */" * MANY,
        "attribute a = " + "b." * 20 * MANY + "c;",
        "attribute a = b" + "->c{d}" * MANY + ";",
        "public " * 20 * MANY + "part a;",
        many("package QN {} import QN::*; part pN : XN;") + AGENT,
        many("package QN { part def R { in x; } } part pN : R[2];"),
        many("part aN : B;") + AGENT,
        "".join(
            f"part def B{n} :> B{n + 1}, C{n + 1}; part def C{n} :> B{n + 1}, C{n + 1};" for n in range(60)
        )
        + "part def B60 { in x; } part def C60; part a : B0[2];",
    ],
    ids=range(9),
)
def test_time_grows_with_the_size_alone(text: str, tmp_path: Path) -> None:
    path = tmp_path / "x.sysml"
    path.write_text(text)
    before = time.process_time()
    with suppress(InputError):
        models.load([path], simulation="elsewhere")
    assert time.process_time() - before < 20  # without limits, minutes and more
