"""Motions as environments of Gymnasium."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import robust_gcp as rg

gymnasium = pytest.importorskip("gymnasium")

from robust_gcp.adapters.gymnasium import MechanismVectorEnv  # noqa: E402

MECH = rg.load("rhombus")


def _reward(q: Any, v: Any, action: Any) -> Any:
    return np.sin(q[:, 0]) - 1e-3 * action[:, 0] ** 2


def _env(n: int = 3, **options: Any) -> MechanismVectorEnv:
    return MechanismVectorEnv(MECH, n, {"q1": 5.0}, _reward, **options)


def test_motions_are_those_of_simulations_through_flat() -> None:
    env, rng = _env(max_steps=100), np.random.default_rng(4)
    observed, _ = env.reset(seed=0)
    assert observed.shape == (3, 9) and env.observation_space.contains(observed)
    alone = [rg.Simulation(MECH, keep="last") for _ in range(3)]
    for _ in range(60):
        actions = rng.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        observed, reward, terminated, truncated, _ = env.step(actions)
        for i, one in enumerate(alone):
            one.step({"q1": 5.0 * float(actions[i, 0])}, 10)
        q, v = np.array([one.q for one in alone]), np.array([one.v for one in alone])
        expected = np.hstack([np.sin(q), np.cos(q), v])
        np.testing.assert_allclose(observed, expected, rtol=2e-6, atol=2e-6)
        np.testing.assert_allclose(reward, _reward(q, v, actions.astype(float)), atol=1e-12)
        assert not terminated.any() and not truncated.any()
    assert env.batch.crossings.all()


def test_episodes_end_and_begin_anew_in_the_next_step() -> None:
    def start(rng: np.random.Generator, n: int) -> tuple[Any, Any]:
        return None, np.array([MECH.lift(MECH.home, [u]) for u in rng.uniform(-1.0, 1.0, n)])

    env = _env(4, max_steps=5, start=start, done=lambda q, v: q[:, 0] > 1e9)
    first, _ = env.reset(seed=7)
    again, _ = env.reset(seed=7)
    np.testing.assert_array_equal(first, again)
    actions = np.zeros((4, 1))
    for k in range(12):
        observed, reward, terminated, truncated, _ = env.step(actions)
        assert truncated.all() == (k in (4, 10)) and not terminated.any()
        if k == 5:
            assert not reward.any() and not np.array_equal(observed, first)
            np.testing.assert_array_equal(env.batch.t, np.zeros(4))


@pytest.mark.filterwarnings("ignore::robust_gcp.CoarseStepWarning")
def test_a_motion_that_must_stop_is_terminated() -> None:
    env = MechanismVectorEnv(MECH, 3, {"q1": 1e200}, _reward)
    env.reset()
    _, _, terminated, truncated, _ = env.step(np.array([[0.0], [1.0], [0.0]]))
    assert terminated.tolist() == [False, True, False] and not truncated.any()
    observed, _, terminated, _, _ = env.step(np.zeros((3, 1)))
    assert not terminated.any() and np.isfinite(observed).all()


@pytest.mark.parametrize(
    ("given", "match"),
    [({"motors": {}}, "motors"), ({"motors": {"q9": 1.0}}, "q9"), ({"motors": {"q1": -1.0}}, "q1"),
     ({"substeps": 0}, "substeps"), ({"max_steps": 0}, "max_steps")],
)  # fmt: skip
def test_refusals(given: dict[str, Any], match: str) -> None:
    options = {"motors": {"q1": 1.0}, "reward": _reward} | given
    with pytest.raises(rg.RobustGcpError, match=match):
        MechanismVectorEnv(MECH, 2, **options)


def test_actions_of_another_shape() -> None:
    env = _env()
    env.reset()
    with pytest.raises(rg.OptionError, match="shape"):
        env.step(np.zeros((3, 2)))


@pytest.mark.parametrize(
    ("given", "match"),
    [({"reward": lambda q, v, action: -(action**2)}, r"reward\(q, v, action\)"),
     ({"reward": lambda q, v, action: None}, "reward"), ({"reward": 1.0}, "reward"),
     ({"done": lambda q, v: q[:, :1] > 0.0}, r"done\(q, v\)"),
     ({"observe": lambda q, v: q[:, 0]}, "observe"), ({"observe": lambda q, v: q[:1]}, "observe")],
)  # fmt: skip
def test_what_functions_say_is_of_each_motion(given: dict[str, Any], match: str) -> None:
    """Rewards (N, 1) were spread to (N, N) without a word."""
    with pytest.raises(rg.OptionError, match=match):
        MechanismVectorEnv(MECH, 3, **({"motors": {"q1": 1.0}, "reward": _reward} | given)).step(
            np.zeros((3, 1))
        )


def test_seeds_of_each_motion_are_refused() -> None:
    for seed in ([1, 2, 3], [], "a", -1):
        with pytest.raises(rg.OptionError, match="seed"):
            _env().reset(seed=seed)  # type: ignore[arg-type]
