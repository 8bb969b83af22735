"""A session without a browser: what it steps, shows, changes and refuses."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from live_models import coupled
from small_runs import write_run

from dntorch import DNF, DNSarsa, Gauss, Global, MemoryTrace, NodeWTA, cosivina, gauss
from dntorch.live.drawing import LEVELS, Drawing, Scale, as_bytes
from dntorch.live.inputs import Peak, recognised
from dntorch.live.pictures import ROWS
from dntorch.live.run_source import RunSource
from dntorch.live.session import Session
from dntorch.live.sources import StructureSource, open_source
from dntorch.modules.architecture import Architecture


def session_of(structure) -> Session:
    return Session(StructureSource(structure))


def test_a_step_is_that_of_the_structure() -> None:
    field, cue = DNF(51), gauss(51, 20, 3.0, 8.0)
    session = session_of(field)
    name = session.touch("field", [20])
    session.set(name, "sigma", 3.0)
    session.set(name, "amplitude", 8.0)
    for _ in range(40):
        output = field(cue)
        session.step()
    picture = session.pictures()["field"]
    assert torch.allclose(torch.from_numpy(picture.activation), field.u, atol=1e-5)
    assert torch.allclose(torch.from_numpy(picture.output), output, atol=1e-5)
    assert torch.allclose(torch.from_numpy(picture.input), cue, atol=1e-5)
    assert session.time == pytest.approx(40 / 32)


def test_what_was_given_stays_as_it_was() -> None:
    field = DNF(20)
    session = session_of(field)
    session.set("field", "h", -2.0)
    session.touch("field", [3])
    session.step(5)
    assert field.h == -5 and bool((field.u == -5).all())
    assert session.source.structure.h == -2
    field(torch.zeros(20))  # its methods are its own, too


def test_input_of_an_element_is_what_reaches_it() -> None:
    session = session_of(coupled())
    session.shown = ["scene", "space", "sum", "trace", "node"]
    session.step(30)
    pictures = session.pictures()
    cue = gauss((4, 30), (1, 10), (0.5, 2.0), 9.0).numpy()
    assert np.allclose(pictures["scene"].input, cue, atol=1e-5)
    assert np.allclose(pictures["sum"].output, pictures["sum"].input)
    assert pictures["space"].activation.argmax() == 10
    assert pictures["trace"].activation.max() > 0.1  # where the field was on
    assert pictures["node"].activation.shape == ()


@pytest.mark.parametrize("label", ["scene", "space", "sum", "trace", "node"])
def test_a_click_puts_an_input_and_another_takes_it_away(label: str) -> None:
    session = session_of(coupled())
    session.shown = [label]
    session.step()
    before = session.pictures()[label].input
    place = [1.0] * len(session.source.parts[label].shape)
    assert session.touch(label, place) == f"input 1 ({label})"
    session.reset()
    session.step()
    more = session.pictures()[label].input - before
    assert more.max() > 0.9 and np.unravel_index(more.argmax(), more.shape) == tuple(place)
    assert session.touch(label, place) is None
    session.reset()
    session.step()
    assert np.allclose(session.pictures()[label].input, before)


def test_every_parameter_has_a_knob() -> None:
    field = DNF((10, 30), (Gauss(3.0, (1.0, 2.0)), Gauss(-1.0, 4.0), Global(-0.1)))
    names = [knob.name for knob in session_of(field).knobs()["field"]]
    assert names == [
        "tau", "h", "steepness", "threshold", "Gauss 1 amplitude", "Gauss 1 sigma y",
        "Gauss 1 sigma x", "Gauss 2 amplitude", "Gauss 2 sigma", "Global 3 amplitude",
    ]  # fmt: skip
    groups = session_of(coupled()).knobs()
    assert set(groups) >= {"scene", "space", "scene -> space", "cue"}
    assert [k.name for k in groups["cue"]] == [
        "amplitude", "position y", "sigma y", "position x", "sigma x"
    ]  # fmt: skip


@pytest.mark.parametrize("structure", [DNF(30), coupled(), NodeWTA(3)], ids=lambda x: type(x))
def test_a_knob_sets_what_it_reads(structure) -> None:
    session = session_of(structure)
    for group, knobs in session.knobs().items():
        for knob in knobs:
            assert knob.low <= session.get(group, knob.name) <= knob.high
            value = session.get(group, knob.name) * 1.1 or 0.5
            session.set(group, knob.name, value)
            assert session.get(group, knob.name) == pytest.approx(value, abs=1e-4), knob.name
    session.step()


def test_a_refused_value_changes_nothing() -> None:
    session = session_of(DNF(30))
    for name, value, sentence in (
        ("tau", 0.0, "tau=0.0 must be positive"),
        ("tau", 0.01, "an explicit step would overshoot"),
        ("h", float("nan"), "not finite"),
        ("Gauss 1 sigma", -1.0, "sigma=-1.0"),
    ):
        before = session.get("field", name)
        with pytest.raises(ValueError, match=sentence):
            session.set("field", name, value)
        assert session.get("field", name) == before
    name = session.touch("field", [3])
    with pytest.raises(ValueError, match=r"sigma=0.0 must be positive"):
        session.set(name, "sigma", 0.0)
    assert session.get(name, "sigma") > 0
    with pytest.raises(ValueError, match="has no 'mass'"):
        session.set("field", "mass", 1.0)


@pytest.mark.parametrize("place", [[], [1, 2], [-1], [30], [float("nan")]])
def test_a_place_outside_is_refused(place: list[float]) -> None:
    session = session_of(DNF(30))
    with pytest.raises(ValueError, match="no place in 'field'"):
        session.touch("field", place)


def test_a_constant_stimulus_is_recognised() -> None:
    for border in ("circular", "zero"):
        value = gauss((12, 40), (3.3, 20.7), (1.5, 4.0), -6.0, border)
        peak = recognised(value)
        assert peak is not None and peak.position == pytest.approx((3.3, 20.7), abs=1e-3)
        assert peak.sigma == pytest.approx((1.5, 4.0), abs=1e-3)
        assert peak.amplitude == pytest.approx(-6, abs=1e-3)
    two = gauss(40, 8, 2.0) + gauss(40, 30, 2.0)
    for other in (two, torch.rand(40), torch.zeros(40), torch.ones(4, 5), torch.tensor(2.0)):
        assert recognised(other) is None
    session = session_of(Architecture({"a": DNF(40)}, ("in", "a"), inputs={"in": two}))
    session.set("in", "gain", 2.0)
    session.step()
    assert np.allclose(session.pictures()["a"].input, 2 * two, atol=1e-6)


def test_reset_goes_back_to_rest_and_keeps_what_was_set() -> None:
    session = session_of(DNF(30))
    session.set("field", "h", -3.0)
    session.touch("field", [5])
    session.step(20)
    session.reset()
    picture = session.pictures()["field"]
    assert session.steps == 0 and np.all(picture.activation == -3) and session.peaks
    assert np.isnan(picture.trail[:-1]).all() and np.all(picture.trail[-1] == -3)
    session.clear()
    assert not session.peaks


def test_the_trail_holds_the_last_steps() -> None:
    session = session_of(DNF((4, 30)))
    session.touch("field", [2, 7])
    session.step(ROWS + 5)
    picture = session.pictures()["field"]
    assert picture.trail.shape == (ROWS, 30)
    assert np.array_equal(picture.trail[-1], picture.activation.max(0))


def test_a_block_is_seen_along_its_first_axis() -> None:
    session = session_of(DNF((3, 4, 5)))
    session.touch("field", [1, 2])
    session.step(3)
    picture = session.pictures()["field"]
    assert picture.activation.shape == (4, 5) and picture.input[1, 2] > 1


def test_time_passes_while_it_plays() -> None:
    session = session_of(DNF(30))
    session.tick()
    assert session.steps == 0
    session.set_speed(4.0)
    session.play()
    begin = time.monotonic()
    while time.monotonic() - begin < 0.5:
        session.tick()
        time.sleep(0.005)
    assert 0.5 * 4 * 32 * 0.5 < session.steps <= 4 * 32 * (time.monotonic() - begin) + 1
    session.pause()
    steps = session.steps
    session.tick()
    assert session.steps == steps
    with pytest.raises(ValueError, match="speed=0 must be positive"):
        session.set_speed(0)


def test_changes_from_other_threads_fall_between_steps() -> None:
    session = session_of(DNF(51))
    session.play()
    session.set_speed(float("inf"))
    done, errors = threading.Event(), []

    def turn() -> None:
        try:
            for k in range(150):
                session.set("field", "h", -5 + 0.01 * k)
                session.set("field", "Gauss 1 amplitude", 20 + 0.01 * k)
                session.touch("field", [20])
                session.pictures()
        except Exception as error:
            errors.append(error)
        done.set()

    threading.Thread(target=turn).start()
    while not done.is_set():
        session.tick()
        time.sleep(0.001)
    assert not errors and not session.trouble and session.steps > 0


def test_a_step_that_fails_stops_and_says_why() -> None:
    session = session_of(MemoryTrace(5))
    session.source.advance = lambda: (_ for _ in ()).throw(ValueError("no\nmore"))
    session.play()
    time.sleep(0.05)
    session.tick()
    assert not session.playing and session.note() == "no more"


# ------------------------------------------------------------------ what may be viewed


def test_a_cosivina_file_runs_with_its_noise(tmp_path: Path) -> None:
    quiet = Architecture({"a": DNF(20, dt=0.001)}, ("n", "a"), inputs={"n": 20})
    source = StructureSource(quiet, noise={"n": (20,)})
    session = Session(source)
    assert session.speed == 1 / 16
    session.step()
    first = session.pictures()["a"].input
    session.step()
    assert first.std() > 0.5 and not np.array_equal(first, session.pictures()["a"].input)
    session.set("noise", "gain", 0.0)
    session.step()
    assert np.all(session.pictures()["a"].input == 0)
    path = tmp_path / "model.json"
    cosivina.save(Architecture({"field u": DNF(50, dt=0.001)}), path)
    again = open_source(path)
    assert again.shown == ["field u"] and again.title == str(path)


def test_what_cannot_be_viewed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="DNSarsa cannot be viewed"):
        open_source(DNSarsa(3))
    with pytest.raises(TypeError, match="target=3 cannot be viewed"):
        open_source(3)
    with pytest.raises(ValueError, match=r"has a batch \[2\]"):
        open_source(DNF(3).resize(2))
    with pytest.raises(ValueError, match="is not there"):
        open_source(tmp_path / "none.json")
    with pytest.raises(ValueError, match="holds no run"):
        open_source(tmp_path)


@pytest.mark.parametrize("world", ["nodes", "ring"])
def test_a_run_goes_on_in_a_fresh_world(world: str, tmp_path: Path) -> None:
    if world == "ring":
        pytest.importorskip("gymnasium")
    write_run(tmp_path, world)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    session = Session(open_source(str(tmp_path)))
    session.step(20)
    assert session.source.found >= 0 and "rewarded" in session.note()
    assert set(session.images()) == ({"outside", "camera"} if world == "ring" else set())
    assert all(matrix.shape == (4, 4) for matrix in session.matrices().values())
    if world == "ring":
        session.touch("sensorimotor.heading", [10])
        session.step()
        assert session.pictures()["sensorimotor.heading"].input[10] > 1
    session.close()
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_reward_by_hand_is_learned_from(tmp_path: Path) -> None:
    sessions = [Session(RunSource(write_run(tmp_path))) for _ in range(3)]
    for k, session in enumerate(sessions):
        session.set("learning", "exploration", 5.0)
        session.learn(k != 2)
        session.step(400)
        if k:
            session.reward()
        session.step(40)
    without, rewarded, deaf = (session.source.agent.weights for session in sessions)
    assert float((rewarded - without).abs().max()) > 0.01
    assert torch.equal(deaf, RunSource(tmp_path).agent.weights)
    with pytest.raises(ValueError, match="exploration=-1"):
        sessions[0].set("learning", "exploration", -1)
    with pytest.raises(ValueError, match="nobody learns"):
        session_of(DNF(3)).reward()


# ------------------------------------------------------------------ what is sent


def test_a_picture_is_a_byte_per_site() -> None:
    session = session_of(DNF((100, 100)))
    described, data = Drawing().encode(session)
    assert data.dtype == np.uint8 and data.nbytes == 3 * 100 * 100 + ROWS * 100
    assert len(described) < 2000
    levels = as_bytes(np.array([[-1.0, 0.5, 2.0, np.nan]]), 0.0, 1.0)
    assert levels.tolist() == [[0, (LEVELS - 1) // 2, LEVELS - 1, LEVELS]]


def test_a_scale_grows_in_few_steps() -> None:
    scale = Scale()
    assert scale.fit(np.array([np.nan])) == (0.0, 1.0)
    first = scale.fit(np.array([-5.0, 3.0]))
    assert first == (-5.0, 3.0) and scale.fit(np.array([2.9])) == first
    low, high = scale.fit(np.array([3.1]))
    assert low == -5 and 3.1 <= high <= 4
    assert Scale().fit(np.zeros(3)) == (0.0, 1.0)


def test_a_peak_of_a_node_is_a_number() -> None:
    assert float(Peak((), (), (), 3.0, ()).tensor()) == 3
