// A point of a cluster's mode in a chart: x, its derivatives, and how near K is to singular; see
// maps/cluster/jet.py, whose docstrings say why.
#pragma once

#include <algorithm>
#include <complex>
#include <memory>
#include <utility>
#include <vector>

#include "dense.h"
#include "space.h"

namespace rg {

constexpr double FILTER = 0.6;

struct Jet;
using JetPtr = std::shared_ptr<const Jet>;

struct Distance {
    double size = FAR;
    Vector way;
};

struct Jet {
    Space* space = nullptr;
    Vector x;
    Chart C;
    Matrix J;                          // (nv, m)
    Matrix bend;                       // (nv, m²): Γ_ij in column i m + j
    std::shared_ptr<const Matrix> P;   // (nd, rows)
    double sigma = 0.0;
    bool solved = false;               // the rest is there only where it was solved for
    double smallest = 0.0;             // σ of rank nd
    Vector u;                          // its left vector
    Matrix V;                          // (nv, m + 1): its right vector, and the null vectors of K
    Matrix W;                          // (nv, nd): P K W = 1, Cᵀ W = 0
    std::vector<Matrix> rate;          // (nd, nv) each: P φ''[J_i, ·]

    Vector y() const { return C->transpose() * x; }

    Vector predicted(const Vector& step) const { return x + J * step + 0.5 * bent(step, step); }

    // Γ[a, b].
    Vector bent(const Vector& a, const Vector& b) const {
        Vector sum = Vector::Zero(x.size());
        const auto m = J.cols();
        for (Eigen::Index i = 0; i < m; ++i)
            for (Eigen::Index j = 0; j < m; ++j) sum += (a[i] * b[j]) * bend.col(i * m + j);
        return sum;
    }

    // Orthonormal basis of the tangent space, (nv, m).
    Matrix tangent() const {
        return orthonormal(J);
    }

    // First-order places μ along the chart direction d where det(B + μ B') = 0.
    Roots roots(const Vector& d) const {
        Matrix turned = Matrix::Zero(space->nd, space->nv);
        for (Eigen::Index i = 0; i < d.size(); ++i) turned += d[i] * rate[static_cast<std::size_t>(i)];
        return reciprocal(eigenvalues(-times(turned, W)), 0.0, 1e-3);
    }

    // First-order distance along the mode to the singular set, and the way in the chart.
    const Distance& nearest() const {
        if (!known_nearest_) nearest_ = find_nearest(), known_nearest_ = true;
        return nearest_;
    }

    // First-order distance to where K loses rank on or off the mode.
    double ambient() const {
        if (!known_ambient_) ambient_ = find_ambient(), known_ambient_ = true;
        return ambient_;
    }

    double delta() const { return regular() ? FAR : std::min(nearest().size, ambient()); }

  private:
    bool regular() const { return !solved || space->nd == 0 || sigma > FILTER; }

    Distance find_nearest() const {
        Distance found;
        found.way = Vector::Ones(space->m);
        if (regular()) return found;
        if (space->m == 1) {  // by arc length: where y turns back the mode is not singular
            const double pace = J.norm();
            const Vector t = J.col(0) / pace;
            const Matrix across = W - t * (t.transpose() * W);
            const Roots mu = reciprocal(eigenvalues(-times(rate[0], across) / pace), 0.0, 1e-3);
            if (!mu.empty()) found.size = std::abs(nearest_of(mu));
            return found;
        }
        Matrix rates;
        space->second(x, V.col(0), rates);
        const Vector gradient = J.transpose() * (rates.transpose() * u);
        const Vector way = solution(transposed_times(J, J), gradient);
        const double pace = std::sqrt(std::max(gradient.dot(way), 0.0));
        if (pace > 0.0) found.size = smallest / pace, found.way = way / pace;
        return found;
    }

    double find_ambient() const {
        if (!solved || space->nd == 0) return FAR;
        Matrix rows(V.cols(), space->nv), rates;
        for (Eigen::Index i = 0; i < V.cols(); ++i) {
            space->second(x, V.col(i), rates);
            rows.row(i) = u.transpose() * rates;
        }
        Vector target = Vector::Zero(V.cols());
        target[0] = -smallest;
        return least_squares(rows, target, 1e-8).norm();
    }

