// What is singular near a point of a mode: places on a pencil, how clearly modes part, the place itself; see
// maps/cluster/jet.py and singular_place.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include "linalg/dense.h"
#include "cluster/jet.h"

namespace rg {

// Cᵀ with its columns balanced as those of K, and rows of size one at most.
inline Matrix chart_rows(const Space& space, const Matrix& C) {
    Matrix rows = C.transpose() * space.balance.asDiagonal();
    for (Eigen::Index i = 0; i < rows.rows(); ++i) rows.row(i) /= std::max(1.0, rows.row(i).norm());
    return rows;
}

// Places μ along `way` (dx/ds) from x where [P K; Cᵀ] loses rank. The pencil is shifted by a distance of about
// `far` in x, where it is regular: B itself is singular at the places that are looked for.
inline Roots pencil_roots(Space& space, const Matrix& P, const Vector& x, const Vector& way, const Matrix& C,
                          double far) {
    const int nd = space.nd, nv = space.nv;
    Vector phi;
    Matrix K, rates;
    space.linear(x, phi, K);
    space.second(x, way, rates);
    const auto balance = space.balance.asDiagonal();
    const Matrix closed = times(P, K) * balance, turned = times(P, rates) * balance;
    Matrix B(nv, nv);
    B.bottomRows(space.m) = chart_rows(space, C);
    const double scale = far / way.norm();
    double best = -1.0, shift = 0.0;
    Matrix W;
    for (const double share : {0.5, -0.37}) {
        B.topRows(nd) = closed + share * scale * turned;
        double pivots = 0.0;
        const Matrix undone = inverse(B, &pivots);
        if (!(pivots > best)) continue;
        best = pivots, shift = share * scale;
        W = undone.leftCols(nd);
        if (pivots > 1e-2) break;
    }
    if (!(best > 0.0) || !W.allFinite()) throw Lost{};
    return reciprocal(eigenvalues(-times(turned, W)), shift, 1e-9);
}

// Whether K itself loses rank at x: combinations P of redundant rows may do so where K does not.
inline bool is_singular(Space& space, const Vector& x) {
    constexpr double SINGULAR = 1e-9;  // σ of K · balance
    if (space.rows == space.nd) return true;
    Vector phi;
    Matrix K;
    space.linear(x, phi, K);
    return Svd(Matrix(K * space.balance.asDiagonal())).s[space.nd - 1] < SINGULAR;
}

// Corank of [P K; Cᵀ] at x, and the transversality of the mode with tangent `way` there.
inline std::pair<int, double> null_pairing(Space& space, const Matrix& P, const Vector& x, const Vector& way,
                                           const Matrix& C) {
    const int nd = space.nd, nv = space.nv;
    Vector phi;
    Matrix K, rates;
    space.linear(x, phi, K);
    Matrix B(nv, nv);
    B.topRows(nd) = times(P, K) * space.balance.asDiagonal();
    B.bottomRows(space.m) = chart_rows(space, C);
    const Svd svd(B);
    int r = 0;
    for (int i = 0; i < nv; ++i) r += svd.s[i] < 1e-6;
    if (r == 0) return {0, 1.0};
    space.second(x, way, rates);
    Matrix turned = Matrix::Zero(nv, nv);
    turned.topRows(nd) = times(P, rates) * space.balance.asDiagonal();
    const Matrix pairing = transposed_times(svd.U.rightCols(r), times(turned, svd.V.rightCols(r)));
    const double smallest = r == 1 ? std::fabs(pairing(0, 0)) : Svd(pairing).s[r - 1];
    return {r, smallest / (space.phi_size * way.norm())};
}

// The nearest configuration at which K loses rank, on the mode or beside it; see maps/cluster/singular_place.py.
struct Place {
    Vector x;
    double gap = 0.0;        // |uᵀ φ| there, in lengths
    Vector values;           // |eigenvalues| of Q = Nᵀ (uᵀ φ'') N, largest first
    double correction = FAR;  // Newton's last step

    bool found() const { return correction < 1e-9; }
    // Whether Q bends in three directions or more: modes do not cross there, they meet in a point.
    bool cone() const { return found() && values.size() > 2 && values[2] > 0.02 * values[0]; }
    // Closest approach of modes that veer.
    double approach() const { return std::sqrt(2.0 * gap / std::max(values[0], 1e-300)); }
};

// Newton from a solved point on U₁ᵀ φ = 0 and uᵀ K N = 0.
inline Place place(const Jet& here) {
    Space& space = *here.space;
    const int nd = space.nd, m = space.m, nv = space.nv;
    Place found;
    found.x = here.x;
    Vector phi;
    Matrix K, rates, N, rows(nd + m, nv);
    for (int iteration = 0; iteration < 15; ++iteration) {
        space.linear(found.x, phi, K);
        const Svd svd(K);
        const Vector u = svd.U.col(nd - 1);
        N = svd.V.rightCols(m + 1);
        for (int i = 0; i <= m; ++i) {
            space.second(found.x, N.col(i), rates);
            rows.row(nd - 1 + i) = u.transpose() * rates;
        }
        rows.topRows(nd - 1) = svd.s.head(nd - 1).asDiagonal() * svd.V.leftCols(nd - 1).transpose();
        Vector residual(nd + m);
        residual.head(nd - 1) = svd.U.leftCols(nd - 1).transpose() * phi;
        residual.tail(m + 1) = N.transpose() * (K.transpose() * u);
        rows = rows * space.balance.asDiagonal();
        for (int i = 0; i < nd + m; ++i) {  // some are small between links of very different lengths
            const double largest = rows.row(i).cwiseAbs().maxCoeff();
            if (largest > 1e-12) rows.row(i) /= largest, residual[i] /= largest;
        }
        const Vector dx = -space.balance.cwiseProduct(least_squares(rows, residual, 1e-6));
        const double size = dx.norm(), before = std::exchange(found.correction, size);
        found.x += dx * std::min(1.0, size > 0.0 ? 0.5 / size : 1.0);
        if (size < 1e-14 || (found.found() && size > 0.1 * before)) break;  // the rest is rounding
    }
    space.linear(found.x, phi, K);
    const Svd svd(K);
    const Vector u = svd.U.col(nd - 1);
    N = svd.V.rightCols(m + 1);
    Matrix Q(m + 1, m + 1);
    for (int i = 0; i <= m; ++i) {
        space.second(found.x, N.col(i), rates);
        Q.row(i) = (N.transpose() * (rates.transpose() * u)).transpose();
    }
    found.values = Svd(0.5 * (Q + Q.transpose())).s;
    found.gap = std::fabs(u.dot(phi));
    return found;
}

}  // namespace rg
