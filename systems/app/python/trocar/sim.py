"""One world: Sim, its bodies, tools and links."""

from __future__ import annotations

import ctypes as c
import os
from typing import Any, Mapping, Sequence

from . import _c, _data

_lib = _c.lib
_BODY, _TOOL, _LINK = 0, 1, 2
_MOTIONS = ["static", "kinematic", "hand", "deformable", "free"]


def _scene(scene, text, overrides: Mapping[str, Any] | None, paint: bool) -> _c.Scene:
    def value(v) -> str:
        if isinstance(v, bool):
            return "true" if v else "false"
        return f"[{', '.join(value(x) for x in v)}]" if isinstance(v, (list, tuple)) else str(v)

    asked = _c.Scene(paint=int(paint))
    asked.file = os.fsencode(scene) if scene is not None else None
    asked.text = text.encode() if text is not None else None
    words = [f"{key}={value(v)}".encode() for key, v in (overrides or {}).items()]
    asked.set = (c.c_char_p * len(words))(*words)
    asked.set_count = len(words)
    return asked


class Body:
    """One body of a world. Lengths in m, masses in kg."""

    def __init__(self, sim: "World", index: int):
        self._sim, self.index = sim, index
        self.name: str = _c.text_of(_lib.trocar_name, sim._handle, _BODY, index)

    def _info(self) -> _c.Body:
        info = _c.Body()
        _c.check(_lib.trocar_get_body(self._sim._handle, self.index, c.byref(info)))
        return info

    @property
    def motion(self) -> str:
        """static, kinematic, hand, deformable or free."""
        return _MOTIONS[self._info().motion]

    @property
    def mass(self) -> float:
        """kg; of a deformable body: of the nodes that can move; 0 for static and kinematic bodies."""
        return self._info().mass

    @property
    def origin(self):
        """(3,) m."""
        return _data.vector(self._info().origin)

    @property
    def orientation(self):
        """(4,) unit quaternion w, x, y, z."""
        return _data.vector(self._info().orientation)

    @property
    def particles(self) -> slice:
        """Rows of "particles.offset" of a deformable body: its vertices, then inner nodes and padding."""
        info = self._info()
        return slice(info.first_particle, info.first_particle + info.particles)

    def vertices(self):
        """(n, 3) float64, m: world positions of its vertices now; a copy."""
        return _data.numbers_of("d", 3, _lib.trocar_vertices, self._sim._handle, self.index)

    def triangles(self):
        """(m, 3) uint32: corners of its triangles, counter-clockwise from outside; a copy."""
        return _data.numbers_of("I", 3, _lib.trocar_triangles, self._sim._handle, self.index)

    def nearest(self, points) -> Any:
        """Points of its surface nearest to `points`, (n, 3) m: rows with distance (m, negative inside), point, normal and
        triangle."""
        keep, address, count = _data.doubles(points, 3, "points")
        out = (_c.Nearest * count)()
        _c.check(_lib.trocar_distance(self._sim._handle, self.index, address, count, out))
        del keep
        return _data.np.frombuffer(out, dtype=_data.np.dtype(_c.Nearest), count=count) if _data.np is not None else list(out)

    def distance(self, points) -> Any:
        """Signed distances of `points`, (n, 3) m, to its surface: (n,) float64, m, negative inside a closed one."""
        rows = self.nearest(points)
        return _data.np.array(rows["distance"]) if _data.np is not None else [r.distance for r in rows]

    def push(self, point, impulse) -> None:
        """Pushes it with an impulse, (3,) N s, at a world point, (3,) m."""
        at, where, n = _data.doubles(point, 3, "point")
        j, what, m = _data.doubles(impulse, 3, "impulse")
        if n != 1 or m != 1:
            raise _c.InputError("push: one point and one impulse")
        _c.check(_lib.trocar_push(self._sim._handle, self.index, where, what))

    def __repr__(self) -> str:
        return f"<body {self.name!r}, {self.motion}>"


