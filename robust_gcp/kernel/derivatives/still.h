// Inputs that stay where they are; see `HeldDerivatives`.
#pragma once

#include <algorithm>
#include <vector>

#include "abi.h"
#include "dynamics/driven.h"
#include "path/path.h"

namespace rg {

class Still {
  public:
    explicit Still(const Description& d)
        : m_(d.m), width_(2 * d.m + d.nv), which_(d.driven_y, d.driven_y + d.driven),
          independent_(d.independent, d.independent + d.m), rest_(3 * d.driven) {}

    // Their places as they are, and no motion.
    void prescribe(Driven& driven, Point& point) {
        for (std::size_t k = 0; k < which_.size(); ++k) rest_[k] = point.y()[which_[k]];
        driven.prescribe(rest_.data(), point.y(), point.ydot());
    }

    // Of rows of `Slopes` (m, 2m + nv) that know nothing of it: with what holds them, so that u̇ of these is 0
    // whatever changes.
    void hold(double* rows) const {
        for (const int p : which_) {
            double* held = rows + p * width_;
            const int by_force = 2 * m_ + independent_[p];
            for (int i = 0; i < m_; ++i) {
                if (i == p) continue;
                double* row = rows + i * width_;
                const double share = row[by_force] / held[by_force];
                for (int k = 0; k < width_; ++k) row[k] -= share * held[k];
            }
            std::fill(held, held + width_, 0.0);
        }
    }

  private:
    int m_, width_;
    std::vector<int> which_, independent_;
    std::vector<double> rest_;
};

}  // namespace rg
