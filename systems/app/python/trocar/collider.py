"""Contact of deforming meshes without a world: Collider."""

from __future__ import annotations

import ctypes as c
from typing import Any, Sequence

from . import _c, _data

_lib = _c.lib


class Collider:
    """Contact of two or more deforming meshes: that of `trocar collide`, to the bit.

    meshes: pairs of vertices, (n, 3) m, and triangles, (m, 3) indices, counter-clockwise from outside. Closed ones have an
    inside; open ones are sheets. tolerance: m, of the deepest points; 0: 1e-4 of the smallest diagonal. faces: search faces for
    points deeper than their corners and edges. InputError names mesh and element.

    >>> contact = Collider([(xyz_a, triangles_a), (xyz_b, triangles_b)])
    >>> contact.move(1, xyz_b + (0, 0, -0.01))
    >>> contact.find()
    >>> contact.pairs()["depth"]
    """

    def __init__(self, meshes: Sequence[tuple[Any, Any]], *, tolerance: float = 0, faces: bool = True):
        given = (_c.Mesh * len(meshes))()
        keep = []
        self._counts: list[int] = []
        for i, (xyz, corners) in enumerate(meshes):
            points, at, vertices = _data.doubles(xyz, 3, f"mesh {i}")
            index, corner, triangles = _data.indices(corners, 3, f"mesh {i}, triangles")
            keep += [points, index]
            given[i].size = c.sizeof(_c.Mesh)
            given[i].vertices, given[i].triangles, given[i].xyz, given[i].corners = vertices, triangles, at, corner
            self._counts.append(vertices)
        options = _c.ColliderOptions(no_faces=int(not faces), tolerance=tolerance)
        pointer = c.c_void_p()
        _c.check(_lib.trocar_collider_open(given, len(meshes), c.byref(options), c.byref(pointer)))
        self._owner = _data.Handle(pointer.value or 0, _lib.trocar_collider_close)

    def admission(self, mesh: int) -> str:
        """How a mesh was judged: "solid", "winding" (closed, but flawed) or "sheet"."""
        value = c.c_int()
        _c.check(_lib.trocar_collider_admission(self._owner.value, mesh, c.byref(value)))
        return ("solid", "winding", "sheet")[value.value]

    def move(self, mesh: int, xyz) -> None:
        """New positions of all vertices of a mesh, (n, 3) m."""
        handle = self._owner.value
        keep, at, count = _data.doubles(xyz, 3, f"mesh {mesh}")
        if 0 <= mesh < len(self._counts) and count != self._counts[mesh]:
            raise _c.InputError(f"mesh {mesh}: {count} vertices, it has {self._counts[mesh]}")
        _c.check(_lib.trocar_collider_move(handle, mesh, at))
        del keep

    def find(self) -> "Collider":
        """Finds contacts of all pairs at the present positions."""
        _c.check(_lib.trocar_collider_find(self._owner.value))
        return self

    def pairs(self) -> Any:
        """Pairs whose boxes meet: rows with a, b, overlap, depth (m), surface_depth, direction (b leaves a), witness ..."""
        return _data.rows_of(_c.Pair, _lib.trocar_collider_pairs, self._owner.value)

    def contacts(self) -> Any:
        """Rows with body, other (indices of meshes), vertex, triangle, point, closest, normal, distance (m, negative inside) ..."""
        return _data.rows_of(_c.Contact, _lib.trocar_collider_contacts, self._owner.value)

    def regions(self) -> Any:
        """Connected parts of the overlaps: rows with a, b, area (m2), volume (m3), depth (m), direction ..."""
        return _data.rows_of(_c.Region, _lib.trocar_collider_regions, self._owner.value)

    def close(self) -> None:
        self._owner.closed, self._owner = True, _data.CLOSED

    def __enter__(self) -> "Collider":
        return self

    def __exit__(self, *_) -> None:
        self.close()