class Tool:
    """An instrument that a hand holds. Positions in m, forces in N, torques in N m, angles in rad."""

    def __init__(self, sim: "World", index: int):
        self._sim, self.index = sim, index
        self.name: str = _c.text_of(_lib.trocar_name, sim._handle, _TOOL, index)

    def set_target(self, position, orientation=None, grip: float | None = None, buttons: int = 0, seconds: float = 0) -> None:
        """Sends the hand evenly to a pose in `seconds` (0: during the next pass), where it rests. It leaves the scene's script.
        position (3,) m and orientation (4,) w, x, y, z are of the device, as in tool.path of the scene. InputError above 2 m/s."""
        target = _c.Target(buttons=buttons, seconds=seconds, grip=-1 if grip is None else grip)
        target.position = _c.vec3(*position)
        if orientation is not None:
            target.orientation = _c.quat(*orientation)
        _c.check(_lib.trocar_set_target(self._sim._handle, self.index, c.byref(target)))

    def release(self) -> None:
        """Gives it back to the scene's script."""
        _c.check(_lib.trocar_release_tool(self._sim._handle, self.index))

    def _state(self) -> _c.Tool:
        state = _c.Tool()
        _c.check(_lib.trocar_get_tool(self._sim._handle, self.index, c.byref(state)))
        return state

    @property
    def device(self):
        """(3,) m, world: where the hand is."""
        return _data.vector(self._state().device)

    @property
    def orientation(self):
        """(4,) unit quaternion w, x, y, z of the hand."""
        return _data.vector(self._state().orientation)

    @property
    def proxy(self):
        """(3,) m, world: the tip, kept outside surfaces."""
        return _data.vector(self._state().proxy)

    @property
    def force(self):
        """(3,) N, on the hand."""
        return _data.vector(self._state().force)

    @property
    def torque(self):
        """(3,) N m, on the hand, about the tip."""
        return _data.vector(self._state().torque)

    @property
    def tissue(self):
        """(3,) N, of tissue on the simulated tool, mean over the last pass."""
        return _data.vector(self._state().tissue)

    @property
    def links(self):
        """(3,) N, of links on it, mean over the last pass."""
        return _data.vector(self._state().links)

    @property
    def grip(self) -> float:
        """rad, between the jaws."""
        return self._state().grip

    @property
    def touched(self) -> str | None:
        """Name of the body that its proxy touches."""
        body = self._state().touched
        return None if body == _c.NONE else self._sim.bodies[body]


class Link:
    """A group of links: springs from a deformable body to a holder."""

    def __init__(self, sim: "World", index: int):
        self._sim, self.index = sim, index

    def _state(self) -> _c.Link:
        state = _c.Link()
        _c.check(_lib.trocar_get_link(self._sim._handle, self.index, c.byref(state)))
        return state

    @property
    def holding(self) -> int:
        """Links that hold now."""
        return self._state().holding

    @property
    def force(self):
        """(3,) N, of the holder on the body, mean over the last pass."""
        return _data.vector(self._state().force)

    @property
    def largest_force(self) -> float:
        """N, so far."""
        return self._state().largest_force

    def remove(self) -> None:
        """Takes it off; its slot is free for another staple."""
        _c.check(_lib.trocar_remove_link(self._sim._handle, self.index))


