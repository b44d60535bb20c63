// Derivatives at many states, and of many steps of RK4, on regular ground and on known modes; see derivatives.py, discrete.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "abi.h"
#include "derivatives/adjoint.h"
#include "derivatives/apart.h"
#include "dynamics/motion.h"
#include "path/path.h"
#include "derivatives/results.h"
#include "derivatives/rounding.h"
#include "derivatives/accelerations.h"
#include "derivatives/still.h"

namespace rg {

class Derivation {
  public:
    explicit Derivation(const Description& d)
        : path_(d), motion_(d, path_), slopes_(d, path_, motion_), adjoint_(d, path_),
          rounding_(d, path_, motion_, slopes_), results_(path_.layout, motion_, slopes_.moved()), m_(d.m), nq_(d.nq), nv_(d.nv),
          width_(2 * d.m + d.nv), independent_(d.independent, d.independent + d.m),
          independent_q_(d.independent_q, d.independent_q + d.m), still_(d), size_(d.size, d.size + d.nv),
          points_(4, Point(path_.layout)), x_(2 * d.m), state_(2 * d.m), sum_(2 * d.m), rate_(2 * d.m) {
        path_.modes = std::make_unique<Modes>(d, path_.parts);
    }

    // u̇ at states, and the rows of `Slopes`, G and ∂v/∂y; null where not wanted.
    void at(const States& s) {
        for (std::int64_t i = 0; i < s.count; ++i) {
            Point& point = points_[0];
            Reason reason = set_out(s, i, point);
            still_.tell(nullptr, 0, point.y());
            if (reason == DONE) reason = evaluate(s, i, 0.0, point);
            if (reason == DONE && s.rows != nullptr && !differentiated(s, point, s.rows + i * m_ * width_)) reason = NON_FINITE;
            if (reason == DONE) results_.write(s, i, point);
            s.status[i] = reason;
        }
    }

    // Takes the steps between states again; G and ∂v/∂y are written for each state. A step is good where the states
    // at both its ends are, and where it ends at the second one, if that is known: NaN are not. None is where inputs are no rates in a loop.
    void take(const States& s, const double* times) {
        if (path_.charted) return std::fill(s.status, s.status + s.count, CHART);
        const auto steps = static_cast<std::size_t>(s.count - 1);
        adjoint_.resize(steps);
        adjoint_.drive(still_.which(), static_cast<std::size_t>(s.drives));
        bool ready = false;
        for (std::int64_t i = 0; i < s.count; ++i) {
            // the torque of the last step serves at its end, where no more than G is asked for
            const std::int64_t held = std::min<std::int64_t>(i, s.count - 2);
            Reason reason = ready ? DONE : set_out(s, i, *begin_);
            tell(s, i, 0, begin_->y());
            if (reason == DONE) reason = evaluate(s, held, times[i], *begin_);
            if (reason == DONE && !differentiated(s, *begin_, adjoint_.stage(static_cast<std::size_t>(i), 0))) reason = NON_FINITE;
            s.status[i] = reason;
            ready = false;
            if (reason == TORQUE) return std::fill(s.status + i, s.status + s.count, TORQUE);
            if (reason != DONE) continue;
            results_.write(s, i, *begin_);
            results_.reached(s, i, *begin_);
            if (i == s.count - 1) return;
            const auto number = static_cast<std::size_t>(i);
            adjoint_.h[number] = times[i + 1] - times[i];
            results_.record(s, number, 0, *begin_);
            reason = step(s, i, times[i], number, [&](std::size_t stage, Point& point) {
                if (!differentiated(s, point, adjoint_.stage(number, stage))) return NON_FINITE;
                results_.record(s, number, stage, point);
                return DONE;
            });
            const bool known = !std::isnan(s.q[(i + 1) * nq_]);
            if (reason == DONE && known && !(apart(s, i + 1, *end_) < s.same)) reason = BRANCH;
            s.status[i] = reason;
            if (reason == TORQUE) return std::fill(s.status + i, s.status + s.count, TORQUE);
            if (reason != DONE) continue;
            std::swap(begin_, end_);
            adjoint_.renew(*begin_);
            ready = true;
        }
    }

