"""Grains: state, neighbours, contact, walls and shafts, DEM, packing."""

from particles.bodies import Body, FreeShaft, PrescribedSpeed
from particles.dem.dem import DEM
from particles.dem.step_totals import StepTotals
from particles.dem.time_step import TimeStep, choose_time_step, contact_time, stiffness_for_overlap
from particles.faults import DemError, PackingError, ParticleError
from particles.grains import Grains
from particles.laws.linear import LinearContact, damping_ratio, restitution_of
from particles.laws.rolling_friction import RollingFriction
from particles.lists.contact_table import ContactTable
from particles.lists.neighbours import PairList, find_pairs
from particles.packing.random_packing import pack
from particles.sector import CyclicSector

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
