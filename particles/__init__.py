"""Grains: state, neighbours, contact, walls and shafts, DEM, packing."""

import geometry.kernels.cache  # noqa: F401 (before the first kernel is defined)
from particles.attraction import Attraction, depth_warning, pull_stiffness_ratio
from particles.barostat import Barostat
from particles.bodies import Body, FreeShaft
from particles.dem.dem import DEM
from particles.dem.time_step import TimeStep, choose_time_step, stiffness_for_overlap
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact
from particles.dvi.dvi_step import choose_dvi_step
from particles.dvi.dvi_totals import DviTotals
from particles.errors import DemError, DemErrorKind, PackingError, ParticleError
from particles.grain_motion import GrainMotion
from particles.grains import Grains
from particles.laws.cohesion import Cohesion
from particles.laws.contact_law import ContactLaw
from particles.laws.elastic import Elastic
from particles.laws.hertz import HertzContact
from particles.laws.hertz_mindlin import HertzMindlin
from particles.laws.linear import LinearContact
from particles.laws.pair_table import PairLaws
from particles.laws.restitution import damping_ratio, restitution_of
from particles.laws.rolling_friction import RollingFriction
from particles.laws.thesis import ThesisContact
from particles.laws.twisting_friction import TwistingFriction
from particles.laws.walton_braun import WaltonBraun
from particles.neighbours.contact_table import ContactTable
from particles.neighbours.neighbour_list import PairList, find_pairs
from particles.packing.file_packing import read_packing
from particles.packing.grown_packing import grown_packing
from particles.packing.lattice_packing import lattice_packing
from particles.packing.packing import Packing
from particles.packing.periodic_packing import BoxTooDense, periodic_packing
from particles.packing.poured_packing import poured_packing
from particles.packing.random_packing import pack, random_packing
from particles.packing.settling import NotAtRestError, Settling, before_the_start, settle
from particles.packing.sizes import (
    EqualSizes,
    ListedSizes,
    LogNormalSizes,
    NormalSizes,
    PercentileSizes,
    UniformSizes,
    read_sizes,
)
from particles.packing.space import Space
from particles.periodicity import Periodicity
from particles.sector import CyclicSector
from particles.sheared_box import GapBox, ShearedBox
from particles.step_totals import BoxStress, EnergyTotals, StepTotals

__all__ = [
    "DEM",
    "DVI",
    "Attraction",
    "Barostat",
    "Body",
    "BoxStress",
    "BoxTooDense",
    "Cohesion",
    "ContactLaw",
    "ContactTable",
    "CyclicSector",
    "DemError",
    "DemErrorKind",
    "DviContact",
    "DviTotals",
    "Elastic",
    "EnergyTotals",
    "EqualSizes",
    "FreeShaft",
    "GapBox",
    "GrainMotion",
    "Grains",
    "HertzContact",
    "HertzMindlin",
    "LinearContact",
    "ListedSizes",
    "LogNormalSizes",
    "NormalSizes",
    "NotAtRestError",
    "Packing",
    "PackingError",
    "PairLaws",
    "PairList",
    "ParticleError",
    "PercentileSizes",
    "Periodicity",
    "RollingFriction",
    "Settling",
    "ShearedBox",
    "Space",
    "StepTotals",
    "ThesisContact",
    "TimeStep",
    "TwistingFriction",
    "UniformSizes",
    "WaltonBraun",
    "before_the_start",
    "choose_dvi_step",
    "choose_time_step",
    "damping_ratio",
    "depth_warning",
    "find_pairs",
    "grown_packing",
    "lattice_packing",
    "pack",
    "periodic_packing",
    "poured_packing",
    "pull_stiffness_ratio",
    "random_packing",
    "read_packing",
    "read_sizes",
    "restitution_of",
    "settle",
    "stiffness_for_overlap",
]
