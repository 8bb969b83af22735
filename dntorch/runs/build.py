"""The agent of a run and the noise with which it explores."""

from dntorch.modules.behaviors import ElementaryBehaviors
from dntorch.modules.constraints import Constraints
from dntorch.modules.curiosity import Curiosity
from dntorch.modules.dissatisfaction import Dissatisfaction
from dntorch.modules.find_color import FindColor
from dntorch.modules.habituation import Habituation
from dntorch.modules.hebbian import HebbianQ
from dntorch.modules.learner import Learner
from dntorch.modules.recall import Recall
from dntorch.modules.sarsa import DNSarsa
from dntorch.modules.transient import TPCell
from dntorch.modules.working_memory import ItemOrderWM
from dntorch.noise import Exploration
from dntorch.runs.config import Config
from dntorch.runs.worlds import WORLDS


def build_agent(config: Config, n: int | None = None) -> DNSarsa:
    """The agent of a run, without batch, at rest, knowing nothing; a behaviour for each colour.

    Args:
        n: another number of behaviours, for a world without colours.
    """
    n, dt = n or len(config.colors), config.fine
    camera = "image" in WORLDS[config.world].senses
    recall = Recall(n, config.recall, dt=dt) if config.recall else None
    states = recall.states if recall else n
    return DNSarsa(
        n,
        sensorimotor=FindColor(config.colors, dt=dt) if camera else None,
        behaviors=_behaviors(config, n),
        learner=Learner(
            n,
            pulses=TPCell((n, states), tau=config.pulse_tau, dt=dt),
            trace=ItemOrderWM(n, tau=config.trace_tau, states=states, dt=dt),
            values=HebbianQ(n, learning_rate=config.learning_rate, states=states, dt=dt),
            states=states,
            dt=dt,
        ),
        recall=recall,
        habituation=_habituation(config, n),
        constraints=_constraints(config, n, states),
        curiosity=_curiosity(config, n),
        dt=config.dt,
        substeps=config.substeps,
        integrator=config.integrator,
    )


def _behaviors(config: Config, n: int) -> ElementaryBehaviors | None:
    if not config.patience:
        return None
    waiting = Dissatisfaction(n, patience=config.patience, dt=config.fine)
    return ElementaryBehaviors(n, dissatisfaction=waiting, dt=config.fine)


def _habituation(config: Config, n: int) -> Habituation | None:
    if config.habituation < 0:
        return None
    return Habituation(n, config.habituation, recovery=config.recovery, dt=config.fine)


def _constraints(config: Config, n: int, states: int) -> Constraints | None:
    if not config.constraints:
        return None
    return Constraints(n, learning_rate=config.constraints, states=states, dt=config.fine)


def _curiosity(config: Config, n: int) -> Curiosity | None:
    if not config.curiosity:
        return None
    levels = len(config.sequence) + 1
    return Curiosity(n, levels, gain=config.curiosity, dt=config.fine)


def build_exploration(config: Config) -> Exploration:
    """The noise of a run while it explores."""
    return Exploration(len(config.colors), config.seed, amplitude=config.noise)


def build_lifelong(config: Config) -> Exploration | None:
    """The noise of a trained agent at work: that of one without phases, which draws anew what to
    do after a failure; none of one that has explored."""
    return build_exploration(config) if config.lifelong else None


def senses_of(config: Config) -> tuple[str, ...]:
    """What the agent of a run reads, and so what its world shows it."""
    return build_agent(config).senses
