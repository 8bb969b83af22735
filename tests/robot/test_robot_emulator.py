"""The emulator against what is known of the firmware, and the faults of links."""

import math

import numpy as np
import pytest
from robot_worlds import Setup, Turntable, number

from dntorch.robot.clock import VirtualClock
from dntorch.robot.codecs import wifi
from dntorch.robot.emulated.camera import HARD, MILD, Camera
from dntorch.robot.emulated.emulator import SERIAL, Emulator
from dntorch.robot.emulated.faults import Faults, Injector
from dntorch.robot.emulated.firmware import WifiFirmware, build_firmware
from dntorch.robot.emulated.servers import MemoryServer

SPEED = math.tau / 10  # 100 motor steps/s


class Raw:
    """The emulator, and a client that speaks bytes."""

    def __init__(self, pacing="firmware", **arguments):
        self.clock, self.server, self.world = VirtualClock(), MemoryServer(), Turntable()
        firmware = WifiFirmware(pacing)
        self.emulator = Emulator(self.world, self.server, firmware, self.clock, **arguments)
        self.emulator.start()
        self.link = self.server.connect()

    def say(self, *commands, ticks=1):
        self.link.to_robot += b"".join(map(wifi.encode_command, commands))
        return self.hear(ticks)

    def hear(self, ticks=1):
        self.clock.sleep_until(self.clock.now() + ticks / 32)
        data = bytes(self.link.to_host)
        self.link.to_host.clear()
        kinds, rest = wifi.split_packets(data)
        assert rest == b""
        return "".join(type(kind).__name__[0] for kind in kinds)


# ---------------------------------------------------------------- pacing


def test_firmware_streams_images_and_then_sensors_after_the_first_command():
    raw = Raw()
    assert raw.hear(5) == ""
    assert raw.say(wifi.Command(), ticks=3) == "PSPSPS"
    assert raw.say(wifi.Command(request=wifi.ASK_SENSORS), ticks=3) == "SSS"
    assert raw.say(wifi.Command(request=0), ticks=3) == "EEE"


def test_webots_streams_sensors_and_then_images_and_nothing_when_nothing_is_asked():
    raw = Raw("webots")
    assert raw.say(wifi.Command(), ticks=3) == "SPSPSP"
    assert raw.say(wifi.Command(request=0), ticks=3) == ""


def test_the_ideal_robot_answers_once_to_each_command():
    raw = Raw("request")
    assert raw.say(wifi.Command(), ticks=3) == "PS"
    assert raw.hear(3) == ""


def test_split_commands_are_completed_by_the_firmware_and_lost_by_webots():
    for pacing, speed in (("firmware", 100), ("webots", 0)):
        raw = Raw(pacing)
        data = wifi.encode_command(wifi.Command(100, 100))
        for part in (data[:7], data[7:]):
            raw.link.to_robot += part
            raw.hear()
        assert raw.emulator.speeds == (speed, speed)


def test_a_flood_of_commands_leaves_only_the_last():
    raw = Raw()
    raw.say(*[wifi.Command(left) for left in range(1, 5)], wifi.Command(9, settings=wifi.CALIBRATE))
    assert raw.emulator.speeds == (9, 0) and raw.emulator.firmware.calibrations == 1
    raw.say(*[wifi.Command(settings=wifi.CALIBRATE)] * 5)
    assert raw.emulator.firmware.calibrations == 2, "it obeyed more than the last command"


def test_motors_are_clipped_and_counters_can_be_set_without_moving():
    raw = Raw()
    raw.say(wifi.Command(30000, -30000))
    assert raw.emulator.speeds == (1100, -1100)
    raw.say(wifi.Command(0, 0))
    raw.say(wifi.Command(77, -77, settings=wifi.SET_STEPS))
    assert raw.emulator.speeds == (0, 0)
    raw.link.to_host.clear()
    raw.clock.sleep_until(raw.clock.now() + 1 / 32)
    _, sensors = wifi.split_packets(bytes(raw.link.to_host))[0]
    assert sensors.steps == (77, -77)


