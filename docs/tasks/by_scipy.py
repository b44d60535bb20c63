"""The tasks by NumPy and SciPy alone: a planar four-bar's equations written by hand."""

import csv

import numpy as np
from scipy.integrate import solve_ivp

# setup
CRANK, COUPLER, ROCKER, GROUND, WEIGHT = 1.0, 3.5, 3.0, 4.0, 9.81


def terms(x, lengths=(CRANK, COUPLER, ROCKER)):
    """M, forces, J and J's rest for rods of 1 kg at absolute angles x[:3], rates x[3:]."""
    angle, rate, (a, b, c) = x[:3], x[3:], lengths
    e = np.array([np.cos(angle), np.sin(angle)])
    n = np.array([-e[1], e[0]])
    tie = 0.5 * a * b
    cos, sin = np.cos(angle[0] - angle[1]), np.sin(angle[0] - angle[1])
    M = np.array([[4 / 3 * a**2, tie * cos, 0], [tie * cos, b**2 / 3, 0], [0, 0, c**2 / 3]])
    force = np.array([-tie * sin * rate[1] ** 2, tie * sin * rate[0] ** 2, 0])
    force -= WEIGHT * np.array([1.5 * a, 0.5 * b, 0.5 * c]) * e[0]
    side = np.array([a, b, -c])
    return M, force, n * side, (e * side) @ rate**2


def solved(x, torque=0.0, lengths=(CRANK, COUPLER, ROCKER)):
    """Accelerations and the force in the pin between coupler and rocker."""
    M, force, J, rest = terms(x, lengths)
    whole = np.block([[M, -J.T], [J, np.zeros((2, 2))]])
    found = np.linalg.solve(whole, np.concatenate([force + [torque, 0, 0], rest]))
    return found[:3], found[3:]


def rate_of(t, x, lengths=(CRANK, COUPLER, ROCKER)):
    return np.concatenate([x[3:], solved(x, lengths=lengths)[0]])


def closed(crank):
    """Absolute angles with the loop closed, from the crank's."""
    to = np.array([GROUND - CRANK * np.cos(crank), -CRANK * np.sin(crank)])
    far = np.hypot(*to)
    inner = np.arccos((COUPLER**2 + far**2 - ROCKER**2) / (2 * COUPLER * far))
    coupler = np.arctan2(to[1], to[0]) + inner
    tip = COUPLER * np.array([np.cos(coupler), np.sin(coupler)]) - to
    return np.array([crank, coupler, np.arctan2(tip[1], tip[0])])


def moved(duration=2.0, crank=1.0, **more):
    start = np.concatenate([closed(crank), np.zeros(3)])
    return solve_ivp(
        rate_of, (0, duration), start, "DOP853", rtol=1e-10, atol=1e-12, dense_output=True, **more
    )


def simulate():
    x = moved().y[:3, -1]
    return np.array([x[0], x[1] - x[0], x[2]])


def drive():
    def torque(t):
        angle = closed(1 + 3 * t)
        M, force, J, rest = terms(np.concatenate([angle, np.zeros(3)]))
        rate = np.concatenate([[3], -np.linalg.solve(J[:, 1:], J[:, 0] * 3)])
        M, force, J, rest = terms(np.concatenate([angle, rate]))
        a = np.concatenate([[0], np.linalg.solve(J[:, 1:], rest)])
        pin = np.linalg.solve(J[:, 1:].T, (M @ a - force)[1:])
        return (M @ a - force - J.T @ pin)[0]

    return np.array([torque(t) for t in np.linspace(0, 2, 201)])


def event():
    return moved(events=lambda t, x: x[5]).t_events[0][1:]


def stop():
    def low(t, x):
        return x[0] + 0.5

    low.terminal = True
    return moved(events=low).t[-1]


def pin_force():
    run = moved()
    return np.array([solved(run.sol(t))[1] for t in np.linspace(0, 2, 21)])


def frame():
    run = moved()

    def acceleration(t):
        x = run.sol(t)
        a = solved(x)[0]
        e = np.array([np.cos(x[2]), np.sin(x[2])])
        return ROCKER * (np.array([-e[1], e[0]]) * a[2] - e * x[5] ** 2)

    return np.array([acceleration(t) for t in np.linspace(0, 2, 21)])


def export(path):
    run, times = moved(), np.linspace(0, 2, 2001)
    with open(path, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["t", "q1", "q2", "q3", "v1", "v2", "v3"])
        table.writerows(np.column_stack([times, run.sol(times).T]))


def control():
    x = np.concatenate([closed(1.0), np.zeros(3)])
    for _ in range(200):
        torque = 400 * (2 - x[0]) - 40 * x[3]
        step = solve_ivp(
            lambda t, x, u=torque: np.concatenate([x[3:], solved(x, u)[0]]),
            (0, 0.01),
            x,
            rtol=1e-8,
            atol=1e-10,
        )
        x = step.y[:, -1]
    return x[0]


def sweep():
    return np.array([moved(crank=crank).y[0, -1] for crank in np.linspace(0.6, 1.4, 5)])


def singular():
    """A rhombus swings through its flat position, where J loses rank."""
    start = np.array([0.5, 0.0, 0.5, 0, 0, 0])
    run = solve_ivp(
        lambda t, x: rate_of(t, x, (1.0, 1.0, 1.0)), (0, 5), start, "DOP853", rtol=1e-10, atol=1e-12
    )
    return run.y[0, -1], abs(run.y[0, -1] - run.y[2, -1])
