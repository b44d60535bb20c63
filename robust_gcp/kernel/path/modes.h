// A part's mode of one or two coordinates as a series about a place, singular or not, where Newton's method on K_d
// finds no good point; see `Around` in taylor_series.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "tree/chain.h"
#include "tree/parts.h"
#include "path/point.h"

namespace rg {

// γ of a part's velocities by its one or two inputs: Σ c_jk z₁^j z₂^k, with z the shares of y less the centre.
class Expansion {
  public:
    Expansion(const ModeSeries& given, const std::vector<int>& velocities)
        : n_(static_cast<int>(given.inputs)), count_(given.count), orders_{given.first, given.second}, velocities_(velocities),
          center_(given.center, given.center + n_), shares_(given.shares, given.shares + n_ * n_),
          terms_(given.terms, given.terms + given.first * given.second * given.count) {}

    // Whether it serves at y, a row of all inputs; where it does, that is where it is asked for next.
    bool look(const double* y, const std::vector<int>& inputs) {
        double z[2] = {};
        for (int i = 0; i < n_; ++i) {
            for (int a = 0; a < n_; ++a) z[i] += shares_[i * n_ + a] * (y[inputs[a]] - center_[a]);
            if (!(std::fabs(z[i]) <= INSIDE)) return false;
        }
        for (int i = 0; i < 2; ++i) raise(z[i], orders_[i], powers_[i]);
        return true;
    }

    // γ of a velocity by its place in the part.
    double position(std::int64_t v) const { return sum(0, 0, v); }

    // γ_a.
    void slopes(std::int64_t v, double* by) const {
        const double own[2] = {sum(1, 0, v), n_ > 1 ? sum(0, 1, v) : 0.0};
        for (int a = 0; a < n_; ++a) {
            by[a] = 0.0;
            for (int i = 0; i < n_; ++i) by[a] += own[i] * shares_[i * n_ + a];
        }
    }

    // γ_ab into `second` (2, 2), and γ_abc u_b u_c into `third` (2,), with ẏ = u.
    void bends(std::int64_t v, const double* u, double* second, double* third) const {
        double w[2] = {0.0, 0.0};
        for (int i = 0; i < n_; ++i)
            for (int a = 0; a < n_; ++a) w[i] += shares_[i * n_ + a] * u[a];
        double twice[3] = {}, thrice[4] = {};  // by how many of the shares are the second one
        for (int k = 0; k <= 2 * (n_ - 1); ++k) twice[k] = sum(2 - k, k, v);
        for (int k = 0; k <= 3 * (n_ - 1); ++k) thrice[k] = sum(3 - k, k, v);
        for (int a = 0; a < n_; ++a) {
            third[a] = 0.0;
            for (int b = 0; b < n_; ++b) second[2 * a + b] = 0.0;
            for (int i = 0; i < n_; ++i) {
                const double way = shares_[i * n_ + a];
                for (int b = 0; b < n_; ++b)
                    for (int j = 0; j < n_; ++j) second[2 * a + b] += twice[i + j] * way * shares_[j * n_ + b];
                for (int j = 0; j < n_; ++j)
                    for (int k = 0; k < n_; ++k) third[a] += thrice[i + j + k] * way * w[j] * w[k];
            }
        }
    }

    const std::vector<int>& velocities() const { return velocities_; }

  private:
    static constexpr double INSIDE = 0.5;  // as in taylor_series.py

    // z^k and its derivatives of order 1, 2 and 3, one after the other.
    static void raise(double z, std::int64_t count, std::vector<double>& powers) {
        powers.resize(static_cast<std::size_t>(4 * count));  // what is zero stays so
        powers[0] = 1.0;
        for (std::int64_t k = 1; k < count; ++k) powers[k] = powers[k - 1] * z;
        for (std::int64_t order = 1; order < 4; ++order)
            for (std::int64_t k = 1; k < count; ++k)
                powers[order * count + k] = static_cast<double>(k) * powers[(order - 1) * count + k - 1];
    }

    double sum(int one, int two, std::int64_t v) const {
        const double *first = powers_[0].data() + one * orders_[0], *second = powers_[1].data() + two * orders_[1];
        double whole = 0.0;
        for (std::int64_t j = orders_[0]; j-- > 0;) {
            const double* row = terms_.data() + j * orders_[1] * count_ + v;
            double part = 0.0;
            for (std::int64_t k = orders_[1]; k-- > 0;) part += second[k] * row[k * count_];
            whole += first[j] * part;
        }
        return whole;
    }

    int n_;
    std::int64_t count_, orders_[2];
    std::vector<int> velocities_;
    std::vector<double> center_, shares_, terms_;
    std::vector<double> powers_[2];
};

// All that are known, and which of them are in use at the point placed last.
class Modes {
  public:
    bool on = false;
    Point* through = nullptr;         // where it is given, a series serves that the mode at this point lies on
    const double* moving = nullptr;   // where it is given, one along which the part has these velocities (nv,)
    std::vector<double> bend, third;  // γ_ab (2, 2) and γ_abc u_b u_c (2,) by velocity, of parts in use

    Modes(const Description& d, const Parts& parts)
        : bend(4 * d.nv), third(2 * d.nv), parts_(parts), m_(d.m), size_(d.size, d.size + d.nv), known_(parts.list.size()),
          used_(parts.list.size()) {}

