// The point and ÿ at a state: on regular ground all at once, beside singular places cluster by cluster.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "abi.h"
#include "cluster/clusters.h"
#include "dynamics/motion.h"
#include "linalg/cells.h"
#include "path/path.h"

namespace rg {

class Evaluator {
  public:
    explicit Evaluator(const Description& d)
        : path(d), clusters(d, path), motion_(d, path), works_(d.works), n_(2 * d.m + d.works),
          numbers_(d.independent_q, d.independent_q + d.m), slots_(SLOTS, Point(path.layout)), stage_(n_), home_(d.nq) {
        for (const Part& part : path.parts.list)
            for (const int k : part.inputs)
                if (numbers_[k] < 0) (part.on_group ? on_groups_ : in_loops_).push_back(k);
    }

    Path path;
    Clusters clusters;

  protected:
    static constexpr int SLOTS = 6;  // anchor, trial, accepted, kept, safe, and one more

    // ẋ at a point that was evaluated just now.
    void rate(Point& point, Cells<double>& rate) {
        const int m = path.layout.m;
        std::copy(point.ydot(), point.ydot() + m, rate.begin());
        path.rate(point, origin_, rate.data());
        std::copy(motion_.ydd.begin(), motion_.ydd.end(), rate.begin() + m);
        if (works_) rate[2 * m] = motion_.power;
    }

    // Controls of the actuators at a stage of the step after a time.
    void control(const Request& r, std::int64_t time, int stage) {
        const std::int64_t stages = r.stages > 0 ? r.stages : 2;
        const std::int64_t row = std::min<std::int64_t>((time - r.first) * stages + stage, r.control_rows - 1);
        motion_.control = r.control == nullptr ? nullptr : r.control + row * r.control_stride;
    }

    // What moves by prescription at a stage of the step after a time.
    void prescribe(const Request& r, std::int64_t time, int stage, double* y, double* ydot) {
        const std::int64_t stages = r.stages > 0 ? r.stages : 2;
        motion_.driven->prescribe(r.prescribed + (time * stages + stage) * motion_.driven->width(), y, ydot);
    }

    // The point and ÿ at the state `stage_`, which is at a stage of the step after a time; the point becomes the anchor.
    Reason evaluate(const Request& r, double t, std::int64_t time, int stage) {
        if (motion_.driven) prescribe(r, time, stage, stage_.data(), stage_.data() + path.layout.m);
        control(r, time, stage);
        return evaluate(r, t);
    }

    // The same under what is prescribed already.
    Reason evaluate(const Request& r, double t) {
        ++rhs_;
        if (Reason reason = place(r)) return reason;
        return motion_.evaluate(t, *anchor_, r);
    }

    // The point at the state `stage_`, which becomes the anchor.
    Reason place(const Request& r) {
        const double *y = stage_.data(), *ydot = y + path.layout.m;
        Point& point = spare();
        Reason reason = clusters.in_zone() ? ZONE : by_regular_path(r, y, ydot, point);
        if (reason != DONE && r.bridging != nullptr && clusters.some()) {
            const Reason found = clusters.at(*anchor_, origin_, y, ydot, point, r.zone);
            if (found != ZONE) reason = found;
        }
        if (reason == DONE) anchor_ = &point;
        return reason;
    }

    // One step of the regular path, if it is good enough; see RegularGround in regular_ground.py.
    Reason by_regular_path(const Request& r, const double* y, const double* ydot, Point& point) {
        if (Reason reason = path.step(*anchor_, origin_, y, ydot, point)) return reason;
        if (r.bridging == nullptr) return point.conditioning() >= r.zone ? DONE : ZONE;
        const double needed = std::max(r.zone, std::min(POOR, PACE * point.turn));
        if (!(point.conditioning() >= needed)) return ZONE;
        return same_branch(*anchor_, point, path.layout.blocks) ? DONE : BRANCH;
    }

    // New charts about the accepted point; those in loops stay where one of these is on a bridge.
    void renew_charts(double* x) {
        Point& point = *accepted_;
        for (int k : on_groups_) point.y()[k] = x[k] = 0.0;
        if (in_loops_.empty() || !clusters.turning_on_bridge()) {
            origin_ = point.q();
            for (int k : in_loops_) point.y()[k] = x[k] = 0.0;
            return;
        }
        const std::vector<double> before(origin_, origin_ + home_.size());
        std::copy(point.q(), point.q() + home_.size(), home_.begin());
        path.keep_charts(before.data(), home_.data());
        origin_ = home_.data();
    }

    Point& spare() {
        for (Point& point : slots_)
            if (&point != anchor_ && &point != accepted_ && &point != kept_ && &point != safe_) return point;
        return slots_[0];  // never: five places are taken at most
    }

    Motion motion_;
    int works_, n_;
    const std::vector<int> numbers_;  // where y is in q, −1 where in charts
    std::vector<int> on_groups_, in_loops_;  // which of y are in charts
    std::vector<Point> slots_;
    Cells<double> stage_;             // the state that is asked for
    Point *anchor_ = nullptr, *accepted_ = nullptr, *kept_ = nullptr, *safe_ = nullptr;  // `kept_` within a step
    Cells<double> home_;              // q where charts have theirs, where that is no point of the motion
    const double* origin_ = nullptr;  // where they have them
    std::int64_t rhs_ = 0;
};

}  // namespace rg
