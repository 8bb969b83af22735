"""The hardware env: in virtual time on the emulator, the simulated env beside it."""

import math

import numpy as np
import pytest
from robot_worlds import STEPS, Setup, number

gymnasium = pytest.importorskip("gymnasium")

from dntorch.body import Body  # noqa: E402
from dntorch.envs import RingEnv  # noqa: E402
from dntorch.envs.hardware import HardwareEnv  # noqa: E402
from dntorch.envs.task import SequenceTask  # noqa: E402
from dntorch.robot.calibration import Calibration  # noqa: E402
from dntorch.robot.codecs import wifi  # noqa: E402
from dntorch.robot.emulated.camera import Camera  # noqa: E402
from dntorch.robot.emulated.faults import Faults  # noqa: E402
from dntorch.robot.safety import Limits  # noqa: E402
from dntorch.robot.transports import LinkLost  # noqa: E402


def env_on(setup, **arguments):
    return HardwareEnv(setup.driver, setup.clock, **arguments)


def hours(env, steps, speeds=(0.6, -0.6)):
    """Infos of driving at one speed."""
    return [env.step(np.array(speeds))[4] for _ in range(steps)]


# ---------------------------------------------------------------- an env


def test_spaces_are_those_of_the_simulated_env():
    setup = Setup(pacing="request")
    env, simulated = env_on(setup), RingEnv()
    assert env.observation_space == simulated.observation_space
    assert env.action_space == simulated.action_space
    simulated.close()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(2))
    observation, info = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    for _ in range(5):
        observation, *_, info = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
    assert info["fresh"] and info["age"] == 0 and info["late"] == 0 and info["stopped"] == ""
    env.close()
    setup.wait(0.1)
    assert setup.emulator.speeds == (0, 0)


def test_wheels_count_from_the_reset():
    setup = Setup(pacing="request")
    env = env_on(setup)
    env.reset()
    hours(env, 40)
    observation, _ = env.reset()
    assert observation["wheels"].tolist() == [0.0, 0.0]
    hours(env, 32)
    observation, *_ = env.step(np.zeros(2))
    assert np.allclose(observation["wheels"], np.array((0.6, -0.6)) * STEPS, atol=2)


def test_nothing_answers():
    setup = Setup()
    setup.emulator._ongoing.cancel()
    with pytest.raises(ConnectionError, match="selector"):
        env_on(setup, patience=2.0).reset()


def test_wrong_actions_stop_the_robot():
    for wrong in (np.zeros(3), np.array([math.nan, 0.0])):
        setup = Setup(pacing="request")
        env = env_on(setup)
        env.reset()
        hours(env, 5)
        assert setup.emulator.speeds != (0, 0)
        with pytest.raises(ValueError, match="rad/s"):
            env.step(wrong)
        setup.wait(0.1)
        assert setup.emulator.speeds == (0, 0)


def test_the_task_rewards_what_the_agent_reports():
    setup = Setup(pacing="request")
    env = env_on(setup, task=SequenceTask(reward=3.0, duration=0.25))
    env.reset()
    rewards, completed = [], []
    for color in "GBYRG":
        env.report(env.colors.index(color))
        for _ in range(12):
            _, reward, _, _, info = env.step(np.zeros(2))
            rewards.append(reward)
            completed.append(info["completed"])
    assert sum(completed) == 1 and rewards == [0.0] * 48 + [3.0] * 8 + [0.0] * 4
    with pytest.raises(ValueError, match="found=4"):
        env.report(4)


def test_a_key_press_is_rewarded():
    setup, pressed = Setup(pacing="request"), iter([False, True] + 20 * [False])
    env = env_on(setup, task=SequenceTask(duration=0.25), key=lambda: next(pressed))
    env.reset()
    rewards = [env.step(np.zeros(2))[1] for _ in range(20)]
    assert rewards == [0.0] + [2.0] * 8 + [0.0] * 11


def test_images_are_corrected():
    setup = Setup(pacing="request", camera=Camera((1.0, 1.0, 0.5)))
    setup.world.image[:20, :20] = (0, 200, 0)  # green at the upper left
    env = env_on(setup, calibration=Calibration(rotate=180, mirror=True, gains=(1.0, 0.5, 2.0)))
    observation, _ = env.reset()
    image = observation["image"]
    assert image.shape == (39, 52, 3)
    assert image[36, 2].tolist() == [0, 100, 0] and image[20, 26].tolist() == [0, 0, 255]


