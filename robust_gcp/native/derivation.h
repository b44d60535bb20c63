// Derivatives at many states, and of many steps of RK4, on regular ground; see derivatives.py, discrete.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "abi.h"
#include "chart_slopes.h"
#include "motion.h"
#include "path.h"
#include "slopes.h"

namespace rg {

class Derivation {
  public:
    explicit Derivation(const Description& d)
        : path_(d, true), motion_(d, path_), slopes_(d, path_, motion_), m_(d.m), nq_(d.nq), nv_(d.nv),
          width_(2 * d.m + d.nv), independent_(d.independent, d.independent + d.m),
          independent_q_(d.independent_q, d.independent_q + d.m), size_(d.size, d.size + d.nv),
          points_(3, Point(path_.layout)), x_(2 * d.m), state_(2 * d.m), sum_(2 * d.m), rate_(2 * d.m) {
        std::vector<int> input(d.nv, -1);
        for (int k = 0; k < m_; ++k) input[independent_[k]] = k;
        for (const Part& part : path_.parts.list) {
            if (!part.on_group) continue;
            const Body& b = path_.chain.bodies[part.joints[0]];
            OnGroup joint{b.kind, b.q, b.count, {}};
            for (int i = 0; i < b.count; ++i) joint.input[i] = input[b.first + i];
            groups_.push_back(joint);
        }
    }

    // u̇ at states, and the rows of `Slopes`, G and ∂v/∂y; null where not wanted.
    void at(const States& s) {
        for (std::int64_t i = 0; i < s.count; ++i) {
            Point& point = points_[0];
            Reason reason = set_out(s, i, point);
            if (reason == DONE) reason = evaluate(s, i, point);
            if (reason == DONE && s.rows != nullptr && !slopes_.at(point, s.rows + i * m_ * width_)) reason = NON_FINITE;
            if (reason == DONE) write(s, i, point);
            s.status[i] = reason;
        }
    }

    // Takes the steps between states again; G and ∂v/∂y are written for each state. A step is good where the states
    // at both its ends are, and where it ends at the second one. None is where inputs are no rates in a loop.
    void take(const States& s, const double* times) {
        if (path_.charted) return std::fill(s.status, s.status + s.count, CHART);
        const auto steps = static_cast<std::size_t>(s.count - 1);
        stages_.resize((4 * steps + 1) * static_cast<std::size_t>(m_ * width_));  // and at the last state
        charts_.resize(5 * steps * groups_.size());
        h_.resize(steps);
        bool ready = false;
        for (std::int64_t i = 0; i < s.count; ++i) {
            // the torque of the last step serves at its end, where no more than G is asked for
            const std::int64_t held = std::min<std::int64_t>(i, s.count - 2);
            Reason reason = ready ? DONE : set_out(s, i, *begin_);
            if (reason == DONE) reason = evaluate(s, held, *begin_);
            if (reason == DONE && !slopes_.at(*begin_, stage(static_cast<std::size_t>(i), 0))) reason = NON_FINITE;
            s.status[i] = reason;
            ready = false;
            if (reason != DONE) continue;
            write(s, i, *begin_);
            if (i == s.count - 1) return;
            h_[static_cast<std::size_t>(i)] = times[i + 1] - times[i];
            reason = step(s, i);
            if (reason == DONE && !(apart(s, i + 1, *end_) < s.same)) reason = BRANCH;
            s.status[i] = reason;
            if (reason != DONE) continue;
            std::swap(begin_, end_);
            for (const OnGroup& joint : groups_)
                for (int k = 0; k < joint.count; ++k) begin_->y()[joint.input[k]] = 0.0;
            ready = true;
        }
    }

    // Takes rows (count, 2m) that multiply changes of (η, u) after the step `last` − 1 back to before the step
    // `first`: `after` and `before` (steps, 2m) are added to each row at either end of a step, where they are given.
    // `by_tau` (last − first, count, nv): what multiplies the torques of each step.
    void pull(std::int64_t first, std::int64_t last, int count, double* rows, const double* after,
              const double* before, double* by_tau) {
        for (std::int64_t i = last; i-- > first;) {
            for (int r = 0; r < count; ++r) {
                double* row = rows + r * 2 * m_;
                if (after != nullptr) add(row, after + i * 2 * m_);
                pull_step(static_cast<std::size_t>(i), row, by_tau + ((i - first) * count + r) * nv_);
                if (before != nullptr) add(row, before + i * 2 * m_);
            }
        }
    }

  private:
    struct OnGroup { int kind, q, count, input[6]; };

