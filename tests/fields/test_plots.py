"""Figures of fields: what is drawn is what was given and found."""

import math
import subprocess
import sys

import pytest
import torch

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

import dntorch
from dntorch import DNF, Gauss, Global, NodeWTA, fixed_points, plots, rollout, space_code


@pytest.fixture
def ax():
    return Figure().subplots()


def drawn(ax, label):
    (line,) = (line for line in ax.lines if line.get_label() == label)
    return torch.as_tensor(line.get_xydata())


def labels(ax):
    return ax.get_xlabel(), ax.get_ylabel()


def test_space_time_shows_a_line_over_seconds(ax):
    field = DNF(40, dt=1 / 32)
    _, states = rollout(field, space_code(torch.full((24,), 10.0), 40, 0.0, 40.0, 3.0, "zero"))
    assert plots.space_time(states.u, field.dt, ax) is ax
    (image,) = ax.images
    torch.testing.assert_close(torch.as_tensor(image.get_array().data), states.u.T)
    assert image.get_extent() == [0.0, 0.75, -0.5, 39.5] and image.origin == "lower"
    assert labels(ax) == ("time (s)", "position (sites)")
    low, high = image.get_clim()
    assert low == -high == states.u.min()  # white is zero
    assert ax.figure.axes[1].get_ylabel() == "activation u"
    output = plots.space_time(states.u.sigmoid(), 0.1, label="output").images[0]
    assert output.get_clim() == (0.0, states.u.sigmoid().max())
    assert plots.space_time(torch.zeros(2, 3), 0.1).images[0].get_clim() == (0.0, 1.0)


def test_peaks_of_a_line_are_marked_on_its_curve(ax):
    u = space_code(torch.tensor([8.3, 39.6]), 40, 0.0, 40.0, 2.0, amplitude=10.0).sum(0) - 5
    plots.peaks(u, ax=ax)
    torch.testing.assert_close(drawn(ax, "field")[:, 1], u.double())
    assert drawn(ax, "field")[:, 0].tolist() == list(range(40))
    place, height = drawn(ax, "centres of peaks").T
    torch.testing.assert_close(place, torch.tensor([8.3, 39.6]).double(), atol=0.05, rtol=0)
    for here, high, left, right in zip(place % 1, height, u[[8, 39]], u[[9, 0]]):
        assert high.item() == pytest.approx((left + here * (right - left)).item(), abs=1e-4)
    assert drawn(ax, "threshold")[:, 1].tolist() == [0.0, 0.0]
    assert labels(ax) == ("position (sites)", "activation u")
    assert len(drawn(plots.peaks(u - 20), "centres of peaks")) == 0


def test_peaks_of_a_sheet_are_marked_at_x_and_y(ax):
    places = torch.tensor([[5.0, 20.0], [14.0, 7.0]])
    u = space_code(places, (20, 30), 0.0, (20.0, 30.0), 1.5, amplitude=10.0).sum(0) - 5
    plots.peaks(u.requires_grad_(), border=("circular", "circular"), ax=ax)
    torch.testing.assert_close(torch.as_tensor(ax.images[0].get_array().data), u.detach())
    assert ax.images[0].get_extent() == [-0.5, 29.5, -0.5, 19.5]
    marks = drawn(ax, "centres of peaks")
    torch.testing.assert_close(marks, places.flip(-1).double(), atol=1e-3, rtol=0)
    assert labels(ax) == ("x (sites)", "y (sites)")


def test_a_kernel_is_the_effect_of_the_middle_site(ax):
    field = DNF(51, (Gauss(20.0, 3.0), Global(-1.0)))
    plots.kernel(field, ax)
    (line,) = (line for line in ax.lines if len(line.get_xdata()) == 51)
    distance, weight = torch.as_tensor(line.get_xydata()).T
    assert distance.tolist() == list(range(-25, 26))
    expected = 20 * torch.exp(-0.5 * (distance / 3) ** 2) / (3 * math.sqrt(2 * math.pi)) - 1
    torch.testing.assert_close(weight, expected, atol=1e-5, rtol=0)
    assert labels(ax) == ("distance (sites)", "weight")


