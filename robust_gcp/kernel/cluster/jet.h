// A point of a cluster's mode in a chart: x, its derivatives, and how near K is to singular; see
// maps/cluster/jet.py, whose docstrings say why.
#pragma once

#include <algorithm>
#include <complex>
#include <memory>
#include <utility>
#include <vector>

#include "linalg/dense.h"
#include "cluster/space.h"

namespace rg {

constexpr double FILTER = 0.6;

// P times rows of φ; the rows themselves where none are left over, as any P serves there.
inline Matrix determining(const Space& space, const Matrix& P, const Matrix& rows) {
    return space.rows == space.nd ? rows : times(P, rows);
}

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
    double given = 0.0;                // σ where it was not solved for
    bool solved = false;               // the rest is there only where it was solved for
    Matrix closed;                     // (nd, nv): `determining` K, balanced
    std::vector<Matrix> rate;          // (nd, nv) each: the same of φ''[J_i, ·]

    // The smallest of the nd leading singular values of K, balanced.
    double sigma() const { return !solved ? given : space->nd == 0 ? FAR : smallest().sigma; }

    Vector y() const { return C->transpose() * x; }

    Vector predicted(const Vector& step) const {
        Vector found = x;
        found.noalias() += J.lazyProduct(step);
        add_bent(found, 0.5, step, step);
        return found;
    }

    // Γ[a, b].
    Vector bent(const Vector& a, const Vector& b) const {
        Vector sum = Vector::Zero(x.size());
        add_bent(sum, 1.0, a, b);
        return sum;
    }

    void add_bent(Vector& sum, double share, const Vector& a, const Vector& b) const {
        const auto m = J.cols();
        for (Eigen::Index i = 0; i < m; ++i)
            for (Eigen::Index j = 0; j < m; ++j) sum += (share * a[i] * b[j]) * bend.col(i * m + j);
    }

    // Orthonormal basis of the tangent space, (nv, m).
    Matrix tangent() const {
        return orthonormal(J);
    }

    // P K W = 1, Cᵀ W = 0, (nv, nd).
    const Matrix& W() const {
        if (W_.size() == 0) {
            Matrix B(space->nv, space->nv);
            B.topRows(space->nd) = closed;
            B.bottomRows(space->m) = C->transpose() * space->balance.asDiagonal();
            W_ = space->balance.asDiagonal() * inverse(B).leftCols(space->nd);
        }
        return W_;
    }

