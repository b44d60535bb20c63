// A step with error control, through a zone without a bridge: see simulation/runs/error_control.py. By DOP853, an
// explicit Runge–Kutta method of order 8 with estimates of order 5 and 3 (Hairer, Nørsett, Wanner, II.5 and II.10).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "simulation/steps.h"
#include "simulation/watch.h"

namespace rg {

class ControlledSteps : public Steps {
  public:
    explicit ControlledSteps(const Description& d) : Steps(d), watch_(d, path.parts), now_(n_), atol_(n_) {}

  protected:
    // From the state `x_` at the accepted point to the state `sum_` at the next time. What is not DONE is Python's:
    // where no trial is short enough, coordinates that turn back on the way.
    Reason controlled(Request& r, std::int64_t i) {
        const Reason reason = to_the_end(r, i);
        kept_ = nullptr;
        return reason;
    }

    // The point that was kept, on regular ground or beside it cluster by cluster, is gone on from; see
    // ClusterMap._restart.
    void go_back(const Request& r, Point& kept) {
        Point& point = spare();
        point = kept;
        anchor_ = &kept;
        if (r.bridging == nullptr) return;
        const bool regular = path.settle(point, origin_) && point.conditioning() >= r.zone &&
                             path.apart(kept.q(), point) < SAME_PLACE;
        if (regular) {
            anchor_ = &point;
            clusters.leave();
        } else if (clusters.some()) {
            clusters.enter(kept, origin_);
        }
    }

    // The point and ÿ at the state `stage_`, at a time of no step's stage.
    Reason at(const Request& r, double t) {
        if (r.tell != nullptr && r.tell(t) != 0) return TORQUE;
        return evaluate(r, t, r.first, 0);
    }

    Watch watch_;

  private:
    static constexpr int STAGES = 12;                // of the method
    static constexpr int PATIENCE = 30, MOST = 400;  // trials of one step, and steps from one output to the next
    static constexpr int MANY = 5;                   // as in error_control.py
    static constexpr double LEAST = 0.2, SAFE = 0.9, ORDER = 8.0, GROWTH = 10.0, SHARE = 0.01;

    Reason to_the_end(Request& r, std::int64_t i) {
        const double end = r.times[i + 1];
        double t = r.times[i], h = end - t;
        std::fill(atol_.begin(), atol_.end(), r.atol);
        now_ = x_, kept_ = accepted_;
        k_.resize(STAGES);
        for (Cells<double>& k : k_) k.resize(static_cast<std::size_t>(n_));
        rate(*accepted_, k_[0]);
        int refused = 0;  // since the last step that was taken
        for (int taken = 0; refused < PATIENCE && taken < MOST;) {
            const bool last = t + h >= end - 1e-3 * h;  // no step to the end is so short that rounding is all of it
            if (last) h = end - t;
            if (refused == 0) allow(r);
            const Reason reason = stages(r, t, h);
            const bool too_far = reason == REFUSED || reason == ZONE || reason == BRANCH || reason == NEWTON;
            if (reason != DONE && !too_far) return reason;
            const double off = reason == DONE ? error(r, h) : std::numeric_limits<double>::infinity();
            const double factor = SAFE * std::pow(off, -1.0 / ORDER);
            if (!(off < 1.0)) {
                h *= factor > LEAST ? factor : LEAST;  // LEAST for NaN too
                go_back(r, *kept_);
                ++refused;
                continue;
            }
            if (last) return DONE;
            const double done = h;
            now_ = sum_, t += h;
            h *= std::min(refused > 0 ? 1.0 : GROWTH, factor);
            refused = 0;
            stage_ = now_;
            if (Reason reason = at(r, t)) return reason;
            kept_ = anchor_;
            if (watch_.turns_back(*kept_, clusters.on_bridge())) return ZONE;
            rate(*kept_, k_[0]);
            if (++taken % MANY == 0)
                if (Reason reason = hear(r, t, done)) return reason;
        }
        return ZONE;
    }

    // The rates at the stages of a step, and the state at its end.
    Reason stages(const Request& r, double t, double h) {
        const double *a = r.solver, *c = r.solver + STAGES * (STAGES + 1) / 2;
        for (int s = 1; s <= STAGES; ++s) {
            Cells<double>& to = s < STAGES ? stage_ : sum_;
            to = now_;
            for (int j = 0; j < s; ++j, ++a)
                for (int k = 0; *a != 0.0 && k < n_; ++k) to[k] += h * *a * k_[j][k];
            if (s == STAGES) break;
            if (Reason reason = at(r, t + c[s] * h)) return reason;
            rate(*anchor_, k_[s]);
        }
        return DONE;
    }

    // No less than what rounding costs of G where a step begins.
    void allow(Request& r) {
        const double told = r.uncertain, nearest = r.nearest;
        clusters.rounding(r);
        rtol_ = std::max(r.rtol, r.asked), least_ = SHARE * r.asked;
        if (told > r.uncertain) r.uncertain = told, r.nearest = nearest;
    }

    // That of a step, in units of what is allowed: e₅² / √(e₅² + 0.01 e₃²).
    double error(const Request& r, double h) const {
        const double *e3 = r.solver + STAGES * (STAGES + 3) / 2, *e5 = e3 + STAGES;
        double fifth = 0.0, third = 0.0;
        for (int k = 0; k < n_; ++k) {
            double by_five = 0.0, by_three = 0.0;
            for (int s = 0; s < STAGES; ++s) by_five += e5[s] * k_[s][k], by_three += e3[s] * k_[s][k];
            const double size = std::max(std::fabs(now_[k]), std::fabs(sum_[k]));
            const double allowed = std::max(atol_[k], least_) + rtol_ * size;
            fifth += (by_five / allowed) * (by_five / allowed), third += (by_three / allowed) * (by_three / allowed);
        }
        if (fifth == 0.0 && third == 0.0) return 0.0;
        return std::fabs(h) * fifth / std::sqrt((fifth + 0.01 * third) * n_);
    }

    // Allow no less than what the rounding of ẋ makes of a step; see RefinedRun._refinements.
    Reason hear(const Request& r, double t, double h) {
        std::fill(atol_.begin(), atol_.end(), r.atol);
        for (const double ulps : {-2.0, 1.0, 2.0}) {
            for (int k = 0; k < n_; ++k) stage_[k] = now_[k] * (1.0 + ulps * std::numeric_limits<double>::epsilon());
            if (Reason reason = at(r, t)) return reason;
            rate(*anchor_, rate_);
            for (int k = 0; k < n_; ++k) atol_[k] = std::max(atol_[k], h * std::fabs(rate_[k] - k_[0][k]));
        }
        return DONE;
    }

    Cells<double> now_, atol_;  // the state at the point that was kept, and absolute tolerances
    double rtol_ = 0.0, least_ = 0.0;
};

}  // namespace rg