class World:
    """What Sim and the worlds of a Batch have in common."""

    _owner: _data.Handle
    _copies = False
    _names: tuple[list[str], list[str]] | None = None

    @property
    def _handle(self) -> int:
        return self._owner.value

    # -- state

    @property
    def time(self) -> float:
        """s, simulated so far."""
        return _lib.trocar_time(self._handle)

    @property
    def hash(self) -> str:
        """Hash of the state, 16 hexadecimal digits: `state_hash` of `trocar run` after as many passes."""
        value = _c.u64()
        _c.check(_lib.trocar_hash(self._handle, c.byref(value)))
        return f"{value.value:016x}"

    def state(self) -> bytes:
        """The whole state, for restore() in any world of the same scene and overrides."""
        handle = self._handle
        size = _c.count_of(_lib.trocar_save, handle)
        buffer = c.create_string_buffer(size)
        _c.check(_lib.trocar_save(handle, buffer, size, c.byref(c.c_size_t())))
        return buffer.raw

    def restore(self, state: bytes) -> None:
        """Back to a state(). InputError if it is damaged or of another scene."""
        _c.check(_lib.trocar_restore(self._handle, state, len(state)))

    def reset(self) -> None:
        """Back to the start."""
        _c.check(_lib.trocar_reset(self._handle))

    @property
    def warnings(self) -> list[str]:
        """What building the scene warned of."""
        return _c.text_of(_lib.trocar_warnings, self._handle).splitlines()

    # -- arrays

    @property
    def arrays(self) -> list[str]:
        """Names of all arrays."""
        handle = self._handle
        return [_lib.trocar_array_name(handle, i).decode() for i in range(_lib.trocar_array_count(handle))]

    def _view(self, name: str) -> _c.ArrayView:
        view = _c.ArrayView()
        _c.check(_lib.trocar_array(self._handle, name.encode(), c.byref(view)))
        return view

    def array(self, name: str) -> Any:
        """The array of a name, as captures have it: (rows,) or (rows, columns). What is constant and the state of bodies
        ("particles.*", "poses.*") is shown without a copy and always as it is now; the latter may be written between two steps.
        What a step finds ("contacts.*") is copied, read only."""
        return _data.array_of(self._owner, self._view(name), self._copies)

    __getitem__ = array

    def unit(self, name: str) -> str:
        """Unit of an array: "m", "N"; empty without one."""
        return self._view(name).unit.decode()

    def put(self, name: str, values) -> None:
        """Writes an array of the state, in float64 or what it has."""
        view = self._view(name)
        if not view.writable:
            raise _c.CallError(f"{name} is not an array that may be written")
        if _data.np is None:
            raise _c.CallError("put needs numpy")
        target = _data.np.asarray(_data._Memory(self._owner, view, (view.rows, view.columns), True))
        target[...] = _data.np.asarray(values).reshape(view.rows, view.columns)

    # -- bodies, tools, links

    def _all_names(self, kind: int) -> list[str]:
        handle = self._handle
        return [_c.text_of(_lib.trocar_name, handle, kind, i) for i in range(_lib.trocar_count(handle, kind))]

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies."""
        self._handle
        if self._names is None:
            self._names = self._all_names(_BODY), self._all_names(_TOOL)
        return self._names[0]

    @property
    def tools(self) -> list[str]:
        """Names of the tools: those of the bodies that hands hold."""
        self.bodies
        return self._names[1]  # type: ignore[index]

    def _index(self, kind: int, name: str | int) -> int:
        if isinstance(name, int):
            return name
        index = _c.u32()
        _c.check(_lib.trocar_find(self._handle, kind, name.encode(), c.byref(index)))
        return index.value

    def body(self, name: str | int) -> Body:
        """A body by name or index. CallError if there is none."""
        return Body(self, self._index(_BODY, name))

    def tool(self, name: str | int = 0) -> Tool:
        """A tool by name or index; the first by default."""
        return Tool(self, self._index(_TOOL, name))

    def link(self, name: str | int) -> Link:
        """A group of links of the scene by name or index."""
        return Link(self, self._index(_LINK, name))

    def staple(self, a: str | int, b: str | int, position, stiffness: float, reach: float = 0.01, rest: float | None = None,
               break_strain: float | None = None) -> Link:
        """Joins the nodes of a (deformable) and b nearest to a world point, (3,) m, by a link of `stiffness`, N/m, `rest`, m
        (as far apart as they are). The scene must reserve room: staples = N."""
        asked = _c.Staple(a=self._index(_BODY, a), b=self._index(_BODY, b), stiffness=stiffness, reach=reach, rest=rest or 0,
                          break_strain=break_strain or 0)
        asked.position = _c.vec3(*position)
        index = _c.u32()
        _c.check(_lib.trocar_add_staple(self._handle, c.byref(asked), c.byref(index)))
        return Link(self, index.value)

    def distance(self, body: str | int, points) -> Any:
        """Signed distances of `points`, (n, 3) m, to a body: (n,) m, negative inside."""
        return self.body(body).distance(points)

    # -- what the last step found

    def contacts(self) -> Any:
        """Contacts of the last step: rows with body, other, vertex, triangle, point, closest, normal, distance (m) ..."""
        return _data.rows_of(_c.Contact, _lib.trocar_contacts, self._handle)

    def pairs(self) -> Any:
        """Overlapping pairs of the last step: rows with a, b, overlap, depth (m), direction, witness ..."""
        return _data.rows_of(_c.Pair, _lib.trocar_pairs, self._handle)

    def picture(self, width: int = 640, height: int = 480, *, target: Sequence[float] | None = None, distance: float = 0,
                azimuth: float = 0.5236, elevation: float = 0.4363, field_of_view: float = 0, wireframe: bool = False,
                depth_colours: bool = False, plain: bool = False) -> Any:
        """The present state: (height, width, 3) uint8, sRGB. With `target`, (3,) m, or `distance`, m, an orbit camera (angles in
        rad); else the scene's. plain: without markers and text."""
        asked = _c.Picture(width=width, height=height, wireframe=wireframe, depth_colours=depth_colours, plain=plain,
                           own_camera=int(target is not None or distance > 0), distance=distance, azimuth=azimuth,
                           elevation=elevation, field_of_view=field_of_view)
        asked.target = _c.vec3(*(target if target is not None else (0, 0, 0)))
        size = 3 * width * height
        pixels = (c.c_uint8 * size)()
        _c.check(_lib.trocar_draw(self._handle, c.byref(asked), pixels, size, c.byref(c.c_size_t())))
        if _data.np is not None:
            return _data.np.frombuffer(pixels, dtype=_data.np.uint8).reshape(height, width, 3)
        return memoryview(pixels).cast("B").cast("B", (height, width, 3))


