"""A client that is not ours, in its own process, drives the emulated robot over TCP."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import wait

pytest.importorskip("gymnasium")

from dntorch.envs import RingEnv
from dntorch.robot.emulated.emulator import WIFI_BODY, Emulator
from dntorch.robot.emulated.firmware import WifiFirmware
from dntorch.robot.emulated.servers import TcpServer

CLIENT = Path(__file__).with_name("third_party_client.py")


@pytest.fixture(params=["firmware", "webots"])
def emulator(request):
    world = RingEnv(body=WIFI_BODY)
    world.reset(seed=0)
    server = TcpServer()
    with Emulator(world, server, WifiFirmware(request.param)) as emulator:
        yield emulator
    world.close()


def arguments(emulator, *more):
    server = emulator.server
    return [sys.executable, "-S", str(CLIENT), server.host, str(server.port), *more]


def test_a_foreign_client_sees_turns_and_stops(emulator):
    assert "dntorch" not in CLIENT.read_text()
    done = subprocess.run(arguments(emulator), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    left, right = result["turned"]
    assert left == -right and 20 < right < 200, "about a second at 100 steps/s"
    assert result["rest"] == [0, 0]
    assert sum(count > 200 for count in result["seen"].values()) >= 2
    assert result["proximity"] == [67] * 8  # nothing within 7 cm


def test_after_sigkill_the_firmware_keeps_the_last_speed(emulator):
    client = subprocess.Popen(arguments(emulator, "--hang"), stdout=subprocess.PIPE, text=True)
    assert client.stdout.readline() == "driving\n"
    assert wait(lambda: emulator.speeds == (-80, 80))
    client.send_signal(signal.SIGKILL)
    client.wait()
    client.stdout.close()
    start = emulator.steps
    assert wait(lambda: emulator.steps > start + 20)
    keeps = emulator.firmware.pacing == "firmware"  # Webots' server stops
    assert (emulator.speeds == (-80, 80)) is keeps
