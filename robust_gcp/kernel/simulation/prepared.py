"""One step after the other by a call that is prepared once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...mechanism.tree.tree import Array
from ..structures import Beginning

if TYPE_CHECKING:
    from .workspace import Workspace

ON, TURNED = int(Beginning.ON), int(Beginning.TURNED)


class Prepared:
    """Steps that go on in a workspace under a torque that is held, with outputs into rows of the run's own.

    What they took, and the state that they reached, stays in the kernel until `Workspace.settled` fetches it.
    Any other use of the workspace ends this.

    Parameters
    ----------
    workspace : Workspace
        Whose request has the times from 0 on, the rows of outputs 1, 2, …, and all choices.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._run, self._handle, self._held = workspace.library.run, workspace.handle, workspace.acting.tau
        self._request, self._reference = workspace.request, workspace.reference
        self._owner = workspace  # of the memory that the request points to

    def __call__(self, first: int, steps: int, torque: Array | None = None) -> bool:
        """Steps from a time on, the one reached last; whether all were taken, with nothing to tell of them.

        Parameters
        ----------
        first, steps : int
        torque : ndarray (nv,), optional
            Another than before: output `first` then has the acceleration under it.
        """
        request = self._request
        request.first, request.steps = first, steps
        if torque is None:
            request.beginning = ON
        else:
            self._held[:] = torque
            request.beginning = TURNED
        self._run(self._handle, self._reference)
        return bool(request.plain)

    @property
    def used(self) -> bool:
        """Whether it was called."""
        return bool(self._request.beginning >= ON)

    @property
    def completed(self) -> int:
        """Steps that the last call took; −1 where even the look under another torque failed."""
        return int(self._request.completed)
