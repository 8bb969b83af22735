"""A robot behind a protocol, through the same wrapper, policy and collector as the worlds."""

import pytest
import torch
from robot_worlds import Setup
from torchrl.collectors import Collector
from torchrl.data import Unbounded
from torchrl.envs import check_env_specs

from dntorch import DNSarsa, FindColor
from dntorch.body import Body
from dntorch.envs import HardwareEnv, RingEnv, SequenceTask
from dntorch.rl import AgentPolicy, wrap
from dntorch.robot.calibration import Calibration
from dntorch.robot.emulated.emulator import WIFI_BODY


class Emulated:
    """An e-puck in virtual time, its env, and what truly happens to it."""

    def __init__(self, colors: str = "GB", body: Body = WIFI_BODY) -> None:
        self.world = RingEnv(SequenceTask("GB", colors), body=body)
        self.world.reset(seed=1)
        self.found: list[int] = []
        self.setup = Setup(pacing="request", world=self.world, on_step=self.see)
        hardware = HardwareEnv(
            self.setup.driver, self.setup.clock, SequenceTask("GB", colors),
            calibration=Calibration(fov=body.fov),
        )  # fmt: skip
        self.env = wrap(hardware, found=Unbounded((), dtype=torch.int64))

    def see(self, info: dict) -> None:
        self.found += [int(info["found"])] if info["found"] >= 0 else []


@pytest.fixture
def emulated():
    made = Emulated()
    yield made
    made.world.close()


def test_specs(emulated) -> None:
    check_env_specs(emulated.env)


def test_an_agent_learns_on_a_robot_from_what_it_reports_itself(emulated) -> None:
    policy = AgentPolicy(DNSarsa(2, FindColor("GB")))
    collector = Collector(emulated.env, policy, frames_per_batch=200, total_frames=-1)
    batch = torch.cat([b.clone() for _, b in zip(range(4), collector)])
    reported = batch["next", "found"][batch["next", "found"] >= 0].tolist()
    assert len(reported) >= 3 and reported == emulated.found[: len(reported)]
    assert (batch["next", "reward"] > 0).any() and policy.agent.weights.abs().max() > 0.01
    assert batch["action"].abs().max() > 0.3 and emulated.setup.emulator.speeds != (0, 0)
    state = collector.state_dict()
    collector.shutdown()
    emulated.setup.wait(0.1)
    assert emulated.setup.emulator.speeds == (0, 0)

    again, other = Emulated(), AgentPolicy(DNSarsa(2, FindColor("GB")))
    resumed = Collector(again.env, other, frames_per_batch=1, total_frames=-1)
    resumed.load_state_dict(state)
    batch = next(iter(resumed))
    resumed.shutdown()
    again.world.close()
    # A robot is where it is: at rest there, with what was learned.
    assert batch["is_init"].all() and not (batch["satisfaction"] > 0.5).any()
    assert torch.equal(batch["weights"][0], policy.agent.weights)
    assert batch["steps"] == 801


@pytest.mark.parametrize("carried", [False, True], ids=["buffers", "tensordict"])
def test_what_was_learned_survives_a_reset_of_the_robot(carried: bool, emulated) -> None:
    policy = AgentPolicy(DNSarsa(2, FindColor("GB")), carried=carried)
    policy.agent.weights.fill_(0.25)
    env = emulated.env
    if carried:
        env.insert_transform(2, policy.primer())
    first = Collector(env, policy, frames_per_batch=5, total_frames=-1)
    next(iter(first))
    state = first.state_dict()
    policy.agent.weights.zero_()
    second = Collector(env, policy, frames_per_batch=5, total_frames=-1)
    second.load_state_dict(state)
    assert (next(iter(second))["weights"] == 0.25).all()
    second.shutdown()