@pytest.mark.parametrize("pacing, keeps", [("firmware", True), ("webots", False)])
def test_the_last_speed_stays_when_the_client_has_gone(pacing, keeps):
    raw = Raw(pacing)
    raw.say(wifi.Command(100, -100))
    raw.link.ended = True  # as the kernel does for a client that was killed
    raw.clock.sleep_until(raw.clock.now() + 60)
    assert (raw.emulator.speeds == (100, -100)) is keeps
    assert np.allclose(raw.world.speeds[-1], (SPEED, -SPEED)) is keeps
    raw.link = raw.server.connect()
    assert raw.hear(3) == ""
    assert raw.say(wifi.Command(), ticks=2) == {"firmware": "PSPS", "webots": "SPSP"}[pacing]


@pytest.mark.parametrize("pacing, keeps", [("firmware", True), ("webots", False)])
def test_the_last_speed_stays_when_the_link_breaks(pacing, keeps):
    raw = Raw(pacing)
    raw.say(wifi.Command(100, -100))
    raw.link.broken = True  # as for a client that was killed with packets unread
    raw.clock.sleep_until(raw.clock.now() + 1)
    assert not raw.emulator.connected
    assert (raw.emulator.speeds == (100, -100)) is keeps


def test_a_slow_reader_gets_whole_packets_from_the_firmware_and_parts_from_webots():
    for pacing in ("firmware", "webots"):
        raw = Raw(pacing)
        raw.link.room = 50_000
        raw.link.to_robot += wifi.encode_command(wifi.Command())
        raw.clock.sleep_until(5.0)
        first = bytes(raw.link.to_host)
        raw.link.to_host.clear()
        raw.clock.sleep_until(5.1)
        stream = first + bytes(raw.link.to_host)
        assert len(first) == 50_000
        if pacing == "firmware":
            packets, _ = wifi.split_packets(stream)
            assert len(packets) >= 4
        else:
            with pytest.raises(wifi.ProtocolError):
                wifi.split_packets(stream)


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="pacing='fast'"):
        WifiFirmware("fast")
    with pytest.raises(ValueError, match="protocol='ros'"):
        build_firmware("ros")


# ---------------------------------------------------------------- the driver on the emulator


