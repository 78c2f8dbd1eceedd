"""The convex law of friction in tests: by chunks, so that few steps are compiled; one test has it all at once."""

import pytest

from particles.dvi import sweep_chunks
from particles.dvi.dvi import DVI


@pytest.fixture(autouse=True)
def convex_law_by_chunks(request, monkeypatch):
    """Few grains are worth sharing where the law is the convex one; exact Coulomb keeps its own limit.

    A test that is marked `convex_all_at_once` has the step of scenes with few grains.
    """
    if request.node.get_closest_marker("convex_all_at_once") is not None:
        return
    make_room = DVI._make_room

    def room(self):
        with monkeypatch.context() as patch:
            if self._convex:
                patch.setattr(sweep_chunks, "WORTH_SHARING", 1)
            make_room(self)

    monkeypatch.setattr(DVI, "_make_room", room)
