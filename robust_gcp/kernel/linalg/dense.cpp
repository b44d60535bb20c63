#include "linalg/dense.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>

namespace rg {

// Columns of `W` made orthogonal to each other by rotations from the right, which `R` goes on with (one-sided Jacobi;
// Golub and Van Loan, Matrix Computations, 8.6.3).
static void orthogonalise(Matrix& W, Matrix& R) {
    const Eigen::Index n = W.cols();
    Vector squares(n);
    for (int sweep = 0; sweep < 60; ++sweep) {
        bool turned = false;
        squares = W.colwise().squaredNorm().transpose();
        for (Eigen::Index i = 0; i + 1 < n; ++i)
            for (Eigen::Index j = i + 1; j < n; ++j) {
                const double a = squares[i], b = squares[j], c = W.col(i).dot(W.col(j));
                if (!(std::fabs(c) > 1e-15 * std::sqrt(a * b))) continue;
                turned = true;
                const double zeta = (b - a) / (2.0 * c);
                const double t = std::copysign(1.0, zeta) / (std::fabs(zeta) + std::sqrt(1.0 + zeta * zeta));
                const double cosine = 1.0 / std::sqrt(1.0 + t * t), sine = cosine * t;
                squares[i] -= t * c, squares[j] += t * c;
                for (Matrix* M : {&W, &R}) {
                    double *__restrict x = M->col(i).data(), *__restrict y = M->col(j).data();
                    for (Eigen::Index k = 0; k < M->rows(); ++k) {
                        const double turned_x = cosine * x[k] - sine * y[k];
                        y[k] = sine * x[k] + cosine * y[k];
                        x[k] = turned_x;
                    }
                }
            }
        if (!turned) return;
    }
}

// The places of the values, the largest first.
static std::vector<Eigen::Index> descending(const Vector& values) {
    std::vector<Eigen::Index> order(static_cast<std::size_t>(values.size()));
    std::iota(order.begin(), order.end(), Eigen::Index{0});
    std::sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) { return values[a] > values[b]; });
    return order;
}

// A = left diag(s) rightᵀ for A at least as high as wide, `left` square and completed to an orthonormal basis.
static void rotated(const Matrix& A, Matrix& left, Vector& s, Matrix& right) {
    const Eigen::Index rows = A.rows(), n = A.cols();
    Matrix W = A, R = Matrix::Identity(n, n);
    orthogonalise(W, R);
    const Vector sizes = W.colwise().norm().transpose();
    const std::vector<Eigen::Index> order = descending(sizes);
    left.resize(rows, rows), right.resize(n, n), s.resize(n);
    Eigen::Index known = 0;
    for (Eigen::Index k = 0; k < n; ++k) {
        const Eigen::Index from = order[static_cast<std::size_t>(k)];
        s[k] = sizes[from];
        right.col(k) = R.col(from);
        if (s[k] > 1e-14 * s[0]) left.col(known++) = W.col(from) / s[k];
    }
    // the rest by Gram and Schmidt, twice, from the unit vector that is farthest from all before
    for (; known < rows; ++known) {
        Vector best;
        for (Eigen::Index i = 0; i < rows; ++i) {
            Vector unit = Vector::Unit(rows, i);
            for (int pass = 0; pass < 2; ++pass)
                for (Eigen::Index k = 0; k < known; ++k) unit -= left.col(k) * left.col(k).dot(unit);
            if (best.size() == 0 || unit.squaredNorm() > best.squaredNorm()) best = unit;
            if (best.squaredNorm() > 0.5) break;
        }
        left.col(known) = best.normalized();
    }
}

constexpr Eigen::Index SMALL = 16;  // up to which plain loops are faster than Eigen's blocks

// The same; where A is large of Rᵀ, A P = Q R, whose columns are nearly orthogonal (Drmač and Veselić, SIAM J. Matrix
// Anal. Appl. 29, 2008): a third of the time for 40 of unequal size.
static void tall(const Matrix& A, Matrix& left, Vector& s, Matrix& right) {
    const Eigen::Index n = A.cols();
    if (n <= SMALL) return rotated(A, left, s, right);
    const Eigen::ColPivHouseholderQR<Matrix> qr(A);
    const Matrix R = qr.matrixQR().topRows(n).triangularView<Eigen::Upper>();
    Matrix from, to;
    rotated(R.transpose(), from, s, to);
    left = Matrix::Identity(A.rows(), A.rows());
    left.topLeftCorner(n, n) = to;
    left.applyOnTheLeft(qr.householderQ());
    right = qr.colsPermutation() * from;
}

Svd::Svd(const Matrix& A) {
    if (A.rows() >= A.cols())
        tall(A, U, s, V);
    else
        tall(A.transpose(), V, s, U);
}

Matrix left_vectors(const Matrix& A) {
    const Eigen::Index n = A.rows();
    if (n > A.cols() || A.cols() > SMALL) return Svd(A).U;
    Matrix W = A.transpose(), R = Matrix::Identity(n, n);
    orthogonalise(W, R);
    Matrix U(n, n);
    Eigen::Index k = 0;
    for (const Eigen::Index from : descending(W.colwise().norm().transpose())) U.col(k++) = R.col(from);
    return U;
}

