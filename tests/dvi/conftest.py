"""The convex law of friction in tests: always by chunks, which is one compiled step less than with and without them."""

import pytest

from particles.dvi import sweep_chunks
from particles.dvi.dvi import DVI


@pytest.fixture(autouse=True)
def convex_law_by_chunks(monkeypatch):
    """Few grains are worth sharing where the law is the convex one; exact Coulomb keeps its own limit."""
    make_room = DVI._make_room

    def room(self):
        with monkeypatch.context() as patch:
            if self._convex:
                patch.setattr(sweep_chunks, "WORTH_SHARING", 1)
            make_room(self)

    monkeypatch.setattr(DVI, "_make_room", room)