def test_a_kernel_of_a_sheet_has_its_axes_and_all_its_terms(ax):
    field = DNF((21, 31), (Gauss(20.0, (2.0, 3.0)), Gauss(-5.0, 4.0), Global(-0.1)), border="zero")
    plots.kernel(field, ax)
    image = ax.images[0]
    assert image.get_extent() == [-15.5, 15.5, -10.5, 10.5]
    effect = torch.as_tensor(image.get_array().data)
    y, x = torch.arange(-10, 11)[:, None], torch.arange(-15, 16)
    inner = 20 / (2 * math.pi * 6) * torch.exp(-0.5 * ((y / 2) ** 2 + (x / 3) ** 2))
    outer = -5 / (2 * math.pi * 16) * torch.exp(-0.5 * ((y / 4) ** 2 + (x / 4) ** 2))
    torch.testing.assert_close(effect, (inner + outer - 0.1).double(), atol=1e-4, rtol=0)
    assert labels(ax) == ("distance along x (sites)", "distance along y (sites)")


@pytest.mark.parametrize("node", [DNF((), [Global(6.0)]), NodeWTA(1, excitation=6.0, tau=0.2)])
def test_a_phase_plot_crosses_zero_at_its_fixed_points(ax, node):
    plots.phase(node, torch.tensor([0.0, 2.0]), ax)
    assert labels(ax) == ("activation u", "du/dt (1/s)")
    for k, input in enumerate((0.0, 2.0)):
        u, rate = drawn(ax, f"input {input:g}").T
        points = fixed_points(node, input)
        crossings = u[:-1][rate[:-1] * rate[1:] <= 0]
        step = (u[1] - u[0]).item()
        for point in points:
            assert (crossings - point.u).abs().min() < 1.01 * step
        stable = [line for line in ax.lines if line.get_gid() == "stable"][k]
        unstable = [line for line in ax.lines if line.get_gid() == "unstable"][k]
        assert list(stable.get_xdata()) == [p.u for p in points if p.stable]
        assert list(unstable.get_xdata()) == [p.u for p in points if not p.stable]
        assert not any(stable.get_ydata()) and not any(unstable.get_ydata())
        assert stable.get_markerfacecolor() != unstable.get_markerfacecolor() == "white"
        state = node.initial([])._replace(u=u.to(node.u)[:1].reshape(node.u.shape))
        _, after = node.step(torch.full_like(node.u, input), state)  # the node moves at this rate
        moved = (after.u - state.u).item() / node.dt
        assert moved == pytest.approx(rate[0].item(), rel=1e-3)


def test_a_phase_plot_ends_at_the_floor(ax):
    plots.phase(NodeWTA(1, floor=-6.0), -4.0, ax)
    assert drawn(ax, "input -4")[0, 0] == -6.0


def test_nothing_global_is_left_behind():
    program = (
        "import sys, torch, dntorch\n"
        "from dntorch import DNF, plots\n"
        "assert 'matplotlib' not in sys.modules\n"
        "plots.kernel(DNF(9)).figure\n"
        "assert 'matplotlib' in sys.modules and 'matplotlib.pyplot' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    figure = plots.kernel(DNF(9)).figure
    assert isinstance(figure, Figure)
    figure.canvas.draw()


def test_without_matplotlib_a_figure_names_what_to_install():
    program = (
        "import sys\n"
        "sys.modules['matplotlib'] = None\n"
        "import dntorch\n"
        "try: dntorch.plots.kernel(dntorch.DNF(9))\n"
        "except ImportError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    said = "matplotlib is not installed: run pip install 'dntorch[cli]'"
    assert done.stdout.strip() == said, done.stderr


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (lambda: plots.space_time(torch.zeros(5), 0.1), r"field of shape \[5\] can't be drawn"),
        (lambda: plots.space_time(torch.zeros(5, 5), 0.0), "dt=0.0 must be positive: give seconds"),
        (lambda: plots.space_time(torch.zeros(5, 5) / 0, 0.1), "field has 25 NaN of 25"),
        (lambda: plots.peaks(torch.zeros(2, 5)), r"u of shape \[2, 5\] is no single line or sheet"),
        (lambda: plots.peaks(torch.zeros(5), border="both"), "border='both' is unknown"),
        (lambda: plots.kernel(DNF(())), r"field of shape=\[\] has 0 axes: give one of 1 or 2"),
        (lambda: plots.phase(DNF(5)), "more than one"),
        (lambda: plots.phase(DNF(()), math.nan), "input has 1 NaN"),
    ],
)
def test_they_refuse_in_one_sentence(draw, words):
    with pytest.raises(ValueError, match=words):
        draw()


def test_they_refuse_what_is_none_of_theirs():
    with pytest.raises(TypeError, match="field is a NodeWTA: give a DNF"):
        dntorch.plots.kernel(NodeWTA(1))
    with pytest.raises(TypeError, match="field is a list: give a tensor"):
        dntorch.plots.space_time([[1.0]], 0.1)
