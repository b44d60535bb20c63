// A matrix of at most three rows, its determinant and conditioning; solved by its cofactors.
#pragma once

#include <algorithm>
#include <cmath>

namespace rg {

constexpr int SMALL = 3;

struct Small {
    int n = 0;
    double e[SMALL * SMALL] = {};  // row by row
    double det = 0.0;

    // After its entries; false where it is exactly singular or not finite.
    bool factor() {
        if (n == 3) {
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j) {
                    const int r = 3 * ((j + 1) % 3), s = 3 * ((j + 2) % 3), c = (i + 1) % 3, d = (i + 2) % 3;
                    cofactors_[3 * i + j] = e[r + c] * e[s + d] - e[r + d] * e[s + c];
                }
            det = e[0] * cofactors_[0] + e[1] * cofactors_[3] + e[2] * cofactors_[6];
        } else {
            det = n == 2 ? e[0] * e[3] - e[1] * e[2] : e[0];
        }
        inverse_ = 1.0 / det;
        return std::isfinite(inverse_);
    }

    // x = A⁻¹ x.
    void solve(double* x) const {
        if (n == 1) {
            x[0] *= inverse_;
        } else if (n == 2) {
            const double first = x[0], second = x[1];
            x[0] = (e[3] * first - e[1] * second) * inverse_;
            x[1] = (e[0] * second - e[2] * first) * inverse_;
        } else {
            const double *m = cofactors_, first = x[0], second = x[1], third = x[2];
            for (int i = 0; i < 3; ++i)
                x[i] = (m[3 * i] * first + m[3 * i + 1] * second + m[3 * i + 2] * third) * inverse_;
        }
    }

    // x = A⁻ᵀ x.
    void solve_transposed(double* x) const {
        if (n == 1) {
            x[0] *= inverse_;
        } else if (n == 2) {
            const double first = x[0], second = x[1];
            x[0] = (e[3] * first - e[2] * second) * inverse_;
            x[1] = (e[0] * second - e[1] * first) * inverse_;
        } else {
            const double *m = cofactors_, first = x[0], second = x[1], third = x[2];
            for (int i = 0; i < 3; ++i) x[i] = (m[i] * first + m[3 + i] * second + m[6 + i] * third) * inverse_;
        }
    }

    // 1 at most: |A| of one row, σ_min/σ_max of two, 1/(‖A‖₁ ‖A⁻¹‖₁) of three against that at the start.
    double rcond(double reference) const {
        if (n == 1) return std::min(std::fabs(det), 1.0);
        if (n == 2) {
            const double s = e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3];
            const double root = std::sqrt(std::max(s * s - 4.0 * det * det, 0.0));
            return 2.0 * std::fabs(det) / std::max(s + root, 1e-300);
        }
        const double stretch = norm(e) * norm(cofactors_) * std::fabs(inverse_);
        return std::isfinite(stretch) ? std::min(1.0 / (reference * stretch), 1.0) : 0.0;
    }

  private:
    // ‖A‖₁ of three rows.
    static double norm(const double* a) {
        double most = 0.0;
        for (int j = 0; j < 3; ++j)
            most = std::max(most, std::fabs(a[j]) + std::fabs(a[3 + j]) + std::fabs(a[6 + j]));
        return most;
    }

    double cofactors_[9] = {}, inverse_ = 0.0;
};

}  // namespace rg
