"""Settings of the test suite."""

import os
import signal
from collections.abc import Iterator

# Two processes of tests with two threads each would fight over two cores; before torch loads.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
import torch
from hypothesis import settings

# The same examples in every run: a suite that fails by chance tells nothing.
settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")

#: Warnings that are no errors, and why. All others are, here and in programs that tests start.
EXEMPT = {
    "ignore:`torch.jit:DeprecationWarning": "robots with this stack need TorchScript",
    "ignore:Creating :DeprecationWarning": "TorchRL 0.14 deprecates weight updaters of its own",
    "ignore:The policy is not an nn.Module:UserWarning": "each Ray worker builds its own",
    "ignore:Guards may run slower on Python 3.13.0:RuntimeWarning": "so says TorchDynamo of 3.13.0",
    "ignore:RayCollector iteration started before weight:UserWarning": "no weights are sent",
}
os.environ["PYTHONWARNINGS"] = ",".join(["error", *EXEMPT])

#: Tests that may be skipped, and why: nothing else is skipped unseen by `make test`.
MAY_SKIP = {
    "tests/cosivina/test_public_files.py": "third-party models, not part of this repository",
    "tests/envs/test_nodes.py": "one test needs a C++ compiler",
    "tests/envs/test_ring.py": "one test needs a GPU",
    "tests/live/test_in_chromium.py": "needs Chromium",
    "tests/fields/test_gallery.py": "one model is a third-party file, not part of this repository",
    "tests/modules/test_compiled.py": "needs a C++ compiler",
    "tests/modules/test_dnfc_data.py": "third-party field runs, not part of this repository",
    "tests/export/test_export_cpp.py": "needs a C++ compiler; with CUDA, its toolkit",
    "tests/export/test_export_executorch.py": "needs dntorch[executorch], which nothing else does",
}


torch.set_num_threads(1)  # as the command line does


@pytest.fixture(autouse=True)
def process_settings() -> Iterator[None]:
    """Put back what a test, or a command it calls, sets for its process."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    torch.set_num_threads(1)
    torch.set_flush_denormal(False)
    for number, handler in handlers.items():
        signal.signal(number, handler)


def pytest_configure(config: pytest.Config) -> None:
    for line in ["error", *EXEMPT]:
        config.addinivalue_line("filterwarnings", line)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--no-unlisted-skips", action="store_true", help="fail when a test that MAY_SKIP lacks is"
    )


@pytest.fixture(autouse=True)
def _doctest_names(doctest_namespace: dict) -> None:
    doctest_namespace["torch"] = torch


def pytest_sessionfinish(session: pytest.Session) -> None:
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if hasattr(session.config, "workerinput"):  # a process of pytest-xdist: its parent judges
        return
    skipped = {report.nodeid for report in reporter.stats.get("skipped", [])}
    unlisted = sorted(name for name in skipped if name.split("::")[0] not in MAY_SKIP)
    if session.config.getoption("--no-unlisted-skips") and unlisted:
        session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED
        reporter.line("skipped, but not on the list in conftest.py: " + ", ".join(unlisted))
