"""Grains: state, neighbours, contact, walls and shafts, DEM, packing."""

from particles.bodies import Body, FreeShaft, PrescribedSpeed
from particles.contact_law import LinearContact, damping_ratio, restitution_of
from particles.contact_table import ContactTable
from particles.dem import DEM
from particles.faults import DemError, PackingError, ParticleError
from particles.grains import Grains
from particles.neighbours import PairList, find_pairs
from particles.packing import pack
from particles.rolling_friction import RollingFriction
from particles.sector import CyclicSector
from particles.step_totals import StepTotals
from particles.time_step import TimeStep, choose_time_step, contact_time, stiffness_for_overlap

__all__ = [
    "DEM",
    "Body",
    "ContactTable",
    "CyclicSector",
    "DemError",
    "FreeShaft",
    "Grains",
    "LinearContact",
    "PackingError",
    "PairList",
    "ParticleError",
    "PrescribedSpeed",
    "RollingFriction",
    "StepTotals",
    "TimeStep",
    "choose_time_step",
    "contact_time",
    "damping_ratio",
    "find_pairs",
    "pack",
    "restitution_of",
    "stiffness_for_overlap",
]
