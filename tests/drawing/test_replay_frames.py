"""Pictures of a motion: even times, the right speed, between the outputs on joints of every kind."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import robust_gcp as rg
from robust_gcp.drawing.replay.frames import (
    FPS,
    LONGEST,
    MOST_FRAMES,
    SHORTEST,
    frame_times,
    pictures,
    playing_speed,
)


@given(st.floats(1e-6, 1e9))
def test_every_motion_plays_for_a_time_that_can_be_watched(duration: float) -> None:
    # A step of the series 1, 2, 5 changes the time of play by at most 2.5.
    speed = playing_speed(duration)
    play = duration / speed
    assert SHORTEST * (1 - 1e-9) <= play <= LONGEST * (1 + 1e-9)
    if duration < SHORTEST:
        assert play <= 2.5 * SHORTEST * (1 + 1e-9)
    elif duration > LONGEST:
        assert play >= LONGEST / 2.5 * (1 - 1e-9)
    else:
        assert speed == 1.0


@pytest.mark.parametrize(
    ("duration", "speed"), [(5.0, 1.0), (0.03, 0.01), (1.0, 0.5), (1000.0, 5.0), (0.0, 1.0)]
)
def test_speeds_by_hand(duration: float, speed: float) -> None:
    assert playing_speed(duration) == pytest.approx(speed, rel=1e-12)


def test_thirty_pictures_a_second_of_play_with_both_ends() -> None:
    for start, end, speed in ((0.0, 5.0, 1.0), (0.2, 0.23, 0.01), (-1.0, 1.01, 0.25)):
        times = frame_times(start, end, speed)
        assert (times[0], times[-1]) == (start, end)
        spacing = np.diff(times)
        assert np.ptp(spacing) < 1e-12
        assert spacing.max() <= speed / FPS * (1 + 1e-9)
        assert len(times) <= (end - start) * FPS / speed + 2
    assert frame_times(2.0, 2.0, 1.0).tolist() == [2.0]


def test_a_page_that_would_be_too_long_names_a_speed_that_is_not() -> None:
    with pytest.raises(rg.OptionError, match="give speed=") as caught:
        frame_times(0.0, 1e5, 1.0)
    remedy = float(str(caught.value).split("give speed=")[1].split()[0])
    assert len(frame_times(0.0, 1e5, 1.01 * remedy)) <= MOST_FRAMES


@pytest.mark.parametrize("name", ["rhombus", "tripod", "spherical loop"])
def test_sixth_order_between_outputs(name: str, mechanisms: dict[str, rg.Mechanism]) -> None:
    """q(t) = q₀ ⊕ f(t) moves with v = ∂(q₀ ⊕ f)/∂f ḟ; halving the spacing divides the error by 64."""
    mechanism = mechanisms[name]
    model, q0 = mechanism.model, mechanism.home
    rng = np.random.default_rng(7)
    amplitude, phase = rng.uniform(0.3, 0.6, model.nv), rng.uniform(0.0, 6.0, model.nv)

    def state(t: float) -> tuple[np.ndarray, np.ndarray]:
        f, rate = amplitude * np.sin(2.0 * t + phase), 2.0 * amplitude * np.cos(2.0 * t + phase)
        return pin.integrate(model, q0, f), pin.dIntegrate(model, q0, f, pin.ArgumentPosition.ARG1) @ rate

    def error(steps: int) -> float:
        t = np.linspace(0.0, 1.0, steps + 1)
        states = [state(x) for x in t]
        run = rg.Trajectory(mechanism, t, np.array([q for q, _ in states]), np.array([v for _, v in states]))
        got = pictures(run, FPS / 96.0)
        times = np.linspace(0.0, 1.0, 97)
        return max(
            float(np.linalg.norm(pin.difference(model, state(x)[0], q)))
            for x, q in zip(times, got, strict=True)
        )

    errors = [error(steps) for steps in (8, 16, 32)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 5.4).all(), orders


def test_outputs_themselves_are_kept(mechanisms: dict[str, rg.Mechanism]) -> None:
    run = rg.simulate(mechanisms["rhombus"], [0.2, -0.2, 0.2], duration=0.2, step=0.02)
    np.testing.assert_allclose(pictures(run, 0.02 * FPS), run.q, rtol=0, atol=1e-15)


def test_empty_and_broken_motions_are_refused(mechanisms: dict[str, rg.Mechanism]) -> None:
    rhombus = mechanisms["rhombus"]
    with pytest.raises(rg.StateError, match="empty"):
        pictures(rg.Trajectory(rhombus, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))), 1.0)
    with pytest.raises(rg.StateError, match="not finite"):
        pictures(rg.Trajectory(rhombus, np.zeros(1), np.full((1, 3), np.nan), np.zeros((1, 3))), 1.0)
    still = rg.Trajectory(rhombus, np.zeros(1), rhombus.home[None], np.zeros((1, 3)))
    assert np.array_equal(pictures(still, 1.0), rhombus.home[None])
