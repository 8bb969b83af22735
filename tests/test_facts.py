"""Facts that several parts need have one home: whoever needs one reads it there."""

import inspect
import subprocess
import sys

from dntorch import FindColor
from dntorch.body import EPUCK

MISSING = "numpy", "gymnasium", "pybullet", "cv2", "scipy", "matplotlib", "click"


def defaults(function) -> dict:
    """Defaults of a function's parameters, by name."""
    return {k: p.default for k, p in inspect.signature(function).parameters.items()}


def test_the_core_needs_torch_alone():
    program = (
        "import sys, torch\n"
        f"sys.modules.update(dict.fromkeys({MISSING!r}))\n"
        "import dntorch, dntorch.body"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_an_agent_expects_the_body_that_the_simulation_has():
    built = defaults(FindColor)
    assert built["fov"] is EPUCK.fov and built["max_speed"] is EPUCK.speed_cap
    assert built["wheel_radius"] is EPUCK.wheel_radius and built["axle"] is EPUCK.axle
