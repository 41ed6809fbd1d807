"""emcee, without what only moves that are not made here would need; the other files of the room have it from here."""

from __future__ import annotations

from fitball.environment import heavy_later

with heavy_later():
    import emcee

__all__ = ["emcee"]
