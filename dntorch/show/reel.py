"""A film of a robot: kept while it drives, drawn when there is time."""

import copy
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dntorch.drive.driving import Step, Trip
from dntorch.modules.sarsa import DNSarsa
from dntorch.runs.config import Config
from dntorch.show.film import film, stride_of
from dntorch.show.panels import Moment


class Reel:
    """Keeps what a film in the paper's layout needs, a few times a second.

    Args:
        agent, config: that drive.
        glance: what the panel "outside" needs, at once: a pose, or an image.
        develop: makes an image of it, later.
        fps: pictures/s, about, as in `write_video`.
        title: of the panel.
    """

    def __init__(
        self,
        agent: DNSarsa,
        config: Config,
        glance: Callable[[], Any],
        develop: Callable[[Any], np.ndarray] = lambda image: image,
        fps: float = 8,
        title: str = "outside",
    ) -> None:
        self.agent, self.config, self.fps, self.title = agent, config, fps, title
        self.glance, self.develop = glance, develop
        self._stride, self._kept = stride_of(fps, config), []

    def take(self, step: Step, trip: Trip) -> None:
        """Look at one control step, after ``trip`` wrote it."""
        if trip.steps % self._stride == 0:
            score = trip.steps, len(trip.found), len(trip.completed), step.reward > 0
            self._kept.append((self.glance(), step.observation["image"], self.agent.state, score))

    def write(self, path: Path) -> Path:
        """Draw all of it, as a WebM film.

        Raises:
            RuntimeError: as `write_video`.
        """
        actor = copy.deepcopy(self.agent)
        return film(actor, self.config, self._moments(actor), path, self.fps)

    def _moments(self, actor: DNSarsa) -> Iterator[Moment]:
        outside = None
        for number, (glance, image, state, (steps, found, rewards, paid)) in enumerate(self._kept):
            # The view from outside takes longer than all the rest: every second one will do.
            outside = self.develop(glance) if outside is None or number % 2 == 0 else outside
            actor.state = state
            yield Moment(outside, image, steps, found, rewards, paid, self.title)
