"""Columns of the tables in which the step keeps its sums."""

# columns of a chunk's sums; GRAIN is the row at which the largest overlap was met
CONTACTS, ELASTIC, NORMAL_DAMPING, TANGENTIAL_DAMPING, SLIDING, ROLLING, TWISTING, MAX_OVERLAP, GRAIN = range(9)
# works of a kick: its half with the velocities before it, and further down its half with those after it
CONTACT_WORK, GRAVITY_WORK, EXTERNAL_WORK, KINETIC, MAX_SQUARED_TRAVEL, MAX_SQUARED_SPEED = range(9, 15)
CONTACT_LATER, GRAVITY_LATER, EXTERNAL_LATER = range(15, 18)
N_SUMS = 18
# columns of a body's sums; those up to FORCE_T + 2 are kept by chunk. N: springs along the normal, D: the dashpots
# parallel to them, T: tangential, with rolling and twisting torques
TORQUE_N, TORQUE_D, TORQUE_T, FORCE_N, FORCE_D, FORCE_T = 0, 1, 2, 3, 6, 9
N_CHUNK_BODY = 12
BODY_WORK, DRIVE_WORK, LOAD_WORK, SHAFT_CONTACT_WORK, LAST_TORQUE = range(12, 17)
N_BODY_SUMS = 17
