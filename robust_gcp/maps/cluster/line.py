"""One line across a singular surface: a mode's jets at its nodes, and Hermite's polynomials between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...mechanism.tree.tree import Array
from .interpolation import NewtonForm
from .jet import Jet
from .space import ClusterSpace


def jet_on_line(
    space: ClusterSpace, C: Array, d: Array, ss: Sequence[float] | Array, nodes: Sequence[Jet], s: float
) -> Jet:
    """The point at s on a line along d (m,) in the chart C (nv, m), from nodes at ss.

    x by Hermite in (x, J d, Γ[d, d]), J in (J, Γ[d, ·]), Γ by values, its parts along d from these.
    """
    m, nv = space.m, space.nv
    places = np.asarray(ss)
    order = np.argsort(places)
    center, half = float(places.mean()), float(np.ptp(places)) / 2.0 or 1.0
    at, z = (places[order] - center) / half, np.array([(s - center) / half])
    sorted_nodes = [nodes[i] for i in order]
    along = [np.einsum("i,ijn->jn", d, node.bend) for node in sorted_nodes]  # Γ[d, ·], (m, nv)
    x_data = [
        [n.x, (n.J @ d) * half, (d @ row) * half**2] for n, row in zip(sorted_nodes, along, strict=True)
    ]
    J_data = [[n.J.T.ravel(), row.ravel() * half] for n, row in zip(sorted_nodes, along, strict=True)]
    bends = [[n.bend.ravel()] for n in sorted_nodes]
    x_form, J_form, bend_form = (NewtonForm(at, np.array(data))(z) for data in (x_data, J_data, bends))
    J = J_form[0][0].reshape(m, nv).T
    rate = J_form[1][0].reshape(m, nv) / half
    bend = bend_form[0][0].reshape(m, m, nv)
    # in a basis whose first direction is d, the parts along d are derivatives of what is known better
    basis = np.linalg.qr(np.column_stack([d, np.eye(m)]))[0]
    length = float(basis[:, 0] @ d)
    turned = np.einsum("ia,jb,ijn->abn", basis, basis, bend)
    row = (basis.T @ rate) / length
    row[0] = x_form[2][0] / (half * length) ** 2
    turned[0] = row
    turned[:, 0] = row
    bend = np.einsum("ia,jb,abn->ijn", basis, basis, turned)
    best = max(sorted_nodes, key=lambda node: node.sigma)  # its rows are told best; K at s may have lost rank
    return Jet(space, x_form[0][0], C, J, bend, best.P)