    // A step from each state, at time t and of length h, to `q_out` and `v_out`, and its derivatives where they are wanted.
    void step_each(const States& s, double t, double h) {
        if (path_.charted) return std::fill(s.status, s.status + s.count, CHART);
        adjoint_.resize(1);
        adjoint_.drive(still_.which(), 0);
        adjoint_.h[0] = h;
        for (std::int64_t i = 0; i < s.count; ++i) {
            Reason reason = set_out(s, i, *begin_);
            still_.tell(nullptr, 0, begin_->y());
            if (reason == DONE) reason = evaluate(s, i, t, *begin_);
            if (reason == DONE) {
                results_.write(s, i, *begin_);
                const auto differentiate = [&](std::size_t stage, Point& point) {
                    return s.A == nullptr || differentiated(s, point, adjoint_.stage(0, stage)) ? DONE : NON_FINITE;
                };
                reason = differentiate(0, *begin_);
                if (reason == DONE) reason = step(s, i, t, 0, differentiate);
            }
            s.status[i] = reason;
            if (reason == TORQUE) return std::fill(s.status + i, s.status + s.count, TORQUE);
            if (reason != DONE) continue;
            path_.velocity(*end_, motion_.v.data());
            results_.reached(s, i, *end_);
            if (s.A != nullptr) adjoint_.matrices(s.A + i * 4 * m_ * m_, s.B + i * 2 * m_ * nv_);
        }
    }

    // What the steps that were taken are pulled back by.
    Adjoint& adjoint() { return adjoint_; }

    // Takes in a series that parts may be put on; false where it is not one of a part of one coordinate.
    bool learn(const ModeSeries& series) { return path_.modes->learn(series); }

  private:
    static constexpr double MEETING = 1e-4;  // conditioning, and speed, below which modes are not told apart

    // Whether series may serve. Where the end of a step is not known, which tells the modes apart, the series are
    // those that its stages lie on one after the other.
    bool led() const { return path_.modes->some(); }
    void lead(const States& s, Point& anchor) {
        path_.modes->on = true;
        path_.modes->through = std::isfinite(s.same) ? nullptr : &anchor;
    }

    // The point at a state, if it is one of the mechanism's: on regular ground, on a series, or where K_d is poor and
    // rounding costs little.
    Reason set_out(const States& s, std::int64_t i, Point& point) {
        rounding_.renew();
        const Reason reason = by_series(s, i, point);
        if (reason != ZONE || !(s.steady > 0.0)) return reason;
        path_.modes->on = false;
        if (settled(s, i, point) != ZONE || !steady(s, point)) return ZONE;
        return apart(s, i, point) <= s.close ? DONE : BRANCH;
    }

    bool steady(const States& s, Point& point) {
        return s.steady > 0.0 && !path_.charted && !motion_.driven && rounding_.steady(point, s.steady);
    }

    // On regular ground, else with the parts on series that these serve. Where modes meet, one that rests does not
    // tell which is its own; `mode` does.
    Reason by_series(const States& s, std::int64_t i, Point& point) {
        path_.modes->on = false;
        const Reason reason = settled(s, i, point);
        path_.modes->through = nullptr;
        if (reason == DONE || !led()) return reason;
        double fastest = reason == ZONE ? point.conditioning() : 0.0;
        for (int k = 0; k < nv_; ++k) fastest = std::max(fastest, std::fabs(s.v[i * nv_ + k] * size_[k]));
        path_.modes->on = true;
        if (s.mode == nullptr && !(fastest > MEETING)) return reason;
        path_.modes->moving = s.mode == nullptr ? s.v + i * nv_ : nullptr;
        if (s.mode != nullptr) {
            std::copy(point.y(), point.y() + m_, told_->y());
            std::copy(s.q + i * nq_, s.q + (i + 1) * nq_, told_->q());
            std::copy(s.mode, s.mode + nv_ * m_, told_->G());
            path_.modes->through = told_;
        }
        const Reason again = settled(s, i, point);
        path_.modes->through = nullptr, path_.modes->moving = nullptr;
        return again == DONE ? DONE : reason;
    }

    Reason settled(const States& s, std::int64_t i, Point& point) {
        const double *q = s.q + i * nq_, *v = s.v + i * nv_;
        std::copy(q, q + nq_, point.q());
        for (int k = 0; k < m_; ++k) {
            point.ydot()[k] = v[independent_[k]];
            point.y()[k] = independent_q_[k] < 0 ? 0.0 : q[independent_q_[k]];
        }
        point.distance = point.turn = 0.0;
        if (!path_.settle(point, q)) return NEWTON;
        if (!(point.conditioning() >= s.zone)) return ZONE;
        if (!(apart(s, i, point) <= s.close)) return BRANCH;
        return DONE;
    }

    Reason evaluate(const States& s, std::int64_t i, double t, Point& point) {
        Request request{};
        request.held = s.tau == nullptr ? nullptr : s.tau + i * nv_;
        request.torque = s.torque;
        request.torque_q = s.torque_q, request.torque_v = s.torque_v;
        request.torque_tau = s.torque_tau, request.torque_stored = s.torque_stored;
        if (motion_.driven) still_.prescribe(*motion_.driven, point);
        const Reason reason = motion_.evaluate(t, point, request);
        if (reason != DONE) return reason;
        return std::all_of(motion_.ydd.begin(), motion_.ydd.end(), [](double x) { return std::isfinite(x); })
                   ? DONE
                   : NON_FINITE;
    }

