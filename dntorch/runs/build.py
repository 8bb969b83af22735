"""The agent of a run and the noise with which it explores."""

from dntorch.modules.find_color import FindColor
from dntorch.modules.hebbian import HebbianQ
from dntorch.modules.learner import Learner
from dntorch.modules.sarsa import DNSarsa
from dntorch.modules.working_memory import ItemOrderWM
from dntorch.noise import Exploration
from dntorch.runs.config import Config
from dntorch.runs.worlds import WORLDS


def build_agent(config: Config) -> DNSarsa:
    """The agent of a run, without batch, at rest, knowing nothing."""
    n, dt = len(config.colors), config.fine
    camera = "image" in WORLDS[config.world].senses
    return DNSarsa(
        n,
        sensorimotor=FindColor(config.colors, dt=dt) if camera else None,
        learner=Learner(
            n,
            trace=ItemOrderWM(n, tau=config.trace_tau, dt=dt),
            values=HebbianQ(n, learning_rate=config.learning_rate, dt=dt),
            dt=dt,
        ),
        dt=config.dt,
        substeps=config.substeps,
        integrator=config.integrator,
    )


def build_exploration(config: Config) -> Exploration:
    """The noise of a run while it explores."""
    return Exploration(len(config.colors), config.seed, amplitude=config.noise)


def senses_of(config: Config) -> tuple[str, ...]:
    """What the agent of a run reads, and so what its world shows it."""
    return build_agent(config).senses
