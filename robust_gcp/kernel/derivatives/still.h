// Inputs that move as prescribed, or stay where they are; see `HeldDerivatives` and `DrivenDerivatives`.
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
          independent_(d.independent, d.independent + d.m), now_(3 * d.driven) {}

    // What they do from here on: `told` (3, drives) of the first of them, or null; the others rest.
    void tell(const double* told, std::size_t drives, const double* y) {
        const std::size_t n = which_.size();
        std::fill(now_.begin() + n, now_.end(), 0.0);
        for (std::size_t k = 0; k < n; ++k) now_[k] = y[which_[k]];
        for (std::size_t part = 0; told != nullptr && part < 3; ++part)
            std::copy(told + part * drives, told + (part + 1) * drives, now_.data() + part * n);
    }

    // Into the state (y, ẏ) of a stage.
    void lead(double* state) const {
        const std::size_t n = which_.size();
        for (std::size_t k = 0; k < n; ++k) {
            state[which_[k]] = now_[k];
            state[m_ + which_[k]] = now_[n + k];
        }
    }

    void prescribe(Driven& driven, Point& point) { driven.prescribe(now_.data(), point.y(), point.ydot()); }

    // Of rows of `Slopes` (m, 2m + nv) that know nothing of it: with what holds them, so that u̇ of these is as it is
    // whatever changes. The torque on one that is prescribed changes nothing: its column says what its ÿ changes.
    void hold(double* rows, std::size_t drives) const {
        for (std::size_t n = 0; n < which_.size(); ++n) {
            const int p = which_[n];
            double* held = rows + p * width_;
            const int by_force = 2 * m_ + independent_[p];
            for (int i = 0; i < m_; ++i) {
                if (i == p) continue;
                double* row = rows + i * width_;
                const double share = row[by_force] / held[by_force];
                for (int k = 0; k < width_; ++k) row[k] -= share * held[k];
                if (n < drives) row[by_force] = share;
            }
            std::fill(held, held + width_, 0.0);
        }
    }

    const std::vector<int>& which() const { return which_; }

  private:
    int m_, width_;
    std::vector<int> which_, independent_;
    std::vector<double> now_;  // (3, driven)
};

}  // namespace rg
