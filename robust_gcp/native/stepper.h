// RK4 steps until the end of the batch, or until something rare happens.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "bridge.h"
#include "motion.h"
#include "path.h"

namespace rg {

class alignas(CACHE_LINE) Stepper {
  public:
    explicit Stepper(const Description& d)
        : path(d), motion_(d, path), works_(d.works), n_(2 * d.m + d.works),
          independent_(d.m > 0 ? d.independent[0] : 0), independent_v_(d.independent, d.independent + d.m), independent_q_(d.m > 0 ? d.independent_q[0] : 0),
          slots_(SLOTS, Point(path.layout)), x_(n_), stage_(n_), sum_(n_), rate_(n_) {
        for (int k = 0; k < d.m; ++k)
            if (d.independent_q[k] < 0) on_groups_.push_back(k);
    }

    Path path;

    void run(Request& r) {
        path.newton_iterations = path.evaluations = motion_.force_evaluations = 0;
        rhs_ = zone_ = 0;
        r.completed = 0;
        count(r);
        r.safe_step = -1;
        r.reason = DONE;
        const int m = path.layout.m;
        anchor_ = accepted_ = &slots_[0];
        before_ = safe_ = nullptr;
        anchor_->read(r.anchor);
        std::copy(r.x, r.x + n_, x_.begin());
        std::copy(r.ydd, r.ydd + m, motion_.ydd.begin());
        motion_.power = r.power;
        std::vector<Bridge> bridges;
        if (r.table != nullptr) bridges.emplace_back(*r.table, path.layout, independent_, independent_q_);
        bridge_ = bridges.empty() ? nullptr : &bridges[0];
        const Bridge* known = bridge_;
        bool on_bridge = bridge_ != nullptr;  // at the last accepted output
        Cells<double> before_x, before_ydd, safe_x, last_ydd(r.ydd, r.ydd + m), last_tau(r.tau, r.tau + path.layout.nv);
        double last_power = r.power;
        for (std::int64_t i = 0; i < r.steps && r.reason == DONE; ++i) {
            const Reason reason = step(r, r.times[i], r.times[i + 1]);
            if (reason != DONE) {
                r.reason = reason;
                break;
            }
            // accepted
            const bool passed = signs_differ(*accepted_, *anchor_) ||
                                (known != nullptr && known->passes(accepted_->y()[0], anchor_->y()[0]));
            before_ = accepted_;
            before_x.swap(x_);
            accepted_ = anchor_;
            x_ = sum_;
            for (int k : on_groups_) accepted_->y()[k] = x_[k] = 0.0;  // a new chart about the point
            on_bridge = bridge_ != nullptr;
            before_ydd.swap(last_ydd);
            last_ydd = motion_.ydd;
            last_tau = motion_.tau;
            last_power = motion_.power;
            r.completed = i + 1;
            count(r);
            if (accepted_->conditioning() >= POOR) {
                safe_ = accepted_;
                safe_x = x_;
                r.safe_step = i + 1;
            }
            if ((i + 1) % r.every == 0) output(r, (i + 1) / r.every - 1);
            if (passed)
                r.reason = PASSED;
            else if (!on_bridge && exceeds(r, *accepted_))
                r.reason = CHART;
        }
        accepted_->write(r.anchor);
        std::copy(x_.begin(), x_.end(), r.x);
        std::copy(last_ydd.begin(), last_ydd.end(), r.ydd);
        std::copy(last_tau.begin(), last_tau.end(), r.tau);
        r.power = last_power;
        write(r.before, before_, before_x);
        if (before_ != nullptr && r.before != nullptr)
            std::copy(before_ydd.begin(), before_ydd.end(), r.before + path.layout.size + n_);
        write(r.safe, safe_, safe_x);
        r.on_bridge = on_bridge;
    }

  private:
    // Whether the independent velocities are about to turn back, or may be: see simulation/coordinates.py.
    bool exceeds(const Request& r, Point& point) const {
        if (r.sizes == nullptr) return false;
        const int m = path.layout.m;
        const double* G = point.G();
        for (int j = 0; j < m; ++j) {
            const double own = r.sizes[independent_v_[j]];
            if (!(own > 0.0)) continue;
            for (int i = 0; i < path.layout.nv; ++i)
                if (std::abs(G[i * m + j]) * (r.sizes[i] / own) > r.limit) return true;
        }
        return false;
    }

    static constexpr int SLOTS = 6;  // anchor, trial, accepted, before it, safe, and one more

    // What the steps accepted so far took; a step that is given up is done, and counted, by Python.
    void count(Request& r) const {
        r.rhs = rhs_;
        r.newton = path.newton_iterations;
        r.constraint_evaluations = path.evaluations;
        r.force_evaluations = motion_.force_evaluations;
        r.zone_evaluations = zone_;
    }

