"""Compiled parts of a step of rigid grains in a sheared box (`particles.sheared_box`): flow, images, stress.

Contacts across its faces couple a grain with an image of its partner, as in a sector (`particles.periodic_images`);
the image of the layer above is faster by rate Lz, which is in the relative velocity of the contact. Momentum is m p,
with p = v - rate z e_x the peculiar velocity. It is carried by contacts, from centre to centre, and by the
grains as these drift in a straight line:

    sigma_ab = 1/(V t) [ sum over contacts r_a b_b + sum over drifts m p_a p_b s ],

summed over the steps of a time t, with r the impulse on a grain and b the way to it from its partner's centre, and p
at the middle of a drift of s seconds; pulls of near pairs (`particles.dvi.near_pulls`) count as contacts of their own
kind. With these parts momentum and energy balance to round-off: the work of the
shear is -rate V t sigma_xz, through contacts it adds to the work on their relative motion, through drifts it is what
p changes by where z does. Overlap that is removed from the positions moves momentum in the same way,
m p_a times the displacement along b, and stands with the drifts.
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from particles.dem.box_kernel import HEIGHT, LIST_STRAIN, OFFSET, RATE, REACH, STRAIN, STRETCHED
from particles.dvi.gauss_seidel import ARM, EX, VX, VY, VZ
from particles.periodic_images import pair_place_to_image
from particles.periodicity import DU, DX

CONTACT, MOTION, ATTRACTION, N_BOX_SUMS = 0, 9, 18, 27
"""Sums over steps [J s]: force or momentum along a, way along b, in row 3 a + b behind each."""


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def shear(time, flow, images):
    """Let the layers of the box move on for some time [s], and the images with them."""
    flow[OFFSET] += flow[RATE] * flow[HEIGHT] * time
    flow[STRAIN] += flow[RATE] * time
    for row in range(images.shape[0]):
        images[row, DX] += images[row, DU] * time


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def bound_peculiar_speeds(grains, grain):
    """Fill the bounds of the grains with peculiar speeds; returns the largest [m/s].

    By the flow a pair within twice its reach comes nearer at no more than |rate| (R_i + R_j).
    """
    position, velocity, bound, rate = grains.position, grains.velocity, grains.bound, grains.flow[RATE]
    fastest = 0.0
    for i in range(position.shape[0]):
        flow = rate * position[i, 2]
        x, y, z = velocity[i, 0] - flow, velocity[i, 1], velocity[i, 2]
        before = x * x + y * y + z * z
        x, y, z = grain[i, VX] - flow, grain[i, VY], grain[i, VZ]
        bound[i] = np.sqrt(max(before, x * x + y * y + z * z)) + abs(rate) * grains.radius[i]
        fastest = max(fastest, bound[i])
    return fastest


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def strain_of_list(flow):
    """The strain since the list was made."""
    return flow[STRAIN] - flow[LIST_STRAIN]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def nearer_by_flow(h, flow):
    """Half of what flow and stretch bring a pair nearer by, from the list to the end of the next step of h [s] [m]."""
    return 0.5 * (abs(strain_of_list(flow)) + abs(flow[RATE]) * h + flow[STRETCHED]) * flow[REACH]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def add_drift(time, grains, velocity, sums):
    """Add what the grains carry in a drift of some time [s] at ``velocity`` (n, 3 or more), before they are moved."""
    position, mass, rate = grains.position, grains.mass, grains.flow[RATE]
    xx = yy = zz = xy = xz = yz = 0.0
    for i in range(mass.shape[0]):
        y, z = velocity[i, 1], velocity[i, 2]
        x = velocity[i, 0] - rate * (position[i, 2] + 0.5 * time * z)
        m = time * mass[i]
        xx, yy, zz = xx + m * x * x, yy + m * y * y, zz + m * z * z
        xy, xz, yz = xy + m * x * y, xz + m * x * z, yz + m * y * z
    sums[MOTION] += xx
    sums[MOTION + 1] += xy
    sums[MOTION + 2] += xz
    sums[MOTION + 3] += xy
    sums[MOTION + 4] += yy
    sums[MOTION + 5] += yz
    sums[MOTION + 6] += xz
    sums[MOTION + 7] += yz
    sums[MOTION + 8] += zz


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def add_shifts(before, grains, sums):
    """Add what the grains carry where they are moved from ``before`` (n, 3) [m] at once."""
    position, velocity, mass, rate = grains.position, grains.velocity, grains.mass, grains.flow[RATE]
    for i in range(mass.shape[0]):
        x = velocity[i, 0] - 0.5 * rate * (before[i, 2] + position[i, 2])
        for b in range(3):
            way = mass[i] * (position[i, b] - before[i, b])
            sums[MOTION + b] += x * way
            sums[MOTION + 3 + b] += velocity[i, 1] * way
            sums[MOTION + 6 + b] += velocity[i, 2] * way


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def add_impulses(pull, radius, pairs, contacts, sums):
    """Add the impulses of a step, which have been kept in the slots of their contacts, and their pulls."""
    impulse, slot, index, pair = pairs.impulse, pairs.contact_slot, contacts.pair_index, contacts.pair
    for k in range(pair.shape[0]):
        s = slot[k]
        distance = pair[k, ARM] * (radius[index[k, 0]] + radius[index[k, 1]])
        for a in range(3):
            r = impulse[s, a]
            if pull > 0:
                r += impulse[s, pull + a]
            for b in range(3):
                sums[CONTACT + 3 * a + b] += r * distance * pair[k, EX + b]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def add_pulls(h, grains, pairs, pull, sums):
    """Add the pulls (p, 3) [N] on the first grains of the listed pairs, constant for a step of h [s]."""
    position, images, shift = grains.position, pairs.images, pairs.shift
    for i in range(position.shape[0]):
        for k in range(pairs.start[i], pairs.start[i + 1]):
            j = pairs.other[k]
            x, y, z = pair_place_to_image(images, shift, k, position[j, 0], position[j, 1], position[j, 2])
            x, y, z = position[i, 0] - x, position[i, 1] - y, position[i, 2] - z
            for a in range(3):
                r = h * pull[k, a]
                sums[ATTRACTION + 3 * a] += r * x
                sums[ATTRACTION + 3 * a + 1] += r * y
                sums[ATTRACTION + 3 * a + 2] += r * z
