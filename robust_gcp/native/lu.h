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

    explicit Lu(int n = 0)
        : n_(n), a_(static_cast<std::size_t>(n) * n), at_(n), inverse_(n), x_(n), sign_(n), y_(n) {}

    int size() const { return n_; }
    double* matrix() { return a_.data(); }  // row by row; overwritten by `factor`
    double norm() const { return norm_; }   // ‖A‖₁

    void factor() {
        switch (n_) {  // sizes of one spatial loop and of two: loops of known length
            case 3: return eliminate<3>();
            case 4: return eliminate<4>();
            case 5: return eliminate<5>();
            case 6: return eliminate<6>();
            case 12: return eliminate<12>();
            default: return eliminate<0>();
        }
    }

    void solve(double* x) { solve(x, 1); }

    // Several right-hand sides, (n, count) row by row.
    void solve(double* x, int count) {
        const int n = n_;
        y_.resize(static_cast<std::size_t>(n) * count);
        double* y = y_.data();
        for (int i = 0; i < n; ++i) {
            const double* from = x + at_[i] * count;
            double* row = y + i * count;
            for (int c = 0; c < count; ++c) row[c] = from[c];
            clear(i, 0, i, row, y, count);
        }
        for (int i = n - 1; i >= 0; --i) {
            double* row = y + i * count;
            clear(i, i + 1, n, row, y, count);
            for (int c = 0; c < count; ++c) x[i * count + c] = row[c] *= inverse_[i];
        }
    }

    void solve_transposed(double* x) {
        const int n = n_;
        for (int i = 0; i < n; ++i) {
            x[i] *= inverse_[i];
            const double* row = a_.data() + at_[i] * n;
            for (int j = i + 1; j < n; ++j) x[j] -= row[j] * x[i];
        }
        for (int i = n - 1; i >= 0; --i) {
            const double* row = a_.data() + at_[i] * n;
            for (int j = 0; j < i; ++j) x[j] -= row[j] * x[i];
        }
        for (int i = 0; i < n; ++i) y_[i] = x[i];
        for (int i = 0; i < n; ++i) x[at_[i]] = y_[i];
    }

    // 1/‖A⁻¹‖₁ with Higham's estimate of the norm, as LAPACK's dgecon makes it
    // (Higham, ACM Trans. Math. Softw. 14, 1988).
    double least_stretch() {
        if (!regular || !std::isfinite(norm_) || norm_ == 0.0) return 0.0;
        const double inverse = inverse_norm();
        return inverse > 0.0 ? 1.0 / inverse : 0.0;
    }

  private:
    template <int N>
    void eliminate() {
        const int n = N > 0 ? N : n_;
        double *a = a_.data(), *sums = x_.data();
        for (int j = 0; j < n; ++j) sums[j] = 0.0;
        for (int i = 0; i < n; ++i) {
            at_[i] = i;
            for (int j = 0; j < n; ++j) sums[j] += std::fabs(a[i * n + j]);
        }
        norm_ = 0.0;
        for (int j = 0; j < n; ++j)
            if (!(sums[j] <= norm_)) norm_ = sums[j];
        det = 1.0;
        regular = true;
        for (int k = 0; k < n; ++k) {
            int best = k;
            double largest = std::fabs(a[at_[k] * n + k]);
            for (int i = k + 1; i < n; ++i) {
                const double size = std::fabs(a[at_[i] * n + k]);
                if (size > largest) best = i, largest = size;
            }
            if (best != k) {
                det = -det;
                std::swap(at_[k], at_[best]);
            }
            const double* __restrict top = a + at_[k] * n;
            det *= top[k];
            if (top[k] == 0.0) {
                regular = false;
                inverse_[k] = 1.0 / top[k];
                continue;
            }
            inverse_[k] = 1.0 / top[k];
            for (int i = k + 1; i < n; ++i) {
                double* __restrict row = a + at_[i] * n;
                if (row[k] == 0.0) continue;  // K_d is sparse: most are
                const double factor = row[k] *= inverse_[k];
                for (int j = k + 1; j < n; ++j) row[j] -= factor * top[j];
            }
        }
    }

    // Row i of right-hand sides less what rows `first` to `last` have in it.
    void clear(int i, int first, int last, double* row, const double* y, int count) const {
        const double* entries = a_.data() + at_[i] * n_;
        for (int j = first; j < last; ++j) {
            const double entry = entries[j];
            if (entry == 0.0) continue;
            const double* other = y + j * count;
            for (int c = 0; c < count; ++c) row[c] -= entry * other[c];
        }
    }

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
    Cells<int> at_;          // rows in the order of elimination
    Cells<double> inverse_;  // of the pivots
    Cells<double> x_, sign_, y_;
};

}  // namespace rg
