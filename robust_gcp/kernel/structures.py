"""What crosses the boundary to the compiled kernel; the mirror of abi.h."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from ctypes import c_double, c_int32, c_int64, c_void_p
from enum import IntEnum
from typing import Any

import numpy as np

from ..mechanism.tree.tree import Array

VERSION = 31
"""Of the interface; a library with another one is not used."""

TorqueCallback: Any = ctypes.CFUNCTYPE(c_int32, c_double)


class Reason(IntEnum):
    """Why the kernel handed control back."""

    DONE = 0
    ZONE = 1
    BRANCH = 2
    NEWTON = 3
    NON_FINITE = 4
    INERTIA = 5
    FORCE = 6
    TORQUE = 7
    CHART = 8
    MET = 9
    REFUSED = 10
    ROWS = 11
    OBSTACLE = 12


ALONE = -1
"""In place of a reason: a row of many goes through singular places, and needs a workspace of its own."""


def _all(kind: Any, names: str) -> list[tuple[str, Any]]:
    return [(name, kind) for name in names.split()]


def _fields(integers: str, pointers: str) -> list[tuple[str, Any]]:
    return _all(c_int32, integers) + _all(c_void_p, pointers)


class Beginning(IntEnum):
    """What a batch begins from."""

    GO_ON = 0
    REGULAR = 1
    IN_ZONE = 2
    ON = 3
    TURNED = 4


class Description(ctypes.Structure):
    """A mechanism as plain arrays; see abi.h."""

    _fields_ = [
        *_fields(
            "joints nq nv m",
            "parent kind placement inertia armature gravity ground "
            "independent independent_q size turn own scale",
        ),
        *_fields(
            "closures rows",
            "closure_joint closure_point row_closure row_axis row_weight row_terms terms",
        ),
        *_fields(
            "couplings coupling_width coupling_further",
            "coupling_at coupling_curve further_at further_arm",
        ),
        *_fields("blocks", "block_start block_rows block_columns reference"),
        *_fields("springs lines forces works", "spring_at spring damping drive line_joint line"),
        *_fields("paths pulls", "path_at arm_at arm stretch_at stretch pull_at pull effort"),
        ("driven", c_int32),
        *_fields("", "driven_y"),
        *_fields("redundant clusters", "cluster home"),
    ]


class Cluster(ctypes.Structure):
    """A loop cluster as plain arrays."""

    _fields_ = [
        *_fields("", "loops iq iv inputs rotates periodic balance"),
        *_all(c_double, "phi_size"),
    ]


class Bridging(ctypes.Structure):
    """The choices of the bridges."""

    _fields_ = [
        *_fields("count", "nodes"),
        ("error_controlled", c_int32),
        *_all(c_double, "reach reach_of_several closure_tolerance geometric_tolerance transversality"),
        ("last_resort", c_double),
    ]


class OutputRows(ctypes.Structure):
    """Where outputs are written; see abi.h."""

    _fields_ = [*_fields("", "q v a tau energy work effort")]


class Request(ctypes.Structure):
    """A batch of steps: what to do, where to write, and what came of it."""

    _fields_ = [
        *_all(c_int64, "steps first"),
        ("times", c_void_p),
        ("zone", c_double),
        ("bridging", ctypes.POINTER(Bridging)),
        ("beginning", c_int32),
        ("sizes", c_void_p),
        ("best", c_double),
        ("limit", c_double),
        ("uneven", c_void_p),
        ("torque", TorqueCallback),
        *_fields("", "torque_q torque_v torque_tau torque_stored held control"),
        *_fields("control_stride control_rows", ""),
        ("looked", TorqueCallback),
        ("tell", TorqueCallback),
        *_fields("", "trackers prescribed effort"),
        *_fields("stages", "tableau guard solver"),
        *_all(c_double, "rtol atol"),
        ("safe_from", c_int64),
        *_fields("", "x rate anchor origin ydd tau safe"),
        ("ends", OutputRows),
        ("within", OutputRows),
        *_fields("", "times_within before prescribed_within control_within"),
        *_all(c_int64, "completed safe_step rhs newton constraint_evaluations force_evaluations"),
        *_all(c_int64, "zone_evaluations marching_steps svds bridges_built second_order logged"),
        ("log", c_void_p),
        ("power", c_double),
        *_fields("in_zone reason met", ""),
        *_all(c_double, "uncertain asked nearest"),
        ("plain", c_int32),
    ]


class Guarded(ctypes.Structure):
    """What is to stay within bounds; see abi.h."""

    _fields_ = [*_fields("values rates", "begin in_q in_v weight lower upper")]


class States(ctypes.Structure):
    """States at which derivatives are asked for; see abi.h."""

    _fields_ = [
        ("count", c_int64),
        *_fields("", "q v tau"),
        *_all(c_double, "zone steady close same at_rest"),
        *_fields("", "mode ydd rows G v_y a a_y a_u status"),
        *_fields("drives", "prescribed"),
        ("torque", TorqueCallback),
        *_fields("", "torque_q torque_v torque_tau torque_stored q_out v_out A B"),
        *_fields("", "stage_q stage_v stage_a stage_G stage_v_y"),
    ]


class Rows(ctypes.Structure):
    """Many motions of one mechanism; see abi.h."""

    _fields_ = [
        ("count", c_int64),
        ("which", c_void_p),
        ("step", c_double),
        *_fields("", "t0 at left passed own going trackers in_zone status limit uneven"),
        *_fields("width", "held x anchor origin ydd q v"),
    ]


class ExportedChart(ctypes.Structure):
    """A choice of independent joints, as a file holds it; see abi.h."""

    _fields_ = [*_fields("", "description sizes uneven"), ("limit", c_double)]


class Exported(ctypes.Structure):
    """A mechanism as a file holds it; see abi.h."""

    _fields_ = [
        *_fields("charts controls", ""),
        ("zone", c_double),
        *_fields("", "bridging chart ranges joints actuators"),
    ]


class ModeSeries(ctypes.Structure):
    """A mode of one or two coordinates about a place; see abi.h."""

    _fields_ = [
        *_all(c_int64, "count inputs first second"),
        *_fields("", "velocities center shares terms"),
    ]


class Assembly(ctypes.Structure):
    """How loops are closed from afar; see abi.h."""

    _fields_ = [
        *_fields(
            "free_count point_count turn_count",
            "free points turns sort frames axis row_scale column_scale units",
        ),
        *_all(c_double, "length"),
    ]


class Arrays:
    """Fills a structure's pointers and keeps the arrays alive."""

    def __init__(self, structure: ctypes.Structure) -> None:
        self.structure = structure
        self._kept: dict[str, Any] = {}
        self._followed: dict[str, Callable[[], Array]] = {}
        self._members: list[Arrays] = []

    def reals(self, **arrays: Any) -> None:
        """Pointers to copies as doubles."""
        for name, array in arrays.items():
            self._point(name, np.ascontiguousarray(array, dtype=np.float64))

    def integers(self, **arrays: Any) -> None:
        """Pointers to copies as 32-bit integers."""
        for name, array in arrays.items():
            self._point(name, np.ascontiguousarray(array, dtype=np.int32))

    def following(self, name: str, numbers: Callable[[], Array]) -> None:
        """A pointer to numbers that `refresh` asks for again, as doubles."""
        self._followed[name] = numbers
        self.reals(**{name: numbers()})

    def refresh(self) -> None:
        """Ask again for numbers that change, of members too."""
        for name, numbers in self._followed.items():
            self._kept[name][...] = numbers()  # in place: the structure points there
        for member in self._members:
            member.refresh()

    def text(self, name: str, words: Sequence[str]) -> None:
        """A pointer to words, one a line, ended by zero."""
        self._point(name, np.frombuffer("\n".join(words).encode() + b"\0", np.uint8))

    def parts(self) -> dict[str, Array | Arrays]:
        """What its pointers point to, by name: arrays, or another structure."""
        found: dict[str, Array | Arrays] = dict(self._kept)
        places = {ctypes.addressof(member.structure): member for member in self._members}
        for name in (field[0] for field in self.structure._fields_):
            place = getattr(self.structure, name)
            if name not in found and isinstance(place, int) and place in places:
                found[name] = places[place]
        return found

    def members(self, addresses: Array) -> list[Arrays] | None:
        """The structures at these addresses; None where they are numbers."""
        if addresses.dtype != np.uint64:
            return None
        places = {ctypes.addressof(member.structure): member for member in self._members}
        return [places[int(address)] for address in addresses]

    def structures(self, name: str, members: Sequence[Arrays]) -> None:
        """A pointer to pointers to other structures."""
        self._members += members
        self._point(name, np.array([ctypes.addressof(m.structure) for m in members], dtype=np.uint64))

    def another(self, name: str, member: Arrays) -> None:
        """A pointer to another structure."""
        self._members.append(member)
        setattr(self.structure, name, ctypes.addressof(member.structure))

    def _point(self, name: str, array: Any) -> None:
        self._kept[name] = array
        setattr(self.structure, name, array.ctypes.data)


def address(array: Any) -> int | None:
    """Where an array's numbers are; the quick way, as it is asked for with every step."""
    return None if array is None else int(array.__array_interface__["data"][0])


def side_by_side(sizes: Mapping[str, int]) -> tuple[list[Array], dict[str, int]]:
    """Arrays of zeros of these sizes in one piece of memory, and where each begins."""
    whole = np.zeros(sum(sizes.values()))
    at, begin = whole.__array_interface__["data"][0], 0
    arrays, places = list[Array](), dict[str, int]()
    for name, size in sizes.items():
        arrays.append(whole[begin : begin + size])
        places[name] = at + 8 * begin
        begin += size
    return arrays, places
