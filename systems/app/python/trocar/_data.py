"""Arrays of the library for Python: numpy arrays where numpy is there, else memoryviews."""

from __future__ import annotations

import ctypes as c
from typing import Any

from . import _c

try:
    import numpy as np
except ImportError:  # pragma: no cover - tried in a process of its own
    np = None  # type: ignore[assignment]

_CODES = ["B", "H", "I", "Q", "f", "d"]  # per trocar_type
_SIZES = [1, 2, 4, 8, 4, 8]


class Handle:
    """A world, batch or collider of the library. It is freed when it was closed and the last view of it is gone."""

    def __init__(self, pointer: int, free):
        self.pointer, self.closed, self._free = pointer, False, free

    @property
    def value(self) -> int:
        if self.closed:
            raise _c.ClosedError("it was closed")
        return self.pointer

    def __del__(self):
        if self.pointer and self._free:
            self._free(self.pointer)


CLOSED = Handle(0, None)
CLOSED.closed = True


if np is not None:

    class View(np.ndarray):
        """An array of a running world, without a copy: it always shows the present state. Once the world is closed every use
        raises ClosedError. np.array(view) copies."""

        _handle: Handle | None = None

        def __array_finalize__(self, source):
            self._handle = getattr(source, "_handle", None)

        def _check(self):
            if self._handle is not None and self._handle.closed:
                raise _c.ClosedError("the world of this view was closed")

        def __getitem__(self, key):
            self._check()
            return super().__getitem__(key)

        def __setitem__(self, key, value):
            self._check()
            super().__setitem__(key, value)

        def __iter__(self):
            self._check()
            return super().__iter__()

        def __repr__(self):
            return "<view of a closed world>" if self._handle is not None and self._handle.closed else super().__repr__()

        __str__ = __repr__

        def __array_ufunc__(self, ufunc, method, *inputs, out=None, **options):
            def plain(x):
                if isinstance(x, View):
                    x._check()
                    return np.ndarray.view(x, np.ndarray)
                return x

            if out is not None:
                options["out"] = tuple(plain(x) for x in out)
            result = getattr(ufunc, method)(*(plain(x) for x in inputs), **options)
            return out[0] if out is not None and len(out) == 1 else result

        def __array_function__(self, function, types, arguments, options):
            self._check()
            return super().__array_function__(function, types, arguments, options)

        def copy(self, order="C"):
            """The values as an array of its own."""
            self._check()
            return np.array(np.ndarray.view(self, np.ndarray), order=order)

        def tobytes(self, order="C"):
            self._check()
            return super().tobytes(order)

        def tolist(self):
            self._check()
            return super().tolist()

    class _Memory:
        def __init__(self, handle: Handle, view: _c.ArrayView, shape, writable: bool):
            self.handle = handle  # keeps the memory while the array lives
            kind = ("<u", "<f")[view.type >= 4] + str(_SIZES[view.type])
            self.__array_interface__ = {"version": 3, "shape": shape, "typestr": kind, "data": (view.data, not writable)}


def array_of(handle: Handle, view: _c.ArrayView, copy: bool) -> Any:
    """An array as the library showed it; without a copy if it stays where it is."""
    shape = (view.rows,) if view.columns == 1 else (view.rows, view.columns)
    copy = copy or not view.fixed
    if np is not None:
        if not view.data:
            return np.empty(shape, dtype=np.dtype(_CODES[view.type]))
        raw = np.asarray(_Memory(handle, view, shape, bool(view.writable) and not copy))
        if copy:
            raw = raw.copy()
            raw.flags.writeable = False
            return raw
        shown = raw.view(View)
        shown._handle = handle
        return shown
    size = view.rows * view.columns * _SIZES[view.type]
    if not view.data:
        return memoryview(b"")
    if copy:
        return memoryview(c.string_at(view.data, size)).cast(_CODES[view.type])
    buffer = type("Buffer", (c.c_ubyte * size,), {}).from_address(view.data)
    buffer.handle = handle  # keeps the memory while the memoryview lives
    shown = memoryview(buffer).cast("B")
    shown = shown.cast(_CODES[view.type], shape) if len(shape) == 2 else shown.cast(_CODES[view.type])
    return shown if view.writable else shown.toreadonly()


def doubles(values: Any, width: int, name: str):
    """Values as `width` C doubles a row: (object that keeps them, address, rows)."""
    if np is not None:
        array = np.ascontiguousarray(values, dtype=np.float64)
        if array.size % width or (array.ndim > 1 and array.shape[-1] != width):
            raise _c.InputError(f"{name}: {array.shape} is not rows of {width}")
        return array, array.ctypes.data, array.size // width
    flat: list[float] = []

    def add(v):
        for x in v:
            flat.append(float(x)) if not hasattr(x, "__iter__") else add(x)

    add(values)
    if len(flat) % width:
        raise _c.InputError(f"{name}: {len(flat)} numbers are not rows of {width}")
    array = (c.c_double * len(flat))(*flat)
    return array, c.addressof(array), len(flat) // width


def indices(values: Any, width: int, name: str):
    """The same for 32-bit indices."""
    if np is not None:
        array = np.asarray(values)
        if array.size and (array.dtype.kind not in "iu" or array.min() < 0 or array.max() > _c.NONE):
            raise _c.InputError(f"{name}: not indices from 0 on")
        array = np.ascontiguousarray(array, dtype=np.uint32)
        if array.size % width:
            raise _c.InputError(f"{name}: {array.shape} is not rows of {width}")
        return array, array.ctypes.data, array.size // width
    flat = [int(x) for row in values for x in row]
    array = (c.c_uint32 * len(flat))(*flat)
    return array, c.addressof(array), len(flat) // width


def rows_of(kind: type, function, *arguments) -> Any:
    """The list that a function fills, as a numpy array of structs (rows["depth"]), else as a list of structs; rows[0]["depth"] in both."""
    count = _c.count_of(function, *arguments)
    rows = (kind * count)()
    _c.check(function(*arguments, rows, count, c.byref(c.c_size_t())))
    return np.frombuffer(rows, dtype=np.dtype(kind), count=count) if np is not None else list(rows)


def numbers_of(code: str, width: int, function, *arguments) -> Any:
    """The vectors that a function fills: an array of `count` x `width`."""
    count = _c.count_of(function, *arguments)
    if np is not None:
        out = np.empty((count, width), dtype=np.dtype(code))
        _c.check(function(*arguments, out.ctypes.data, count, c.byref(c.c_size_t())))
        return out
    raw = (({"d": c.c_double, "I": c.c_uint32}[code]) * (count * width))()
    _c.check(function(*arguments, raw, count, c.byref(c.c_size_t())))
    return memoryview(raw).cast("B").cast(code, (count, width)) if count else memoryview(b"")


def vector(values) -> Any:
    """Three or four numbers: a numpy array, else a tuple."""
    return np.array(values) if np is not None else tuple(values)