def test_a_narrow_camera_shows_things_as_large_as_the_agents_own_would():
    wide, narrow = Body(width=160, height=120), Body(width=160, height=120, fov=0.44)
    images = []
    for body in (wide, narrow):
        world = RingEnv(body=body)
        world.reset(seed=3)
        env = env_on(Setup(pacing="request", world=world), calibration=Calibration(fov=body.fov))
        images.append(env.reset()[0]["image"].astype(int))
        world.close()
    seen = slice(12, 28), slice(16, 36)  # well within the narrow view
    assert np.abs(images[0][seen] - images[1][seen]).mean() < 6
    assert (images[1][:, :12] == 0).all() and (images[1][:, -12:] == 0).all()


# ---------------------------------------------------------------- faults


def test_after_a_stall_it_goes_on_with_a_fresh_frame_and_says_so():
    setup = Setup(faults=Faults(stall=0.02, seed=4))
    env = env_on(setup)
    env.reset()
    infos = hours(env, 1500)
    stopped = np.array([info["stopped"] == "no fresh frame" for info in infos])
    starts = np.flatnonzero(np.diff(stopped.astype(int)) == 1)
    ends = np.flatnonzero(np.diff(stopped.astype(int)) == -1)
    stalls = setup.emulator.faults.counts["stall"]
    assert stalls >= 3 and len(starts) >= stalls - 1 and len(ends) >= stalls - 1
    assert all(infos[end + 1]["age"] < 0.5 for end in ends)
    moving = np.array([info["speeds"].any() for info in infos])
    old = np.array([info["age"] > 0.45 for info in infos])
    assert moving.mean() > 0.1 and old.mean() > 0.1 and not (moving[1:] & old[:-1]).any()
    assert infos[-1]["connections"] == 1


def test_without_being_asked_it_does_not_reconnect():
    setup = Setup(faults=Faults(reset=0.05, seed=1))
    env = env_on(setup)
    env.reset()
    with pytest.raises(LinkLost):
        hours(env, 200)
    assert setup.emulator.faults.counts["reset"] == 1


FAULTS = Faults(
    stall=0.001, delay=0.02, drop=0.02, truncate=0.002, split=0.02, duplicate=0.02,
    garbage=0.002, reset=0.002, seed=3,
)  # fmt: skip


@pytest.fixture(scope="module")
def troubled():
    """10,000 control steps with everything that can go wrong; what the robot was told, when."""
    setup = Setup(reconnect=True, faults=FAULTS)
    env, told = env_on(setup, body=Body(width=160, height=120)), []
    env.reset()
    obey, greet = setup.emulator.firmware._obey, setup.emulator.firmware.greet

    def record(data):
        obey(data)
        command = wifi.decode_command(data)
        told.append((setup.clock.now(), any(command[:2]), env.guard.frame))

    def begin():
        greet()
        told.append((setup.clock.now(), None, None))

    setup.emulator.firmware._obey, setup.emulator.firmware.greet = record, begin
    infos = hours(env, 10_000)
    setup.wait(0.1)
    return setup, infos, told


def test_random_faults_do_not_crash_it_and_each_kind_happened(troubled):
    setup, infos, _ = troubled
    counts = setup.emulator.faults.counts
    assert all(counts[name] >= 3 for name in FAULTS.chances), counts
    assert len(infos) == 10_000 and infos[-1]["connections"] > 10
    assert np.mean([info["speeds"].any() for info in infos]) > 0.5


def test_under_faults_speed_zero_is_first_after_each_connection(troubled):
    _, infos, told = troubled
    first = [b for (_, a, _), (_, b, _) in zip(told, told[1:]) if a is None]
    assert len(first) >= infos[-1]["connections"] - 2 and not any(first)


def test_under_faults_no_frame_is_acted_on_beyond_its_age_limit(troubled):
    _, infos, _ = troubled
    for before, info in zip(infos, infos[1:]):
        if info["speeds"].any():
            assert before["age"] <= 0.45 and before["age"] < math.inf


def test_under_faults_speed_zero_is_sent_within_half_a_second_of_the_last_fresh_frame(troubled):
    _, _, told = troubled
    moves = [(time, frame) for time, moving, frame in told if moving and frame is not None]
    # The emulator hears a command with its next step, 1/32 s after it was sent at the latest.
    assert moves and max(time - frame.time for time, frame in moves) <= 0.5 + 1 / 32
    moving, frame = False, None
    for time, now, held in told:
        if moving and frame is not None and now is not None:
            assert time - frame.time <= 0.5 + 1 / 32, "the last speed stayed without a frame"
        moving, frame = bool(now), held or frame


