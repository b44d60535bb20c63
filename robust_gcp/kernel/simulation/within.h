// Outputs, at the ends of steps and within them: there y and ẏ are on the quintic through y, ẏ and ÿ at the ends, loops
// closed; see simulation/runs/within_steps.py and trajectories/interpolant.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "simulation/error_control.h"

namespace rg {

class StepsWithin : public ControlledSteps {
  public:
    explicit StepsWithin(const Description& d) : ControlledSteps(d), ydd_(d.m), tau_(d.nv), v_(d.nv), effort_(d.driven) {}

  protected:
    // Outputs within the step after time i that was taken just now, from the accepted point and ÿ and the power there
    // to the anchor, which stays what it is.
    Reason within(Request& r, std::int64_t i, const Cells<double>& ydd, double power) {
        if (r.before == nullptr || r.before[i + 1] == r.before[i]) return DONE;
        kept_ = anchor_;
        ydd_ = motion_.ydd, tau_ = motion_.tau, v_ = motion_.v;
        if (motion_.driven) motion_.driven->write(effort_.data());
        const double end_power = motion_.power;
        bool beside = clusters.in_zone();
        Reason reason = DONE;
        for (std::int64_t k = r.before[i]; k < r.before[i + 1] && reason == DONE; ++k) {
            const double t = r.times_within[k], h = r.times[i + 1] - r.times[i], s = (t - r.times[i]) / h;
            for (int j = 0; j < path.layout.m; ++j) interpolate(j, s, h, ydd[j]);
            if (works_) {
                const double w0 = x_[n_ - 1], w1 = sum_[n_ - 1], p0 = h * power, p1 = h * end_power;
                stage_[n_ - 1] = w0 + s * (p0 + s * (3.0 * (w1 - w0) - 2.0 * p0 - p1 + s * (p0 + p1 - 2.0 * (w1 - w0))));
            }
            if (motion_.driven) {
                const double* told = r.prescribed_within + k * motion_.driven->width();
                motion_.driven->prescribe(told, stage_.data(), stage_.data() + path.layout.m);
            }
            control(r, i, 0);
            if (r.control_within != nullptr) motion_.control = r.control_within + k * r.control_stride;
            reason = evaluate(r, t);
            if (reason == DONE) output(r.within, k, *anchor_, stage_);
            beside = beside || clusters.in_zone();
        }
        anchor_ = kept_;
        if (reason == DONE && beside) {  // every cluster goes on from the end
            stage_ = sum_;
            reason = place(r);
        }
        kept_ = nullptr;
        motion_.ydd = ydd_, motion_.tau = tau_, motion_.v = v_, motion_.power = end_power;
        if (motion_.driven) motion_.driven->read(effort_.data());
        return reason;
    }

    // A point, with what was evaluated there and the state.
    void output(const OutputRows& rows, std::int64_t row, Point& point, const Cells<double>& x) {
        const Layout& l = path.layout;
        if (rows.q) std::copy(point.q(), point.q() + l.nq, rows.q + row * l.nq);
        if (rows.v) std::copy(motion_.v.begin(), motion_.v.end(), rows.v + row * l.nv);
        if (rows.tau) std::copy(motion_.tau.begin(), motion_.tau.end(), rows.tau + row * l.nv);
        if (rows.energy) rows.energy[row] = motion_.energy(point);
        if (rows.effort) motion_.driven->write(rows.effort + row * (motion_.driven->width() / 3));
        if (rows.work && works_) rows.work[row] = x[2 * l.m];
        if (rows.a) path.acceleration(point, motion_.ydd.data(), rows.a + row * l.nv);
    }

  private:
    static constexpr double JUMP = 0.25;  // as in interpolant.py

    // One of y, and its rate, at a share s of a step h; `bend` at its beginning.
    void interpolate(int j, double s, double h, double bend) {
        Point &one = *accepted_, &two = *kept_;
        const double v0 = one.ydot()[j], v1 = two.ydot()[j], a0 = h * h * bend, a1 = h * h * ydd_[j];
        const double way = two.y()[j] - one.y()[j];
        double b = 3.0 * way - h * (2.0 * v0 + v1), c = h * (v0 + v1) - 2.0 * way;
        const double A = 0.5 * (a0 - 2.0 * b), middle = 2.0 * b + 3.0 * c - A - 0.5 * (a0 + a1);
        double B = 0.5 * (a1 - (2.0 * b + 6.0 * c)) - A;
        if (!(2.0 * std::fabs(B) <= JUMP * (std::fabs(a1 - a0) + std::fabs(middle)))) B = 0.0;
        b += A, c += B - 2.0 * A;
        const double d = A - 2.0 * B;
        stage_[j] = one.y()[j] + s * (h * v0 + s * (b + s * (c + s * (d + s * B))));
        stage_[path.layout.m + j] = v0 + s * (2.0 * b + s * (3.0 * c + s * (4.0 * d + s * 5.0 * B))) / h;
    }

    Cells<double> ydd_, tau_, v_, effort_;  // at the step's end
};

}  // namespace rg