    // First-order places μ along the chart direction d where det(B + μ B') = 0.
    Roots roots(const Vector& d) const {
        Matrix turned = Matrix::Zero(space->nd, space->nv);
        for (Eigen::Index i = 0; i < d.size(); ++i) turned += d[i] * rate[static_cast<std::size_t>(i)];
        return reciprocal(eigenvalues(-times(turned, W())), 0.0, 1e-3);
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
    bool regular() const { return !solved || space->nd == 0 || sigma() > FILTER; }

    // The smallest singular value of K, with its vectors: Pᵀ u on the left, or u where no rows are left over; v on
    // the right.
    struct Smallest {
        double sigma = 0.0;
        Vector u, v;
    };

    const Smallest& smallest() const {
        if (smallest_.u.size() == 0) {
            smallest_.u = left_vectors(closed).rightCols(1);
            const Vector row = closed.transpose() * smallest_.u;
            smallest_.sigma = row.norm();
            smallest_.v = space->balance.cwiseProduct(row) / smallest_.sigma;
        }
        return smallest_;
    }


    Distance find_nearest() const {
        Distance found;
        found.way = Vector::Ones(space->m);
        if (regular()) return found;
        if (space->m == 1) {  // by arc length: where y turns back the mode is not singular
            const double pace = J.norm();
            const Vector t = J.col(0) / pace;
            const Matrix across = W() - t * (t.transpose() * W());
            const Roots mu = reciprocal(eigenvalues(-times(rate[0], across) / pace), 0.0, 1e-3);
            if (!mu.empty()) found.size = std::abs(nearest_of(mu));
            return found;
        }
        const Vector gradient = J.transpose() * slope();
        const Vector way = solution(transposed_times(J, J), gradient);
        const double pace = std::sqrt(std::max(gradient.dot(way), 0.0));
        if (pace > 0.0) found.size = sigma() / pace, found.way = way / pace;
        return found;
    }

    // The gradient of σ by x.
    const Vector& slope() const {
        if (slope_.size() == 0) {
            Matrix rates;
            space->second(x, smallest().v, rates);
            slope_ = determining(*space, *P, rates).transpose() * smallest().u;
        }
        return slope_;
    }

    // The shortest dx with uᵀ φ''[v] dx = −σ and uᵀ φ''[N] dx = 0 for the null vectors N of K: its length is σ
    // against the part of the gradient that is at right angles to the rows of N.
    double find_ambient() const {
        if (!solved || space->nd == 0) return FAR;
        const Eigen::Index m = J.cols();
        Matrix rows(space->nv, m + 1);
        for (Eigen::Index i = 0; i < m; ++i) rows.col(i) = rate[static_cast<std::size_t>(i)].transpose() * smallest().u;
        rows.col(m) = slope();
        const double least = 1e-2 * rows.colwise().norm().maxCoeff();
        Matrix across = rows;
        double length = 0.0;
        for (Eigen::Index i = 0; i <= m; ++i) {
            length = across.col(i).norm();
            if (m > 2 || !(length > least)) return shortest(rows);
            for (Eigen::Index j = i + 1; j <= m; ++j)
                across.col(j) -= across.col(i) * (across.col(i).dot(across.col(j)) / (length * length));
        }
        return sigma() / length;
    }

    // The same where the rows may depend on each other.
    double shortest(const Matrix& rows) const {
        const Eigen::Index m = J.cols();
        const Matrix N = space->balance.asDiagonal() * orthonormal(space->balance.cwiseInverse().asDiagonal() * J);
        Matrix A(m + 1, space->nv);
        A.row(0) = rows.col(m).transpose();
        A.bottomRows(m) = (times(rows.leftCols(m), transposed_times(*C, N))).transpose();
        Vector target = Vector::Zero(m + 1);
        target[0] = -sigma();
        return least_squares(A, target, 1e-8).norm();
    }

    mutable bool known_nearest_ = false, known_ambient_ = false;
    mutable Distance nearest_;
    mutable Vector slope_;
    mutable Matrix W_;
    mutable Smallest smallest_;
    mutable double ambient_ = FAR;
};

// The same point in another chart: W = (C'ᵀ J)⁻¹, J W, W·W·Γ − J W (C'ᵀ W·W·Γ).
inline JetPtr recharted(const JetPtr& jet, const Chart& C) {
    if (C == jet->C) return jet;
    const auto m = jet->J.cols();
    const Matrix W = inverse(transposed_times(*C, jet->J));
    auto made = std::make_shared<Jet>();
    made->space = jet->space, made->x = jet->x, made->C = C, made->P = jet->P, made->given = jet->given;
    made->solved = jet->solved, made->closed = jet->closed;
    made->J = times(jet->J, W);
    made->bend.resize(jet->x.size(), m * m);
    for (Eigen::Index i = 0; i < m; ++i)
        for (Eigen::Index j = 0; j < m; ++j) made->bend.col(i * m + j) = jet->bent(W.col(i), W.col(j));
    made->bend -= times(made->J, transposed_times(*C, made->bend));
    if (jet->solved) {
        for (Eigen::Index i = 0; i < m; ++i) {
            Matrix rate = Matrix::Zero(jet->closed.rows(), jet->x.size());
            for (Eigen::Index j = 0; j < m; ++j) rate += W(j, i) * jet->rate[static_cast<std::size_t>(j)];
            made->rate.push_back(rate);
        }
    }
    return made;
}

// The jet at a closed x where K is regular, whose rows P K (nd, nv) the space has factorised: B = [P K; Cᵀ],
// J = B⁻¹ [0; I], Γ = −B⁻¹ [P φ''[J, J]; 0].
inline JetPtr jet_of(Space& space, const Vector& x, const Chart& C, const Matrix& rows,
                     std::shared_ptr<const Matrix> P) {
    const int nd = space.nd, m = space.m, nv = space.nv;
    auto made = std::make_shared<Jet>();
    made->space = &space, made->x = x, made->C = C, made->P = std::move(P), made->solved = true;
    made->closed = rows * space.balance.asDiagonal();
    made->J.setZero(nv, m);
    for (int i = 0; i < m; ++i) {
        made->J(nd + i, i) = 1.0;
        space.lu.solve(made->J.col(i).data());
    }
    if (!made->J.allFinite()) throw Lost{};
    made->rate.resize(static_cast<std::size_t>(m));
    for (int i = 0; i < m; ++i) {
        Matrix& rate = made->rate[static_cast<std::size_t>(i)];
        space.second(x, made->J.col(i), rate);
        if (space.rows != nd) rate = times(*made->P, rate);
    }
    made->bend.setZero(nv, m * m);
    for (int i = 0; i < m; ++i)
        for (int j = i; j < m; ++j) {
            auto column = made->bend.col(i * m + j);
            column.head(nd) = -0.5 * (made->rate[static_cast<std::size_t>(i)].lazyProduct(made->J.col(j)) +
                                      made->rate[static_cast<std::size_t>(j)].lazyProduct(made->J.col(i)));
            space.lu.solve(column.data());
            if (i != j) made->bend.col(j * m + i) = column;
        }
    return made;
}

// The same where nothing was factorised, with P from the left vectors of K, or given where all rows are in it.
inline JetPtr jet_at(Space& space, const Vector& x, const Chart& C,
                     std::shared_ptr<const Matrix> P = nullptr) {
    Vector phi;
    Matrix K;
    space.linear(x, phi, K);
    if (P == nullptr || space.rows != space.nd)
        P = std::make_shared<Matrix>(left_vectors(K * space.balance.asDiagonal()).leftCols(space.nd).transpose());
    const Matrix rows = determining(space, *P, K);
    space.factor(rows, *C);
    return jet_of(space, x, C, rows, std::move(P));
}

}  // namespace rg
