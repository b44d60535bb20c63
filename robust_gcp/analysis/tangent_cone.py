"""The tangent cone from second-order forms alone: rank-two forms in their span, linear spaces of zeros.

Rows of φ may be mixed, loops cut elsewhere, joints described otherwise: the span of the forms on ker K stays
the same. So nothing here asks which closure a form came from.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cmp_to_key

import numpy as np

from ..mechanism.tolerances import FORM
from ..mechanism.tree.tree import Array

TRANSVERSAL = 1e-4
"""Smallest singular value of the stacked Q_k(w, ·), relative to the forms, of a certified mode."""

SAME = 1e-6
"""Difference of shares of a motion, or of tangents, that does not count."""

TRIES = 60
"""Random starts at least, and for each thing found so far a fifth of them more, before a search ends."""


def rank_two_forms(forms: Sequence[Array]) -> list[Array] | None:
    """A basis of the forms' span made of forms of rank two, one for each loop; None where there is none.

    Gauss–Newton on the n − 2 small eigenvalues of Σ c_k Q_k from many starts c.
    """
    r, n = len(forms), len(forms[0])
    basis = _orthonormal(forms)
    if n < 3:  # all forms are of rank two at most
        return list(basis)
    rng = np.random.default_rng(5)  # always the same: so must be the answer
    found: list[Array] = []
    tries = 0
    while tries < TRIES * (1 + len(found)):
        tries += 1
        c = _refined(basis, rng.normal(size=r))
        if c is None or any(abs(abs(float(c @ known)) - 1.0) < 1e-6 for known in found):
            continue
        found.append(c)
        if len(found) == r:
            s = np.linalg.svd(np.array(found), compute_uv=False)
            return [np.einsum("k,kij->ij", c, basis) for c in found] if s[-1] > 1e-4 else None
    return None


def _refined(basis: Array, c: Array) -> Array | None:
    """The coefficients of a rank-two form near c, (r,), of unit length."""
    c, last = c / np.linalg.norm(c), np.inf
    for _ in range(30):
        values, vectors = np.linalg.eigh(np.einsum("k,kij->ij", c, basis))
        small = np.argsort(np.abs(values))[:-2]
        size = float(np.abs(values).max())
        left = float(np.abs(values[small]).max())
        if left < 1e-15 * size or (left < 1e-12 * size and left > 0.5 * last):
            return np.asarray(c)
        last = left
        V = vectors[:, small]
        rows = np.array([(V.T @ Q @ V)[np.triu_indices(len(small))] for Q in basis]).T
        # to first order small eigenvalues change with the form on their own eigenvectors, Vᵀ δQ V
        target = -rows @ c
        system = np.vstack([rows, c])  # steps across c alone
        step = np.linalg.lstsq(system, np.append(target, 0.0), rcond=1e-12)[0]
        c = c + step * min(1.0, 0.5 / max(float(np.linalg.norm(step)), 1e-300))
        c = c / np.linalg.norm(c)
    return None


def linear_modes(forms: Sequence[Array]) -> tuple[list[Array], bool]:
    """Linear spaces of dimension n − r on which all forms vanish, transversally; and whether there is more.

    Newton finds directions w with Q_k(w, w) = 0; the tangent space there, ker Q_k(w, ·), is a mode if the
    forms vanish on all of it.

    Returns
    -------
    list of ndarray (n, n − r)
        Orthonormal bases.
    bool
        Whether directions were found that are not transversal, or whose cone is curved.
    """
    basis = _orthonormal(forms)
    r, n = len(basis), basis.shape[1]
    m = n - r
    rng = np.random.default_rng(6)
    found: list[Array] = []
    more = False
    tries = 0
    while tries < TRIES * (2 + len(found)) and len(found) < 2**r:  # Bézout: r quadrics have no more
        tries += 1
        w = _zero(basis, np.asarray(rng.normal(size=n)))
        if w is None:
            continue
        normals = np.einsum("kij,j->ki", basis, w)
        _, s, Vt = np.linalg.svd(normals)
        if s[-1] < TRANSVERSAL or m < 1:  # the cone is no smooth space at w: a double zero
            more = True
            continue
        T = Vt[r:].T
        if np.abs(np.einsum("kij,ia,jb->kab", basis, T, T)).max() > FORM:  # w is a zero, its tangents are not
            more = True
            continue
        if not any(np.linalg.norm(T - known @ (known.T @ T), 2) < 1e-6 for known in found):
            found.append(T)
    return found, more


def in_order(modes: Sequence[Array], scale: Array) -> tuple[Array, ...]:
    """The modes as they are numbered, by what they are and not by how a decomposition came to them.

    Those of more freedoms come first; then those in which the first joint has the larger share of the
    motion, or the second one where these are equal, and so on; then by the signs with which joints move.

    Parameters
    ----------
    modes : sequence of ndarray (nv,) or (nv, m)
    scale : ndarray (nv,)
        Velocities of unit size.
    """

    def told(mode: Array) -> Array:
        Q = np.linalg.qr(mode.reshape(len(scale), -1) / scale[:, None])[0]
        P = Q @ Q.T  # the same in any basis
        return np.concatenate([[-Q.shape[1]], -np.diag(P), P.ravel()])

    def compared(one: tuple[Array, Array], other: tuple[Array, Array]) -> int:
        apart = one[0] - other[0]
        return int(np.sign(apart[np.argmax(np.abs(apart) > SAME)]))

    pairs = sorted(((told(mode), mode) for mode in modes), key=cmp_to_key(compared))
    return tuple(mode for _, mode in pairs)


def is_definite(forms: Sequence[Array]) -> bool:
    """Whether a combination of the forms is definite: then no direction passes second order."""
    basis = _orthonormal(forms)
    rng = np.random.default_rng(8)
    for c in rng.normal(size=(20, len(basis))):
        c = c / np.linalg.norm(c)
        for k in range(200):
            values, vectors = np.linalg.eigh(np.einsum("k,kij->ij", c, basis))
            if values[0] > FORM:
                return True
            v = vectors[:, 0]
            c = c + 0.5 / (1.0 + 0.05 * k) * np.einsum("kij,i,j->k", basis, v, v)  # subgradient of λ_min
            c = c / np.linalg.norm(c)
    return False


def _zero(basis: Array, w: Array) -> Array | None:
    """A direction on which all forms vanish, by Newton of least norm from w."""
    w = w / np.linalg.norm(w)
    for _ in range(60):
        values = np.einsum("kij,i,j->k", basis, w, w)
        if np.abs(values).max() < 1e-14:
            return np.asarray(w)
        slopes = 2.0 * np.einsum("kij,j->ki", basis, w)
        w = w - np.linalg.lstsq(slopes, values, rcond=1e-10)[0]
        w = w / np.linalg.norm(w)
    return None


def _orthonormal(forms: Sequence[Array]) -> Array:
    """An orthonormal basis of the span, (r, n, n)."""
    n = len(forms[0])
    _, s, Vt = np.linalg.svd(np.array([form.ravel() for form in forms]), full_matrices=False)
    return np.asarray(Vt[s > 1e-12 * s[0]].reshape(-1, n, n))


def polished(forms: Sequence[Array], w: Array) -> Array:
    """A common zero w (n,) of the forms, found to √ε where it is a double one, to rounding.

    Where the forms touch, a combination has w in its kernel: Gauss–Newton on Q_k(w, w) = 0 together with
    Σ c_k Q_k w = 0, which is regular there.
    """
    basis = _orthonormal(forms)
    w = w / np.linalg.norm(w)
    normals = np.einsum("kij,j->ki", basis, w)
    _, s, combinations = np.linalg.svd(normals.T)
    if s[len(basis) - 1] > TRANSVERSAL:
        return np.asarray(w)
    c = combinations[-1]
    for _ in range(8):
        slopes = np.einsum("kij,j->ki", basis, w)
        combined = np.einsum("k,kij->ij", c, basis)
        residual = np.concatenate([slopes @ w, combined @ w])
        rows = np.vstack(
            [
                np.hstack([2.0 * slopes, np.zeros((len(c), len(c)))]),
                np.hstack([combined, slopes.T]),
                np.concatenate([w, np.zeros(len(c))]),
                np.concatenate([np.zeros(len(w)), c]),
            ]
        )
        step = np.linalg.lstsq(rows, -np.append(residual, [0.0, 0.0]), rcond=1e-6)[0]
        w, c = w + step[: len(w)], c + step[len(w) :]
        w, c = w / np.linalg.norm(w), c / np.linalg.norm(c)
    return np.asarray(w)
