"""Tasks and worlds that are drawn, one for each agent; and the discrete learner by their rule."""

import numpy as np
import torch

from dntorch.envs.task import SequenceTask
from dntorch.paper.autonomous import Rule, autonomous
from dntorch.paper.beyond import SECTIONS
from dntorch.paper.discrete import Learning
from dntorch.paper.drawn import DrawnTask, draw_feasible, draw_targets
from dntorch.paper.populations import Population
from dntorch.runs.config import Config
from dntorch.runs.run import Run

LEARNING = Learning(0.1, 0.7, 0.8)


def test_each_agent_is_rewarded_for_its_own_sequence():
    task = DrawnTask(SequenceTask("GBY"), torch.tensor([[0, 1, 2], [2, 1, 2]]), 4)
    state, progress = task.initial((2,)), []
    for color in (0, 1, 2, 1, 2):
        _, completed, state = task.step(torch.tensor([color, color]), state)
        progress.append([round(3 * share) for share in task.progress(state).tolist()])
    assert completed.tolist() == [False, True]
    assert progress == [[1, 0], [2, 0], [3, 1], [0, 2], [0, 3]]


def test_sequences_are_drawn_for_an_agent_and_from_all():
    targets = draw_targets(7, range(3000), n=4, length=3)
    assert torch.equal(draw_targets(7, [5, 6], n=4, length=3), targets[5:7])
    kinds, counts = targets.unique(dim=0, return_counts=True)
    assert len(kinds) == 36 and counts.min() > 40  # of about 83 each
    assert not (targets[:, 1:] == targets[:, :-1]).any()


def test_what_may_follow_leaves_no_dead_end():
    tables = draw_feasible(3, range(50), n=8, after=2)
    assert (tables.sum(-1) == 2).all() and (tables.sum(-2) == 2).all()
    assert not tables.diagonal(dim1=1, dim2=2).any()
    targets = draw_targets(3, range(50), 8, 5, tables)
    for table, target in zip(tables, targets):
        assert table[target[1:], target[:-1]].all()


def test_more_behaviours_than_colours_act_in_the_abstract_world():
    config = Config(world="nodes", steps=600, explore=600)
    group = Population(config, (0, 1, 2), drawn=True, count=16, after=2, keep_weights=False)
    run = Run(group, events=True)
    run.advance(600)
    assert run.agent.n == 16 and run.world.n == 16
    assert run.world.feasible is not None and len(run.memory.joined()["find"])


def test_the_discrete_rule_tries_every_sequence_once_before_any_twice():
    """With all of a context, and nothing that is rewarded: the limit of exploration."""
    nothing = np.full((20, 5), -9)
    rule = Rule(order=2, recovery=1e9)
    behaviors, rewarded = autonomous(LEARNING, 1.0, rule, nothing, n=3, total=12, seed=0)
    assert not rewarded.any()
    for sequence in behaviors.tolist():
        seen, again = {}, 0
        for k in range(2, 12):
            tried = seen.setdefault(tuple(sequence[k - 2 : k]), set())
            again += len(tried) == 1 and sequence[k] in tried
            tried.add(sequence[k])
        assert again == 0


def test_the_discrete_rule_learns_and_needs_the_state():
    target = np.tile([1, 2, 3, 0, 1], (10, 1))
    behaviors, rewarded = autonomous(LEARNING, 1.0, Rule(), target, n=4, total=900, seed=0)
    assert (rewarded[:, -40:].sum(1) >= 9).sum() >= 9
    ends = [(behaviors[:, k - 4 : k + 1] == target).all(1) for k in range(4, 900)]
    assert np.array_equal(np.array(ends).T, rewarded[:, 4:])
    twice = np.tile([1, 2, 1, 3, 1], (10, 1))  # two followers of 1
    for depth, least, most in ((0, 0, 1), (1, 8, 10)):
        rule = Rule(depth=depth)
        _, rewarded = autonomous(LEARNING, 1.0, rule, twice, n=4, total=1200, seed=0)
        assert least <= (rewarded[:, -40:].sum(1) >= 9).sum() <= most
    later = target[:, ::-1]
    behaviors, rewarded = autonomous(
        LEARNING, 1.0, Rule(), target, n=4, total=1200, seed=0, then=(later, 600)
    )
    assert (rewarded[:, 560:600].sum(1) >= 9).sum() >= 9  # before the change
    ends = [(behaviors[:, k - 4 : k + 1] == later).all(1) for k in range(600, 1200)]
    assert np.array_equal(np.array(ends).T, rewarded[:, 600:]) and rewarded[:, 600:].any()


def test_every_line_beyond_the_paper_makes_agents_and_a_world():
    lines = [line for section in SECTIONS.values() for line in section(0, 2).values()]
    assert len(lines) == 41
    for group in lines:
        run = Run(group, events=True)
        assert run.agent.decisions.shape == (len(group.agents),)
        assert set(run.agent.senses) <= set(run.world.senses)
