// LU of one small matrix with partial pivoting, its determinant and how much it stretches at least.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "linalg/cells.h"
#include "linalg/rows.h"

namespace rg {

class Lu {
  public:
    double det = 0.0;
    bool regular = true;

    explicit Lu(int n = 0)
        : n_(n), a_(static_cast<std::size_t>(n) * n), inverse_(n), swap_(n), x_(n), sign_(n),
          below_(n, n), end_(n, n), first_(n, 0), shares_(static_cast<std::size_t>(n)) {}

    // With entries in these places (row, column) alone: where each column ends, whatever the pivots.
    Lu(int n, const std::vector<std::pair<int, int>>& filled) : Lu(n) {
        std::vector<char> some(static_cast<std::size_t>(n) * n, 0);  // column by column
        for (const auto& [row, column] : filled) some[column * n + row] = 1;
        const auto end = [&](int k) {
            int last = n;
            while (last > k + 1 && !some[k * n + last - 1]) --last;
            return last;
        };
        for (int k = 0; k < n; ++k) {
            below_[k] = end(k);
            for (int j = 0; j < n; ++j) {  // the pivot's row may be any of these, and changes places with the first
                const auto from = some.begin() + j * n + k, to = some.begin() + j * n + below_[k];
                if (j != k && std::find(from, to, 1) != to) std::fill(from, to, 1);
            }
        }
        for (int k = 0; k < n; ++k) {
            end_[k] = end(k);
            while (first_[k] < k && !some[first_[k] * n + k]) ++first_[k];
        }
    }

    // Column by column; overwritten by `factor`.
    double* matrix() { return a_.data(); }

    // Columns are passed over where they are zero in the pivot's row: K_d is sparse.
    void factor() {
        det = 1.0;
        regular = true;
        const int n = n_;
        for (int k = 0; k < n; ++k) {
            double* __restrict below = &a_[k * n];
            const int end = below_[k];
            int best = k;
            for (int i = k + 1; i < end; ++i)
                if (std::fabs(below[i]) > std::fabs(below[best])) best = i;
            swap_[k] = best;
            if (best != k) {
                det = -det;
                for (int j = 0; j < n; ++j) std::swap(a_[j * n + k], a_[j * n + best]);
            }
            det *= below[k];
            inverse_[k] = 1.0 / below[k];
            if (below[k] == 0.0) {
                regular = false;
                continue;
            }
            for (int i = k + 1; i < end; ++i) below[i] *= inverse_[k];
            for (int j = k + 1; j < n; ++j) {
                double* __restrict column = &a_[j * n];
                const double entry = column[k];
                if (entry == 0.0) continue;
                for (int i = k + 1; i < end; ++i) column[i] -= entry * below[i];
            }
        }
    }

    void solve(double* x) const {
        const int n = n_;
        for (int k = 0; k < n; ++k)
            if (swap_[k] != k) std::swap(x[k], x[swap_[k]]);
        for (int j = 0; j < n; ++j) take(x, j, j + 1, end_[j]);
        for (int j = n - 1; j >= 0; --j) {
            x[j] *= inverse_[j];
            take(x, j, 0, j);
        }
    }

    // The same of several right sides, side by side (n, count); L and U are sparse.
    void solve(double* x, int count) {
        if (count == 1) return solve(x);
        const std::size_t width = static_cast<std::size_t>(count);
        for (int k = 0; k < n_; ++k)
            if (swap_[k] != k) std::swap_ranges(x + k * count, x + (k + 1) * count, x + swap_[k] * count);
        for (int i = 1; i < n_; ++i) {
            for (int j = first_[i]; j < i; ++j) shares_.add(-a_[j * n_ + i], x + j * count);
            shares_.into(x + i * count, 0, width);
            shares_.clear();
        }
        for (int i = n_; i-- > 0;) {
            for (int j = i + 1; j < n_; ++j) shares_.add(-a_[j * n_ + i], x + j * count);
            shares_.into(x + i * count, 0, width, inverse_[i]);
            shares_.clear();
        }
    }

    void solve_transposed(double* x) const {
        const int n = n_;
        for (int i = 0; i < n; ++i) {
            for (int j = 0; j < i; ++j) x[i] -= a_[i * n + j] * x[j];
            x[i] *= inverse_[i];
        }
        for (int i = n - 1; i >= 0; --i)
            for (int j = i + 1; j < end_[i]; ++j) x[i] -= a_[i * n + j] * x[j];
        for (int k = n - 1; k >= 0; --k)
            if (swap_[k] != k) std::swap(x[k], x[swap_[k]]);
    }

    // 1/‖A⁻¹‖₁ with Higham's estimate of the norm, as LAPACK's dgecon makes it (Higham, ACM Trans. Math.
    // Softw. 14, 1988).
    double least_stretch() {
        if (!regular) return 0.0;
        const double inverse = inverse_norm();
        return inverse > 0.0 && std::isfinite(inverse) ? 1.0 / inverse : 0.0;
    }

  private:
    // Rows `first` to `last` of x less those of column j times its entry.
    void take(double* __restrict x, int j, int first, int last) const {
        const double entry = x[j];
        if (entry == 0.0) return;
        const double* __restrict column = &a_[j * n_];
        for (int i = first; i < last; ++i) x[i] -= entry * column[i];
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
    Cells<double> a_, inverse_;  // the factors, and what the pivots are divided by
    std::vector<int> swap_;
    Cells<double> x_, sign_;
    std::vector<int> below_, end_;  // by column: where it ends when it is eliminated, and of L
    std::vector<int> first_;        // by row: where that of L begins
    Shares shares_;
};

}  // namespace rg
