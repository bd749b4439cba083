"""Environments in the shape of Gymnasium's (reset(seed=), step with five values), without importing it. Where gymnasium is
installed, spaces are its Boxes, else plain tuples (low, high, shape)."""

from __future__ import annotations

from typing import Any

from .sim import Sim

try:
    import numpy as np
except ImportError as error:  # pragma: no cover
    raise ImportError("trocar.envs needs numpy (python3-numpy)") from error


def _box(low: float, high: float, shape: tuple[int, ...]) -> Any:
    try:
        from gymnasium.spaces import Box
    except ImportError:
        return low, high, shape
    return Box(low, high, shape, dtype=np.float32)


class Palpation:
    """A probe feels for a hard lump of 24 mm under the surface of a soft liver (the scene "palpate").

    action (3,) float32 in -1..1: velocity of the hand along x, y, z, in parts of 50 mm/s, for one step of 1/30 s.
    observation (9,) float32: position of the hand relative to the middle of the field (m x 10), its force (N), touching (0 or 1),
    velocity of the hand (last action; x, y).
    reward of a step: the force (N) that the probe feels where it is nearer than 12 mm, across, to the middle of the lump, less 0.01,
    less what the force is beyond 4 N. An episode ends (terminated) after half a second of touching within 12 mm, and is cut (truncated) after `seconds`.
    reset(seed=) places the probe above a random point of the field. options: {"lump": stiffness in parts of the tissue}, on the
    first reset only.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 30}
    spec = None

    _MIDDLE = np.array([0.01, -0.005, 0.06])  # m, above the lump
    _HALF = np.array([0.03, 0.025, 0.02])  # m, of the field
    _SPEED = 0.05  # m/s

    def __init__(self, seconds: float = 10, set: dict[str, Any] | None = None, render_mode: str | None = None):
        self.render_mode = render_mode  # "rgb_array": organs have their textures
        self._set, self._seconds, self._sim = dict(set or {}), seconds, None
        self._random = np.random.default_rng()
        self.action_space = _box(-1, 1, (3,))
        self.observation_space = _box(-np.inf, np.inf, (9,))
        self._action, self._hand, self._near = np.zeros(3), self._MIDDLE.copy(), 0.0

    def _observation(self) -> "np.ndarray":
        tool = self._sim.tool()
        return np.concatenate([10 * (self._hand - self._MIDDLE), tool.force, [float(tool.touched == "liver")], self._action[:2]]).astype(np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """The probe above a random point, at rest: (observation, {})."""
        if seed is not None:
            self._random = np.random.default_rng(seed)
        if self._sim is None:
            extra = {"lump": options["lump"]} if options and "lump" in options else {}
            self._sim = Sim("palpate", set={**self._set, **extra}, paint=self.render_mode is not None)
            self._start = self._sim.tool().device
        else:
            self._sim.reset()
        goal = self._MIDDLE + self._HALF * np.array([*self._random.uniform(-1, 1, 2), 1])
        self._sim.tool().set_target(goal, seconds=0.1)
        self._sim.step_until(0.15)
        self._hand, self._action, self._near = goal, np.zeros(3), 0.0
        return self._observation(), {}

    def step(self, action):
        """One thirtieth of a second: (observation, reward, terminated, truncated, info)."""
        if self._sim is None:
            raise RuntimeError("reset the environment before its first step")
        self._action = np.clip(np.asarray(action, dtype=float), -1, 1)
        self._hand = np.clip(self._hand + self._action * self._SPEED / 30, self._MIDDLE - self._HALF, self._MIDDLE + self._HALF)
        self._sim.tool().set_target(self._hand, seconds=1 / 30)
        self._sim.step_until(self._sim.time + 1 / 30 - 5e-4)
        observation = self._observation()
        force = float(np.linalg.norm(observation[3:6]))
        away = float(np.linalg.norm((self._hand - self._MIDDLE)[:2]))
        on_lump = bool(observation[6]) and away < 0.012
        self._near = self._near + 1 / 30 if on_lump else 0.0
        reward = (force if on_lump else 0.0) - 0.01 - max(0.0, force - 4)
        return observation, reward, self._near >= 0.5, self._sim.time >= self._seconds, {"force": force, "away": away}

    def render(self):
        """(480, 640, 3) uint8."""
        return self._sim.picture()

    def close(self) -> None:
        if self._sim is not None:
            self._sim.close()
