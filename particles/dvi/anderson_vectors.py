"""Anderson's vectors part by part: what `particles.dvi.accelerated` keeps of its last sweeps.

A vector holds the impulses of pairs, of walls and the loads of shafts, the torques of pairs and of walls where there
are some, then the velocities of grains and of shafts. Parts (`particles.dvi.solver_state.Part`) do not touch each
other's entries, so that threads may work on several.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geometry.kernels.device_functions import device_function
from particles.dvi.contact_torques import CX
from particles.dvi.gauss_seidel import BRAKE, PX, PY, PZ, RX, SPEED, VX, VY, VZ

HISTORY = 5
# what `store_change` adds up: products of the newest change with all kept ones, and of these with f; `gather`: f.f,
# first
N_PRODUCTS = 2 * HISTORY


class Vectors(NamedTuple):
    """History of the last sweeps, for ``size`` impulses and velocities of which ``contacts`` are impulses.

    Attributes
    ----------
    r, g, old_g, best_g : ndarray, shape (size,)
        From where the last sweeps began, where they have come to, where the ones before and the best ones had.
    f, old_f, weight : ndarray, shape (contacts,)
        Weighed change of the last sweeps and of those before; sqrt(w_n), and what weighs loads and torques.
    d_g, d_f : ndarray, shapes (HISTORY, size), (HISTORY, contacts)
        Changes of g and f from one time to the next.
    products : ndarray, shape (N_PRODUCTS,)
    """

    r: np.ndarray
    g: np.ndarray
    old_g: np.ndarray
    best_g: np.ndarray
    f: np.ndarray
    old_f: np.ndarray
    weight: np.ndarray
    d_g: np.ndarray
    d_f: np.ndarray
    products: np.ndarray


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _contacts(contacts, bodies, contact_torques):
    """Index of the first velocity."""
    if contact_torques.law.shape[0] == 0:
        return 3 * contacts + bodies
    return 6 * contacts + bodies


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _impulses(p0, p1, w0, w1, pairs, loads, own, bodies, contact_torques):
    """Stretches of impulses, loads and torques."""
    first = loads + bodies
    a0, a1, b0, b1 = first, first, first, first
    if contact_torques.law.shape[0] > 0:
        a0, a1, b0, b1 = first + 3 * p0, first + 3 * p1, first + 3 * (pairs + w0), first + 3 * (pairs + w1)
    return (3 * p0, 3 * p1), (3 * (pairs + w0), 3 * (pairs + w1)), (loads, loads + own), (a0, a1), (b0, b1)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def gather(part, g, vectors, products, records, contact_torques):
    """Read impulses and velocities into ``g``, weigh how far it is from r, f = weight (g - r), and add up f.f."""
    p0, p1, w0, w1, i0, i1, shafts = part
    r, weight, f = vectors.r, vectors.weight, vectors.f
    grain, body, pair, wall = records.grain, records.body, records.pair, records.wall
    p, w, n, m = pair.shape[0], wall.shape[0], grain.shape[0], body.shape[0]
    loads, contacts = 3 * (p + w), _contacts(p + w, m, contact_torques)
    product = 0.0
    for k in range(p0, p1):
        q = 3 * k
        g[q], g[q + 1], g[q + 2] = pair[k, RX], pair[k, RX + 1], pair[k, RX + 2]
    product += _weigh(3 * p0, 3 * p1, g, r, weight, f)
    for k in range(w0, w1):
        q = 3 * (p + k)
        g[q], g[q + 1], g[q + 2] = wall[k, RX], wall[k, RX + 1], wall[k, RX + 2]
    product += _weigh(3 * (p + w0), 3 * (p + w1), g, r, weight, f)
    for i in range(i0, i1):
        q = contacts + 6 * i
        g[q], g[q + 1], g[q + 2] = grain[i, VX], grain[i, VY], grain[i, VZ]
        g[q + 3], g[q + 4], g[q + 5] = grain[i, PX], grain[i, PY], grain[i, PZ]
    if shafts == 1:
        for b in range(m):
            g[loads + b], g[contacts + 6 * n + b] = body[b, BRAKE], body[b, SPEED]
        product += _weigh(loads, loads + m, g, r, weight, f)
    if contact_torques.law.shape[0] > 0:
        for lo, hi, first, contact_torque in (
            (p0, p1, loads + m, contact_torques.pair),
            (w0, w1, loads + m + 3 * p, contact_torques.wall),
        ):
            for k in range(lo, hi):
                q = first + 3 * k
                g[q], g[q + 1], g[q + 2] = contact_torque[k, CX], contact_torque[k, CX + 1], contact_torque[k, CX + 2]
            product += _weigh(first + 3 * lo, first + 3 * hi, g, r, weight, f)
    products[0] = product


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _weigh(lo, hi, g, r, weight, f):
    for q in range(lo, hi):
        f[q] = weight[q] * (g[q] - r[q])
    return _dot(f[lo:hi], f[lo:hi])


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def store_change(part, better, first, slot, known, vectors, products, records, contact_torques):
    """Keep the changes since the last time, unless this is the ``first``, and ``g`` also where it is ``better``."""
    p0, p1, w0, w1, i0, i1, shafts = part
    g, old_g, best_g, d_g = vectors.g, vectors.old_g, vectors.best_g, vectors.d_g
    f, old_f, d_f = vectors.f, vectors.old_f, vectors.d_f
    p, w, n, m = records.pair.shape[0], records.wall.shape[0], records.grain.shape[0], records.body.shape[0]
    loads, contacts = 3 * (p + w), _contacts(p + w, m, contact_torques)
    products[:] = 0.0
    own = shafts * m
    impulses = _impulses(p0, p1, w0, w1, p, loads, own, m, contact_torques)
    velocities = ((contacts + 6 * i0, contacts + 6 * i1), (contacts + 6 * n, contacts + 6 * n + own))
    for lo, hi in impulses + velocities:
        for q in range(lo, hi):
            if not first:
                d_g[slot, q] = g[q] - old_g[q]
            old_g[q] = g[q]
            if better:
                best_g[q] = g[q]
    for lo, hi in impulses:
        for q in range(lo, hi):
            if not first:
                d_f[slot, q] = f[q] - old_f[q]
            old_f[q] = f[q]
        if not first:
            for q in range(known):
                products[q] += _dot(d_f[slot, lo:hi], d_f[q, lo:hi])
                products[HISTORY + q] += _dot(d_f[q, lo:hi], f[lo:hi])


@device_function(error_model="numpy", fastmath={"contract"})
def extrapolate(part, g, c, known, vectors, records, contact_torques):
    """r = g less the changes of g times ``c``, into the records as well."""
    p0, p1, w0, w1, i0, i1, shafts = part
    r, d_g = vectors.r, vectors.d_g
    grain, body, pair, wall = records.grain, records.body, records.pair, records.wall
    p, w, n, m = pair.shape[0], wall.shape[0], grain.shape[0], body.shape[0]
    loads, contacts = 3 * (p + w), _contacts(p + w, m, contact_torques)
    own = shafts * m
    velocities = ((contacts + 6 * i0, contacts + 6 * i1), (contacts + 6 * n, contacts + 6 * n + own))
    for lo, hi in _impulses(p0, p1, w0, w1, p, loads, own, m, contact_torques) + velocities:
        r[lo:hi] = g[lo:hi]
        for q in range(known):
            for k in range(lo, hi):
                r[k] -= c[q] * d_g[q, k]
    for k in range(p0, p1):
        q = 3 * k
        pair[k, RX], pair[k, RX + 1], pair[k, RX + 2] = r[q], r[q + 1], r[q + 2]
    for k in range(w0, w1):
        q = 3 * (p + k)
        wall[k, RX], wall[k, RX + 1], wall[k, RX + 2] = r[q], r[q + 1], r[q + 2]
    for i in range(i0, i1):
        q = contacts + 6 * i
        grain[i, VX], grain[i, VY], grain[i, VZ] = r[q], r[q + 1], r[q + 2]
        grain[i, PX], grain[i, PY], grain[i, PZ] = r[q + 3], r[q + 4], r[q + 5]
    for b in range(own):
        body[b, BRAKE], body[b, SPEED] = r[loads + b], r[contacts + 6 * n + b]
    if contact_torques.law.shape[0] > 0:
        for lo, hi, first, contact_torque in (
            (p0, p1, loads + m, contact_torques.pair),
            (w0, w1, loads + m + 3 * p, contact_torques.wall),
        ):
            for k in range(lo, hi):
                q = first + 3 * k
                contact_torque[k, CX], contact_torque[k, CX + 1], contact_torque[k, CX + 2] = r[q], r[q + 1], r[q + 2]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _dot(a, b):
    """Sum of products in eight partial sums: a fixed order that the compiler can still vectorise."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    full = 8 * (a.shape[0] // 8)
    for k in range(0, full, 8):
        s0 += a[k] * b[k]
        s1 += a[k + 1] * b[k + 1]
        s2 += a[k + 2] * b[k + 2]
        s3 += a[k + 3] * b[k + 3]
        s4 += a[k + 4] * b[k + 4]
        s5 += a[k + 5] * b[k + 5]
        s6 += a[k + 6] * b[k + 6]
        s7 += a[k + 7] * b[k + 7]
    for k in range(full, a.shape[0]):
        s0 += a[k] * b[k]
    return ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))
