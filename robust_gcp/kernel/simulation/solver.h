// ẋ for a solver that chooses its own steps and takes trials back; see kernel/simulation/rates.py and
// simulation/runs/solver_rates.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "cluster/hermite.h"
#include "simulation/stepper.h"

namespace rg {

constexpr double OUTGROWN = 1.0;  // as in explicit.py
constexpr double FORWARD = 1.4901161193847656e-08;  // as in differences.py

class Solver : public Stepper {
  public:
    using Stepper::Stepper;

    // Goes on from `anchor` and x, with charts about `origin`; what was met before was told of.
    void set_out_from(Request& r) {
        count_anew(r);
        begin(r);
        if (r.beginning != IN_ZONE) clusters.forget();
        r.in_zone = clusters.place(), r.met = clusters.met(), r.plain = false;
    }

    // ẋ at the state x and times[0]; NaN at one that is not finite, of a trial that a refusal has spoilt. From
    // the point evaluated last, or from the one that was kept where that is nearer.
    void follow(Request& r) {
        r.reason = DONE;
        if (!std::all_of(r.x, r.x + n_, [](double number) { return std::isfinite(number); })) {
            std::fill(r.rate, r.rate + n_, std::numeric_limits<double>::quiet_NaN());
            return;
        }
        if (accepted_ != anchor_ && apart(r.x, *accepted_) < apart(r.x, *anchor_)) go_back(r, *accepted_);
        r.in_zone = clusters.place();
        std::copy(r.x, r.x + n_, stage_.begin());
        r.reason = evaluate(r, r.times[0], 0, 0);
        r.met = clusters.met();
        if (r.reason != DONE) {  // Python evaluates it, and counts
            --rhs_;
            if (r.reason == REFUSED) {  // the solver tries a shorter step
                go_back(r, *accepted_);
                r.in_zone = clusters.place();
            }
            return;
        }
        count(r);
        r.in_zone = clusters.place();
        rate(*anchor_, rate_);
        std::copy(rate_.begin(), rate_.end(), r.rate);
        watch_.follow(r);
        r.plain = !r.met && !r.in_zone && !watch_.exceeds(*anchor_) && !outgrown(*anchor_);
    }

    // ∂ẋ/∂x without the work done, by forward differences at x and times[0], row by row; `unit` (m,) are those of y.
    // See dynamics/linearise.py.
    void bend(Request& r, const double* unit, double* A) {
        const int m = path.layout.m, n = 2 * m;
        follow(r);
        const std::vector<double> base(r.rate, r.rate + n);
        for (int k = 0; k < n && r.reason == DONE; ++k) {
            const double size = unit[k % m], at = r.x[k];
            // a force that ẏ does not change rounds to ε ÿ: ẏ is moved far enough to rise above that
            const double fast = std::max({size, std::fabs(at), std::sqrt(size * std::fabs(base[m + k % m]))});
            r.x[k] += FORWARD * (k < m ? size : fast);
            follow(r);
            for (int i = 0; i < n; ++i) A[i * n + k] = (r.rate[i] - base[i]) / (r.x[k] - at);
            r.x[k] = at;
        }
    }

    // What a step of the solver's passed, into `log`: of the states at its `ends`, and of y, ẏ and ÿ within. ZONE where
    // Python has to look.
    void passed(Request& r, const double* ends, const Series& solved) {
        const int m = path.layout.m;
        r.reason = ZONE;
        r.logged = 0;
        if (motion_.driven || !in_loops_.empty()) return;
        const Point here = *anchor_;
        const bool inside = clusters.in_zone();
        const std::vector<double> trackers = clusters.written();
        Point before = here, after = here;
        if (reached(r, ends, before) && reached(r, ends + 2 * m, after)) {
            look_through(r, before, after, solved);
            r.reason = DONE;
        }
        Point& back = spare();  // the solver goes on from where it was
        back = here, anchor_ = &back;
        clusters.read(trackers.data());
        if (!inside) clusters.leave();
        if (r.reason == DONE) clusters.forget();
        count(r);
        r.in_zone = clusters.place(), r.met = clusters.met();
    }

    // The point evaluated last, and ÿ, τ and the power there.
    void tell(Request& r) {
        anchor_->write(r.anchor);
        std::copy(motion_.ydd.begin(), motion_.ydd.end(), r.ydd);
        std::copy(motion_.tau.begin(), motion_.tau.end(), r.tau);
        r.power = motion_.power;
        if (motion_.driven) motion_.driven->write(r.effort);
        clusters.rounding(r);
    }

    // Go back to the point evaluated last where that is nearer to a state than those after it.
    void keep() { accepted_ = anchor_; }

  private:
    // What lies between two points of such a step, all other joints where y has them then.
    void look_through(Request& r, Point& before, Point& after, const Series& solved) {
        const int m = path.layout.m;
        const double t0 = solved.left(), t1 = solved.right();
        Vector y, ydot, first, last;
        solved.evaluate(t0, y, ydot, first);
        solved.evaluate(t1, y, ydot, last);
        log_.clear();
        log(0, {t0, t1, &before, &after, first.data(), last.data(), &solved});
        const std::size_t width = static_cast<std::size_t>(path.layout.nq) + 8;
        for (std::size_t at = 0; path.parts.list.size() > 1 && at < log_.size(); at += width) {
            solved.evaluate(log_[at + 1], y, ydot, first);
            y.conservativeResize(2 * m);
            y.tail(m) = ydot;
            if (reached(r, y.data(), before))
                std::copy(before.q(), before.q() + path.layout.nq, log_.begin() + static_cast<std::ptrdiff_t>(at) + 8);
        }
        r.log = log_.data();
        r.logged = static_cast<std::int64_t>(log_.size() / width);
    }

    // The point at a state, without what acts there.
    bool reached(Request& r, const double* x, Point& point) {
        if (accepted_ != anchor_ && apart(x, *accepted_) < apart(x, *anchor_)) go_back(r, *accepted_);
        std::copy(x, x + 2 * path.layout.m, stage_.begin());
        const bool found = place(r) == DONE;
        if (found) point = *anchor_;
        return found;
    }

    // Whether charts ought to be renewed.
    bool outgrown(Point& point) const {
        if (path.charted && path.away(point, origin_) > OUTGROWN) return true;
        const auto far = [&](int k) { return std::fabs(point.y()[k]) > OUTGROWN; };
        return std::any_of(on_groups_.begin(), on_groups_.end(), far) ||
               std::any_of(in_loops_.begin(), in_loops_.end(), far);
    }

    double apart(const double* y, Point& point) const {
        double worst = 0.0;
        for (int i = 0; i < path.layout.m; ++i) worst = std::max(worst, std::fabs(y[i] - point.y()[i]));
        return worst;
    }
};

}  // namespace rg
