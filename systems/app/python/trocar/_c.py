"""The C interface of libtrocar (trocar/trocar.h) for ctypes: structs, prototypes, errors. What they mean is said there."""

from __future__ import annotations

import ctypes as c
import os
import re
from pathlib import Path

ABI = 0
NONE = 0xFFFFFFFF  # "no index"


class TrocarError(Exception):
    """Any failure of the library; its text says why."""


class InputError(TrocarError, ValueError):
    """A scene, mesh, file or value that cannot be used. `file`, `line` and `column` say where, if it is known; else None."""

    file: str | None = None
    line: int | None = None
    column: int | None = None

    def __init__(self, text: str):
        super().__init__(text)
        where = re.match(r"(.+?):(\d+):(\d+): ", text)
        if where:
            self.file, self.line, self.column = where[1], int(where[2]), int(where[3])


class CallError(TrocarError, LookupError):
    """A name or an index that is not there, or a call that makes no sense now."""


class ClosedError(TrocarError):
    """Use of a world, batch or collider, or of one of its views, after it was closed."""


class Struct(c.Structure):
    """A struct whose `size` is set."""

    def __init__(self, **members):
        super().__init__(**members)
        self.size = c.sizeof(self)


class Row(c.Structure):
    """A row of a list: row["depth"], as rows of a numpy array have it, is row.depth."""

    def __getitem__(self, name: str):
        return getattr(self, name)


u32, u64, f64, vec3, quat = c.c_uint32, c.c_uint64, c.c_double, c.c_double * 3, c.c_double * 4


class Scene(Struct):
    _fields_ = [("size", u32), ("set_count", u32), ("file", c.c_char_p), ("text", c.c_char_p), ("set", c.POINTER(c.c_char_p)),
                ("paint", u32), ("reserved", u32)]


class ArrayView(Struct):
    _fields_ = [("size", u32), ("type", u32), ("data", c.c_void_p), ("rows", u64), ("columns", u32), ("fixed", u32),
                ("writable", u32), ("reserved", u32), ("unit", c.c_char * 32)]


class Body(Struct):
    _fields_ = [("size", u32), ("motion", u32), ("vertices", u32), ("triangles", u32), ("first_particle", u32),
                ("particles", u32), ("origin", vec3), ("orientation", quat), ("mass", f64)]


class Nearest(Row):
    _fields_ = [("distance", f64), ("point", vec3), ("normal", vec3), ("triangle", u32), ("reserved", u32)]


class Target(Struct):
    _fields_ = [("size", u32), ("buttons", u32), ("position", vec3), ("orientation", quat), ("grip", f64), ("seconds", f64)]


class Tool(Struct):
    _fields_ = [("size", u32), ("body", u32), ("touched", u32), ("contacts", u32), ("device", vec3), ("orientation", quat),
                ("proxy", vec3), ("force", vec3), ("torque", vec3), ("tissue", vec3), ("links", vec3), ("grip", f64),
                ("grip_torque", f64)]


class Contact(Row):
    _fields_ = [("body", u32), ("other", u32), ("vertex", u32 * 2), ("third", u32), ("triangle", u32), ("along", c.c_float),
                ("across", c.c_float), ("point", vec3), ("closest", vec3), ("normal", vec3), ("distance", f64)]


class Pair(Row):
    _fields_ = [("a", u32), ("b", u32), ("overlap", u32), ("saturated", u32), ("a_in_b", u32), ("b_in_a", u32), ("depth", f64),
                ("surface_depth", f64), ("direction", vec3), ("witness", u32), ("reserved", u32)]


class Link(Struct):
    _fields_ = [("size", u32), ("body", u32), ("holder", u32), ("holding", u32), ("made", u64), ("broken", u64), ("force", vec3),
                ("largest_force", f64), ("largest_strain", f64)]


class Staple(Struct):
    _fields_ = [("size", u32), ("a", u32), ("b", u32), ("reserved", u32), ("position", vec3), ("reach", f64), ("stiffness", f64),
                ("rest", f64), ("break_strain", f64)]


class Picture(Struct):
    _fields_ = [("size", u32), ("width", u32), ("height", u32), ("wireframe", u32), ("depth_colours", u32), ("plain", u32),
                ("own_camera", u32), ("reserved", u32), ("target", vec3), ("distance", f64), ("azimuth", f64), ("elevation", f64),
                ("field_of_view", f64)]


class Mesh(Struct):
    _fields_ = [("size", u32), ("vertices", u32), ("triangles", u32), ("reserved", u32), ("xyz", c.c_void_p), ("corners", c.c_void_p)]


class ColliderOptions(Struct):
    _fields_ = [("size", u32), ("no_faces", u32), ("tolerance", f64)]


