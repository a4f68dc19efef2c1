"""Solvers of dx/dphi = v that were tried for `VDDIMScheduler`; the benchmark compares them, nothing else uses them.

All take the angles of a run and a velocity, and evaluate it once per step. In the angle variable x'' + x = g, where the
forcing g = x + dv/dphi vanishes as long as data and noise, as the model predicts them, stay the same: DDIM is the exact
solution for g = 0.
"""

import numpy as np


def run(rule, angles, velocity, x):
    """Follows `velocity(x, phi)` from the first to the last angle.

    Args:
        rule (`Callable`): one of `RULES`.
        angles (`np.ndarray`): (steps + 1,) decreasing, rad.
        velocity (`Callable`): (x, phi) -> v of the shape of x.
        x: array or tensor, the sample at the first angle.

    Returns:
        the sample at the last angle.
    """
    history = []  # (angle, x, v), latest first
    for index, (phi, following) in enumerate(zip(angles[:-1], angles[1:], strict=True)):
        history = [(float(phi), x, velocity(x, float(phi))), *history[:2]]
        last = index == len(angles) - 2
        x = rule(float(following), history, last)
    return x


def ddim(following, history, last):
    """An exact rotation (Song et al. 2021; v-prediction: Salimans and Ho 2022)."""
    phi, x, v = history[0]
    turn = phi - following
    return np.cos(turn) * x - np.sin(turn) * v


def _forcing(newer, older):
    """The forcing g that, held constant, leads from the older to the newer velocity."""
    (phi, _, v), (before, x_before, v_before) = newer, older
    turn = before - phi
    return (np.cos(turn) * v_before + np.sin(turn) * x_before - v) / np.sin(turn)


def rotation_2(following, history, last):
    """DDIM plus the variation of constants: g of the last step is held for this one."""
    if len(history) < 2:
        return ddim(following, history, last)
    phi, x, v = history[0]
    turn, g = phi - following, _forcing(*history[:2])
    return np.cos(turn) * x - np.sin(turn) * v + (1 - np.cos(turn)) * g


def rotation_2_lowered(following, history, last):
    """As `rotation_2`, the last step by DDIM."""
    return ddim(following, history, last) if last else rotation_2(following, history, last)


def rotation_3(following, history, last):
    """Third order: g goes on as a straight line through those of the last two steps."""
    if len(history) < 3:
        return rotation_2(following, history, last)
    phi, x, v = history[0]
    turn, before, earlier = phi - following, history[1][0] - phi, history[2][0] - history[1][0]
    newer, older = _forcing(*history[:2]), _forcing(*history[1:3])
    slope = (newer - older) / ((before + earlier) / 2)
    g = newer + slope * before / 2
    return np.cos(turn) * x - np.sin(turn) * v + (1 - np.cos(turn)) * g + (turn - np.sin(turn)) * slope


def adams_bashforth_2(following, history, last):
    """Second-order Adams-Bashforth on v, first step by DDIM."""
    if len(history) < 2:
        return ddim(following, history, last)
    phi, x, v = history[0]
    turn = phi - following
    ratio = turn / (history[1][0] - phi)
    return x - turn * ((1 + ratio / 2) * v - ratio / 2 * history[1][2])


def adams_bashforth_3(following, history, last):
    """Third-order Adams-Bashforth on v."""
    if len(history) < 3:
        return adams_bashforth_2(following, history, last)
    phi, x, _ = history[0]
    turn = phi - following
    times = [angle - phi for angle, *_ in history]
    for k, (_, _, v) in enumerate(history):
        polynomial = np.poly1d([1.0])
        for j, time in enumerate(times):
            if j != k:
                polynomial *= np.poly1d([1.0, -time]) / (times[k] - time)
        integral = polynomial.integ()
        x = x - float(integral(0.0) - integral(-turn)) * v
    return x


def data_2m(following, history, last):
    """Extrapolated data as in DPM-Solver++ 2M (Lu et al. 2022, arXiv 2211.01095): in the log of cos phi / sin phi.

    First and last step by DDIM, where that logarithm is infinite.
    """
    phi, x, v = history[0]
    data = np.cos(phi) * x - np.sin(phi) * v
    if not last and len(history) > 1 and history[1][0] < np.pi / 2 - 1e-9:
        before, x_before, v_before = history[1]
        log = [-np.log(np.tan(angle)) for angle in (before, phi, following)]
        ratio = (log[2] - log[1]) / (log[1] - log[0])
        data = data + ratio / 2 * (data - (np.cos(before) * x_before - np.sin(before) * v_before))
    scale = np.sin(following) / np.sin(phi)
    return scale * x + (np.cos(following) - np.cos(phi) * scale) * data


RULES = {
    "ddim": ddim,
    "rotation_2": rotation_2,
    "rotation_2_lowered": rotation_2_lowered,
    "rotation_3": rotation_3,
    "adams_bashforth_2": adams_bashforth_2,
    "adams_bashforth_3": adams_bashforth_3,
    "data_2m": data_2m,
}
