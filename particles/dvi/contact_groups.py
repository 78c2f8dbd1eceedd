"""Groups of up to eight contacts that have no grain in common, which a sweep visits at once.

What contacts of a group do does not touch the others, so that all of it together is the same as one after another: a
sweep over groups is a Gauss-Seidel sweep, and only the order of its visits is another than that of the list. Contact by
contact, in the order of the list, each joins the first group that has room and neither of its grains. Groups are few,
and nearly all are full: a grain has at most a dozen contacts. The order follows from the list alone.

Which groups a grain is in is kept as bits, for the WINDOW groups from the oldest one with room on. A grain that is in
all of these, a big one among many small, closes the oldest.

**Walls.** Bodies of prescribed speed are not changed by their contacts, so that these share nothing but grains.
Contacts with a free shaft come last, one by one.
"""

from __future__ import annotations

from numba.cpython.unsafe.numbers import trailing_zeros

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES

# rows of a group: contacts, their grains, their second grains or bodies; how many they are
CONTACT, FIRST, SECOND, SIZE = range(4)
N_GROUP = 4
WINDOW = 60  # open groups, bits of an integer
_ALL, _NEWEST = (1 << WINDOW) - 1, 1 << (WINDOW - 1)


@device_function(without_refcounts=True, error_model="numpy")
def group_contacts(part, body, column, records):
    """Fill the groups of a part; bodies whose ``column`` of ``body`` is more than 0 are changed by contacts."""
    _group(part.p0, part.p1, None, column, records.pair_index, records.pair_group, records.membership)
    _group(part.w0, part.w1, body, column, records.wall_index, records.wall_group, records.membership)


@device_function(without_refcounts=True, error_model="numpy")
def _group(lo, hi, body, column, index, table, membership):
    """Groups of the contacts lo <= k < hi, with bodies, or None: with each other."""
    for k in range(lo, hi):
        membership[index[k, 0], 0] = membership[index[k, 0], 1] = 0
        if body is None:
            membership[index[k, 1], 0] = membership[index[k, 1], 1] = 0
    oldest, end, room = lo, lo, _ALL
    for k in range(lo, hi):
        i = index[k, 0]
        j = i
        if body is None:
            j = index[k, 1]
        if body is not None:
            if body[index[k, 1], column] > 0.0:
                continue
        occupied = _groups_of(membership, i, oldest) | _groups_of(membership, j, oldest)
        if room & ~occupied == 0:
            oldest, room, occupied = oldest + 1, (room >> 1) | _NEWEST, occupied >> 1
        places = room & ~occupied
        place = places & -places
        _join(membership, i, oldest, place)
        _join(membership, j, oldest, place)
        g = oldest + trailing_zeros(place)  # type: ignore[call-arg]
        if g == end:
            table[g, SIZE, 0], end = 0, end + 1
        _put(table, g, table[g, SIZE, 0], k, i, index[k, 1])
        table[g, SIZE, 0] += 1
        if table[g, SIZE, 0] == LANES:
            room &= ~place
            while room & 1 == 0:
                oldest, room = oldest + 1, (room >> 1) | _NEWEST
    if body is not None:
        for k in range(lo, hi):
            if body[index[k, 1], column] > 0.0:
                table[end, SIZE, 0] = 1
                _put(table, end, 0, k, index[k, 0], index[k, 1])
                end += 1
    for g in range(lo, end):
        for lane in range(table[g, SIZE, 0], LANES):
            _put(table, g, lane, table[g, CONTACT, 0], table[g, FIRST, 0], table[g, SECOND, 0])
    if end < hi:
        table[end, CONTACT, 0] = -1


@device_function(without_refcounts=True, error_model="numpy")
def _groups_of(membership, i, oldest):
    """Bits of the groups from the oldest one on that grain i is in."""
    past = oldest - membership[i, 1]
    return membership[i, 0] >> past if past < WINDOW else 0


@device_function(without_refcounts=True, error_model="numpy")
def _join(membership, i, oldest, place):
    membership[i, 0], membership[i, 1] = _groups_of(membership, i, oldest) | place, oldest


@device_function(without_refcounts=True, error_model="numpy")
def _put(table, g, lane, k, i, j):
    table[g, CONTACT, lane], table[g, FIRST, lane], table[g, SECOND, lane] = k, i, j