    static constexpr double SHARE[] = {0.0, 0.5, 0.5, 1.0}, WEIGHT[] = {1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0};

    void add(double* row, const double* more) const {
        for (int k = 0; k < 2 * m_; ++k) row[k] += more[k];
    }

    // The point at a state, if it is one of the mechanism's on regular ground.
    Reason set_out(const States& s, std::int64_t i, Point& point) {
        const double *q = s.q + i * nq_, *v = s.v + i * nv_;
        std::copy(q, q + nq_, point.q());
        for (int k = 0; k < m_; ++k) {
            point.ydot()[k] = v[independent_[k]];
            point.y()[k] = independent_q_[k] < 0 ? 0.0 : q[independent_q_[k]];
        }
        if (!path_.settle(point)) return NEWTON;
        if (!(point.conditioning() >= s.zone)) return ZONE;
        if (!(apart(s, i, point) <= s.close)) return BRANCH;
        return DONE;
    }

    Reason evaluate(const States& s, std::int64_t i, Point& point) {
        Request request{};
        request.held = s.tau == nullptr ? nullptr : s.tau + i * nv_;
        const Reason reason = motion_.evaluate(0.0, point, request);
        if (reason != DONE) return reason;
        return std::all_of(motion_.ydd.begin(), motion_.ydd.end(), [](double x) { return std::isfinite(x); })
                   ? DONE
                   : NON_FINITE;
    }

    void write(const States& s, std::int64_t i, Point& point) {
        if (s.ydd != nullptr) std::copy(motion_.ydd.begin(), motion_.ydd.end(), s.ydd + i * m_);
        if (s.G != nullptr) std::copy(point.G(), point.G() + nv_ * m_, s.G + i * nv_ * m_);
        if (s.v_y != nullptr) std::copy(slopes_.v_y().begin(), slopes_.v_y().end(), s.v_y + i * nv_ * m_);
    }

    // Largest difference between a point and a state: of numbers in q, dimensionless, and of v relative to the
    // largest one.
    double apart(const States& s, std::int64_t i, Point& point) {
        const double *q = s.q + i * nq_, *v = s.v + i * nv_;
        double worst = 0.0, fastest = 0.0, off = 0.0;
        for (int j : path_.chain.all) {
            const Body& b = path_.chain.bodies[j];
            const bool ball = b.kind == SPHERICAL || b.kind == FREE_FLYER;
            const int end = b.q + NUMBERS[b.kind].q, turns = ball ? end - 4 : end;
            const bool flat = NUMBERS[b.kind].q == b.count;
            for (int k = b.q; k < turns; ++k)
                keep(worst, (point.q()[k] - q[k]) * (flat ? size_[b.first + k - b.q] : 1.0));
            double same = 0.0, opposite = 0.0;  // ± q is one rotation
            for (int k = turns; k < end; ++k) {
                keep(same, point.q()[k] - q[k]);
                keep(opposite, point.q()[k] + q[k]);
            }
            keep(worst, std::min(same, opposite));
        }
        path_.product(point, point.ydot(), motion_.v.data());
        for (int k = 0; k < nv_; ++k) {
            keep(fastest, v[k] * size_[k]);
            keep(off, (motion_.v[k] - v[k]) * size_[k]);
        }
        keep(worst, off > 0.0 ? off / (s.at_rest + fastest) : 0.0);
        return worst;
    }

    // Keeps a NaN.
    static void keep(double& worst, double value) {
        const double magnitude = std::fabs(value);
        if (!(magnitude <= worst)) worst = magnitude;
    }

    // One step from the point at its start, which was evaluated, to `end_`.
    Reason step(const States& s, std::int64_t i) {
        const auto number = static_cast<std::size_t>(i);
        const double h = h_[number];
        std::copy(begin_->y(), begin_->y() + m_, x_.begin());
        std::copy(begin_->ydot(), begin_->ydot() + m_, x_.begin() + m_);
        std::fill(sum_.begin(), sum_.end(), 0.0);
        Point *anchor = begin_, *spare = middle_;
        for (std::size_t stage = 0; stage < 4; ++stage) {
            if (stage > 0) {
                for (int k = 0; k < 2 * m_; ++k) state_[k] = x_[k] + h * SHARE[stage] * rate_[k];
                Reason reason = move(s, *anchor, *spare);
                if (reason == DONE) reason = evaluate(s, i, *spare);
                if (reason == DONE && !slopes_.at(*spare, this->stage(number, stage))) reason = NON_FINITE;
                if (reason != DONE) return reason;
                std::swap(anchor, spare);
                if (spare == begin_) spare = end_;  // the start is needed until the end
            }
            if (!chart(*anchor, 5 * number + stage)) return CHART;
            std::copy(anchor->ydot(), anchor->ydot() + m_, rate_.begin());
            path_.rate_on_groups(*anchor, rate_.data());
            std::copy(motion_.ydd.begin(), motion_.ydd.end(), rate_.begin() + m_);
            for (int k = 0; k < 2 * m_; ++k) sum_[k] += WEIGHT[stage] * rate_[k];
        }
        for (int k = 0; k < 2 * m_; ++k) state_[k] = x_[k] + h * sum_[k];
        const Reason reason = move(s, *anchor, *spare);
        if (reason != DONE) return reason;
        end_ = spare;
        middle_ = anchor;
        return chart(*end_, 5 * number + 4) ? DONE : CHART;
    }

