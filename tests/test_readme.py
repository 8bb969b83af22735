"""The code in the README and in the docs runs as it stands."""

import importlib.util
import re
from pathlib import Path

import pytest
from needs import needs

ROOT = Path(__file__).parents[1]
PAGES = ["own.md", "export.md", "beyond.md", "fields.md"]


def blocks_of(page: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)


BLOCKS = blocks_of(ROOT / "README.md")


def test_there_is_code_to_run() -> None:
    assert len(BLOCKS) >= 2


@pytest.mark.parametrize(
    "block", [pytest.param(b, marks=needs("pybullet") if "EPuck" in b else ()) for b in BLOCKS]
)
def test_readme_code_runs(block: str) -> None:
    exec(compile(block, "README.md", "exec"), {})


@pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning")
@pytest.mark.parametrize("page", PAGES)
def test_code_of_a_page_runs_from_top_to_bottom(page: str, tmp_path: Path) -> None:
    """As a file: TorchScript reads the source of a class."""
    blocks = blocks_of(ROOT / "docs" / page)
    assert blocks
    path = tmp_path / "page.py"
    path.write_text("\n".join(blocks))
    spec = importlib.util.spec_from_file_location("page", path)
    spec.loader.exec_module(importlib.util.module_from_spec(spec))
