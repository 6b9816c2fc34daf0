r"""Balancing one or two poles on a cart, with or without being shown the velocities.

::

                   \
        long pole   \      /  short pole, a tenth as long
                     \    /
                   +------+
               F ->|      |
    |--------------+-o--o-+-----------------|
    -2.4 m             0               2.4 m

- *Start:* the cart at rest in the middle, the long pole at rest at 0.0700851 rad (4 degrees), the short one upright.
  Other starts on request, among them the 625 of the usual test of generalisation, one of which is drawn at random.
- *Action:* one number in [-1, 1], the force on the cart in units of 10 N. A weaker force than 10/256 N is raised to
  that, so the cart never stands still by itself. An action lasts 0.02 s.
- *Observations:* ``DoublePole`` shows x/4.8, v/2, a_1/0.52, w_1/2, a_2/0.52, w_2/2: place and velocity of the cart,
  angle and angular velocity of the long pole and of the short one (metres, radians, seconds). ``DoublePoleHidden``
  keeps the velocities back. ``SinglePole`` and ``SinglePoleHidden`` have the long pole alone.
- *Rewards:* by default 1 for every step survived. With ``reward="failure"``, -1 for the step in which something
  falls, and nothing else. With ``reward="damping"``, rewards add up to Gruau's fitness, see below.
- *End:* the cart more than 2.4 m away from the middle, or a pole leaning by more than 36 degrees, if there are two,
  or 12, if there is one; or the limit of 100,000 steps, half an hour, which counts as solved.

**Damping.** A controller without memory for velocities can balance two poles by shaking the cart. Gruau's fitness
rewards calm: 0.1 f_1 + 0.9 f_2, with f_1 = t / 1000 after t steps survived, and f_2 = 0 for t < 100, else
0.75 divided by the sum, from i = t - 100 to t, of abs(x_i) + abs(v_i) + abs(a_1,i) + abs(w_1,i), over an episode of
1,000 steps. Each step earns what it adds to the fitness, so that the return is the fitness however long the episode;
a step in which something falls adds nothing.

Sources: A. P. Wieland, "Evolving neural network controllers for unstable systems", IJCNN 1991; F. Gomez and
R. Miikkulainen, "Incremental evolution of complex general behavior", Adaptive Behavior 5, 1997; F. Gruau, D. Whitley
and L. Pyeatt, "A comparison between cellular encoding and direct encoding for genetic neural networks", GP 1996
(damping fitness and test of generalisation).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray
from typing_extensions import override

from dpsearch.env_kit.drawing.canvas import Frame
from dpsearch.env_kit.env import KernelEnv
from dpsearch.env_kit.task import Task
from dpsearch.env_kit.vector_env import VectorOf
from dpsearch.envs.poles.drawing import View, picture, text
from dpsearch.envs.poles.kernel import applied_force, pack

TRACK = 2.4
"""Largest distance of the cart from the middle (m)."""
LEAN = {1: math.radians(12), 2: math.radians(36)}
"""Largest angle of a pole (rad), by the number of poles."""
FASTEST = 10.0
"""The largest velocity of a start state, in m/s or rad/s."""
START_ANGLE = 0.0700851
"""First angle of the long pole (rad); all else starts at 0."""
SCALES = (4.8, 2.0, 0.52, 2.0, 0.52, 2.0)
"""Divisors of the numbers of the state, which give the observations."""
LONGEST = 100_000
DAMPING_LIMIT = 1000
REWARDS: dict[str, tuple[float, float] | None] = {"steps": (1.0, 0.0), "failure": (0.0, -1.0), "damping": None}
"""Rewards of a step survived, and of a step in which something falls; None for Gruau's fitness."""
GENERALISATION = "generalisation"

_GRUAU_FRACTIONS = (0.05, 0.25, 0.5, 0.75, 0.95)
_GRUAU_RANGES = (2.16, 1.35, math.radians(3.6), math.radians(8.6))  # each from minus to plus: m, m/s, rad, rad/s