class Sim(World):
    """A world of a scene: a path, the name of a built-in scene ("palpate"), or `text` in TOML.

    set: overrides as `trocar run --set`: {"liver.tissue.youngs_modulus": 2e4}. paint: textures of generated shapes, which only
    pictures show. InputError has file, line and column of what is wrong.

    >>> with Sim("probe_on_liver") as sim:
    ...     sim.step(60)
    ...     depths = sim.pairs()["depth"]
    """

    def __init__(self, scene: str | os.PathLike | None = None, *, text: str | None = None, set: Mapping[str, Any] | None = None,
                 paint: bool = False):
        pointer = c.c_void_p()
        _c.check(_lib.trocar_open(c.byref(_scene(scene, text, set, paint)), c.byref(pointer)))
        self._owner = _data.Handle(pointer.value or 0, _lib.trocar_close)
        self._step = _lib.trocar_step

    def step(self, passes: int = 1) -> None:
        """Simulates contact passes: 1/60 s each, or 1/contact.rate of the scene. Other Python threads run meanwhile."""
        code = self._step(self._owner.value, passes)
        if code:
            _c.check(code)

    def step_until(self, seconds: float) -> None:
        """Passes until the clock is at `seconds` or later."""
        _c.check(_lib.trocar_step_until(self._handle, seconds))

    def record(self, file: str | os.PathLike | None) -> None:
        """Records every pass from now on; None ends it and writes the capture (.cap), for `trocar replay` and `trocar capture`."""
        _c.check(_lib.trocar_record(self._handle, os.fsencode(file) if file is not None else None))

    def close(self) -> None:
        """Ends it. Its views raise ClosedError from then on; a recording that was not ended is not written."""
        self._owner.closed, self._owner = True, _data.CLOSED

    def __enter__(self) -> "Sim":
        return self

    def __exit__(self, *_) -> None:
        self.close()