// Elimination with partial pivoting of a small A, beside right-hand sides B that become A⁻¹ B; returns the
// smallest pivot as a share of the largest.
template <typename Right>
static double eliminate(Matrix& A, Right& B) {
    const Eigen::Index n = A.rows(), m = B.cols();
    double least = INFINITY, most = 0.0;
    for (Eigen::Index k = 0; k < n; ++k) {
        Eigen::Index pivot = k;
        for (Eigen::Index i = k + 1; i < n; ++i)
            if (std::fabs(A(i, k)) > std::fabs(A(pivot, k))) pivot = i;
        if (pivot != k) {
            for (Eigen::Index j = k; j < n; ++j) std::swap(A(k, j), A(pivot, j));
            for (Eigen::Index j = 0; j < m; ++j) std::swap(B(k, j), B(pivot, j));
        }
        least = std::min(least, std::fabs(A(k, k))), most = std::max(most, std::fabs(A(k, k)));
        const Eigen::Index below = n - k - 1;
        auto factor = A.col(k).tail(below);
        factor /= A(k, k);
        for (Eigen::Index j = k + 1; j < n; ++j) A.col(j).tail(below) -= A(k, j) * factor;
        for (Eigen::Index j = 0; j < m; ++j) B.col(j).tail(below) -= B(k, j) * factor;
    }
    for (Eigen::Index j = 0; j < m; ++j)
        for (Eigen::Index k = n; k-- > 0;) {
            B(k, j) /= A(k, k);
            B.col(j).head(k) -= B(k, j) * A.col(k).head(k);
        }
    return least / most;
}

Matrix times(const Matrix& A, const Matrix& B) {
    return std::max(A.rows(), B.rows()) > SMALL ? Matrix(A * B) : Matrix(A.lazyProduct(B));
}

Matrix transposed_times(const Matrix& A, const Matrix& B) {
    return std::max(A.rows(), A.cols()) > SMALL ? Matrix(A.transpose() * B) : Matrix(A.transpose().lazyProduct(B));
}

Matrix inverse(const Matrix& A, double* pivots) {
    if (A.rows() > SMALL) {
        const Eigen::PartialPivLU<Matrix> lu(A);
        const auto diagonal = lu.matrixLU().diagonal().cwiseAbs();
        if (pivots != nullptr) *pivots = diagonal.minCoeff() / diagonal.maxCoeff();
        return lu.inverse();
    }
    Matrix undone = Matrix::Identity(A.rows(), A.cols()), reduced = A;
    const double share = eliminate(reduced, undone);
    if (pivots != nullptr) *pivots = share;
    return undone;
}

double determinant(const Matrix& A) { return A.rows() == 1 ? A(0, 0) : A.determinant(); }

Vector solution(Matrix A, Vector b) {
    if (A.rows() > SMALL) return A.partialPivLu().solve(b);
    eliminate(A, b);
    return b;
}

Matrix orthonormal(const Matrix& A) {
    const Eigen::HouseholderQR<Matrix> qr(A);
    return qr.householderQ() * Matrix::Identity(A.rows(), std::min(A.rows(), A.cols()));
}

std::vector<int> best_rows(const Matrix& A) {
    const Eigen::ColPivHouseholderQR<Matrix> qr(A.transpose());
    const auto& order = qr.colsPermutation().indices();
    return {order.data(), order.data() + A.cols()};
}

Roots eigenvalues(const Matrix& A) {
    if (A.rows() == 0) return {};
    if (A.rows() == 1) return {A(0, 0)};
    if (A.rows() == 2) {
        const double half = 0.5 * (A(0, 0) + A(1, 1)), apart = 0.5 * (A(0, 0) - A(1, 1));
        const double square = apart * apart + A(0, 1) * A(1, 0);
        if (square < 0.0) return {{half, std::sqrt(-square)}, {half, -std::sqrt(-square)}};
        const double larger = half + std::copysign(std::sqrt(square), half);
        const double det = A(0, 0) * A(1, 1) - A(0, 1) * A(1, 0);
        return {larger, larger != 0.0 ? det / larger : 0.0};
    }
    const Eigen::EigenSolver<Matrix> solver(A, false);
    const auto& found = solver.eigenvalues();
    return {found.data(), found.data() + found.size()};
}

static Vector by_svd(const Svd& svd, const Vector& b, double share) {
    Vector x = Vector::Zero(svd.V.rows());
    for (Eigen::Index i = 0; i < svd.s.size(); ++i)
        if (svd.s[i] > share * svd.s[0]) x += svd.V.col(i) * (svd.U.col(i).dot(b) / svd.s[i]);
    return x;
}

Vector least_squares(const Matrix& A, const Vector& b, double share) {
    return by_svd(Svd(A), b, share);
}

Vector shortest(const Matrix& A, const Vector& b, double share, bool* full) {
    constexpr double PLAIN = 1e-4, ROUNDING = 1e-12;  // of the pivots: far above any share, and zero
    const Eigen::Index n = std::min(A.rows(), A.cols());
    if (full != nullptr) *full = A.cols() == 0;
    if (n == 0) return Vector::Zero(A.cols());
    Eigen::CompleteOrthogonalDecomposition<Matrix> whole;
    whole.setThreshold(PLAIN).compute(A);
    const Eigen::Index rank = whole.rank();
    if (rank > 0 && (rank == n || std::fabs(whole.matrixQTZ()(rank, rank)) < ROUNDING * whole.maxPivot())) {
        if (full != nullptr) *full = rank == A.cols();
        return whole.solve(b);
    }
    const Svd svd(A);
    if (full != nullptr) *full = n == A.cols() && svd.s[n - 1] > share * svd.s[0];
    return by_svd(svd, b, share);
}

}  // namespace rg
