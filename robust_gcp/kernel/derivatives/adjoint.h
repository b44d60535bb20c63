// Derivatives of steps of RK4 taken backwards: what multiplies changes after a step becomes what multiplies those
// before it; see `Step.jacobians_by` in discrete.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "abi.h"
#include "derivatives/chart_derivatives.h"
#include "path/path.h"

namespace rg {

class Adjoint {
  public:
    static constexpr double SHARE[] = {0.0, 0.5, 0.5, 1.0}, WEIGHT[] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};

    std::vector<double> h;  // of each step

    Adjoint(const Description& d, const Path& path) : m_(d.m), nv_(d.nv), width_(2 * d.m + d.nv) {
        independent_.assign(d.independent, d.independent + d.m);
        std::vector<int> input(d.nv, -1);
        for (int k = 0; k < m_; ++k) input[d.independent[k]] = k;
        for (const Part& part : path.parts.list) {
            if (!part.on_group) continue;
            const Body& b = path.chain.bodies[part.joints[0]];
            OnGroup joint{b.kind, b.count, {}};
            for (int i = 0; i < b.count; ++i) joint.input[i] = input[b.first + i];
            groups_.push_back(joint);
        }
    }

    void resize(std::size_t steps) {
        stages_.resize((4 * steps + 1) * static_cast<std::size_t>(m_ * width_));  // and at the last state
        charts_.resize(5 * steps * groups_.size());
        h.resize(steps);
    }

    // The first of these inputs move as prescribed.
    void drive(const std::vector<int>& which, std::size_t drives) { driven_.assign(which.begin(), which.begin() + drives); }

    // Rows of `Slopes` (m, 2m + nv) at a stage of a step.
    double* stage(std::size_t step, std::size_t stage) {
        return stages_.data() + (4 * step + stage) * static_cast<std::size_t>(m_ * width_);
    }

    // Takes up how joints on groups move at a stage, or at the end; false where they are too far in their charts.
    bool chart(Point& point, std::size_t step, std::size_t stage) {
        const std::size_t place = 5 * step + stage;
        for (std::size_t g = 0; g < groups_.size(); ++g) {
            double w[6], u[6];
            for (int k = 0; k < groups_[g].count; ++k) {
                w[k] = point.y()[groups_[g].input[k]];
                u[k] = point.ydot()[groups_[g].input[k]];
                if (!(std::fabs(w[k]) < WIDEST_CHART)) return false;
            }
            charts_[place * groups_.size() + g] = ChartSlopes(groups_[g].kind, w, u);
        }
        return true;
    }

    // A new chart about the point.
    void renew(Point& point) const {
        for (const OnGroup& joint : groups_)
            for (int k = 0; k < joint.count; ++k) point.y()[joint.input[k]] = 0.0;
    }

    // Adds to the derivatives of u̇ at stages those of torques that follow the state, by y and u (count, nv, m) each.
    void follow(std::size_t first, std::size_t count, const double* tau_y, const double* tau_u) {
        const std::size_t m = static_cast<std::size_t>(m_), nv = static_cast<std::size_t>(nv_);
        double* rows = stages_.data() + first * m * static_cast<std::size_t>(width_);
        for (std::size_t s = 0; s < count; ++s, tau_y += nv * m, tau_u += nv * m)
            for (std::size_t k = 0; k < m; ++k, rows += width_)
                for (std::size_t j = 0; j < nv; ++j) {
                    if (is_driven(static_cast<int>(j))) continue;
                    for (std::size_t a = 0; a < m; ++a) {
                        rows[a] += rows[2 * m + j] * tau_y[j * m + a];
                        rows[m + a] += rows[2 * m + j] * tau_u[j * m + a];
                    }
                }
    }

