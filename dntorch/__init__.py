"""Neural dynamics that learn behaviour, in PyTorch.

Dynamic neural fields, elementary behaviours, item-and-order working memory and Hebbian
values as ``nn.Module`` s, composed into DN-SARSA(lambda): an agent that learns a rewarding
sequence of behaviours from delayed reward in continuous time.
"""

from importlib.metadata import PackageNotFoundError, version

from dntorch import envs
from dntorch.cells.kernels import Gauss, Global, Matrices
from dntorch.dynamics import Dynamics
from dntorch.modules.behaviors import ElementaryBehaviors
from dntorch.modules.field import DNF
from dntorch.modules.find_color import FindColor
from dntorch.modules.hebbian import HebbianQ
from dntorch.modules.learner import Learner
from dntorch.modules.node import NodeWTA
from dntorch.modules.opposition import ValueOpposition
from dntorch.modules.repertoire import Repertoire
from dntorch.modules.sarsa import DNSarsa
from dntorch.modules.sensorimotor import Direct, Sensorimotor
from dntorch.modules.transient import TPCell
from dntorch.modules.value import ValueNodes
from dntorch.modules.working_memory import ItemOrderWM
from dntorch.noise import Exploration
from dntorch.number import Number

try:
    __version__ = version("dntorch")
except PackageNotFoundError:  # a source tree that was never installed
    __version__ = "0+unknown"

__all__ = [
    "DNF",
    "DNSarsa",
    "Direct",
    "Dynamics",
    "ElementaryBehaviors",
    "Exploration",
    "FindColor",
    "Gauss",
    "Global",
    "HebbianQ",
    "ItemOrderWM",
    "Learner",
    "Matrices",
    "NodeWTA",
    "Number",
    "Repertoire",
    "Sensorimotor",
    "TPCell",
    "ValueNodes",
    "ValueOpposition",
    "envs",
]