    // What driven inputs do at a stage of step i.
    void tell(const States& s, std::int64_t i, std::size_t stage, const double* y) {
        const auto n = static_cast<std::size_t>(s.drives);
        still_.tell(s.prescribed == nullptr ? nullptr : s.prescribed + (4 * static_cast<std::size_t>(i) + stage) * 3 * n, n, y);
    }

    bool differentiated(const States& s, Point& point, double* rows) {
        if (!slopes_.at(point, rows)) return false;
        still_.hold(rows, static_cast<std::size_t>(s.drives));
        return true;
    }

    double apart(const States& s, std::int64_t i, Point& point) {
        return rg::apart(s.q + i * nq_, s.v + i * nv_, s.at_rest, path_, motion_, size_, point);
    }

    // One step from the evaluated point at its start to `end_`; a reason of the later stages other than DONE ends it.
    template <typename AtStage>
    Reason step(const States& s, std::int64_t i, double t, std::size_t number, AtStage at_stage) {
        const double h = adjoint_.h[number];
        std::copy(begin_->y(), begin_->y() + m_, x_.begin());
        std::copy(begin_->ydot(), begin_->ydot() + m_, x_.begin() + m_);
        std::fill(sum_.begin(), sum_.end(), 0.0);
        Point *anchor = begin_, *spare = middle_;
        for (std::size_t stage = 0; stage < 4; ++stage) {
            if (stage > 0) {
                for (int k = 0; k < 2 * m_; ++k) state_[k] = x_[k] + h * Adjoint::SHARE[stage] * rate_[k];
                lead(s, i, stage);
                Reason reason = move(s, *anchor, *spare);
                if (reason == DONE) reason = evaluate(s, i, t + h * Adjoint::SHARE[stage], *spare);
                if (reason == DONE) reason = at_stage(stage, *spare);
                if (reason != DONE) return reason;
                std::swap(anchor, spare);
                if (spare == begin_) spare = end_;  // the start is needed until the end
            }
            if (!adjoint_.chart(*anchor, number, stage)) return CHART;
            std::copy(anchor->ydot(), anchor->ydot() + m_, rate_.begin());
            path_.groups.rate(*anchor, rate_.data());
            std::copy(motion_.ydd.begin(), motion_.ydd.end(), rate_.begin() + m_);
            for (int k = 0; k < 2 * m_; ++k) sum_[k] += Adjoint::WEIGHT[stage] * rate_[k];
        }
        for (int k = 0; k < 2 * m_; ++k) state_[k] = x_[k] + h * sum_[k];
        lead(s, i, 3);
        const Reason reason = move(s, *anchor, *spare);
        if (reason != DONE) return reason;
        end_ = spare;
        middle_ = anchor;
        return adjoint_.chart(*end_, number, 4) ? DONE : CHART;
    }

    // Driven inputs of the state at a stage are as prescribed.
    void lead(const States& s, std::int64_t i, std::size_t stage) {
        if (!motion_.driven) return;
        tell(s, i, stage, x_.data());
        still_.lead(state_.data());
    }

    // The point at `state_`, if the path is good enough; see RegularGround in regular_ground.py.
    Reason move(const States& s, Point& anchor, Point& point) {
        path_.modes->on = false;
        if (anchor.by_modes && !std::isfinite(s.same)) {
            lead(s, anchor);
            return stepped(s, anchor, point);
        }
        const Reason reason = stepped(s, anchor, point);
        if (reason == DONE || !led()) return reason;
        lead(s, anchor);
        return stepped(s, anchor, point) == DONE ? DONE : reason;
    }

    Reason stepped(const States& s, Point& anchor, Point& point) {
        if (Reason reason = path_.step(anchor, begin_->q(), state_.data(), state_.data() + m_, point)) return reason;
        if (!(point.conditioning() >= std::min(POOR, PACE * point.turn))) return ZONE;
        if (!(point.conditioning() >= s.zone) && !steady(s, point)) return ZONE;
        // on which side of a singular place K_d is, a series does not tell: the end of the step will
        const bool same = anchor.by_modes || point.by_modes ? near_prediction(point, path_.layout.blocks)
                                                            : same_branch(anchor, point, path_.layout.blocks);
        return same ? DONE : BRANCH;
    }

    Path path_;
    Motion motion_;
    Slopes slopes_;
    Adjoint adjoint_;
    Rounding rounding_;
    Results results_;
    int m_, nq_, nv_, width_;
    std::vector<int> independent_, independent_q_;
    Still still_;
    Cells<double> size_;
    std::vector<Point> points_;
    Point *begin_ = &points_[0], *middle_ = &points_[1], *end_ = &points_[2], *told_ = &points_[3];
    Cells<double> x_, state_, sum_, rate_;
};

}  // namespace rg
