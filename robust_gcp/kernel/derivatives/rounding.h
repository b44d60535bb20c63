// Points where K_d is poor, closed as well as the rounding of q itself lets them, and what rounding leaves uncertain
// of G and its derivatives there, as map_rates.py has it, and of those of u̇.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "abi.h"
#include "constraint/extended.h"
#include "derivatives/accelerations.h"
#include "dynamics/motion.h"
#include "path/path.h"

namespace rg {

class Rounding {
  public:
    Rounding(const Description& d, Path& path, Motion& motion, Slopes& slopes)
        : path_(path), motion_(motion), slopes_(slopes), m_(d.m), nv_(d.nv), width_(2 * d.m + d.nv),
          independent_(d.independent, d.independent + d.m), step_(d.nv), errors_(d.rows), rows_(d.m * width_),
          sample_(path.layout) {
        for (std::size_t p = 0; p < path.parts.list.size(); ++p) {
            const Loops* loops = path.loops(p);
            known_.emplace_back(loops == nullptr ? nullptr : new Extended(path.chain, path.parts.list[p], loops->closures));
        }
    }

    // Closes a point; whether G, its derivatives and those of u̇ there change by no more than `most` where q, and what
    // φ is known to be, are rounded otherwise.
    bool steady(Point& point, double most) {
        for (std::size_t p = 0; p < known_.size(); ++p)
            if (known_[p] != nullptr) path_.loops(p)->refine(*known_[p], point.q());
        path_.look(point);
        const double poor = point.conditioning();
        if (known_at_ > 0.0 && most_ == most && change_at(poor) <= most) return true;
        bool good = poor >= LOST;
        known_at_ = worst_ = 0.0, most_ = most;
        for (std::uint64_t sample = 0; good && sample <= SAMPLES; ++sample) {
            sample_ = point;
            for (int k = 0; k < m_; ++k) sample_.ydot()[k] = path_.scale(independent_[k]);
            if (sample > 0) round(sample, sample_.q());
            path_.look(sample_);
            good = motion_.evaluate(0.0, sample_, Request{}) == DONE && slopes_.at(sample_, rows_.data());
            if (good) good = sample > 0 ? change() <= most : note();
        }
        if (good) known_at_ = poor;
        path_.look(point);
        return good;
    }

    // For a state that has nothing to do with those before.
    void renew() { known_at_ = 0.0; }

    static constexpr double LOST = 1e-4;  // as in map_rates.py

  private:
    static constexpr double ROUNDINGS = 8.0, DOUBLE = std::numeric_limits<double>::epsilon();
    static constexpr double LEAST = 1e-12;  // change that is taken to be found
    static constexpr std::uint64_t SAMPLES = 4;

    void round(std::uint64_t sample, double* q) {
        std::uint64_t bits = sample * 0x9E3779B97F4A7C15u;
        const auto sign = [&] {  // by xorshift
            bits ^= bits << 13, bits ^= bits >> 7, bits ^= bits << 17;
            return (bits >> 40) % 2 ? ROUNDINGS : -ROUNDINGS;
        };
        for (std::size_t p = 0; p < known_.size(); ++p) {
            if (known_[p] == nullptr) continue;
            for (double& error : errors_) error = sign() * known_[p]->eps();
            path_.loops(p)->reopen(errors_.data(), q);
        }
        for (int v = 0; v < nv_; ++v) step_[v] = sign() * DOUBLE * path_.scale(v);
        for (const int j : path_.chain.all) {
            const Body& b = path_.chain.bodies[j];
            integrate_joint(b.kind, q + b.q, step_.data() + b.first, q + b.q);
        }
    }

    // What the change that was found comes to, at most, where K_d is poorer: it grows as 1/σ².
    double change_at(double poor) const { return 2.0 * std::max(worst_, LEAST) * (known_at_ / poor) * (known_at_ / poor); }

    // Visits G, ∂v/∂y and ∂a/∂y of the sample, and ∂u̇ by y and u, which the reduced inertia may err in; dimensionless.
    template <typename Visit>
    void each(Visit visit) {
        const Displacements& moved = slopes_.moved();
        const auto scaled = [&](double x, int v, int k) { visit(x / path_.scale(v) * path_.scale(independent_[k])); };
        for (const double* part : {static_cast<const double*>(sample_.G()), moved.v_y.data(), moved.a_y.data()})
            for (int v = 0; v < nv_; ++v)
                for (int k = 0; k < m_; ++k) scaled(part[v * m_ + k], v, k);
        for (int j = 0; j < m_; ++j)
            for (int k = 0; k < 2 * m_; ++k) scaled(rows_[j * width_ + k], independent_[j], k % m_);
    }

    bool note() {
        here_.clear();
        each([&](double x) { here_.push_back(x); });
        return all_finite(here_.data(), here_.size());
    }

    double change() {
        double worst = 0.0;
        std::size_t at = 0;
        each([&](double x) { keep(worst, (x - here_[at]) / (1.0 + std::fabs(here_[at]))), ++at; });
        worst_ = std::max(worst_, worst);
        return worst;
    }

    Path& path_;
    Motion& motion_;
    Slopes& slopes_;
    int m_, nv_, width_;
    std::vector<int> independent_;
    std::vector<std::unique_ptr<Extended>> known_;  // by part; none where nothing is tied
    std::vector<double> step_, errors_, rows_, here_;
    Point sample_;
    double known_at_ = 0.0, worst_ = 0.0, most_ = 0.0;  // conditioning where the change was found last, and what it was
};

}  // namespace rg