    mutable bool known_nearest_ = false, known_ambient_ = false;
    mutable Distance nearest_;
    mutable double ambient_ = FAR;
};

// The same point in another chart: W = (C'ᵀ J)⁻¹, J W, W·W·Γ − J W (C'ᵀ W·W·Γ).
inline JetPtr recharted(const JetPtr& jet, const Chart& C) {
    if (C == jet->C) return jet;
    const auto m = jet->J.cols();
    const Matrix W = inverse(transposed_times(*C, jet->J));
    auto made = std::make_shared<Jet>();
    made->space = jet->space, made->x = jet->x, made->C = C, made->P = jet->P, made->sigma = jet->sigma;
    made->solved = jet->solved, made->smallest = jet->smallest, made->u = jet->u, made->V = jet->V;
    made->J = times(jet->J, W);
    made->bend.resize(jet->x.size(), m * m);
    for (Eigen::Index i = 0; i < m; ++i)
        for (Eigen::Index j = 0; j < m; ++j) made->bend.col(i * m + j) = jet->bent(W.col(i), W.col(j));
    made->bend -= times(made->J, transposed_times(*C, made->bend));
    if (jet->solved) {
        made->W = jet->W - times(made->J, transposed_times(*C, jet->W));
        for (Eigen::Index i = 0; i < m; ++i) {
            Matrix rate = Matrix::Zero(jet->W.cols(), jet->x.size());
            for (Eigen::Index j = 0; j < m; ++j) rate += W(j, i) * jet->rate[static_cast<std::size_t>(j)];
            made->rate.push_back(rate);
        }
    }
    return made;
}

// The jet at a closed x where K is regular: B = [P K; Cᵀ], J = B⁻¹ [0; I], Γ = −B⁻¹ [P φ''[J, J]; 0].
inline JetPtr jet_at(Space& space, const Vector& x, const Chart& C) {
    const int nd = space.nd, m = space.m, nv = space.nv;
    auto made = std::make_shared<Jet>();
    made->space = &space, made->x = x, made->C = C, made->solved = true;
    Vector phi;
    Matrix K;
    space.linear(x, phi, K);
    const Svd svd(Matrix(K * space.balance.asDiagonal()));
    made->P = std::make_shared<Matrix>(svd.U.leftCols(nd).transpose());
    Matrix B(nv, nv);
    B.topRows(nd) = svd.s.head(nd).asDiagonal() * svd.V.leftCols(nd).transpose();
    B.bottomRows(m) = C->transpose() * space.balance.asDiagonal();
    const Matrix undone = space.balance.asDiagonal() * inverse(B);
    if (!undone.allFinite()) throw Lost{};
    made->J = undone.rightCols(m);
    made->W = undone.leftCols(nd);
    Matrix bend(nv, m * m), rates;
    for (int i = 0; i < m; ++i) {
        space.second(x, made->J.col(i), rates);
        made->rate.push_back(times(*made->P, rates));
        bend.middleCols(i * m, m) = -times(made->W, times(made->rate.back(), made->J));
    }
    made->bend.resize(nv, m * m);
    for (int i = 0; i < m; ++i)
        for (int j = 0; j < m; ++j)
            made->bend.col(i * m + j) = 0.5 * (bend.col(i * m + j) + bend.col(j * m + i));
    made->sigma = FAR;
    if (nd > 0) {
        made->sigma = made->smallest = svd.s[nd - 1];
        made->u = svd.U.col(nd - 1);
        made->V = space.balance.asDiagonal() * svd.V.rightCols(m + 1);
    }
    return made;
}

// Newton on P φ = 0, Cᵀ x = y from the guess x (overwritten); returns the size of the first correction.
inline double solve(Space& space, Vector& x, const Matrix& C, const Vector& y, const Matrix& P) {
    constexpr double CONVERGED = 3e-15, STAGNANT = 1e-11;
    constexpr int MAX_NEWTON = 12;
    const int nd = space.nd, nv = space.nv;
    double first = FAR, last = FAR, size = FAR;
    Vector phi, right(nv);
    Matrix K, B(nv, nv);
    for (int iteration = 0; iteration < MAX_NEWTON; ++iteration) {
        space.linear(x, phi, K);
        B.topRows(nd) = times(P, K);
        B.bottomRows(space.m) = C.transpose();
        right.head(nd) = P * phi;
        right.tail(space.m) = C.transpose() * x - y;
        const Vector dx = solution(B, right);
        x -= dx;
        size = dx.cwiseQuotient(space.balance).cwiseAbs().maxCoeff();  // rounding of φ turns short links far
        if (!(size < 1e3) || !dx.allFinite()) throw Lost{};
        if (iteration == 0) first = dx.cwiseAbs().maxCoeff();
        if (size < CONVERGED || (size < STAGNANT && size > 0.3 * last)) return first;
        last = size;
    }
    if (size < 1e-9) return first;
    throw Lost{};
}

// `solve` and the jet there.
inline std::pair<JetPtr, double> solved(Space& space, Vector guess, const Chart& C, const Vector& y,
                                        const Matrix& P) {
    const double first = solve(space, guess, *C, y, P);
    return {jet_at(space, guess, C), first};
}

}  // namespace rg