def generalisation_starts(poles: int) -> NDArray[np.float64]:
    """The 625 starts of Gruau's test of generalisation, ``(625, 2 + 2 poles)``.

    All combinations of .05, .25, .5, .75 and .95 of the ranges of the cart's place (2.16 m either side) and velocity
    (1.35 m/s), and of the long pole's angle (3.6 degrees) and velocity (8.6 degrees/s), the last one changing fastest.
    The short pole stands upright.

    Args:
        poles: Number of poles, 1 or 2.

    Raises:
        ValueError: If ``poles`` is neither.
    """
    if poles not in LEAN:
        raise ValueError(f"poles must be 1 or 2, got {poles!r}")
    values = [[(2.0 * fraction - 1.0) * end for fraction in _GRUAU_FRACTIONS] for end in _GRUAU_RANGES]
    grid = np.stack(np.meshgrid(*values, indexing="ij"), axis=-1).reshape(-1, 4)
    return np.pad(grid, ((0, 0), (0, 2 * poles - 2)))


@dataclass(frozen=True, kw_only=True)
class PoleTask(Task):
    """The task of balancing one or two poles.

    Attributes:
        poles: Number of poles, 1 or 2.
        velocities: Whether velocities are observed.
        reward: Kind of reward: "steps", "failure" or "damping".
    """

    poles: int
    velocities: bool
    reward: str

    @override
    def hidden(self, states: NDArray[np.float64]) -> NDArray[Any]:
        """Places, angles and velocities, without the rows that the kernel keeps for rewarding damping."""
        return states[:, : 2 + 2 * self.poles]

    @override
    def threshold(self, limit: int) -> float | None:
        """Mean return of never falling; None with damping."""
        return {"steps": float(limit), "failure": 0.0}.get(self.reward)


def pole_task(
    poles: int,
    velocities: bool,
    reward: str = "steps",
    start_state: ArrayLike | str | None = None,
    cart_friction: float = 0.0,
    max_episode_steps: int | None = None,
) -> PoleTask:
    """The task of balancing.

    Args:
        poles: Number of poles, 1 or 2.
        velocities: Whether velocities are observed.
        reward: Kind of reward: "steps", "failure" or "damping".
        start_state: Start state or states, as in :class:`PolesEnv`.
        cart_friction: Force in N that brakes a moving cart.
        max_episode_steps: Steps after which an episode is cut off; None for the usual limit.

    Raises:
        ValueError: If an argument is not accepted.
    """
    if reward not in REWARDS:
        raise ValueError(f"reward must be one of {', '.join(REWARDS)}, got {reward!r}")
    if not isinstance(cart_friction, int | float) or not 0.0 <= cart_friction < math.inf:
        raise ValueError(f"cart_friction must be finite and at least 0, got {cart_friction!r}")
    if max_episode_steps is None:
        max_episode_steps = DAMPING_LIMIT if reward == "damping" else LONGEST
    starts = _checked_starts(start_state, poles)
    size = starts.shape[1]
    # Only just after a fall is anything beyond its limit, and never so far beyond.
    high = np.array([2.0 * TRACK, np.inf, *[math.pi / 2, np.inf] * poles])
    seen = range(0, size, 1 if velocities else 2)
    shown = (high / SCALES[:size])[seen].astype(np.float32)
    return PoleTask(
        kernel=pack(starts, (TRACK, LEAN[poles]), REWARDS[reward], cart_friction, SCALES[:size], seen),
        observation_space=spaces.Box(-shown, shown, dtype=np.float32),
        action_space=spaces.Box(-1.0, 1.0, (1,), np.float32),
        state_space=spaces.Box(-high, high, dtype=np.float64),
        max_episode_steps=max_episode_steps,
        poles=poles,
        velocities=velocities,
        reward=reward,
    )