    // Derivatives of the first step by (η, u), (2m, 2m), and by torques held over it, (2m, nv).
    void matrices(double* A, double* B) {
        std::fill(A, A + 4 * m_ * m_, 0.0);
        for (int k = 0; k < 2 * m_; ++k) A[k * (2 * m_ + 1)] = 1.0;
        for (int k = 0; k < 2 * m_; ++k) pull_step(0, A + k * 2 * m_, B + k * nv_, nullptr, nullptr);
    }

    // Takes rows (count, 2m) that multiply changes of (η, u) after the step `last` − 1 back to before the step
    // `first`: `after` and `before` (steps, 2m) are added to each row at either end of a step, where they are given.
    // `by_tau` (last − first, count, nv): what multiplies the torques of each step; `by_stage`
    // (last − first, count, 4, nv) those of its stages, if it is given. Where torques held over the steps follow the
    // states before them, `feedback` (last − first, nv, 2m) says how. `by_drive` (last − first, count, 5, 3, driven),
    // where it is given: those of y, ẏ and ÿ of driven inputs at the stages and at the end of each step.
    void pull(std::int64_t first, std::int64_t last, int count, double* rows, const double* after,
              const double* before, const double* feedback, double* by_tau, double* by_stage, double* by_drive) {
        for (std::int64_t i = last; i-- > first;) {
            for (int r = 0; r < count; ++r) {
                double* row = rows + r * 2 * m_;
                if (after != nullptr) add(row, after + i * 2 * m_);
                const std::int64_t at = (i - first) * count + r;
                double* by = by_tau + at * nv_;
                pull_step(static_cast<std::size_t>(i), row, by, by_stage == nullptr ? nullptr : by_stage + at * 4 * nv_,
                          by_drive == nullptr ? nullptr : by_drive + static_cast<std::size_t>(at) * 15 * driven_.size());
                for (int j = 0; feedback != nullptr && j < nv_; ++j)
                    for (int k = 0; k < 2 * m_; ++k) row[k] += by[j] * feedback[((i - first) * nv_ + j) * 2 * m_ + k];
                if (before != nullptr) add(row, before + i * 2 * m_);
            }
        }
    }

  private:
    struct OnGroup { int kind, count, input[6]; };

    void add(double* row, const double* more) const {
        for (int k = 0; k < 2 * m_; ++k) row[k] += more[k];
    }

    // to += from times a matrix of the joints on groups; of other inputs it is a number.
    template <typename Pick>
    void through(std::size_t place, double others, Pick pick, const double* from, double* to) {
        own_.assign(static_cast<std::size_t>(m_), others);
        for (std::size_t g = 0; g < groups_.size(); ++g) {
            const OnGroup& joint = groups_[g];
            const double* matrix = pick(charts_[place * groups_.size() + g]);
            for (int j = 0; j < joint.count; ++j) {
                own_[static_cast<std::size_t>(joint.input[j])] = 0.0;
                for (int i = 0; i < joint.count; ++i)
                    to[joint.input[j]] += from[joint.input[i]] * matrix[i * joint.count + j];
            }
        }
        for (int k = 0; k < m_; ++k) to[k] += own_[static_cast<std::size_t>(k)] * from[k];
    }

