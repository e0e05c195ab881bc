"""Every component conforms, and other packages can add theirs."""

import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmwright import Experiment, InputError
from swarmwright.common.registry import Registry
from swarmwright.controllers import REPRESENTATIONS
from swarmwright.methods import METHODS, Method
from swarmwright.methods.plug_ins import REGISTRIES
from swarmwright.methods.rankings import RANKINGS
from swarmwright.testing import check_method, check_ranking, check_representation


@pytest.mark.parametrize("kind", sorted(REPRESENTATIONS.built_in))
def test_representations_conform(kind: str) -> None:
    check_representation(kind)


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(METHODS.built_in))
def test_methods_conform(kind: str) -> None:
    check_method(kind)


@pytest.mark.parametrize("kind", sorted(RANKINGS.built_in))
def test_rankings_conform(kind: str) -> None:
    check_ranking(kind)


def fresh_registry() -> Registry[Method]:
    return Registry("method", METHODS.group, METHODS.built_in, "swarmwright.methods:Method")


def test_an_unknown_kind_is_refused_with_the_option_that_names_it() -> None:
    METHODS.check("method", None)
    METHODS.check("method", "nnga")
    with pytest.raises(InputError, match=r"^method: .*'nngaa'.*nnga"):
        METHODS.check("method", "nngaa")


def install(folder: Path, name: str, code: str, entry_points: str) -> None:
    """Lay out an installed package: a module and its metadata."""
    (folder / f"{name}.py").write_text(textwrap.dedent(code))
    information = folder / f"{name}-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(f"[swarmwright.methods]\n{entry_points}\n")


HILL_CLIMBER = '''
    """A method of another package: keeps what is better."""
    from typing import Literal
    import numpy as np
    from swarmwright.methods import Method, MethodOptions

    class Options(MethodOptions):
        """One step after the other."""
        kind: Literal["plugin_climb"] = "plugin_climb"
        step: float = 0.1
        """Size of a step."""

    class Climb(Method):
        kind = "plugin_climb"
        options_model = Options
        best = None
        value = np.nan

        @property
        def budget(self):
            return self.options.generations

        @property
        def population_fitness(self):
            return np.array([self.value])

        def _ask(self):
            if self.best is None:
                return self.initials([0])
            stream = self.stream("plugin_climb.step")
            step = self.options.step
            return self.representation.mutate(self.best, stream, severity=step, probability=1.0)[None]

        def _tell(self, genomes, fitness):
            if not fitness[0] <= self.value:
                self.best, self.value = genomes[0], float(fitness[0])
'''


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    before = set(sys.modules)
    yield folder
    for name in set(sys.modules) - before:
        if name.startswith("plugin_"):
            del sys.modules[name]


@pytest.mark.slow
def test_a_method_of_another_package(plugins: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(plugins, "plugin_climber", HILL_CLIMBER, "plugin_climb = plugin_climber:Climb")
    registry = fresh_registry()
    assert registry.names() == sorted({*METHODS.built_in, "plugin_climb"})
    monkeypatch.setitem(REGISTRIES, "method", registry)
    monkeypatch.setattr("swarmwright.testing._methods.METHODS", registry)
    check_method("plugin_climb")
    experiment = Experiment.from_mapping(
        {"simulation": "minisim", "method": {"kind": "plugin_climb", "step": 0.5}}
    )
    assert experiment.new_method(experiment.representation()).ask().shape == (1, 49)
    kinds = Experiment.json_schema()["properties"]["method"]["properties"]["kind"]["enum"]
    assert kinds == registry.names()
    with pytest.raises(InputError, match=r"method\.stepp: unknown key; did you mean 'step'"):
        experiment.replace(method={"stepp": 1})


def test_what_is_built_in_cannot_be_taken_over(plugins: Path) -> None:
    install(plugins, "plugin_thief", HILL_CLIMBER, "nnga = plugin_thief:Climb")
    assert fresh_registry().get("nnga").__module__ == "swarmwright.methods.nnga"


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("raise RuntimeError('out of order')", "cannot be imported: RuntimeError('out of order')"),
        ("Other = 1", "cannot be imported"),
        ("class Climb: pass", "is not a subclass of swarmwright.methods.Method"),
    ],
)
def test_plugins_that_do_not_work(code: str, words: str, plugins: Path) -> None:
    install(plugins, "plugin_broken", code, "plugin_x = plugin_broken:Climb")
    with pytest.raises(InputError, match="method 'plugin_x'") as caught:
        fresh_registry().get("plugin_x")
    assert words in str(caught.value)


def test_two_packages_with_one_name(plugins: Path) -> None:
    install(plugins, "plugin_one", HILL_CLIMBER, "plugin_climb = plugin_one:Climb")
    install(plugins, "plugin_two", HILL_CLIMBER, "plugin_climb = plugin_two:Climb")
    with pytest.raises(InputError, match="announced twice, as plugin_one:Climb by plugin_one and plugin_two"):
        fresh_registry().get("plugin_climb")


def test_unknown_kinds_name_what_there_is() -> None:
    with pytest.raises(
        InputError, match=r"unknown ranking 'absolut'; did you mean 'absolute'\? available: absol"
    ):
        RANKINGS.get("absolut")