    bool some() const { return some_; }
    bool used(std::size_t part) const { return used_[part] != nullptr; }

    // False where it is not one of a part with so many inputs.
    bool learn(const ModeSeries& given) {
        const std::vector<int> velocities(given.velocities, given.velocities + given.count);
        const int part = parts_.of_velocity[velocities[0]];
        std::vector<int> own = parts_.list[part].velocities, asked = velocities;
        std::sort(own.begin(), own.end());
        std::sort(asked.begin(), asked.end());
        if (own != asked || parts_.list[part].count() != given.inputs || given.inputs > 2) return false;
        known_[part].emplace_back(given, velocities);
        return some_ = true;
    }

    // Puts a part on the series whose mode passes its numbers in q; false where none does.
    bool place(std::size_t part, Point& point, const Chain& chain) {
        used_[part] = nullptr;
        if (!on || known_[part].empty()) return false;
        const std::vector<int>& inputs = parts_.list[part].inputs;
        double nearest = TOLERANCE + SHARE * point.distance;
        for (Expansion& series : known_[part]) {
            if (!passes(series, inputs, chain) || !series.look(point.y(), inputs) || !moves(series, inputs, point)) continue;
            const double off = apart(series, point, chain);
            if (off < nearest) nearest = off, used_[part] = &series;
        }
        if (used_[part] == nullptr) return false;
        const std::vector<int>& velocities = used_[part]->velocities();
        for (std::size_t i = 0; i < velocities.size(); ++i)
            point.q()[chain.number_at[velocities[i]]] = used_[part]->position(static_cast<std::int64_t>(i));
        return true;
    }

    // γ_a of a part into G (nv, m), its further derivatives into `bend` and `third`, and γ_ab u_a u_b into g (nv,).
    void rates(std::size_t part, Point& point, double* g) {
        const Expansion& series = *used_[part];
        const std::vector<int>& inputs = parts_.list[part].inputs;
        const std::size_t n = inputs.size();
        double slopes[2], u[2] = {};
        for (std::size_t a = 0; a < n; ++a) u[a] = point.ydot()[inputs[a]];
        for (std::size_t i = 0; i < series.velocities().size(); ++i) {
            const int v = series.velocities()[i];
            series.slopes(static_cast<std::int64_t>(i), slopes);
            series.bends(static_cast<std::int64_t>(i), u, &bend[4 * v], &third[2 * v]);
            g[v] = 0.0;
            for (std::size_t a = 0; a < n; ++a) {
                point.G()[v * m_ + inputs[a]] = slopes[a];
                g[v] += by(v, a, u) * u[a];
            }
        }
    }

    // Σ_b γ_ab x_b of a velocity, with x (2,).
    double by(int v, std::size_t a, const double* x) const {
        return bend[4 * v + 2 * a] * x[0] + bend[4 * v + 2 * a + 1] * x[1];
    }

  private:
    static constexpr double TOLERANCE = 1e-6, SHARE = 0.25;  // of q beside the mode: of a state, and of a prediction
    static constexpr double ALONG = 1e-4;                    // of γ', relative, where modes meet

    // Where `series` looks.
    double apart(const Expansion& series, Point& point, const Chain& chain) const {
        double off = 0.0;
        for (std::size_t i = 0; i < series.velocities().size(); ++i) {
            const int v = series.velocities()[i];
            const double at = series.position(static_cast<std::int64_t>(i));
            off = std::max(off, std::fabs(at - point.q()[chain.number_at[v]]) * size_[v]);
        }
        return off;
    }

    // Where `series` looks: modes that meet are told apart by v = γ_a u_a.
    bool moves(const Expansion& series, const std::vector<int>& inputs, Point& point) const {
        if (moving == nullptr) return true;
        return agrees(series, [&](int v, const double* slopes, auto compare) {
            double rate = 0.0;
            for (std::size_t a = 0; a < inputs.size(); ++a) rate += slopes[a] * point.ydot()[inputs[a]];
            compare(moving[v], rate);
        });
    }

    bool passes(Expansion& series, const std::vector<int>& inputs, const Chain& chain) const {
        if (through == nullptr) return true;
        if (!series.look(through->y(), inputs) || !(apart(series, *through, chain) < TOLERANCE)) return false;
        return agrees(series, [&](int v, const double* slopes, auto compare) {
            for (std::size_t a = 0; a < inputs.size(); ++a) compare(slopes[a], through->G()[v * m_ + inputs[a]]);
        });
    }

    // Whether what `each` compares for a velocity, by γ_a of it, is the same to `ALONG` of the largest.
    template <typename Each>
    bool agrees(const Expansion& series, Each each) const {
        double off = 0.0, whole = 0.0, slopes[2];
        for (std::size_t i = 0; i < series.velocities().size(); ++i) {
            const int v = series.velocities()[i];
            series.slopes(static_cast<std::int64_t>(i), slopes);
            each(v, slopes, [&](double one, double other) {
                off = std::max(off, std::fabs(one - other) * size_[v]);
                whole = std::max(whole, std::fabs(one) * size_[v]);
            });
        }
        return off < ALONG * whole || off == 0.0;
    }

    const Parts& parts_;
    int m_;
    std::vector<double> size_;
    std::vector<std::vector<Expansion>> known_;  // by part
    std::vector<Expansion*> used_;
    bool some_ = false;
};

}  // namespace rg
