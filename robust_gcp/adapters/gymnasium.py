"""Many motions of a mechanism as a vector environment of Gymnasium: loops exact, through singular places.

Each environment is a row of a `Batch`, so its mode is kept wherever it goes. Needs the extra `gymnasium`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..checks import check_callable, check_mechanism, check_positive, check_whole, shown
from ..errors import OptionError, missing_extra
from ..mechanism.mechanism import Mechanism
from ..mechanism.tree.joints import JointKind
from ..mechanism.tree.tree import Array
from ..simulation.batches.batch import Batch

try:
    import gymnasium
    from gymnasium.spaces import Box
    from gymnasium.vector import AutoresetMode
    from gymnasium.vector.utils import batch_space
except ImportError as missing:
    raise missing_extra("environments need gymnasium", "gymnasium", "gymnasium") from missing


Reward = Callable[[Array, Array, Array], Any]
"""(q, v, action) -> rewards (N,), of states after the action."""

Start = Callable[[np.random.Generator, int], tuple[Any, Any]]
"""(rng, n) -> q0 and v0 of n motions, as `Batch.reset` takes them."""


class MechanismVectorEnv(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """N motions, each begun anew in the step after its episode's end (`AutoresetMode.NEXT_STEP`).

    An action is a number from −1 to 1 for each motor, held over `substeps` steps of RK4; an observation the
    sines and cosines of revolute joints, the positions of prismatic ones, all velocities. A motion that must
    stop is `terminated`; one that came to `max_steps` actions is `truncated`.

    Parameters
    ----------
    mechanism : Mechanism
    num_envs : int
    motors : mapping of str to float
        The largest torque (N m) or force (N) by joint.
    reward : callable (q, v, action) -> (N,)
        Of (N, nq), (N, nv) and (N, motors), after the action.
    step : float
        s.
    substeps : int
        Steps for each action.
    max_steps : int
        Actions of an episode.
    start : callable (rng, n) -> (q0, v0), optional
        Home, and at rest, when left out.
    done : callable (q, v) -> (N,) of bool, optional
        Where an episode ends.
    observe : callable (q, v) -> (N, k), optional
        Another observation.
    threads : int
        On which the motions are shared out.

    Attributes
    ----------
    batch : Batch
        The motions.

    Raises
    ------
    OptionError, StateError, SimulationError
        As `Batch`, and for motors that are none.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012 - theirs

    def __init__(
        self,
        mechanism: Mechanism,
        num_envs: int,
        motors: Mapping[str, float],
        reward: Reward,
        *,
        step: float = 1e-3,
        substeps: int = 10,
        max_steps: int = 500,
        start: Start | None = None,
        done: Callable[[Array, Array], Any] | None = None,
        observe: Callable[[Array, Array], Any] | None = None,
        threads: int = 1,
    ) -> None:
        check_mechanism(mechanism, Mechanism, "MechanismVectorEnv")
        check_whole("substeps", substeps, 1)
        check_whole("max_steps", max_steps, 1)
        given: Any = motors
        if not isinstance(given, Mapping) or not given:
            raise OptionError(f"motors = {shown(given)} must be {{joint: largest torque}}")
        for name, most in motors.items():
            check_positive(f"motors[{name!r}]", most)
        self._by = np.array([mechanism.velocity({name: most}, "motors") for name, most in motors.items()])
        self._reward, self._start, self._done = reward, start, done
        self._substeps, self._max_steps = substeps, max_steps
        for label, function in (("reward", reward), ("start", start), ("done", done), ("observe", observe)):
            check_callable(label, function, "of arrays, see MechanismVectorEnv")
        self._observe = self._usual if observe is None else observe
        # of no seed yet, which `reset` is given: to know the shapes
        q0, v0 = (None, None) if start is None else start(np.random.default_rng(0), num_envs)
        self.batch = Batch(mechanism, num_envs, q0, v0, step, threads=threads)
        self._turning = np.zeros(mechanism.nq, bool)
        self._turning[[joint.idx_q for joint in mechanism.joints if joint.kind == JointKind.REVOLUTE]] = True
        self.num_envs, self._age = num_envs, np.zeros(num_envs, np.int64)
        self._over = np.zeros(num_envs, bool)
        seen = np.shape(self._observe(self.batch.q, self.batch.v))
        if len(seen) != 2 or seen[0] != num_envs:
            raise OptionError(f"observe(q, v) returned shape {seen}, expected ({num_envs}, k)")
        size = seen[1]
        self.single_observation_space = Box(-np.inf, np.inf, (size,), np.float32)
        self.single_action_space = Box(-1.0, 1.0, (len(motors),), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin all motions anew; all of them draw from one generator, which `seed` is of."""
        if seed is not None:
            check_whole("seed", seed, 0)
        super().reset(seed=None if seed is None else int(seed), options=options)
        self._begin(np.arange(self.num_envs))
        return self._observed(), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Hold actions (N, motors) over `substeps` steps; those that were over begin anew instead."""
        over, given = self._over.copy(), np.clip(np.asarray(actions, dtype=float), -1.0, 1.0)
        if given.shape != (self.num_envs, len(self._by)):
            raise OptionError(f"actions have shape {given.shape}, expected {(self.num_envs, len(self._by))}")
        # those that are over move on too, which nobody sees: they begin anew after it
        self.batch.step(given @ self._by, self._substeps)
        if over.any():
            self._begin(np.flatnonzero(over))
        self._age[~over] += 1
        q, v = self.batch.q, self.batch.v
        reward = np.where(over, 0.0, self._each("reward(q, v, action)", self._reward(q, v, given)))
        terminated = (self.batch.status != 0) & ~over
        if self._done is not None:
            terminated |= self._each("done(q, v)", self._done(q, v)).astype(bool) & ~over
        truncated = (self._age >= self._max_steps) & ~terminated & ~over
        self._over = terminated | truncated
        return self._observed(), reward, terminated, truncated, {}

    def _each(self, label: str, value: Any) -> Any:
        """What a function of the user's says of each motion, or of all."""
        found = np.asarray(value)
        if found.shape not in ((), (self.num_envs,)) or found.dtype.kind not in "biuf":
            raise OptionError(f"{label} returned {shown(value)}, expected ({self.num_envs},) numbers")
        return found

    def _begin(self, rows: Any) -> None:
        q0, v0 = (None, None) if self._start is None else self._start(self.np_random, len(rows))
        self.batch.reset(rows, q0, v0)
        self._age[rows], self._over[rows] = 0, False

    def _observed(self) -> Any:
        return np.asarray(self._observe(self.batch.q, self.batch.v), np.float32)

    def _usual(self, q: Array, v: Array) -> Array:
        """Sines and cosines of revolute joints, other numbers of q as they are, and v."""
        turning = self._turning
        return np.hstack([np.sin(q[:, turning]), np.cos(q[:, turning]), q[:, ~turning], v])
