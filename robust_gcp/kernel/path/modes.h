// A part's mode of one coordinate as a series about a place, singular or not, where Newton's method on K_d finds no
// good point; see `Around` in continuation.py, which makes them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "tree/chain.h"
#include "tree/parts.h"
#include "path/point.h"

namespace rg {

// Σ_k c_k s^k, s = (y − centre) / radius, of γ', γ'' and γ''' of a part's velocities.
class Series3 {
  public:
    Series3(const ModeSeries& given, const std::vector<int>& velocities)
        : center_(given.center), radius_(given.radius), orders_(given.orders), velocities_(velocities),
          q_(given.q, given.q + given.count), coefficients_(given.coefficients,
                                                            given.coefficients + 3 * given.orders * given.count) {}

    double from(double y) const { return std::fabs(y - center_); }
    bool covers(double y) const { return from(y) <= INSIDE * std::fabs(radius_); }

    // γ at y of a velocity by its place in the part: ∫ γ' dy from the centre.
    double position(double y, std::size_t i) const {
        const double s = (y - center_) / radius_;
        double sum = 0.0;
        for (std::int64_t k = orders_; k-- > 0;) sum = sum * s + at(k, 0, i) / static_cast<double>(k + 1);
        return q_[i] + radius_ * s * sum;
    }

    // The derivative of order 1, 2 or 3.
    double rate(double y, int order, std::size_t i) const {
        const double s = (y - center_) / radius_;
        double sum = 0.0;
        for (std::int64_t k = orders_; k-- > 0;) sum = sum * s + at(k, order - 1, i);
        return sum;
    }

    const std::vector<int>& velocities() const { return velocities_; }

  private:
    static constexpr double INSIDE = 0.5;  // as in continuation.py

    double at(std::int64_t order, int which, std::size_t i) const {
        return coefficients_[(static_cast<std::size_t>(order) * 3 + static_cast<std::size_t>(which)) * q_.size() + i];
    }

    double center_, radius_;
    std::int64_t orders_;
    std::vector<int> velocities_;
    std::vector<double> q_, coefficients_;
};

// All that are known, and which of them are in use at the point placed last.
class Modes {
  public:
    bool on = false;
    Point* through = nullptr;        // where it is given, a series serves that the mode at this point lies on
    std::vector<double> bend, third;  // γ'' and γ''' by velocity, of parts in use

    Modes(const Description& d, const Parts& parts)
        : bend(d.nv), third(d.nv), parts_(parts), m_(d.m), size_(d.size, d.size + d.nv), known_(parts.list.size()),
          used_(parts.list.size()) {}

    bool some() const { return some_; }
    const Series3* used(std::size_t part) const { return used_[part]; }

    // False where it is not one of a part of one coordinate.
    bool learn(const ModeSeries& given) {
        const std::vector<int> velocities(given.velocities, given.velocities + given.count);
        const int part = parts_.of_velocity[velocities[0]];
        std::vector<int> own = parts_.list[part].velocities, asked = velocities;
        std::sort(own.begin(), own.end());
        std::sort(asked.begin(), asked.end());
        if (own != asked || parts_.list[part].count() != 1) return false;
        known_[part].emplace_back(given, velocities);
        return some_ = true;
    }

    // Puts a part on the series whose mode passes its numbers in q; false where none does.
    bool place(std::size_t part, Point& point, const Chain& chain) {
        used_[part] = nullptr;
        if (!on || known_[part].empty()) return false;
        const double y = point.y()[parts_.list[part].inputs[0]];
        double nearest = TOLERANCE + SHARE * point.distance;
        for (const Series3& series : known_[part]) {
            if (!series.covers(y) || !passes(series, part, chain)) continue;
            const double off = apart(series, y, point, chain);
            if (off < nearest) nearest = off, used_[part] = &series;
        }
        if (used_[part] == nullptr) return false;
        for (std::size_t i = 0; i < used_[part]->velocities().size(); ++i)
            point.q()[chain.number_at[used_[part]->velocities()[i]]] = used_[part]->position(y, i);
        return true;
    }

    // γ' of a part into G (nv, m), γ'' and γ''' into `bend` and `third`.
    void rates(std::size_t part, Point& point, int m) {
        const Series3& series = *used_[part];
        const int k = parts_.list[part].inputs[0];
        const double y = point.y()[k];
        for (std::size_t i = 0; i < series.velocities().size(); ++i) {
            const int v = series.velocities()[i];
            point.G()[v * m + k] = series.rate(y, 1, i);
            bend[v] = series.rate(y, 2, i);
            third[v] = series.rate(y, 3, i);
        }
    }

  private:
    static constexpr double TOLERANCE = 1e-6, SHARE = 0.25;  // of q beside the mode: of a state, and of a prediction
    static constexpr double ALONG = 1e-4;                    // of γ', relative, where modes meet

    double apart(const Series3& series, double y, Point& point, const Chain& chain) const {
        double off = 0.0;
        for (std::size_t i = 0; i < series.velocities().size(); ++i) {
            const int v = series.velocities()[i];
            off = std::max(off, std::fabs(series.position(y, i) - point.q()[chain.number_at[v]]) * size_[v]);
        }
        return off;
    }

    bool passes(const Series3& series, std::size_t part, const Chain& chain) const {
        if (through == nullptr) return true;
        const int k = parts_.list[part].inputs[0], m = m_;
        const double y = through->y()[k];
        if (!series.covers(y) || !(apart(series, y, *through, chain) < TOLERANCE)) return false;
        double off = 0.0, whole = 0.0;
        for (std::size_t i = 0; i < series.velocities().size(); ++i) {
            const int v = series.velocities()[i];
            const double slope = series.rate(y, 1, i);
            off = std::max(off, std::fabs(slope - through->G()[v * m + k]) * size_[v]);
            whole = std::max(whole, std::fabs(slope) * size_[v]);
        }
        return off < ALONG * whole;
    }


    const Parts& parts_;
    int m_;
    std::vector<double> size_;
    std::vector<std::vector<Series3>> known_;  // by part
    std::vector<const Series3*> used_;
    bool some_ = false;
};

}  // namespace rg