def test_what_it_acts_on_is_never_much_older_than_it_seems():
    setup = Setup(faults=Faults(stall=0.01, delay=0.05, seed=5))
    env = env_on(setup)
    env.reset()
    older = []
    for _ in range(2000):
        seen = setup.world.steps - number(env.guard.frame.proximity)
        if env.step(np.array((0.6, -0.6)))[4]["speeds"].any():
            older.append(seen / 32)
    # The limit of age, and the delay of the link: never the 6 s of a stall.
    assert max(older) <= 0.5 + 0.3 + 2 / 32


@pytest.mark.parametrize("counted", [-20_000, 20_000])
def test_wheels_do_not_jump_when_another_robot_is_linked(counted):
    setup = Setup(pacing="request", reconnect=True)
    env = env_on(setup)
    env.reset()
    hours(env, 64)
    before = env.step(np.zeros(2))[0]["wheels"]
    setup.emulator.firmware.counters = (counted, counted)  # as after a power cycle
    setup.emulator._drop()
    while env.guard.connections < 2 or env.guard.frame is None:
        env.step(np.zeros(2))
    after, *_, info = env.step(np.zeros(2))
    assert info["connections"] == 2 and np.abs(after["wheels"] - before).max() <= 2
    hours(env, 64)
    turned = env.step(np.zeros(2))[0]["wheels"] - after["wheels"]
    assert np.allclose(turned, np.array((1.2, -1.2)) * STEPS, atol=12)


# ---------------------------------------------------------------- beside the simulated env


def seek(env, steps, bearing, log):
    """A controller of image alone: turn to red, green, blue in turn, or scan."""
    observation, _ = env.reset(seed=3)
    for step in range(steps):
        image, wanted = observation["image"].astype(int), step // 60 % 3
        others = np.delete(image, wanted, axis=-1).max(-1)
        columns = np.flatnonzero(((image[..., wanted] > 100) & (others < 60)).any(0))
        rate = 0.6 if not len(columns) else 0.04 * (25.5 - columns.mean())
        observation, *_ = env.step(np.array(env.body.spin(rate)))
        log.append((bearing(), rate))


class Quantised(RingEnv):
    """The simulated env as a robot sees and moves: RGB565 at 160x120, whole steps a second."""

    def observe(self):
        from dntorch.robot.codecs import rgb565
        from dntorch.robot.images import resample

        observation = super().observe()
        pixels = rgb565.encode(observation["image"])
        image = rgb565.decode(rgb565.Picture(160, 120, pixels))
        return {**observation, "image": resample(image, 52, 39)}

    def step(self, action):
        whole = np.rint(np.asarray(action) * (1000 / math.tau))
        return super().step(whole * (math.tau / 1000))


def test_simulated_and_emulated_robot_do_the_same():
    body, logs = Body(width=160, height=120), ([], [])
    simulated = Quantised(body=body)
    seek(simulated, 240, lambda: simulated.pose.yaw, logs[0])
    simulated.close()
    world = RingEnv(body=body)
    world.reset(seed=3)
    setup = Setup(pacing="request", world=world)
    env = env_on(setup, limits=Limits(slew=math.inf))
    seek(env, 240, lambda: world.pose.yaw, logs[1])
    world.close()
    assert np.ptp([yaw for yaw, _ in logs[0]]) > 0.3, "nothing moved"
    assert np.array_equal(*logs)


def test_real_time_smoke():
    """The only test here that waits for a clock: TCP, threads, half a second of driving."""
    from robot_worlds import Turntable

    from dntorch.robot.clock import RealClock
    from dntorch.robot.dialects import Wifi
    from dntorch.robot.driver import Driver
    from dntorch.robot.emulated.emulator import Emulator
    from dntorch.robot.emulated.firmware import WifiFirmware
    from dntorch.robot.emulated.servers import TcpServer
    from dntorch.robot.transports import Tcp

    server = TcpServer()
    world = Turntable()
    with Emulator(world, server, WifiFirmware(), RealClock()) as emulator:
        driver = Driver(Tcp(server.host, server.port, wait=0.01), Wifi())
        with HardwareEnv(driver) as env:
            env.reset()
            infos = hours(env, 16)
            while emulator.speeds != (95, -95) and len(infos) < 96:  # a busy machine
                infos += hours(env, 1)
            assert emulator.speeds == (95, -95)
        end = RealClock().now() + 1.0
        while emulator.speeds != (0, 0) and RealClock().now() < end:
            RealClock().sleep_until(RealClock().now() + 0.01)
        assert emulator.speeds == (0, 0)
    assert sum(info["fresh"] for info in infos) > 3
