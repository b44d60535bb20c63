"""Mechanisms from URDF and MJCF: readers stand above what they make, and are loaded when they are asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from numpy.typing import ArrayLike

from .constraint.couplings import closures_given
from .contents import tell_left_out
from .facade import Above
from .forces.forces import Force, forces_given

if TYPE_CHECKING:
    from .mechanism import Mechanism


class FromFiles(Above):
    """`Above`, made from files."""

    from_contents: ClassVar[Callable[..., Mechanism]]

    @classmethod
    def from_urdf(
        cls,
        urdf: str | Path,
        closures: Sequence[Any] = (),
        independent: Sequence[str] | Literal["auto"] | None = None,
        home: ArrayLike | None = None,
        name: str = "",
        forces: Sequence[Force] = (),
        base: str | None = None,
        strict: bool = False,
    ) -> Mechanism:
        """A mechanism from a URDF file (or its text); `continuous` joints become one number in q.

        Loops, couplings and dampers of the file are kept beside those that are given; see
        `io.urdf.read_urdf` for what is read, and `from_pinocchio` for the other parameters.

        Parameters
        ----------
        base : "fixed", "free" or None
            What the robot stands on; None: as the file says.
        strict : bool
            Refuse a file with parts that are not simulated instead of warning of them.
        """
        from ..io.urdf.reader import read_urdf  # readers stand above the mechanisms that they make

        contents = read_urdf(urdf, base)
        tell_left_out(contents.left_out, _called(urdf, "URDF"), strict)
        contents.close(closures_given(closures))
        contents.forces += forces_given(forces)
        return cls.from_contents(contents, independent, home, name)

    @classmethod
    def from_mjcf(
        cls,
        mjcf: str | Path,
        independent: Sequence[str] | Literal["auto"] | None = None,
        home: ArrayLike | str | None = None,
        name: str = "",
        base: str | None = None,
        strict: bool = False,
        root: str | Path | None = None,
        moving: Mapping[str, Sequence[str]] | None = None,
    ) -> Mechanism:
        """A mechanism from a MJCF file (or its text); see `io.mjcf.reader` for what is read.

        `home` is q (nq,), the name of a keyframe, or MuJoCo's qpos0 when left out; `root` a folder besides
        the file's own, whose files it may include; `base` and `strict` are those of `from_urdf`, `moving` is
        that of `load`.
        """
        from ..io.mjcf.reader import read_mjcf

        contents = read_mjcf(mjcf, base, root, moving)
        tell_left_out(contents.left_out, _called(mjcf, "MJCF"), strict)
        q = contents.configuration(home) if home is None or isinstance(home, str) else home
        return cls.from_contents(contents, independent, q, name)


def _called(given: str | Path, what: str) -> str:
    """A file's path, or what its text is."""
    return f"{what} text" if "<" in str(given) else str(given)
