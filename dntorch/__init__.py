"""Neural dynamics that learn behaviour, in PyTorch.

Dynamic neural fields, elementary behaviours, item-and-order working memory and Hebbian
values as ``nn.Module`` s, composed into DN-SARSA(lambda): an agent that learns a rewarding
sequence of behaviours from delayed reward in continuous time.

Each name is imported, and PyTorch with it, when it is first asked for.
"""

from typing import TYPE_CHECKING

from dntorch import cosivina, envs
from dntorch.lazy import later

if TYPE_CHECKING:
    from dntorch import losses, plots
    from dntorch.analysis import fixed_points
    from dntorch.cells.codes import rate_code, space_code
    from dntorch.cells.kernels import Gauss, Global, Matrices
    from dntorch.cells.readout import peaks
    from dntorch.cells.stimuli import gauss
    from dntorch.dynamics import Dynamics
    from dntorch.live.serving import view
    from dntorch.modules.architecture import Architecture
    from dntorch.modules.behaviors import ElementaryBehaviors
    from dntorch.modules.constraints import Constraints
    from dntorch.modules.curiosity import Curiosity
    from dntorch.modules.deliberation import Deliberation
    from dntorch.modules.dissatisfaction import Dissatisfaction
    from dntorch.modules.field import DNF
    from dntorch.modules.find_color import FindColor
    from dntorch.modules.folding import Folded
    from dntorch.modules.habituation import Habituation
    from dntorch.modules.hebbian import HebbianQ
    from dntorch.modules.learner import Learner
    from dntorch.modules.links import Link
    from dntorch.modules.memory_trace import MemoryTrace
    from dntorch.modules.node import NodeWTA
    from dntorch.modules.opposition import ValueOpposition
    from dntorch.modules.projection import Projection
    from dntorch.modules.random_input import Noise
    from dntorch.modules.recall import Recall
    from dntorch.modules.relay import Relay
    from dntorch.modules.repertoire import Repertoire
    from dntorch.modules.sarsa import DNSarsa
    from dntorch.modules.sensorimotor import Direct, Sensorimotor
    from dntorch.modules.transient import TPCell
    from dntorch.modules.value import ValueNodes
    from dntorch.modules.working_memory import ItemOrderWM
    from dntorch.noise import Exploration
    from dntorch.number import Number
    from dntorch.through_time import rollout
    from dntorch.version import __version__ as __version__
else:  # the same, later
    __getattr__, __dir__ = later(
        __name__,
        {
            "Architecture": "modules.architecture",
            "Constraints": "modules.constraints",
            "Curiosity": "modules.curiosity",
            "DNF": "modules.field",
            "DNSarsa": "modules.sarsa",
            "Deliberation": "modules.deliberation",
            "Direct": "modules.sensorimotor",
            "Dissatisfaction": "modules.dissatisfaction",
            "Dynamics": "dynamics",
            "ElementaryBehaviors": "modules.behaviors",
            "Exploration": "noise",
            "FindColor": "modules.find_color",
            "Folded": "modules.folding",
            "Gauss": "cells.kernels",
            "Global": "cells.kernels",
            "Habituation": "modules.habituation",
            "HebbianQ": "modules.hebbian",
            "ItemOrderWM": "modules.working_memory",
            "Learner": "modules.learner",
            "Link": "modules.links",
            "Matrices": "cells.kernels",
            "MemoryTrace": "modules.memory_trace",
            "NodeWTA": "modules.node",
            "Noise": "modules.random_input",
            "Number": "number",
            "Projection": "modules.projection",
            "Recall": "modules.recall",
            "Relay": "modules.relay",
            "Repertoire": "modules.repertoire",
            "Sensorimotor": "modules.sensorimotor",
            "TPCell": "modules.transient",
            "ValueNodes": "modules.value",
            "ValueOpposition": "modules.opposition",
            "__version__": "version",
            "fixed_points": "analysis",
            "gauss": "cells.stimuli",
            "losses": "losses",
            "peaks": "cells.readout",
            "plots": "plots",
            "rate_code": "cells.codes",
            "rollout": "through_time",
            "space_code": "cells.codes",
            "view": "live.serving",
        },
    )

__all__ = [
    "DNF",
    "Architecture",
    "Constraints",
    "Curiosity",
    "DNSarsa",
    "Deliberation",
    "Direct",
    "Dissatisfaction",
    "Dynamics",
    "ElementaryBehaviors",
    "Exploration",
    "FindColor",
    "Folded",
    "Gauss",
    "Global",
    "Habituation",
    "HebbianQ",
    "ItemOrderWM",
    "Learner",
    "Link",
    "Matrices",
    "MemoryTrace",
    "NodeWTA",
    "Noise",
    "Number",
    "Projection",
    "Recall",
    "Relay",
    "Repertoire",
    "Sensorimotor",
    "TPCell",
    "ValueNodes",
    "ValueOpposition",
    "cosivina",
    "envs",
    "fixed_points",
    "gauss",
    "losses",
    "peaks",
    "plots",
    "rate_code",
    "rollout",
    "space_code",
    "view",
]
