"""Parameter files of irace."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmwright import Experiment, InputError
from swarmwright.controllers.kinds.parameter_set import ParameterSetOptions, irace

# The facts of ACOTSP's file in irace's package.
ACOTSP = """
# name       switch           type values               [conditions (using R syntax)]
algorithm    "--"             c    (as,mmas,eas,ras,acs)
localsearch  "--localsearch " c    (0, 1, 2, 3)
alpha        "--alpha "       r    (0.00, 5.00)
rho          "--rho  "        r,log (0.01, 1.00)
ants         "--ants "        i,log (5, 100)
q0           "--q0 "          r    (0.0, 1.0)           | algorithm == "acs"   # a comment
nnls         "--nnls "        i    (5, 50)              | localsearch %in% c(1,2,3)
mutation     "--mutation="    o    ("none", "very low", "a, b")
fixed        "--fixed "       c    ("fixed")

[forbidden]
(alpha == 0.0) & (rho == 0.5)
[global]
digits = 3
"""
LINES = [line for line in ACOTSP.splitlines() if line and not line.startswith("#")]


def test_a_file_is_read() -> None:
    content = irace.parse(ACOTSP, "parameters.txt")
    assert content.constants == {"fixed": "fixed"}
    assert content.forbidden == ["(alpha == 0.0) & (rho == 0.5)"]
    parameters = content.parameters
    assert parameters["algorithm"] == {"type": "categorical", "choices": ["as", "mmas", "eas", "ras", "acs"]}
    assert parameters["localsearch"] == {"type": "categorical", "choices": [0, 1, 2, 3]}
    assert parameters["alpha"] == {"type": "real", "range": [0.0, 5.0], "digits": 3}
    assert parameters["rho"] == {"type": "real", "range": [0.01, 1.0], "scale": "log", "digits": 3}
    assert parameters["ants"] == {"type": "integer", "range": [5, 100], "scale": "log"}
    assert parameters["q0"]["when"] == 'algorithm == "acs"'
    assert parameters["nnls"]["when"] == "localsearch %in% c(1,2,3)"
    assert parameters["mutation"] == {"type": "ordinal", "choices": ["none", "very low", "a, b"]}
    options = ParameterSetOptions.model_validate({"parameters": parameters, "forbidden": content.forbidden})
    assert len(options.parameters) == 8
    assert content.lines["parameters", "q0"] == 8
    assert content.lines["forbidden", 0] == 14


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('t-max "" i (1, 50)', "a name of letters, digits"),
        ("temp --temp i (0, 10)", "a switch in double quotes"),
        ('temp "--temp" i,lag (0, 10)', "expected a type after the switch"),
        ('temp "--temp" x (0, 10)', "the type must be r, i, c, o, r,log or i,log, not x"),
        ('temp "--temp" c,log (0, 10)', "not c,log"),
        ('temp "--temp" i c(0, 10)', "expected values in parentheses"),
        ('temp "--temp" c "a,b,c"', "expected values in parentheses"),
        ('temp "--temp" i (1,2,3)', "a number has two values"),
        ('temp "--temp" i (1.1,2.0)', "must be whole numbers"),
        ('temp "--temp" r (0, ants)', "limits cannot depend on other parameters"),
        ('temp "--temp" r (0, 1e9999)', "is not a number"),
        ('temp "--temp" i (1,10) |', "expected a condition after"),
        ('temp "--temp" i (1,10) ants < 3', "expected | and a condition"),
        ('temp "--temp" c (a,,b)', "must be separated by commas"),
        ('temp "--temp" c ()', "a value is missing"),
        ('temp "--temp" c (a) | ants > 3', "has a single value"),
        ('ants "--ants " i (1, 2)', "there are two parameters with the name ants"),
        ('temp "--temp" c (a, b' + "(" * 300, "expected values in parentheses"),
        ("x" * 30_000, "is longer than 20,000 characters"),
    ],
)
def test_wrong_lines_are_reported_with_their_number(line: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        irace.parse(f'ants "--ants " i (1, 20)\n\n{line}\n', "parameters.txt")
    assert str(error.value).startswith("parameters.txt:3: ")
    assert words in str(error.value)


@pytest.mark.parametrize("line", ["digits = 0", "digits = 16", "digits = x", "seed = 3"])
def test_wrong_global_options_are_reported(line: str) -> None:
    with pytest.raises(InputError, match=r"parameters\.txt:3: "):
        irace.parse(f'a "" r (0, 1)\n[global]\n{line}\n', "parameters.txt")


def test_many_problems_are_limited() -> None:
    with pytest.raises(InputError) as error:
        irace.parse("!\n" * 100_000, "parameters.txt")
    assert len(str(error.value).splitlines()) == 21


@given(st.text(alphabet="ab1 \"'()|,.cirolg[]#=\n%-", max_size=80), st.integers(0, len(LINES)))
def test_any_text_is_read_or_refused(text: str, line: int) -> None:
    for whole in (text, "\n".join([*LINES[:line], text, *LINES[line:]])):
        try:
            content = irace.parse(whole, "parameters.txt")
        except InputError:
            continue
        assert content.parameters


FILE = """
evasion          "" c (away, left, right)
avoidance        "" r (0, 5) | evasion != "away"
avoidanceRadius  "" r,log (0.5, 8)
steering         "" c (rule)
[forbidden]
avoidance < 2 & avoidanceRadius < 2
"""
EXPERIMENT = """
simulation: minisim
parameters: {placement: random, numAgents: 3}
controller: {kind: parameter_set, file: tuned/parameters.txt}
method: {kind: de, population: 10, generations: 3}
"""


def write(folder: Path, text: str = FILE, experiment: str = EXPERIMENT) -> Path:
    (folder / "tuned").mkdir()
    (folder / "tuned" / "parameters.txt").write_text(text)
    file = folder / "experiment.yaml"
    file.write_text(experiment)
    return file


def test_an_experiment_names_a_file(tmp_path: Path) -> None:
    experiment = Experiment.load(write(tmp_path))
    options = experiment.controller
    assert isinstance(options, ParameterSetOptions)
    assert [*options.parameters] == ["evasion", "avoidance", "avoidanceRadius"]
    assert options.forbidden == ["avoidance < 2 & avoidanceRadius < 2"]
    assert options.file is None
    assert experiment.parameters["steering"] == "rule"
    copy = tmp_path / "copy.yaml"
    experiment.save(copy)
    assert Experiment.load(copy) == experiment


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (FILE + "avoidanc > 1\n", r"parameters.txt:8: there is no parameter 'avoidanc'; did you mean"),
        (FILE.replace("(0, 5)", "(5, 0)"), r"parameters.txt:3: must be \[lowest, highest\]"),
        (FILE.replace('"away"', '"far"'), r"parameters.txt:3: 'far' is not a choice of evasion"),
        (FILE + "[global]\ndigits = 99\n", "parameters.txt:9: digits must be from 1 to 15"),
        (FILE.replace("r,log (0.5", "r,log (0"), "parameters.txt:4: log needs a range above 0"),
        (FILE.replace("c (away", "q (away"), "parameters.txt:2: the type must be"),
        ("", "has no parameter"),
        ("\x00\xff", "parameters.txt:1: expected a name"),
        ("#" * (2 << 20), "1 MB|larger|bytes"),
    ],
)
def test_problems_of_a_file_have_its_line(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words) as error:
        Experiment.load(write(tmp_path, text))
    assert "experiment.yaml:" in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_unknown_parameters_have_their_line(tmp_path: Path) -> None:
    text = FILE.replace("steering ", "stearing ").replace("avoidance ", "avoidanze ")
    with pytest.raises(InputError, match=r"parameters\.txt:3: unknown parameter of minisim") as error:
        Experiment.load(write(tmp_path, text))
    assert "parameters.stearing: " in str(error.value)
    assert "parameters.txt:5: unknown parameter of minisim; did you mean 'steering'?" in str(error.value)


def test_a_missing_file_and_further_keys_are_reported(tmp_path: Path) -> None:
    file = write(tmp_path)
    file.write_text(EXPERIMENT.replace("parameters.txt", "parameter.txt"))
    with pytest.raises(InputError, match=r"parameter\.txt: cannot be read; did you mean 'parameters\.txt'"):
        Experiment.load(file)
    file.write_text(EXPERIMENT.replace("parameters.txt}", "parameters.txt, forbidden: []}"))
    with pytest.raises(InputError, match=r"controller\.file: cannot be combined with forbidden"):
        Experiment.load(file)
    file.write_text(EXPERIMENT.replace(", file: tuned/parameters.txt", ""))
    with pytest.raises(InputError, match=r"controller\.parameters: is missing"):
        Experiment.load(file)