def _checked_starts(start_state: ArrayLike | str | None, poles: int) -> NDArray[np.float64]:
    """A start state, or several, as rows ``(n, 2 + 2 poles)``."""
    size, lean = 2 + 2 * poles, LEAN[poles]
    if start_state is None:
        return np.array([[0.0, 0.0, START_ANGLE, *[0.0] * (size - 3)]])
    if isinstance(start_state, str) and start_state == GENERALISATION:
        return generalisation_starts(poles)
    try:
        starts = np.atleast_2d(np.array(start_state, np.float64))
    except (TypeError, ValueError):
        starts = np.empty(0)
    if starts.ndim != 2 or starts.shape[1] != size or len(starts) == 0:
        raise ValueError(
            f"start_state must be {size} numbers, or rows of so many, or {GENERALISATION!r}, got {start_state!r}"
        )
    largest = np.array([TRACK, FASTEST, *[lean, FASTEST] * poles])
    if not (np.abs(starts) <= largest).all():
        bounds = ", ".join(f"{bound:.4g}" for bound in largest)
        raise ValueError(f"start_state must be within {bounds} either side of 0, got {start_state!r}")
    return starts


class PolesEnv(KernelEnv):
    """One cart with its poles, as drawn above. The four tasks are subclasses.

    Args:
        reward: Kind of reward: "steps", "failure" or "damping".
        start_state: Start state x, v, a_1, w_1 (and a_2, w_2) in metres, radians and seconds, within the limits,
            velocities up to 10; or rows of these, of which each episode draws one at random; or "generalisation" for
            the 625 of :func:`generalisation_starts`. None for the usual start.
        cart_friction: Force in N that brakes a moving cart. Wieland lists 5e-4, and the literature leaves it out.
        max_episode_steps: Steps after which an episode is cut off; 100,000 by default, and 1,000 with damping.
        render_mode: "rgb_array", "human" (needs pygame), "ansi" (text) or None.

    Attributes:
        poles: Number of poles.
        velocities: Whether velocities are observed.

    Raises:
        ValueError: If an argument is not accepted.
    """

    poles: ClassVar[int]
    velocities: ClassVar[bool]
    task: PoleTask
    metadata = {"render_modes": ["rgb_array", "human", "ansi"], "render_fps": 50}

    def __init__(
        self,
        reward: str = "steps",
        start_state: ArrayLike | str | None = None,
        cart_friction: float = 0.0,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        super().__init__(self.make_task(reward, start_state, cart_friction, max_episode_steps), render_mode)

    @classmethod
    def make_task(
        cls,
        reward: str = "steps",
        start_state: ArrayLike | str | None = None,
        cart_friction: float = 0.0,
        max_episode_steps: int | None = None,
    ) -> PoleTask:
        """The task that the class plays with these arguments."""
        return pole_task(cls.poles, cls.velocities, reward, start_state, cart_friction, max_episode_steps)

    def view(self) -> View:
        """The present moment, for drawings."""
        state = self.kernel_state()
        return View(
            state=tuple(state[: 2 + 2 * self.poles].tolist()),
            scales=SCALES,
            velocities=self.velocities,
            track=TRACK,
            lean=LEAN[self.poles],
            force=None if self.last_action is None else applied_force.py_func(float(np.asarray(self.last_action)[0])),
            step=self.elapsed_steps,
            max_steps=self.max_episode_steps,
            episode_return=self.episode_return,
        )

    def picture(self) -> Frame:
        """The moment as a picture, ``(540, 960, 3)``."""
        return picture(self.view())

    def text(self) -> str:
        """The moment in a few lines of text."""
        return text(self.view())


class SinglePole(PolesEnv):
    """One pole: place, angle and their velocities are shown."""

    poles, velocities = 1, True


class SinglePoleHidden(PolesEnv):
    """One pole: only place and angle are shown."""

    poles, velocities = 1, False


class DoublePole(PolesEnv):
    """Two poles: place, angles and their velocities are shown."""

    poles, velocities = 2, True


class DoublePoleHidden(PolesEnv):
    """Two poles: only place and angles are shown."""

    poles, velocities = 2, False


class SinglePoleVector(VectorOf):
    """Many :class:`SinglePole`."""

    scalar = SinglePole


class SinglePoleHiddenVector(VectorOf):
    """Many :class:`SinglePoleHidden`."""

    scalar = SinglePoleHidden


class DoublePoleVector(VectorOf):
    """Many :class:`DoublePole`."""

    scalar = DoublePole


class DoublePoleHiddenVector(VectorOf):
    """Many :class:`DoublePoleHidden`."""

    scalar = DoublePoleHidden
