"""Beyond second order: what modes do that touch, where second order leaves a configuration undecided.

The mid curve between modes (`maps/cluster/touching/mid_curve`) decides: of a room above this one, asked when
called.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..mechanism.loops import ClosedLoops
from ..mechanism.tree.tree import Array

if TYPE_CHECKING:
    from ..maps.cluster.touching.contact import Contact, Touching


def contact_at(loops: ClosedLoops, q: Array) -> Contact | None:
    """See `maps.cluster.touching.contact.contact_at`."""
    from ..maps.cluster.touching import contact

    return contact.contact_at(loops, q)


def touching_at(loops: ClosedLoops, q: Array) -> Touching:
    """The two modes that touch at q."""
    from ..maps.cluster.touching import contact

    found = contact.contact_at(loops, q)
    assert found is not None  # `analyse` told of it
    return contact.Touching(found)
