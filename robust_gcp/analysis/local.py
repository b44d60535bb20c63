"""Local analysis: what a mechanism can do at a configuration, to second order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..checks import check_between, check_mechanism
from ..mechanism.constraint.rank import rank_along
from ..mechanism.coordinates.partition import numerical_rank
from ..mechanism.loops import ClosedLoops
from ..mechanism.tolerances import FORM, NEARLY_CLOSED, RANK
from ..mechanism.tree.tree import Array
from .second_order import bending, bending_along, curvature, second_order_forms
from .tangent_cone import in_order, is_definite, linear_modes, polished, rank_two_forms
from .touching_modes import contact_at

if TYPE_CHECKING:
    from ..maps.cluster.touching.contact import Contact

Kind = Literal["regular", "redundant", "singular", "cusp", "isolated", "inside", "not certified"]

MAX_COMBINATIONS = 256
"""Modes enumerated when several loops are singular at once; 2 for each loop."""

NOTHING = "no direction passes second order: an isolated point"


@dataclass(frozen=True)
class LocalAnalysis:
    """The local picture at a closed configuration.

    Attributes
    ----------
    q : ndarray (nq,)
    kind : {"regular", "redundant", "singular", "cusp", "isolated", "inside", "not certified"}
        One smooth mode, without or with rows to spare; modes meet; one ends in a cusp; nothing moves; the
        mode lies in the singular set; not decided.
    rank, generic_rank : int
        Rank of K here, and at nearby points of the same mode; or more, where many loops are singular.
    singular_values : ndarray
        Of the scaled (dimensionless) K, descending.
    kernel : ndarray (nv, δ_diff)
        Orthonormal basis of ker K: the tangent space, span of the tangent cone.
    left_kernel : ndarray (nc, nc − rank)
        Orthonormal basis of the left null space of K.
    forms : tuple of ndarray (δ_diff, δ_diff)
        Second-order forms Q_u = Nᵀ (uᵀ φ'') N of the singular left null vectors u, N the kernel.
    modes : tuple of ndarray
        The tangent cone: one array a mode that passes through q. A direction (nv,) for mobility 1,
        largest entry ±1 and first non-zero entry positive; else an orthonormal basis (nv, m). Numbered as
        `tangent_cone.in_order` says.
    message : str
        The picture in words.
    contacts : tuple of (int, int, int)
        Of each two modes that meet, their numbers and their order of contact: 1 where they cross, k where
        they agree to order k. Modes in contact share their tangent.
    """

    q: Array
    kind: Kind
    rank: int
    generic_rank: int
    singular_values: Array
    kernel: Array
    left_kernel: Array
    forms: tuple[Array, ...]
    modes: tuple[Array, ...]
    message: str
    contacts: tuple[tuple[int, int, int], ...] = ()

    def __repr__(self) -> str:
        """The picture in words, and the modes."""
        lines = [f"LocalAnalysis({self.kind} at q = {np.round(self.q, 4).tolist()}: {self.message})"]
        if len(self.modes) > 1:
            shown = [np.round(mode, 4).tolist() for mode in self.modes]
            lines += [f"modes[{i}] = {mode}" for i, mode in enumerate(shown)]
        return "\n  ".join(lines)

    @property
    def differential_dof(self) -> int:
        """δ_diff = nv − rank K: dimension of the tangent space, the instantaneous freedom."""
        return self.kernel.shape[1]

    @property
    def local_dof(self) -> int | None:
        """δ_loc: the largest dimension of a mode through q; None where it is not certified."""
        if self.kind == "not certified":
            return None
        return max(map(_dimension, self.modes), default=0)


def analyse(mechanism: ClosedLoops, q: ArrayLike, rank_tolerance: float = RANK) -> LocalAnalysis:
    """Rank, kernel, operation modes and classification at a closed configuration.

    With N a basis of ker K and u a left null vector, a motion with tangent N w needs
    Q_u(w, w) = wᵀ Nᵀ (uᵀ φ'') N w = 0. One rank-2 indefinite form factors into two hyperplanes, the
    tangent spaces of the two modes that meet; a definite one leaves an isolated point; others are
    not decided at second order. Several singular loops are taken apart where the span of their forms has a
    basis of rank-2 forms, else their common zeros are found together; so the answer does not depend on the
    tree, the cuts or the order of rows.

    Parameters
    ----------
    mechanism : Mechanism or ClosedLoops
    q : array_like (nq,)
        Must close the loops.
    rank_tolerance : float
        Relative size below which a singular value of K counts as zero.

    Raises
    ------
    ClosureError
        When the loops are open at q.

    References
    ----------
    Müller, "Local kinematic analysis of closed-loop linkages", J. Mechanisms Robotics 8 (2016).
    """
    check_mechanism(mechanism, ClosedLoops, "analyse")
    check_between("rank_tolerance", rank_tolerance, 0.0, 1.0)
    q = mechanism.configuration(q)
    mechanism.require_closed(q, NEARLY_CLOSED, "analyse: q")
    found = _to_second_order(mechanism, q, rank_tolerance)
    if found.kind == "not certified":
        return found if (met := contact_at(mechanism, q)) is None else _told(found, met)
    pairs = combinations(range(len(found.modes)), 2) if found.kind == "singular" else ()
    return replace(found, contacts=tuple((i, j, 1) for i, j in pairs))


def _to_second_order(mechanism: ClosedLoops, q: Array, rank_tolerance: float) -> LocalAnalysis:
    """The picture that rank and second-order forms give."""
    K = mechanism.scaled(mechanism.K(q))
    U, s, Vt = np.linalg.svd(K)
    rank = numerical_rank(s, rank_tolerance)
    scaled_kernel = Vt[rank:].T
    kernel = np.linalg.qr(mechanism.column_scale[:, None] * scaled_kernel)[0]
    left = U[:, rank:]

    def answer(
        kind: Kind, generic: int, modes: tuple[Array, ...], message: str, forms: tuple[Array, ...] = ()
    ) -> LocalAnalysis:
        unscaled_left = np.linalg.qr(left / mechanism.row_scale[:, None])[0]
        return LocalAnalysis(q, kind, rank, generic, s, kernel, unscaled_left, forms, modes, message)

    if rank == len(K) or kernel.shape[1] == 0:
        tangent = (_direction(kernel),) if kernel.shape[1] else ()
        return answer("regular", rank, tangent, f"K has full rank {rank}: one smooth mode")
    size = FORM * curvature(mechanism, q)
    # seen along single directions first: all forms of 40 flat loops would cost more than the answer is worth
    most = int(np.log2(MAX_COMBINATIONS))
    if left.shape[1] > most and bending_along(mechanism, q, left, kernel, most + 1, size) > most:
        words = f"more than {most} loops are singular at once: too many combinations of modes to list"
        return answer("not certified", rank + most + 1, (), words)
    forms = second_order_forms(mechanism, q, left, kernel)
    bent, flat = bending(forms, size)
    if bent.shape[1] == 0:
        generic = rank_along(mechanism, q, kernel)
        if generic == rank:
            words = f"K keeps rank {rank} of {len(K)} rows nearby: redundant closures, one smooth mode"
            return answer("redundant", rank, (_direction(kernel),), words)
        words = (
            f"rank {rank} against {generic} nearby, and the second-order forms vanish: "
            "a tangential or higher-order singularity"
        )
        return answer("not certified", generic, (), words, tuple(forms))
    forms = list(np.einsum("uc,uij->cij", bent, np.array(forms)))
    generic = rank + len(forms)
    decoupled = rank_two_forms(forms)
    forms = forms if decoupled is None else decoupled
    if decoupled or len(forms) == 1:
        moves = partial(_seen_to_move, mechanism, q, kernel, rank)
        kind, modes, words = _factored(forms, kernel, moves)
    else:
        kind, modes, words = _coupled(forms, kernel)
    if modes:
        modes = in_order(modes, mechanism.column_scale)
        # of the smallest mode: on larger ones rows are redundant
        generic = rank + kernel.shape[1] - min(_dimension(mode) for mode in modes)
    if modes and flat.shape[1]:
        # what second order leaves flat must be redundant along every mode
        nearby = max(rank_along(mechanism, q, t.reshape(len(kernel), -1)) for t in modes)
        if nearby > generic:
            words = f"rank {nearby} nearby, of which second order explains {generic} only"
            return answer("not certified", nearby, (), words, tuple(forms))
    if modes and kind == "singular":
        sizes = " and ".join(str(m) for m in sorted({_dimension(mode) for mode in modes}))
        words = f"rank {rank} against {generic} nearby: {len(modes)} modes of dimension {sizes} meet here"
    return answer(kind, generic if modes else rank + len(forms), modes, words, tuple(forms))


def _factored(
    forms: list[Array], kernel: Array, moves: Callable[[Array, int], bool]
) -> tuple[Kind, tuple[Array, ...], str]:
    """Factor each form into two hyperplanes and combine them into modes.

    Where hyperplanes of several forms coincide, or the two of one form, loops ask for one thing twice, and
    second order does not say whether there is a motion: `moves` (basis, conditions) looks.
    """
    planes: list[list[Array]] = []
    for form in forms:
        values, vectors = np.linalg.eigh(form)
        size = np.abs(values).max()
        active = np.flatnonzero(np.abs(values) > FORM * size)
        signs = np.sign(values[active])
        # only on all of the kernel: what a definite form leaves flat may still move
        if len(active) == kernel.shape[1] and abs(int(signs.sum())) == len(active):
            return "isolated", (), "the second-order form is definite: an isolated point"
        if len(active) == 1 and len(forms) > 1:  # a square, which forms of other trees or cuts hide in a sum
            planes.append([vectors[:, active[0]]])
            continue
        if len(active) != 2 or signs.sum() != 0:
            return (
                "not certified",
                (),
                f"a second-order form has signature {int((signs > 0).sum())}, {int((signs < 0).sum())} "
                f"on {kernel.shape[1]} directions: tangential or higher order, not two crossing modes",
            )
        (low, high), v = values[active], vectors[:, active]
        a, b = np.sqrt(-low) * v[:, 0], np.sqrt(high) * v[:, 1]  # Q = bᵀb − aᵀa = (b + a)(b − a)
        planes.append([a + b, a - b])
    squares = any(len(pair) == 1 for pair in planes)
    spaces: list[tuple[Array, int]] = []
    for combination in product(*planes):
        normals = np.array(combination)
        _, sigma, Vt = np.linalg.svd(normals)
        conditions = numerical_rank(sigma, FORM)  # hyperplanes of several loops may coincide
        if kernel.shape[1] > conditions:
            T = Vt[conditions:].T
            # a double zero, as beside modes that touch, comes from the eigenvectors to √ε alone
            spaces.append((polished(forms, T[:, 0])[:, None] if T.shape[1] == 1 else T, conditions))
    # the larger ones first: one that lies in another, or is known, is no mode of its own
    modes: list[Array] = []
    kept: list[Array] = []
    undecided = False
    for T, conditions in sorted(spaces, key=lambda space: space[1]):
        if any(np.linalg.norm(T - known @ (known.T @ T), 2) < 1e-6 for known in kept):
            continue
        kept.append(T)
        if (conditions == len(forms) and not squares) or moves(T, conditions):
            modes.append(_direction(kernel @ T))
        else:
            undecided = True
    if undecided:
        words = "the loops' second-order conditions are not independent: not decided at second order"
        return "not certified", tuple(modes), words
    return ("singular" if modes else "isolated"), tuple(modes), NOTHING


def _told(undecided: LocalAnalysis, met: Contact) -> LocalAnalysis:
    """The picture where modes touch."""
    found, rank = met.found, undecided.rank
    kind, words, count = met.words(rank)
    tangent = _direction(met.tangents(undecided.kernel))
    contacts = ((0, 1, found.order),) if count == 2 else ()
    generic = undecided.generic_rank if kind == "not certified" else rank + (kind != "inside")
    return replace(
        undecided, kind=kind, modes=(tangent,) * count, contacts=contacts, generic_rank=generic, message=words
    )


def _seen_to_move(
    mechanism: ClosedLoops, q: Array, kernel: Array, rank: int, T: Array, conditions: int
) -> bool:
    """Whether the loops close a little way along each column of N T, forth and back, with rank above K's."""
    ways, expected = kernel @ T, rank + conditions
    both = np.hstack([ways, -ways])
    return all(rank_along(mechanism, q, way[:, None]) == expected for way in both.T)


def _dimension(mode: Array) -> int:
    return 1 if mode.ndim == 1 else mode.shape[1]


def _coupled(forms: list[Array], kernel: Array) -> tuple[Kind, tuple[Array, ...], str]:
    """The modes of forms that do not come apart into one form of rank two for each loop."""
    found, more = linear_modes(forms)
    modes = [_direction(kernel @ T) for T in found]
    if more or (not modes and not is_definite(forms)):
        words = "second order leaves directions of motion undecided" + (
            f" besides the {len(modes)} modes that it certifies" if modes else ""
        )
        return "not certified", tuple(modes), words
    return ("singular" if modes else "isolated"), tuple(modes), NOTHING


def _direction(basis: Array) -> Array:
    """A mode's tangent as reported: a normalised direction for one column, else an orthonormal basis."""
    if basis.shape[1] != 1:
        return np.asarray(np.linalg.qr(basis)[0])
    t = basis[:, 0] / np.abs(basis[:, 0]).max()
    t[np.abs(t) < 1e-12] = 0.0  # else the sign would hang on the rounding of a joint at rest
    first = t[np.flatnonzero(t)[0]]
    return np.asarray(t * np.sign(first) + 0.0, dtype=float)
