"""What stands where in a batch of contacts side by side (`particles.dem.contact_lanes`)."""

from particles.laws.columns import N_LAW

LANES, SHIFT, LAST = 8, 3, 7  # contact c lies in block c >> SHIFT, lane c & LAST
BLOCKS = 4
ROOM = LANES * BLOCKS  # contacts in a batch

# Fields of a block. Of the pair: centre of j from that of i (3) [m], velocity of i relative to j (3) [m/s], sum and
# difference of the spins (3 each) [rad/s], radii [m] and masses [kg]
CENTRE, VELOCITY, SPINS, TURNING, RADIUS_I, RADIUS_J, MASS_I, MASS_J = 0, 3, 6, 9, 12, 13, 14, 15
# what comes out: force on i (3) [N], torque on i and on j (3 each) [N m], overlap [m], energy of the springs [J], and
# what is lost to normal and tangential damping, sliding, rolling, twisting [J]
FORCE, TORQUE_I, TORQUE_J, OVERLAP, STORED = 16, 19, 22, 25, 26
LOST_N, LOST_T, LOST_S, LOST_R, LOST_W = 27, 28, 29, 30, 31
# of a pull, before contacts take these fields: 1/distance [1/m], gap [radii] and its place in the table
INVERSE, GAP, GAP_PLACE = FORCE, FORCE + 1, FORCE + 2
LAW = 32  # the law's columns
HISTORY = LAW + N_LAW  # what the contact remembers, in columns of its own here
ENERGY_COLUMN, ROLLING_COLUMN, TWISTING_COLUMN = 6, 14, 17
N_HISTORY = 18
N_FIELDS = HISTORY + N_HISTORY


# rows of what is noted of each contact: slot in the list, place in the buffer of reactions (-1 without)
SLOT, PLACE = range(2)