    // The point at `state_`, if the regular path is good enough; see RegularGround in ground.py.
    Reason move(const States& s, Point& anchor, Point& point) {
        if (Reason reason = path_.step(anchor, begin_->q(), state_.data(), state_.data() + m_, point)) return reason;
        const double needed = std::max(s.zone, std::min(POOR, PACE * point.turn));
        if (!(point.conditioning() >= needed)) return ZONE;
        return path_.same_branch(anchor, point) ? DONE : BRANCH;
    }

    double* stage(std::size_t step, std::size_t stage) {
        return stages_.data() + (4 * step + stage) * static_cast<std::size_t>(m_ * width_);
    }

    bool chart(Point& point, std::size_t place) {
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
    void pull_step(std::size_t number, double* row, double* by_tau) {
        const auto by_start = [](const ChartSlopes& c) { return c.by_start; };
        const auto by_w = [](const ChartSlopes& c) { return c.by_w; };
        const auto rate_by_w = [](const ChartSlopes& c) { return c.rate_by_w; };
        const auto rate_by_u = [](const ChartSlopes& c) { return c.rate_by_u; };
        const double h = h_[number];
        const std::size_t m = static_cast<std::size_t>(m_);
        eta_.assign(m, 0.0), end_y_.assign(m, 0.0), slope_y_.assign(m, 0.0), slope_u_.assign(m, 0.0);
        through(5 * number + 4, 1.0, by_start, row, eta_.data());
        through(5 * number + 4, 1.0, by_w, row, end_y_.data());
        last_.assign(row + m_, row + 2 * m_);
        std::fill(by_tau, by_tau + nv_, 0.0);
        for (std::size_t s = 4; s-- > 0;) {
            const std::size_t place = 5 * number + s;
            for (std::size_t k = 0; k < m; ++k) {
                slope_y_[k] += h * WEIGHT[s] * end_y_[k];
                slope_u_[k] += h * WEIGHT[s] * last_[k];
            }
            moved_.assign(m, 0.0), dy_.assign(m, 0.0), du_.assign(m, 0.0);
            const double* rows = stage(number, s);
            for (std::size_t k = 0; k < m; ++k, rows += width_) {
                const double x = slope_u_[k];
                for (std::size_t j = 0; j < m; ++j) moved_[j] += x * rows[j];
                for (std::size_t j = 0; j < m; ++j) du_[j] += x * rows[m + j];
                for (int j = 0; j < nv_; ++j) by_tau[j] += x * rows[2 * m + static_cast<std::size_t>(j)];
            }
            through(place, 1.0, by_start, moved_.data(), eta_.data());
            through(place, 1.0, by_w, moved_.data(), dy_.data());
            through(place, 0.0, rate_by_w, slope_y_.data(), dy_.data());
            through(place, 1.0, rate_by_u, slope_y_.data(), du_.data());
            for (std::size_t k = 0; k < m; ++k) {
                row[m + k] += du_[k];
                slope_y_[k] = h * SHARE[s] * dy_[k];
                slope_u_[k] = h * SHARE[s] * du_[k];
            }
        }
        std::copy(eta_.begin(), eta_.end(), row);
    }

    Path path_;
    Motion motion_;
    Slopes slopes_;
    int m_, nq_, nv_, width_;
    std::vector<int> independent_, independent_q_;
    Cells<double> size_;
    std::vector<OnGroup> groups_;
    std::vector<Point> points_;
    Point *begin_ = &points_[0], *middle_ = &points_[1], *end_ = &points_[2];
    Cells<double> x_, state_, sum_, rate_;
    std::vector<double> h_, stages_;
    std::vector<ChartSlopes> charts_;  // of four stages and the end of each step
    std::vector<double> eta_, end_y_, slope_y_, slope_u_, last_, moved_, dy_, du_, own_;
};

}  // namespace rg