@pytest.mark.parametrize("protocol, size", [
    ("wifi", (120, 160, 3)), ("sercom", (39, 52, 3)), ("sercom2", (39, 52, 3)),
])  # fmt: skip
def test_the_driver_drives_every_kind_of_robot(protocol, size):
    setup = Setup(protocol)
    setup.driver.connect()
    setup.wait(1.0)
    frame = setup.driver.frame
    assert frame.image.shape == size
    middle = frame.image[size[0] // 2, size[1] // 2]
    assert middle.tolist() == [0, 0, 248] and frame.image[0, 0].tolist() == [0, 0, 0]
    setup.driver.drive(SPEED, -SPEED)
    setup.wait(1.0)
    assert setup.emulator.speeds == (100, -100)
    assert np.allclose(setup.driver.frame.steps, (100, -100), atol=7)
    setup.driver.close()
    setup.wait(0.1)
    assert setup.emulator.speeds == (0, 0) and setup.emulator.firmware.calibrations == 0


def test_an_image_too_large_becomes_40x40_and_the_host_asks():
    setup = Setup("sercom")
    setup.emulator.firmware.room = 3456  # GCtronic's firmware of the e-puck1
    setup.driver.connect()
    setup.wait(1.0)
    assert setup.driver.frame.image.shape == (40, 40, 3)


@pytest.mark.parametrize("bandwidth", [None, SERIAL])
def test_repeated_answers_do_not_make_a_serial_line_late(bandwidth):
    setup = Setup("sercom", bandwidth=bandwidth, faults=Faults(duplicate=0.3, seed=2))
    setup.driver.connect()
    setup.wait(5.0)
    late, newest = [], setup.driver.frame.number
    for _ in range(600):
        setup.wait(1 / 32)
        assert setup.driver.lost is None
        if setup.driver.frame.number > newest:
            newest = setup.driver.frame.number
            late.append(setup.world.steps - number(setup.driver.frame.proximity))
    assert setup.emulator.faults.counts["duplicate"] > 5 and len(late) > 10
    assert max(late) <= 15, late  # 4079 bytes take 12 steps


def test_a_robot_with_cliff_sensors_says_so_twice():
    from dntorch.robot.codecs import sercom

    firmware = build_firmware("sercom")
    firmware.ground = 5
    firmware.take(sercom.text("M") + sercom.chain(sercom.GROUND))
    line, data = firmware.give(lambda: None, lambda: wifi.Sensors(ground=(7, 8, 9)))
    assert line == b"m,7,8,9,7,8\r\n" and len(data) == 10


def test_a_serial_line_is_slow():
    setup = Setup("sercom", bandwidth=SERIAL)
    setup.driver.connect()
    setup.wait(10.0)
    rate = setup.driver.frame.number / 10
    assert 2.4 < rate < 2.9  # 4059 bytes of image and 20 more take 0.35 s, and a tick to answer


def test_frames_come_at_the_rate_of_the_camera_and_late():
    setup = Setup(camera=Camera(fps=5.0, latency=0.2))
    setup.driver.connect()
    ages = []
    for _ in range(320):
        setup.wait(1 / 32)
        if setup.driver.age == 0:
            ages.append(setup.world.steps - number(setup.driver.frame.proximity))
    assert len(ages) in (49, 50, 51)
    setup = Setup()
    setup.driver.connect()
    setup.wait(10.0)
    assert setup.driver.frame.number == 320


# ---------------------------------------------------------------- camera


def test_a_perfect_camera_changes_nothing_and_a_bad_one_each_thing():
    image = np.random.default_rng(0).integers(60, 120, (120, 160, 3)).astype(np.uint8)
    assert np.array_equal(Camera().see(image), image)
    assert np.allclose(Camera(exposure=0.5).see(image), image / 2, atol=0.51)
    cast = Camera((2.0, 1.0, 0.5)).see(image).astype(float)
    assert np.allclose(cast / image, (2.0, 1.0, 0.5), atol=0.02)
    assert Camera(blur=2.0).see(image).std() < 0.4 * image.std()
    noisy = Camera(noise=10.0).see(image).astype(float) - image
    assert 9 < noisy.std() < 11 and abs(noisy.mean()) < 0.5
    assert not np.array_equal(Camera(noise=10.0).see(image, 1), Camera(noise=10.0).see(image, 2))
    assert np.array_equal(HARD.see(image, 3), HARD.see(image, 3))


def test_zoom_shows_the_middle_larger():
    image = np.zeros((120, 160, 3), np.uint8)
    image[30:90, 40:120] = 200
    assert (Camera(zoom=2.0).see(image) == 200).all()
    assert math.isclose(Camera(zoom=2.0).fov(2 * math.atan(0.5)), 2 * math.atan(0.25))


@pytest.mark.parametrize("wrong", [{"zoom": 0.5}, {"fps": 0.0}, {"noise": -1.0}, {"exposure": 0}])
def test_a_camera_that_cannot_be_is_refused(wrong):
    ((name, value),) = wrong.items()
    with pytest.raises(ValueError, match=f"{name}={value}: give a number (above|from)"):
        Camera(**wrong)
    assert MILD.fps == 8.0


# ---------------------------------------------------------------- faults

SET = [b"\1" + bytes(38400), b"\2" + bytes(104)]
WHOLE = b"".join(SET)


def once(**chances):
    return Injector(Faults(**chances, seed=1)).apply(SET, 10.0)


def test_each_fault_does_what_it_says():
    assert once() == [(10.0, WHOLE)]
    (start, head), (later, tail) = once(stall=1.0)
    assert head + tail == WHOLE and (start, later) == (10.0, 16.0)
    ((late, data),) = once(delay=1.0)
    assert data == WHOLE and 10.0 < late < 10.3
    assert len(once(drop=1.0)) == 1
    assert 0 < len(b"".join(data for _, data in once(truncate=1.0))) < len(WHOLE)
    pieces = once(split=1.0)
    assert b"".join(data for _, data in pieces) == WHOLE and len(pieces) == 6
    assert once(duplicate=1.0) == [(10.0, 2 * WHOLE)]
    assert once(garbage=1.0)[0][1].endswith(WHOLE) and once(garbage=1.0)[0][1][0] > 3
    assert once(reset=1.0) is None
    with pytest.raises(ValueError, match="sum to at most 1"):
        Faults(stall=0.6, drop=0.6)
