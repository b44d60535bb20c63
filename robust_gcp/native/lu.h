// LU of one small dense matrix with partial pivoting, its determinant and reciprocal condition number.
#pragma once

#include <cmath>
#include <utility>
#include <vector>

#include "cells.h"

namespace rg {

class Lu {
  public:
    double det = 0.0;
    bool regular = true;

    explicit Lu(int n = 0) : n_(n), a_(static_cast<std::size_t>(n) * n), swap_(n), x_(n), sign_(n) {}

    int size() const { return n_; }
    double* matrix() { return a_.data(); }  // row by row; overwritten by `factor`

    void factor() {
        norm_ = 0.0;
        for (int j = 0; j < n_; ++j) {
            double sum = 0.0;
            for (int i = 0; i < n_; ++i) sum += std::fabs(a_[i * n_ + j]);
            if (!(sum <= norm_)) norm_ = sum;
        }
        det = 1.0;
        regular = true;
        for (int k = 0; k < n_; ++k) {
            int best = k;
            for (int i = k + 1; i < n_; ++i)
                if (std::fabs(a_[i * n_ + k]) > std::fabs(a_[best * n_ + k])) best = i;
            swap_[k] = best;
            if (best != k) {
                det = -det;
                for (int j = 0; j < n_; ++j) std::swap(a_[k * n_ + j], a_[best * n_ + j]);
            }
            const double pivot = a_[k * n_ + k];
            det *= pivot;
            if (pivot == 0.0) {
                regular = false;
                continue;
            }
            for (int i = k + 1; i < n_; ++i) {
                const double factor = a_[i * n_ + k] /= pivot;
                if (factor == 0.0) continue;
                for (int j = k + 1; j < n_; ++j) a_[i * n_ + j] -= factor * a_[k * n_ + j];
            }
        }
    }

    void solve(double* x) const {
        for (int k = 0; k < n_; ++k)
            if (swap_[k] != k) std::swap(x[k], x[swap_[k]]);
        for (int i = 0; i < n_; ++i)
            for (int j = 0; j < i; ++j) x[i] -= a_[i * n_ + j] * x[j];
        for (int i = n_ - 1; i >= 0; --i) {
            for (int j = i + 1; j < n_; ++j) x[i] -= a_[i * n_ + j] * x[j];
            x[i] /= a_[i * n_ + i];
        }
    }

    void solve_transposed(double* x) const {
        for (int i = 0; i < n_; ++i) {
            for (int j = 0; j < i; ++j) x[i] -= a_[j * n_ + i] * x[j];
            x[i] /= a_[i * n_ + i];
        }
        for (int i = n_ - 1; i >= 0; --i)
            for (int j = i + 1; j < n_; ++j) x[i] -= a_[j * n_ + i] * x[j];
        for (int k = n_ - 1; k >= 0; --k)
            if (swap_[k] != k) std::swap(x[k], x[swap_[k]]);
    }

    // 1/(‖A‖₁ ‖A⁻¹‖₁) with Higham's estimate of the second norm, as LAPACK's dgecon makes it
    // (Higham, ACM Trans. Math. Softw. 14, 1988).
    double rcond() {
        if (!regular || !std::isfinite(norm_) || norm_ == 0.0) return 0.0;
        const double inverse = inverse_norm();
        return inverse > 0.0 ? 1.0 / inverse / norm_ : 0.0;
    }

  private:
    double inverse_norm() {
        for (double& e : x_) e = 1.0 / n_;
        solve(x_.data());
        if (n_ == 1) return std::fabs(x_[0]);
        double estimate = sum();
        take_signs();
        solve_transposed(x_.data());
        int j = largest();
        for (int iteration = 2; iteration <= 5; ++iteration) {
            for (double& e : x_) e = 0.0;
            x_[j] = 1.0;
            solve(x_.data());
            const double before = estimate;
            estimate = sum();
            if (same_signs() || estimate <= before) break;
            take_signs();
            solve_transposed(x_.data());
            const int last = j;
            j = largest();
            if (x_[last] == std::fabs(x_[j])) break;
        }
        for (int i = 0; i < n_; ++i)
            x_[i] = (i % 2 ? -1.0 : 1.0) * (1.0 + static_cast<double>(i) / (n_ - 1));
        solve(x_.data());
        const double other = 2.0 * sum() / (3.0 * n_);
        return other > estimate ? other : estimate;
    }

    double sum() const {
        double total = 0.0;
        for (double e : x_) total += std::fabs(e);
        return total;
    }
    void take_signs() {
        for (int i = 0; i < n_; ++i) x_[i] = sign_[i] = x_[i] > 0.0 ? 1.0 : -1.0;
    }
    bool same_signs() const {
        for (int i = 0; i < n_; ++i)
            if ((x_[i] > 0.0 ? 1.0 : -1.0) != sign_[i]) return false;
        return true;
    }
    int largest() const {
        int best = 0;
        for (int i = 1; i < n_; ++i)
            if (std::fabs(x_[i]) > std::fabs(x_[best])) best = i;
        return best;
    }

    int n_;
    double norm_ = 0.0;
    Cells<double> a_;
    std::vector<int> swap_;
    Cells<double> x_, sign_;
};

}  // namespace rg
