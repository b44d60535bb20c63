// What torques do: (Gᵀ M G)⁻¹ Gᵀ out of (Gᵀ M G)⁻¹.
#pragma once

#include <algorithm>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "path/path.h"

namespace rg {

// An independent velocity's torque acts on its own input alone, others on those of their part.
class Spread {
  public:
    Spread(const Description& d, const Path& path)
        : parts_(path.parts), m_(d.m), nv_(d.nv), independent_(d.independent, d.independent + d.m), inverse_(d.m) {
        std::vector<char> free(d.nv, 0);
        for (int k : independent_) free[k] = 1;
        for (int i = 0; i < d.nv; ++i)
            if (!free[i]) dependent_.push_back(i);
        as_is_ = dependent_.empty() && std::is_sorted(independent_.begin(), independent_.end());
    }

    // Last in rows (m, 2m + nv): m columns become nv.
    void at(double* rows, const double* G) {
        if (as_is_) return;
        for (int k = 0; k < m_; ++k) {
            double* row = rows + k * (2 * m_ + nv_) + 2 * m_;
            std::copy(row, row + m_, inverse_.begin());
            for (int a = 0; a < m_; ++a) row[independent_[a]] = inverse_[a];
            for (int i : dependent_) {
                double sum = 0.0;
                for (int a : parts_.list[parts_.of_velocity[i]].inputs) sum += inverse_[a] * G[i * m_ + a];
                row[i] = sum;
            }
        }
    }

  private:
    const Parts& parts_;
    int m_, nv_;
    std::vector<int> independent_, dependent_;  // velocities
    bool as_is_ = false;                        // whether these are the inputs in their order
    Cells<double> inverse_;
};

}  // namespace rg
