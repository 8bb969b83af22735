"""Names of the package come when they are asked for, and PyTorch with them."""

import ast
import importlib
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

import dntorch

PACKAGES = ["dntorch", "dntorch.cosivina", "dntorch.envs"]


def run(program: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)


@pytest.mark.parametrize("name", PACKAGES)
def test_type_checkers_and_python_see_the_same_names(name: str) -> None:
    package = importlib.import_module(name)
    (choice,) = (
        node for node in ast.parse(Path(package.__file__).read_text()).body
        if isinstance(node, ast.If)
    )  # fmt: skip
    imports = {
        a.name: f"{name}.{a.name}" if line.module == name else line.module
        for line in choice.body for a in line.names
    }  # fmt: skip
    (table,) = (node for node in ast.walk(choice.orelse[0]) if isinstance(node, ast.Dict))
    homes = {k: f"{name}.{home}" for k, home in ast.literal_eval(table).items()}
    assert homes == imports
    assert set(package.__all__) - {"cosivina", "envs", "register"} == homes.keys() - {"__version__"}


@pytest.mark.parametrize("name", PACKAGES)
def test_every_name_is_there_and_listed(name: str) -> None:
    package = importlib.import_module(name)
    if name == "dntorch.envs":
        pytest.importorskip("gymnasium")
        pytest.importorskip("pybullet")
    for each in package.__all__:
        assert getattr(package, each) is not None and each in dir(package)
    with pytest.raises(AttributeError, match=f"'{name}' has no attribute 'Nonsense'"):
        _ = package.Nonsense
    assert not hasattr(package, "__path_of_nobody__")


def test_all_forms_of_import_give_the_same_class() -> None:
    from dntorch import DNSarsa
    from dntorch.modules.sarsa import DNSarsa as at_home

    names: dict[str, object] = {}
    exec("from dntorch import *", names)
    assert DNSarsa is at_home is dntorch.DNSarsa is names["DNSarsa"]
    assert type(pickle.loads(pickle.dumps(DNSarsa(3)))) is DNSarsa


def test_importing_the_package_alone_imports_neither_torch_nor_numpy() -> None:
    done = run("import sys, dntorch; print({'torch', 'numpy', 'gymnasium'} & sys.modules.keys())")
    assert done.stdout.strip() == "set()", done.stderr


@pytest.mark.parametrize(
    "imports",
    [
        "import dntorch, gymnasium",
        "import gymnasium, dntorch",
        "import gymnasium, dntorch.runs.config",
        "import dntorch.envs; from gymnasium import Env; import gymnasium",
        "import gymnasium; name = 'dntorch:dntorch/EPuck-v0'",
        "import dntorch, gymnasium; name = 'dntorch:dntorch/EPuck-v0'",
    ],
)
def test_gymnasium_knows_the_world_in_any_order_of_imports(imports: str) -> None:
    pytest.importorskip("gymnasium")
    done = run(
        f"name = 'dntorch/EPuck-v0'; {imports}; import sys\n"
        "from gymnasium.envs.registration import _find_spec\n"
        "print(_find_spec(name).entry_point, 'torch' in sys.modules)"
    )
    assert done.stdout.strip() == "dntorch.envs.epuck:EPuckEnv False", done.stderr