    Reason step(const Request& r, double t, double end) {
        const double h = end - t, half = 0.5 * h;
        rate(*accepted_, rate_);
        sum_ = rate_;
        advance(half);
        if (Reason reason = evaluate(r, t + half)) return reason;
        gather(2.0);
        advance(half);
        if (Reason reason = evaluate(r, t + half)) return reason;
        gather(2.0);
        advance(h);
        if (Reason reason = evaluate(r, t + h)) return reason;
        gather(1.0);
        bool finite = true;
        for (int i = 0; i < n_; ++i) {
            sum_[i] = stage_[i] = x_[i] + (h / 6.0) * sum_[i];
            finite = finite && std::isfinite(sum_[i]);
        }
        return finite ? evaluate(r, end) : NON_FINITE;
    }

    void gather(double weight) {
        rate(*anchor_, rate_);
        for (int i = 0; i < n_; ++i) sum_[i] += weight * rate_[i];
    }

    void advance(double h) {
        for (int i = 0; i < n_; ++i) stage_[i] = x_[i] + h * rate_[i];
    }

    // ẋ at a point that was evaluated just now.
    void rate(Point& point, Cells<double>& rate) {
        const int m = path.layout.m;
        std::copy(point.ydot(), point.ydot() + m, rate.begin());
        path.rate_on_groups(point, rate.data());
        std::copy(motion_.ydd.begin(), motion_.ydd.end(), rate.begin() + m);
        if (works_) rate[2 * m] = motion_.power;
    }

    // The point and ÿ at the state `stage_`; the point becomes the anchor.
    Reason evaluate(const Request& r, double t) {
        const int m = path.layout.m;
        const double *y = stage_.data(), *ydot = y + m;
        Point& point = spare();
        ++rhs_;
        if (bridge_ != nullptr) {
            if (bridge_->contains(y[0])) {
                bridge_->at(y[0], ydot[0], point);
                ++zone_;
                path.survey(point);
                anchor_ = &point;
                return motion_.evaluate(t, point, r);
            }
            point.read(bridge_->exit(y[0]));
            bridge_ = nullptr;
            anchor_ = &point;
            return evaluate_regular(r, t, spare());
        }
        return evaluate_regular(r, t, point);
    }

    Reason evaluate_regular(const Request& r, double t, Point& point) {
        const double *y = stage_.data(), *ydot = y + path.layout.m;
        if (Reason reason = path.step(*anchor_, accepted_->q(), y, ydot, point)) return reason;
        if (!(point.conditioning() >= r.zone)) return ZONE;
        if (r.same_branch && !path.same_branch(*anchor_, point)) return BRANCH;
        anchor_ = &point;
        return motion_.evaluate(t, point, r);
    }

    Point& spare() {
        for (Point& point : slots_)
            if (&point != anchor_ && &point != accepted_ && &point != before_ && &point != safe_) return point;
        return slots_[0];  // never: five places are taken at most
    }

    bool signs_differ(Point& a, Point& b) const {
        auto sign = [](double x) { return (x > 0.0) - (x < 0.0); };
        for (int i = 0; i < path.layout.blocks; ++i)
            if (sign(a.det()[i]) != sign(b.det()[i])) return true;
        return false;
    }

    void output(Request& r, std::int64_t row) {
        const Layout& l = path.layout;
        Point& point = *accepted_;
        if (r.q_out) std::copy(point.q(), point.q() + l.nq, r.q_out + row * l.nq);
        if (r.v_out) std::copy(motion_.v.begin(), motion_.v.end(), r.v_out + row * l.nv);
        if (r.tau_out) std::copy(motion_.tau.begin(), motion_.tau.end(), r.tau_out + row * l.nv);
        if (r.energy_out) r.energy_out[row] = motion_.energy(point);
        if (r.work_out && works_) r.work_out[row] = x_[2 * l.m];
        if (!r.a_out) return;
        double* a = r.a_out + row * l.nv;
        path.product(point, motion_.ydd.data(), a);
        for (int i = 0; i < l.nv; ++i) a[i] += point.g()[i];
    }

    void write(double* to, const Point* point, const Cells<double>& x) const {
        if (point == nullptr || to == nullptr) return;
        point->write(to);
        std::copy(x.begin(), x.end(), to + path.layout.size);
    }

    Motion motion_;
    int works_, n_, independent_;
    std::vector<int> independent_v_;
    int independent_q_;
    std::vector<int> on_groups_;  // which of y belong to joints on groups
    std::vector<Point> slots_;
    Cells<double> x_, stage_, sum_, rate_;
    Point *anchor_ = nullptr, *accepted_ = nullptr, *before_ = nullptr, *safe_ = nullptr;
    Bridge* bridge_ = nullptr;
    std::int64_t rhs_ = 0, zone_ = 0;
};

}  // namespace rg
