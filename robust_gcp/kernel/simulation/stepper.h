// Steps until the end of the batch, or until something rare happens.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "simulation/guard.h"
#include "simulation/within.h"

namespace rg {

// Conditioning from which an output is one to return to, of a run that came to `best`: see simulation/runs/recovery.py.
constexpr double BEGINS = 1e-4;  // conditioning of K_d from which a start needs no look at what modes meet there

inline double good_from(double best) { return best >= POOR ? POOR : std::max(0.05, 0.8 * best); }

class alignas(CACHE_LINE) Stepper : public StepsWithin {
  public:
    explicit Stepper(const Description& d) : StepsWithin(d), guard_(d.nv) {}

    void run(Request& r) {
        r.completed = 0;
        r.reason = DONE;
        r.uncertain = 0.0;
        log_.clear();
        if (r.beginning < ON) count_anew(r);
        begin(r);
        r.plain = false;
        if (r.beginning == TURNED && !look(r)) {
            r.completed = -1;
            return;
        }
        watch_.follow(r);
        guard_.follow(r, path, *accepted_);
        const int m = path.layout.m;
        std::int32_t in_zone = clusters.place();  // at the last accepted output
        Cells<double> last_ydd(r.ydd, r.ydd + m), last_tau(r.tau, r.tau + path.layout.nv);
        double last_power = r.power;
        bool through = false;  // of a zone that is passed with error control
        for (std::int64_t i = r.first; i < r.first + r.steps && r.reason == DONE && !through; ++i) {
            Reason reason = step(r, i);
            if (reason == DONE) output(r.ends, i, *anchor_, sum_);
            if (reason == DONE) reason = within(r, i, last_ydd, last_power);
            if (reason != DONE) {
                r.reason = reason;
                break;
            }
            if (clusters.met())
                log(i, {r.times[i], r.times[i + 1], accepted_, anchor_, last_ydd.data(), motion_.ydd.data()});
            accepted_ = anchor_;
            x_ = sum_;
            renew_charts(x_.data());
            clusters.settle(*accepted_);
            in_zone = clusters.place();
            last_ydd = motion_.ydd;
            last_tau = motion_.tau;
            last_power = motion_.power;
            if (motion_.driven) motion_.driven->write(r.effort);
            ++r.completed;
            count(r);
            r.best = std::max(r.best, accepted_->conditioning());
            if (accepted_->conditioning() >= good_from(r.best) && (r.solver == nullptr || i + 1 >= r.safe_from)) {
                through = r.solver != nullptr;
                safe_ = accepted_;
                safe_x_ = x_;
                r.safe_step = i + 1;
            }
            if (watch_.exceeds(*accepted_, r.solver ? in_zone == 2 : in_zone != 0)) r.reason = CHART;
            if (r.looked != nullptr && r.looked(r.times[i + 1]) != 0) r.reason = MET;
            if (guard_.met(path, *accepted_, motion_.v.data(), motion_.ydd.data(), r.times[i + 1] - r.times[i]))
                r.reason = MET;
        }
        accepted_->write(r.anchor);
        std::copy(x_.begin(), x_.end(), r.x);
        std::copy(last_ydd.begin(), last_ydd.end(), r.ydd);
        std::copy(last_tau.begin(), last_tau.end(), r.tau);
        r.power = last_power;
        write(r.safe, safe_, safe_x_);
        std::copy(origin_, origin_ + home_.size(), r.origin);
        r.in_zone = in_zone;
        r.log = log_.data();
        r.logged = static_cast<std::int64_t>(log_.size()) / (8 + path.layout.nq);
        r.plain = r.reason == DONE && r.logged == 0 && !(in_zone != 0 && watch_.exceeds(*accepted_));
    }

    // ÿ, τ and the power at the last accepted point, under the torque that is held now; false where they are
    // not known. What was put out there is put out anew.
    bool look(Request& r) {
        r.reason = NON_FINITE;
        if (accepted_ == nullptr) return false;
        path.survey(*accepted_);
        ++rhs_;
        if (motion_.driven) prescribe(r, r.first, 0, accepted_->y(), accepted_->ydot());
        control(r, r.first, 0);
        r.reason = motion_.evaluate(r.times[r.first], *accepted_, r);
        count(r);
        if (r.reason != DONE) return false;
        std::copy(motion_.ydd.begin(), motion_.ydd.end(), r.ydd);
        std::copy(motion_.tau.begin(), motion_.tau.end(), r.tau);
        r.power = motion_.power;
        if (motion_.driven) motion_.driven->write(r.effort);
        if (r.beginning == TURNED) output(r.ends, r.first - 1, *accepted_, x_);
        return true;
    }

    // Builds the bridges that lie ahead and behind of the last accepted point.
    void explore() {
        if (!clusters.some()) return;
        const bool before = clusters.in_zone();
        if (!before) clusters.enter(*accepted_, origin_);
        clusters.explore();
        if (!before) clusters.leave();
    }

    // v at the last accepted point.
    void velocity(double* v) const { path.velocity(*accepted_, v); }

    // For another motion: nothing of those before is known any more.
    void renew() {
        anchor_ = accepted_ = safe_ = nullptr;
        clusters.renew();
    }