    // A row by (η, u) after a step becomes one before it; see `Step.jacobians_by` in discrete.py.
    void pull_step(std::size_t number, double* row, double* by_tau, double* by_stage, double* by_drive) {
        const auto by_start = [](const ChartSlopes& c) { return c.by_start; };
        const auto by_w = [](const ChartSlopes& c) { return c.by_w; };
        const auto rate_by_w = [](const ChartSlopes& c) { return c.rate_by_w; };
        const auto rate_by_u = [](const ChartSlopes& c) { return c.rate_by_u; };
        const double step = h[number];
        const std::size_t m = static_cast<std::size_t>(m_);
        told(row, row + m_, nullptr, by_drive, 4);
        eta_.assign(m, 0.0), end_y_.assign(m, 0.0), slope_y_.assign(m, 0.0), slope_u_.assign(m, 0.0);
        through(5 * number + 4, 1.0, by_start, row, eta_.data());
        through(5 * number + 4, 1.0, by_w, row, end_y_.data());
        last_.assign(row + m_, row + 2 * m_);
        std::fill(by_tau, by_tau + nv_, 0.0);
        for (std::size_t s = 4; s-- > 0;) {
            const std::size_t place = 5 * number + s;
            for (std::size_t k = 0; k < m; ++k) {
                slope_y_[k] += step * WEIGHT[s] * end_y_[k];
                slope_u_[k] += step * WEIGHT[s] * last_[k];
            }
            moved_.assign(m, 0.0), dy_.assign(m, 0.0), du_.assign(m, 0.0);
            const double* rows = stage(number, s);
            for (std::size_t k = 0; k < m; ++k, rows += width_) {
                const double x = slope_u_[k];
                for (std::size_t j = 0; j < m; ++j) moved_[j] += x * rows[j];
                for (std::size_t j = 0; j < m; ++j) du_[j] += x * rows[m + j];
                for (int j = 0; j < nv_; ++j) by_tau[j] += x * rows[2 * m + static_cast<std::size_t>(j)];
            }
            if (by_stage != nullptr) share(number, s, by_stage + s * static_cast<std::size_t>(nv_));
            told(moved_.data(), du_.data(), stage(number, s), by_drive, s);
            through(place, 1.0, by_start, moved_.data(), eta_.data());
            through(place, 1.0, by_w, moved_.data(), dy_.data());
            through(place, 0.0, rate_by_w, slope_y_.data(), dy_.data());
            through(place, 1.0, rate_by_u, slope_y_.data(), du_.data());
            for (std::size_t k = 0; k < m; ++k) {
                row[m + k] += du_[k];
                slope_y_[k] = step * SHARE[s] * dy_[k];
                slope_u_[k] = step * SHARE[s] * du_[k];
            }
        }
        std::copy(eta_.begin(), eta_.end(), row);
        for (int k : driven_) by_tau[independent_[k]] = 0.0;
    }

    bool is_driven(int velocity) const {
        return std::any_of(driven_.begin(), driven_.end(), [&](int k) { return independent_[k] == velocity; });
    }

    // What multiplies y, ẏ and, by the rows of a stage, ÿ of driven inputs goes to those who prescribe them.
    void told(double* by_y, double* by_u, const double* rows, double* by_drive, std::size_t place) {
        const std::size_t n = driven_.size();
        for (std::size_t k = 0; k < n; ++k) {
            const int input = driven_[k];
            double by_a = 0.0;
            for (int j = 0; rows != nullptr && j < m_; ++j)
                by_a += slope_u_[static_cast<std::size_t>(j)] * rows[j * width_ + 2 * m_ + independent_[input]];
            if (by_drive != nullptr) {
                double* to = by_drive + place * 3 * n + k;
                to[0] = by_y[input], to[n] = by_u[input], to[2 * n] = by_a;
            }
            by_y[input] = by_u[input] = 0.0;
        }
    }

    // What multiplies the torques of one stage.
    void share(std::size_t number, std::size_t stage_number, double* by) {
        const double* rows = stage(number, stage_number) + 2 * m_;
        std::fill(by, by + nv_, 0.0);
        for (int k = 0; k < m_; ++k, rows += width_)
            for (int j = 0; j < nv_; ++j) by[j] += slope_u_[static_cast<std::size_t>(k)] * rows[j];
        for (int k : driven_) by[independent_[k]] = 0.0;
    }

    int m_, nv_, width_;
    std::vector<OnGroup> groups_;
    std::vector<int> independent_, driven_;  // the velocity of each input; inputs that move as prescribed
    std::vector<double> stages_;
    std::vector<ChartSlopes> charts_;  // of four stages and the end of each step
    std::vector<double> eta_, end_y_, slope_y_, slope_u_, last_, moved_, dy_, du_, own_;
};

}  // namespace rg
