"""Many worlds of one scene: Batch."""

from __future__ import annotations

import ctypes as c
import os
from typing import Any, Mapping

from . import _c, _data
from .sim import World, _scene

_lib = _c.lib


class BatchWorld(World):
    """One world of a batch: all of a Sim but stepping and recording. Its arrays are copies; put() writes them."""

    _copies = True

    def __init__(self, batch: "Batch", index: int):
        self._batch, self._number = batch, index
        self._owner = batch._owner

    @property
    def _handle(self) -> int:
        world = c.c_void_p()
        _c.check(_lib.trocar_batch_world(self._batch._owner.value, self._number, c.byref(world)))
        return world.value or 0


class Batch:
    """n worlds of one scene, which share all that is constant; each costs its state. They are stepped on all cores in one call,
    with the bits of single worlds. batch[i] is one of them.

    >>> with Batch("palpate", 64) as batch:
    ...     for i, world in enumerate(batch):
    ...         world.tool().set_target((0, 0, 0.1 - 0.001 * i), seconds=1)
    ...     batch.step(60)
    """

    def __init__(self, scene: str | os.PathLike | None = None, n: int = 1, *, text: str | None = None,
                 set: Mapping[str, Any] | None = None, threads: int = 0):
        pointer = c.c_void_p()
        _c.check(_lib.trocar_batch_open(c.byref(_scene(scene, text, set, False)), n, threads, c.byref(pointer)))
        self._owner = _data.Handle(pointer.value or 0, _lib.trocar_batch_close)
        self._worlds = [BatchWorld(self, i) for i in range(n)]

    def step(self, passes: int = 1) -> None:
        """Steps every world; returns when all are done. Other Python threads run meanwhile."""
        _c.check(_lib.trocar_batch_step(self._owner.value, passes))

    def keep(self, *names: str) -> None:
        """From the next step on keeps derived arrays ("contacts.distance") of every world, for arrays()."""
        for name in names:
            _c.check(_lib.trocar_batch_keep(self._owner.value, name.encode()))

    def arrays(self, name: str) -> list[Any]:
        """An array of the state, or one kept, of every world: copies."""
        found = []
        for i in range(len(self._worlds)):
            view = _c.ArrayView()
            _c.check(_lib.trocar_batch_array(self._owner.value, i, name.encode(), c.byref(view)))
            found.append(_data.array_of(self._owner, view, True))
        return found

    @property
    def memory(self) -> tuple[int, int]:
        """Bytes of one more world, and of what all worlds share."""
        each, shared = _c.u64(), _c.u64()
        _c.check(_lib.trocar_batch_memory(self._owner.value, c.byref(each), c.byref(shared)))
        return each.value, shared.value

    def __getitem__(self, index: int) -> BatchWorld:
        return self._worlds[index]

    def __len__(self) -> int:
        return len(self._worlds)

    def close(self) -> None:
        """Ends all worlds."""
        self._owner.closed, self._owner = True, _data.CLOSED
        for world in self._worlds:
            world._owner = _data.CLOSED

    def __enter__(self) -> "Batch":
        return self

    def __exit__(self, *_) -> None:
        self.close()