    // The state of the clusters' trackers as plain numbers.
    const double* trackers(std::int64_t& count) {
        trackers_ = clusters.written();
        count = static_cast<std::int64_t>(trackers_.size());
        return trackers_.data();
    }

    // The point with the anchor's q, closed, at the state x and times[0], and ÿ there; with bridges in zones too.
    void set_out(Request& r) {
        path.enough = std::max(POOR, r.zone);
        r.in_zone = 0;
        Point& point = slots_[0];
        point.read(r.anchor);
        std::copy(r.x, r.x + path.layout.m, point.y());
        std::copy(r.x + path.layout.m, r.x + 2 * path.layout.m, point.ydot());
        if (motion_.driven) prescribe(r, 0, 0, point.y(), point.ydot());
        for (std::size_t k = 0; k < numbers_.size(); ++k)
            if (numbers_[k] >= 0) point.q()[numbers_[k]] = point.y()[k];
        r.reason = !path.settle(point, r.anchor + path.layout.q) ? NEWTON : point.conditioning() >= r.zone ? DONE : beside(r);
        control(r, r.first, 0);
        if (r.reason == DONE) r.reason = motion_.evaluate(r.times[0], point, r);
        point.write(r.anchor);
        std::copy(motion_.ydd.begin(), motion_.ydd.end(), r.ydd);
        std::copy(motion_.tau.begin(), motion_.tau.end(), r.tau);
        if (motion_.driven) motion_.driven->write(r.effort);
        r.power = motion_.power;
    }

  protected:
    // Whether a start that is closed has a point cluster by cluster, which takes its place.
    Reason beside(Request& r) {
        if (r.bridging == nullptr || !clusters.some() || !(slots_[0].conditioning() >= BEGINS)) return ZONE;
        Point& closed = slots_[1] = slots_[0];
        std::copy(closed.q(), closed.q() + home_.size(), home_.begin());
        count_anew(r);
        clusters.use(*r.bridging);
        clusters.renew();
        if (clusters.at(closed, home_.data(), closed.y(), closed.ydot(), slots_[0], r.zone) != DONE) return ZONE;
        clusters.forget();  // that it is there is nothing to tell of
        r.in_zone = clusters.place();
        count(r);
        return DONE;
    }

    void count_anew(Request& r) {
        path.newton_iterations = path.evaluations = motion_.force_evaluations = rhs_ = 0;
        clusters.count_anew();
        count(r);
        safe_ = nullptr;
        r.safe_step = -1;
    }

    // Takes up the state, and the point at it.
    void begin(const Request& r) {
        path.enough = std::max(POOR, r.zone);
        if (r.beginning < ON && r.bridging != nullptr) clusters.use(*r.bridging);
        if ((r.beginning == GO_ON || r.beginning >= ON) && accepted_ != nullptr) {
            anchor_ = accepted_;
        } else {
            anchor_ = accepted_ = &slots_[0];
            anchor_->read(r.anchor);
            path.prime(*anchor_);
            clusters.leave();
            if (r.beginning == IN_ZONE) clusters.read(r.trackers);
            std::copy(r.origin, r.origin + home_.size(), home_.begin());
            origin_ = home_.data();
        }
        std::copy(r.x, r.x + n_, x_.begin());
        std::copy(r.ydd, r.ydd + path.layout.m, motion_.ydd.begin());
        motion_.power = r.power;
    }

    void log(std::int64_t i, const Step& step) {
        passed_.clear();
        clusters.passed(step, passed_);
        const std::size_t width = static_cast<std::size_t>(path.layout.nq) + 7;
        for (std::size_t at = 0; at < passed_.size(); at += width) {
            log_.push_back(static_cast<double>(i));
            log_.insert(log_.end(), passed_.begin() + static_cast<std::ptrdiff_t>(at),
                        passed_.begin() + static_cast<std::ptrdiff_t>(at + width));
        }
    }

    // What the steps accepted so far took; a step that is given up is done, and counted, by Python.
    void count(Request& r) const {
        r.rhs = rhs_;
        r.newton = path.newton_iterations;
        r.constraint_evaluations = path.evaluations;
        r.force_evaluations = motion_.force_evaluations;
        clusters.count(r);
    }

    Reason step(Request& r, std::int64_t i) {
        const double end = r.times[i + 1];
        const Reason reason = r.solver ? controlled(r, i) : fixed(r, i);
        if (reason != DONE) return reason;
        stage_ = sum_;
        const bool finite = std::all_of(sum_.begin(), sum_.end(), [](double x) { return std::isfinite(x); });
        if (!finite) return NON_FINITE;
        path.chain.anew = true;  // a state that is taken up from its numbers goes on to the same bits
        const Reason ended = r.solver ? at(r, end) : evaluate(r, end, i + 1, 0);
        path.chain.anew = false;
        return ended;
    }

    void write(double* to, const Point* point, const Cells<double>& x) const {
        if (point == nullptr || to == nullptr) return;
        point->write(to);
        std::copy(x.begin(), x.end(), to + path.layout.size);
    }

    Guard guard_;
    Cells<double> safe_x_;
    std::vector<double> log_, passed_, trackers_;
};

}  // namespace rg
