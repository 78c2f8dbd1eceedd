"""The compiled springs by the name of their law (`particles.laws.contact_law`)."""

from __future__ import annotations

from particles.laws.hertz import hertz_spring
from particles.laws.hertz_mindlin import hertz_mindlin_spring
from particles.laws.linear import linear_spring
from particles.laws.thesis import thesis_spring
from particles.laws.walton_braun import walton_braun_spring

SPRINGS = {
    "linear": linear_spring,
    "hertz_mindlin": hertz_mindlin_spring,
    "hertz": hertz_spring,
    "thesis": thesis_spring,
    "walton_braun": walton_braun_spring,
}
