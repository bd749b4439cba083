"""Trocar: virtual surgery with exact contact, deforming tissue and haptic forces.

A first program::

    import trocar
    with trocar.Sim("probe_on_liver", set={"liver.tissue.youngs_modulus": 2e4}) as sim:
        sim.step(60)
        print(sim.time, sim.tool().force, sim.pairs()["depth"])

SI units throughout. Arrays are numpy's where numpy is installed, else memoryviews.
"""

from ._c import CallError, ClosedError, InputError, TrocarError, lib as _lib
from ._c import check as _check
from .batch import Batch, BatchWorld
from .collider import Collider
from .sim import Body, Link, Sim, Tool

__version__ = _lib.trocar_version().decode()
__all__ = ["Batch", "BatchWorld", "Body", "CallError", "ClosedError", "Collider", "InputError", "Link", "Sim", "Tool",
           "TrocarError", "set_threads"]


def set_threads(threads: int) -> None:
    """Worker threads of all worlds; 0 = all cores. Before the first world is made. Results are the same for any number."""
    _check(_lib.trocar_set_threads(threads))