class Region(Row):
    _fields_ = [("a", u32), ("b", u32), ("a_in_b", u32), ("b_in_a", u32), ("curves", u32), ("witness", u32), ("contour", f64),
                ("area", f64), ("volume", f64), ("depth", f64), ("direction", vec3)]


#: struct of trocar.h -> its class here: a test compares their sizes with those of a C compiler
STRUCTS = {"trocar_scene": Scene, "trocar_view": ArrayView, "trocar_body": Body, "trocar_nearest": Nearest, "trocar_target": Target,
           "trocar_tool": Tool, "trocar_contact": Contact, "trocar_pair": Pair, "trocar_link": Link, "trocar_staple": Staple,
           "trocar_picture": Picture, "trocar_mesh": Mesh, "trocar_collider_options": ColliderOptions, "trocar_region": Region}


def _load() -> c.CDLL:
    beside = Path(__file__).parent / "libtrocar.so.0"
    name = os.environ.get("TROCAR_LIBRARY") or (str(beside) if beside.exists() else "libtrocar.so.0")
    try:
        return c.CDLL(name)
    except OSError as error:
        raise ImportError(f"libtrocar cannot be loaded: {error}. Install it, or set TROCAR_LIBRARY to its path") from error


lib = _load()
_p, _s, _z, _n = c.c_void_p, c.c_char_p, c.c_size_t, c.POINTER(c.c_size_t)
for _name, _arguments in {
    "set_threads": [u32], "open": [_p, _p], "warnings": [_p, _s, _z, _n], "step": [_p, u32], "step_until": [_p, f64],
    "hash": [_p, c.POINTER(u64)], "save": [_p, _p, _z, _n], "restore": [_p, _p, _z], "reset": [_p], "array": [_p, _s, _p],
    "find": [_p, c.c_int, _s, c.POINTER(u32)], "name": [_p, c.c_int, u32, _s, _z, _n], "get_body": [_p, u32, _p],
    "vertices": [_p, u32, _p, _z, _n], "triangles": [_p, u32, _p, _z, _n], "distance": [_p, u32, _p, _z, _p],
    "push": [_p, u32, _p, _p], "set_target": [_p, u32, _p], "release_tool": [_p, u32], "get_tool": [_p, u32, _p],
    "contacts": [_p, _p, _z, _n], "pairs": [_p, _p, _z, _n], "get_link": [_p, u32, _p], "add_staple": [_p, _p, c.POINTER(u32)],
    "remove_link": [_p, u32], "record": [_p, _s], "draw": [_p, _p, _p, _z, _n], "batch_open": [_p, u32, u32, _p],
    "batch_step": [_p, u32], "batch_world": [_p, u32, _p], "batch_keep": [_p, _s], "batch_array": [_p, u32, _s, _p],
    "batch_memory": [_p, c.POINTER(u64), c.POINTER(u64)], "collider_open": [_p, u32, _p, _p],
    "collider_admission": [_p, u32, c.POINTER(c.c_int)], "collider_move": [_p, u32, _p], "collider_find": [_p],
    "collider_pairs": [_p, _p, _z, _n], "collider_contacts": [_p, _p, _z, _n], "collider_regions": [_p, _p, _z, _n],
}.items():
    _f = getattr(lib, "trocar_" + _name)
    _f.argtypes, _f.restype = _arguments, c.c_int
for _name, _arguments, _result in [
    ("last_error", [], _s), ("abi", [], u32), ("version", [], _s), ("close", [_p], None), ("time", [_p], f64),
    ("array_count", [_p], u32), ("array_name", [_p, u32], _s), ("count", [_p, c.c_int], u32), ("batch_close", [_p], None),
    ("batch_count", [_p], u32), ("collider_close", [_p], None),
]:
    _f = getattr(lib, "trocar_" + _name)
    _f.argtypes, _f.restype = _arguments, _result
if lib.trocar_abi() != ABI:
    raise ImportError(f"libtrocar has ABI {lib.trocar_abi()}; this module is for {ABI}")

TOO_SMALL = 3


def check(code: int) -> None:
    """Raises what a function of the library returned."""
    if code == 0:
        return
    text = lib.trocar_last_error().decode(errors="replace")
    if code == 4:
        raise MemoryError(text)
    raise {1: InputError, 2: CallError}.get(code, TrocarError)(text)


def count_of(function, *arguments) -> int:
    """The count that a function tells which fills a list."""
    count = c.c_size_t()
    code = function(*arguments, None, 0, c.byref(count))
    if code != TOO_SMALL:
        check(code)
    return count.value


def text_of(function, *arguments) -> str:
    """The text that a function fills in."""
    size = count_of(function, *arguments)
    text = c.create_string_buffer(size)
    check(function(*arguments, text, size, c.byref(c.c_size_t())))
    return text.value.decode(errors="replace")
