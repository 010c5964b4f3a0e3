"""Compiled loops over the surface's nodes. Shapes and units as in `contact.py`.

They compute what the contact's forms of `forms.py` define, node by node; with the weights w of Simpson's
rule,

    gap_i = y_i + u_y - Y - f(s_i) - c lambda_i,   s_i = x_i + u_x - X,   force_i = w_i lambda_i,
    n = (-f', 1),   t = (1, f'),   the tissue being pushed by -force_i (n - mu t)
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

_SWITCH = 50.0
"""kPa/mm: weighs penetration against multiplier when the active set is chosen."""


@njit(cache=True, nogil=True)
def places(x0, x_dof, u, position):
    """Deformed places of the surface's nodes in the probe's frame: s = x + u_x - X."""
    s = np.empty_like(x0)
    for i in range(len(s)):
        s[i] = x0[i] + u[x_dof[i]] - position
    return s


@njit(cache=True, nogil=True)
def choose(y0, x_dof, u, multiplier, weight, height, f, slope, curvature, friction, padding):
    """The active set (primal-dual), lambda + c gap > 0: indices, gap, slope, curvature, force and lift.

    Lift is the force's vertical part, force (1 - mu f').

    The multipliers of all other nodes are cleared: what is out of contact carries nothing.
    """
    count = len(y0)
    active = np.empty(count, np.int64)
    out = np.empty((5, count))
    n = 0
    for i in range(count):
        gap = y0[i] + u[x_dof[i] + 1] - height - f[i] - padding * multiplier[i]
        if multiplier[i] + _SWITCH * gap > 0.0:
            force = weight[i] * multiplier[i]
            active[n] = i
            out[0, n] = gap
            out[1, n] = slope[i]
            out[2, n] = curvature[i]
            out[3, n] = force
            out[4, n] = force * (1.0 - friction * slope[i])
            n += 1
        else:
            multiplier[i] = 0.0
    return active[:n], out[0, :n], out[1, :n], out[2, :n], out[3, :n], out[4, :n]


@njit(cache=True, nogil=True)
def balance(forces, x_dof, active, force, slope, lift, friction, held):
    """Take the contact's forces off, clear what is held; returns the largest that is left (NaN if any is).

    forces += force (n - mu t) = (-force (f' + mu), force (1 - mu f'))
    """
    for i in range(len(active)):
        n = x_dof[active[i]]
        forces[n] -= force[i] * (slope[i] + friction)
        forces[n + 1] += lift[i]
    for n in held:
        forces[n] = 0.0
    largest = 0.0
    for value in forces:
        if not abs(value) <= largest:
            largest = abs(value)
            if np.isnan(value):
                break
    return largest


@njit(cache=True, nogil=True)
def stiffness(active, weight, slope, curvature, force, augmentation, curved, blocks):
    """Fill the rows (xx, xy, yy) of the active nodes in `blocks` (S, 3): r w n n^T - force f'' e_x e_x^T."""
    for i in range(len(active)):
        k = augmentation * weight[active[i]]
        g = -slope[i]
        bend = max(force[i], 0.0) * curvature[i] if curved else 0.0
        blocks[active[i], 0] = k * g * g - bend
        blocks[active[i], 1] = k * g
        blocks[active[i], 2] = k


@njit(cache=True, nogil=True)
def pressures(x0, x_dof, u, multiplier, weight):
    """Deformed places, pressures and the deformed integrals of the nodes' shape functions.

    area_i = integral of N_i dx,   pressure_i = w_i lambda_i / area_i
    """
    count = len(x0)
    x = np.empty(count)
    area = np.zeros(count)
    pressure = np.zeros(count)
    for i in range(count):
        x[i] = x0[i] + u[x_dof[i]]
    for i in range(0, count - 2, 2):
        a = x[i]
        b = x[i + 1]
        c = x[i + 2]
        area[i] += (-3.0 * a + 4.0 * b - c) / 6.0
        area[i + 1] += 4.0 * (c - a) / 6.0
        area[i + 2] += (a - 4.0 * b + 3.0 * c) / 6.0
    for i in range(count):
        if multiplier[i] > 0.0:
            pressure[i] = multiplier[i] * weight[i] / area[i]
    return x, pressure, area


@njit(cache=True, nogil=True)
def sides(residual, x_dof, active, weight, gap, slope, augmentation, fresh, sides):
    """Fill the right-hand sides (2, 2N) of a step and, where it is `fresh`, of the probe's height.

        step = -residual - w r gap n,   border = -w r n

    with r the augmentation. Returns the penetrations' pull r gap (active,) and the active nodes' weights w.
    """
    right = sides[0]
    border = sides[1]
    for n in range(len(right)):
        right[n] = -residual[n]
    if fresh:
        border[:] = 0.0
    pull = np.empty(len(active))
    some = np.empty(len(active))
    for i in range(len(active)):
        n = x_dof[active[i]]
        w = weight[active[i]]
        some[i] = w
        pull[i] = augmentation * gap[i]
        right[n] += w * pull[i] * slope[i]
        right[n + 1] -= w * pull[i]
        if fresh:
            border[n] = w * augmentation * slope[i]
            border[n + 1] = -w * augmentation
    return pull, some


@njit(cache=True, nogil=True)
def advance(change, border_change, rise, scale, x_dof, active, slope, pull, augmentation, multiplier, u):
    """Apply a step (2N,), with the probe's rise and scaled, to multipliers and displacement.

    du = change - rise border_change,   d lambda = r (gap + n . du - rise)
    """
    for n in range(len(change)):
        change[n] -= border_change[n] * rise
    for i in range(len(active)):
        n = x_dof[active[i]]
        moved = change[n + 1] - slope[i] * change[n] - rise
        multiplier[active[i]] += scale * (pull[i] + augmentation * moved)
    for n in range(len(change)):
        change[n] *= scale
        u[n] += change[n]
