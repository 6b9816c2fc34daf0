r"""The real TORCS as an environment: a racing car, steered 30 times a second.

::

         __________________
       .'        ._________)
      /     .____|
     {      |   .----.          e-track-1: 3,244 m, 15 m wide
      \     `--'      `.        the car: 950 kg, 600 hp, rear wheel drive
       `._______|_______}
                start

Actions, observations and rewards are those of :mod:`dpsearch.envs.driving.rules`, which the embedded track shares, so
that a policy learned there can drive here. Time stands still between two steps; an episode is a function of its start
and the actions, bit for bit. Between the control steps TORCS computes in steps of 2 ms.

- *Start:* the car rolls along the middle of the road at the speed to be held.
- *End:* stuck, off the road or standing; or the limit of 54,000 steps, half an hour. There is no damage, and fuel is
  not used up.
- *State* (``info["state"]``): the fields of :class:`dpsearch.envs.torcs.State` up to ``mu``.

Source: section 3.4.4 of the thesis; TORCS, The Open Racing Car Simulator, by E. Espié, C. Guionneau, B. Wymann and
others, torcs.sourceforge.net.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from dpsearch.env_kit.drawing.canvas import Frame, Window
from dpsearch.envs.driving.drawing import View, picture, text
from dpsearch.envs.driving.rules import (
    CONTROL_HZ,
    KMH,
    LONGEST,
    LOOKAHEAD,
    PROFILE,
    STUCK_SECONDS,
    THESIS_OBSERVATIONS,
    Referee,
    driving_rules,
)
from dpsearch.envs.torcs.client import Simulator, State
from dpsearch.envs.torcs.installation import OWN_CAR, Installation, TorcsError

_HIDDEN = len(State._fields) - 1  # all but the rays


class TORCS(gym.Env[NDArray[Any], Any]):
    """One car on one track of TORCS, which runs as a process of its own from the first reset on.

    Args:
        track: Name of the track; TORCS' own are in ``dpsearch.envs.torcs.Installation.find().tracks()``.
        car: Name of the car: "gt1", like the thesis's, or one of TORCS' own.
        speed_profile: (start, end, seconds) in km/h, km/h and s; a number for a constant speed; None if the agent
            has the pedals.
        observations: Names of the observations, from ``dpsearch.envs.driving.rules.OBSERVATIONS``.
        lookahead: Base (m) and gain (s) of the look-ahead distance, ``base + gain * speed``.
        start: "line", or "random" for anywhere on the road.
        control_hz: Control steps a second, from 10 to 200.
        stuck_seconds: Time off the road or standing after which the car is stuck.
        reward: Reward of a step on the road: "speed", "progress" for the speed along the road, or "centred" for that
            times 1 - position^2.
        max_episode_steps: Steps after which an episode is cut off; 54,000 by default.
        render_mode: "rgb_array", "human" (needs pygame), "ansi" (text) or None.

    Attributes:
        rules: The rules of the drive.
        simulator: The process of TORCS; None before the first reset.
        max_episode_steps: Steps after which an episode is cut off.
        reward_threshold: None: how fast one can go is up to the track.

    Raises:
        ValueError: If an argument is not accepted.
        TorcsError: If TORCS is not installed.
        gymnasium.error.DependencyNotInstalled: If the mode is "human" and pygame is missing.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human", "ansi"], "render_fps": 30}
    reward_threshold: float | None = None

    def __init__(
        self,
        track: str = "e-track-1",
        car: str = OWN_CAR,
        speed_profile: Any = PROFILE,
        observations: Sequence[str] = THESIS_OBSERVATIONS,
        lookahead: Sequence[float] = LOOKAHEAD,
        start: str = "line",
        control_hz: float = CONTROL_HZ,
        stuck_seconds: float = STUCK_SECONDS,
        reward: str = "speed",
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode must be one of rgb_array, human, ansi, or None, got {render_mode!r}")
        self.rules = driving_rules(
            speed_profile=speed_profile,
            observations=observations,
            lookahead=lookahead,
            start=start,
            control_hz=control_hz,
            stuck_seconds=stuck_seconds,
            reward=reward,
        )
        self.max_episode_steps = LONGEST if max_episode_steps is None else max_episode_steps
        if self.max_episode_steps < 1:
            raise ValueError(f"max_episode_steps must be at least 1, got {max_episode_steps}")
        Installation.find().check(track, car)
        self.track, self.car = track, car
        self.observation_space = self.rules.observation_space
        self.action_space = self.rules.action_space
        self.state_space = spaces.Box(-np.inf, np.inf, (_HIDDEN,), np.float64)
        self.render_mode = render_mode
        self._window = Window("TORCS", self.metadata["render_fps"]) if render_mode == "human" else None
        self.simulator: Simulator | None = None
        self._referee: Referee | None = None
        self._elapsed = 0
        self._return = 0.0
        self._stuck = False
        self._state: State | None = None
        self._road: NDArray[np.float64] | None = None
        self._trace: list[tuple[float, float]] = []

    @property
    def mirror_signs(self) -> tuple[float, ...] | None:
        """The signs by which a mirror multiplies observations and actions; None if there are rays among them."""
        return self.rules.mirror_signs

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Puts the car on the road.

        Args:
            seed: Draws the place if ``start`` is "random".
            options: ``driven_steps``, from which the speed profile goes on, and ``distance``, where the car is put
                (m along the middle line). ``info["carry_on"]`` at the end of an episode has both, for the next one.

        Raises:
            ValueError: If an option is another one.
            TorcsError: If TORCS does not start.
        """
        super().reset(seed=seed)
        simulator = self._running()
        driven, distance = self.rules.start_of(options, simulator.length)
        if distance is None:
            distance = self.np_random.uniform(0.0, simulator.length) if self.rules.start == "random" else 0.0
        state = simulator.put(distance, self.rules.target_speed(driven) / KMH)
        self._referee = Referee(self.rules, simulator.length)
        self._referee.reset(driven, _on_the_lap(state, simulator))
        self._elapsed, self._return, self._stuck = 0, 0.0, False
        self._trace.clear()
        self._follow(state)
        return self._told(state)

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Plays one step.

        Raises:
            ValueError: If the action has the wrong shape or is not finite.
            gymnasium.error.ResetNeeded: Before the first reset.
            TorcsError: If TORCS has come to an end.
        """
        simulator, referee = self.simulator, self._referee
        if simulator is None or referee is None:
            raise gym.error.ResetNeeded("call reset before step")
        numbers = self._checked(action)
        try:
            if len(numbers) == 1:
                state = simulator.hold(numbers[0], self.rules.target_speed(referee.driven_steps) / KMH)
            else:
                state = simulator.press(numbers[0], numbers[1])
        except TorcsError as error:
            raise TorcsError(f"{error}; a reset starts it anew") from error
        position = 2.0 * state.to_middle / state.width
        progress = None
        if self.rules.reward != "speed":
            progress = KMH * (state.speed * math.cos(state.angle) - state.slip * math.sin(state.angle))
        reward, self._stuck = referee.step(state.speed * KMH, position, _on_the_lap(state, simulator), progress)
        self._elapsed += 1
        self._return += reward
        self._follow(state)
        truncated = self._elapsed >= self.max_episode_steps
        observation, info = self._told(state)
        if self._stuck or truncated:
            info["carry_on"] = referee.carry_on()
        return observation, reward, self._stuck, truncated, info

    def _running(self) -> Simulator:
        if self.simulator is None or not self.simulator.running:
            self.simulator = Simulator(
                self.track,
                self.car,
                control_hz=self.rules.control_hz,
                lookahead=self.rules.lookahead,
                rays="rays" in self.rules.observations,
            )
        return self.simulator

    def _checked(self, action: Any) -> list[float]:
        """The numbers of the action, clipped to the bounds of the action space."""
        array = np.asarray(action)
        if array.shape != self.action_space.shape or array.dtype.kind not in "iuf" or not np.isfinite(array).all():
            raise ValueError(f"an action must be in {self.action_space}, got {action!r}")
        return [min(max(float(number), -1.0), 1.0) for number in array]

    def _told(self, state: State) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Observation and info."""
        referee = self._referee
        assert referee is not None
        speed, position = state.speed * KMH, 2.0 * state.to_middle / state.width
        seen: dict[str, float | Sequence[float]] = {
            "speed": speed,
            "steering": state.steering,
            "position": position,
            "lookahead": state.bearing,
            "angle": state.angle,
            "curvature": state.curvature,
            "rays": state.rays,
            "target": self.rules.target_speed(referee.driven_steps),
        }
        info = referee.info(speed, position)
        info["state"] = np.array(state[:_HIDDEN])
        return self.rules.show(seen), info

    def _follow(self, state: State) -> None:
        self._state = state
        if self.render_mode is not None:
            self._trace.append((state.x, state.y))
        if self._window is not None:
            self._window.show(self.picture())

    def view(self) -> View:
        """The present moment, for drawings."""
        simulator, state, referee = self.simulator, self._state, self._referee
        assert simulator is not None
        assert state is not None
        assert referee is not None
        if self._road is None:
            self._road = simulator.road()
        speed = state.speed * KMH
        places = np.linspace(0.0, simulator.length, len(self._road), endpoint=False)
        ahead = state.along + self.rules.lookahead_distance(speed)
        x, y = (float(np.interp(ahead, places, self._road[:, i], period=simulator.length)) for i in range(2))
        return View(
            title=f"TORCS: {self.track}",
            line=self._road[:, :2],
            width=self._road[:, 2],
            car=(state.x, state.y, state.yaw),
            wheels=state.steering * simulator.steer_lock,
            lock=simulator.steer_lock,
            verge=None,  # TORCS' walls stand here and there
            lookahead=(x, y),
            trace=np.array(self._trace),
            speed=speed,
            target=None if self.rules.profile is None else self.rules.target_speed(referee.driven_steps),
            position=2.0 * state.to_middle / state.width,
            distance=state.along,
            length=simulator.length,
            laps=referee.laps,
            lap_time=referee.lap_time,
            off_road=referee.off_road,
            stuck=self._stuck,
            seconds=self._elapsed / self.rules.control_hz,
            step=self._elapsed,
            max_steps=self.max_episode_steps,
            episode_return=self._return,
        )

    def picture(self) -> Frame:
        """The present moment as a picture, ``(540, 960, 3)``."""
        return picture(self.view())

    def render(self) -> Any:
        """A frame in mode "rgb_array", a sketch in mode "ansi"; mode "human" shows the frame in a window.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if self.render_mode is None:
            gym.logger.warn(
                "nothing is drawn unless the environment is made with a render_mode: rgb_array, human, ansi"
            )
            return None
        if self._state is None:
            raise gym.error.ResetNeeded("call reset before render")
        if self.render_mode == "ansi":
            return text(self.view())
        if self._window is None:
            return self.picture()
        self._window.show(self.picture())
        return None

    def close(self) -> None:
        """Ends TORCS, and closes the window, if there is one."""
        if self.simulator is not None:
            self.simulator.close()
        if self._window is not None:
            self._window.close()


def _on_the_lap(state: State, simulator: Simulator) -> float:
    """The car's place on the middle line (m), kept between its ends, beyond which rounding may put it."""
    return float(min(max(state.along, 0.0), simulator.length))
