// Small dense linear algebra: the decompositions of a cluster's K. Eigen's are compiled in dense.cpp alone.
#pragma once

#include <cmath>
#include <complex>
#include <vector>

#include "linalg/eigen.h"

namespace rg {

using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;
using Roots = std::vector<std::complex<double>>;

constexpr double PI = 3.14159265358979323846, FAR = 1e300;

// A = U diag(s) Vᵀ in full, s descending.
struct Svd {
    Matrix U, V;
    Vector s;

    explicit Svd(const Matrix& A);
};

Matrix left_vectors(const Matrix& A);  // σ descending, (rows, rows); soon where rows are nearly orthogonal
Matrix times(const Matrix& A, const Matrix& B);             // A B
Matrix transposed_times(const Matrix& A, const Matrix& B);  // Aᵀ B
// Not finite where A is singular; also the smallest pivot as a share of the largest.
Matrix inverse(const Matrix& A, double* pivots = nullptr);
Vector solution(Matrix A, Vector b);                        // of A x = b, likewise
double determinant(const Matrix& A);
Matrix orthonormal(const Matrix& A);  // Q of A = Q R, as wide as A, or square where A is wider than high
std::vector<int> best_rows(const Matrix& A);  // as many as A has columns: a pivoted QR of Aᵀ
Roots eigenvalues(const Matrix& A);

// The shortest x that brings A x as near to b as can be; singular values below a share of the first are zero.
Vector least_squares(const Matrix& A, const Vector& b, double share);
// The same, soon where the rank is clear; also whether A has full column rank.
Vector shortest(const Matrix& A, const Vector& b, double share, bool* full = nullptr);

// shift + 1/λ for those that are not beyond 1/least.
inline Roots reciprocal(const Roots& values, double shift, double least) {
    Roots found;
    for (const auto& value : values)
        if (std::abs(value) > least) found.push_back(shift + 1.0 / value);
    return found;
}

// That of smallest magnitude.
inline std::complex<double> nearest_of(const Roots& roots) {
    auto best = roots.front();
    for (const auto& root : roots)
        if (std::abs(root) < std::abs(best)) best = root;
    return best;
}

}  // namespace rg
