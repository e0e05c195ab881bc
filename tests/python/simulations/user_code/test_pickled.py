"""What a simulation's file defines can be pickled: its module has a name that every process can import."""

import multiprocessing
import os
import pickle
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from swarmwright import Experiment, InputError, Run, evaluate, optimize, post_evaluate
from swarmwright.simulations import loading
from swarmwright.simulations.names import files, name_of
from tests.python.simulations.user_code.conftest import EXPERIMENT

SOURCE = """
import gymnasium
import numpy as np
from helper import Data
from parts.units import Metres
from swarmwright import Simulation


def doubled(data):
    return Data(Metres(2 * data.value.number))


class Room(gymnasium.Env):
    observation_space = action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        return np.ones(1, np.float32), {}

    def step(self, action):
        return np.ones(1, np.float32), 3.0, False, False, {}


class Gather(Simulation):
    title, sensors, actuators = "gather", 2, 2
    total = 0.0

    def reset(self, parameters, seed):
        self.left = 2
        if CONTEXT:
            import multiprocessing
            with multiprocessing.get_context(CONTEXT).Pool(1) as pool:
                self.total = sum(one.value.number for one in pool.map(doubled, [Data(Metres(4.0))]))
        return [[0.0, 0.0]]

    def step(self, actions):
        self.left -= 1
        return [[0.0, 0.0]]

    def done(self):
        return self.left == 0

    def fitness(self):
        return self.total
"""


def write(folder: Path, context: str = "") -> Path:
    (folder / "parts").mkdir(parents=True, exist_ok=True)
    (folder / "helper.py").write_text(
        "class Data:\n    def __init__(self, value):\n        self.value = value\n"
    )
    (folder / "parts" / "__init__.py").touch()
    (folder / "parts" / "units.py").write_text(
        "class Metres:\n    def __init__(self, number):\n        self.number = number\n"
    )
    file = folder / "gather.py"
    file.write_text(f"CONTEXT = {context!r}\n{SOURCE}")
    return file


def in_worker(context: str, function: Callable[[Any], Any], value: Any) -> Any:
    with multiprocessing.get_context(context).Pool(1) as pool:
        return pool.apply(function, (value,))


@pytest.mark.parametrize("context", ["spawn", "forkserver"])
def test_a_simulation_uses_worker_processes(context: str, tmp_path: Path) -> None:
    write(tmp_path / "a.b (é:%)", context)
    experiment = Experiment.from_mapping({"simulation": f"{tmp_path}/a.b (é:%)/gather.py:Gather"})
    genomes = np.zeros((1, experiment.genome_size), dtype=np.float32)
    assert evaluate(experiment, genomes, servers="in-process").tolist() == [8.0]


def test_workers_where_modules_are_kept_apart(tmp_path: Path) -> None:
    """Where this process has other modules of these names."""
    for folder in ("one", "other"):
        file = write(tmp_path / folder)
        loading.classes_of_file(file)
        module: Any = files[str(file.resolve())]
    assert "helper" in sys.modules
    assert sys.modules["helper"] is not sys.modules[module.Data.__module__]
    found = in_worker("spawn", module.doubled, module.Data(module.Metres(5.0)))
    assert type(found) is module.Data
    assert type(found.value) is module.Metres
    assert found.value.number == 10


def test_a_copy_in_a_run_is_pickled(project: Path) -> None:
    write(project)
    (project / "gather.yaml").write_text(EXPERIMENT)
    run = optimize(Experiment.load("gather.yaml"), lambda _: False, out="run", servers="in-process")
    for name in ("gather.py", "helper.py", "parts"):
        shutil.move(name, f"gone-{name}")
    post_evaluate(Run.open(run.path), episodes=1, servers="in-process")
    copied: Any = next(
        module for name, module in files.items() if name.startswith(f"{run.path.resolve()}/code/1/")
    )
    found = in_worker("spawn", copied.doubled, copied.Data(copied.Metres(5.0)))
    assert found.value.number == 10


def test_vector_environments(tmp_path: Path) -> None:
    loading.classes_of_file(write(tmp_path))
    module: Any = files[str(tmp_path.resolve() / "gather.py")]
    environments: Any = gymnasium.vector.AsyncVectorEnv([module.Room], context="spawn")
    environments.reset()
    assert environments.step(np.zeros((1, 1), np.float32))[1].tolist() == [3.0]
    environments.close()


def test_a_folder_whose_name_is_not_utf_8(tmp_path: Path) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9"))
    folder.mkdir()
    loading.classes_of_file(write(folder))
    module: Any = files[str(folder.resolve() / "gather.py")]
    assert pickle.loads(pickle.dumps(module.Room)) is module.Room


def test_the_name_of_a_class_is_that_of_its_file(tmp_path: Path) -> None:
    file = write(tmp_path)
    kind = loading.load(f"{file}:Gather")
    assert name_of(kind) == f"{file.resolve()}:Gather"
    assert not kind.__module__.startswith("swarmwright.")


def test_names_run_no_code_that_is_not_trusted(tmp_path: Path) -> None:
    """A pickle, an experiment or an environment may name any file."""
    file = write(tmp_path)
    mark = "import pathlib\npathlib.Path(__file__).with_name('executed').touch()\n"
    file.write_text(mark + file.read_text())
    kind = loading.load(f"{file}:Gather")
    (tmp_path / "executed").unlink()
    pickled, name = pickle.dumps(kind), kind.__module__
    for known in [one for one in sys.modules if one.startswith("swarmwright_files.")]:
        del sys.modules[known]
    files.clear()
    with pytest.raises(InputError, match="is code named by a run folder"):
        pickle.loads(pickled)
    Experiment.from_mapping({"simulation": f"{name}:Gather"})  # is a title, of a server's simulation
    for simulation in (f"gymnasium:{name}:Room-v0", f"pettingzoo:{name}"):
        with pytest.raises(InputError, match="name the file of the class instead"):
            Experiment.from_mapping({"simulation": simulation})
    assert not (tmp_path / "executed").exists()
