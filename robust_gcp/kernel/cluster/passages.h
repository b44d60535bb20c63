// Where in a step the motion passed singular places; see maps/cluster/passages.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "cluster/clusters.h"
#include "cluster/patch.h"

namespace rg {

struct Passage {
    double time;
    int cluster, corank;
    double closure, transversality;
    bool near_miss;
    int order;  // of contact of the modes
    Vector x;
    Space* space;
};

// A number that moves, and its first two rates.
struct Varying {
    double value, rate, bend;
};

// One number on a step: the quintic through its value, rate and second rate at both ends.
class Quintic {
  public:
    Quintic(const Step& step, const Varying& before, const Varying& after) : t0_(step.t0), h_(step.t1 - step.t0) {
        const double p0 = before.value, v0 = h_ * before.rate, a0 = h_ * h_ * before.bend;
        const double p1 = after.value, v1 = h_ * after.rate, a1 = h_ * h_ * after.bend;
        const double jump = p1 - p0 - v0 - 0.5 * a0, turn = v1 - v0 - a0, bend = a1 - a0;
        c_[0] = p0, c_[1] = v0, c_[2] = 0.5 * a0;
        c_[3] = 10.0 * jump - 4.0 * turn + 0.5 * bend;
        c_[4] = -15.0 * jump + 7.0 * turn - bend;
        c_[5] = 6.0 * jump - 3.0 * turn + 0.5 * bend;
    }

    // One entry of y.
    Quintic(const Step& step, int i)
        : Quintic(step, {step.before->y()[i], step.before->ydot()[i], step.ydd0[i]},
                  {step.after->y()[i], step.after->ydot()[i], step.ydd1[i]}) {}

    double at(double t) const {
        const double u = (t - t0_) / h_;
        return c_[0] + u * (c_[1] + u * (c_[2] + u * (c_[3] + u * (c_[4] + u * c_[5]))));
    }

    double rate(double t) const {
        const double u = (t - t0_) / h_;
        return (c_[1] + u * (2.0 * c_[2] + u * (3.0 * c_[3] + u * (4.0 * c_[4] + u * 5.0 * c_[5])))) / h_;
    }

  private:
    double t0_, h_, c_[6];
};

// q at a time of a step at whose beginning charts of joints on groups have their origin.
inline void between(const Path& path, const Step& step, double t, double* q) {
    Point &a = *step.before, &b = *step.after;
    const std::size_t nv = static_cast<std::size_t>(path.layout.nv);
    Cells<double> v0(nv), v1(nv), a0(nv), a1(nv);
    path.velocity(a, v0.data());
    path.velocity(b, v1.data());
    path.acceleration(a, step.ydd0, a0.data());
    path.acceleration(b, step.ydd1, a1.data());
    for (const Part& part : path.parts.list) {
        const auto turned = [&](const Body& body, double* w) {
            const int first = body.first;
            double rate[6], bend[6];
            rate_in_chart(body.kind, w, v1.data() + first, rate);
            bend_in_chart(body.kind, w, rate, v1.data() + first, a1.data() + first, bend);
            for (int i = 0; i < body.count; ++i)
                w[i] = Quintic(step, {0.0, v0[first + i], a0[first + i]}, {w[i], rate[i], bend[i]}).at(t);
            integrate_joint(body.kind, a.q() + body.q, w, q + body.q);
        };
        double w[6];
        if (part.on_group) {
            const Body& body = path.groups.body(part);
            path.groups.take(body, b.y(), w);
            turned(body, w);
            continue;
        }
        for (const int j : part.joints) {
            const Body& body = path.chain.bodies[j];
            if (NUMBERS[body.kind].q > 1) {
                joint_difference(body.kind, a.q() + body.q, b.q() + body.q, w);
                turned(body, w);
                continue;
            }
            const int i = body.first, at = body.q;
            q[at] = Quintic(step, {a.q()[at], v0[i], a0[i]}, {b.q()[at], v1[i], a1[i]}).at(t);
        }
    }
}

// The y of a cluster on a step, and their rates, in the chart of its coordinates.
class Course {
  public:
    Course(const Space& space, const Step& step, const Path& path) : space_(space), step_(step), path_(path) {
        if (space.charted() || step.solved != nullptr) return;
        for (const int input : space.inputs) numbers_.emplace_back(step, input);
    }

    Vector at(double t) const {
        Vector y(space_.m);
        if (space_.charted()) {
            std::vector<double> q(static_cast<std::size_t>(path_.layout.nq));
            between(path_, step_, t, q.data());
            const Vector x = space_.x(q.data());
            for (int i = 0; i < space_.m; ++i) y[i] = x[space_.chosen[i]];
        } else {
            for (int i = 0; i < space_.m; ++i) y[i] = space_.chart_of(i, number(i, t).value);
        }
        return y;
    }

    Vector rate(double t) const {
        Vector rate(space_.m);
        if (space_.charted()) {
            const double apart = 1e-4 * (step_.t1 - step_.t0);
            return (at(t + apart) - at(t - apart)) / (2.0 * apart);
        }
        for (int i = 0; i < space_.m; ++i)
            rate[i] = number(i, t).rate / space_.D[space_.chosen[i]];
        return rate;
    }

    // When the first of them is a value; the nearer end where it stays on one side of it.
    double when(double value) const {
        double low = step_.t0, high = step_.t1, f_low = at(low)[0] - value;
        const double f_high = at(high)[0] - value;
        if (!(f_low * f_high < 0.0)) return std::fabs(f_high) <= std::fabs(f_low) ? high : low;
        double t = low + (high - low) * f_low / (f_low - f_high);
        for (int i = 0; i < 100; ++i) {
            const double f = at(t)[0] - value;
            if (f == 0.0) break;
            (f * f_low > 0.0 ? low : high) = t;
            double next = t - f / rate(t)[0];
            if (!(next > low && next < high)) next = 0.5 * (low + high);
            const double moved = std::fabs(next - t);
            t = next;
            if (moved <= 2.0 * std::numeric_limits<double>::epsilon() * std::fabs(t) || next == low || next == high)
                break;
        }
        return t;
    }

  private:
    Varying number(int i, double t) const {
        Varying found{0.0, 0.0, 0.0};
        if (step_.solved != nullptr) {
            step_.solved->component(space_.inputs[static_cast<std::size_t>(i)], t, found.value, found.rate);
        } else {
            const Quintic& own = numbers_[static_cast<std::size_t>(i)];
            found.value = own.at(t), found.rate = own.rate(t);
        }
        return found;
    }

    const Space& space_;
    const Step& step_;
    const Path& path_;
    std::vector<Quintic> numbers_;
};

inline void on_curve(const Curve& curve, int cluster, const Step& step, const Path& path, std::vector<Passage>& found) {
    const CurveShape& shape = curve.shape();
    const Space& space = *shape.space;
    const Course course(space, step, path);
    const double u0 = curve.u(space.x(step.before->q())), u1 = curve.u(space.x(step.after->q()));
    for (std::size_t i = 0; i < shape.roots.size(); ++i) {
        const double root = shape.roots[i];
        if (shape.corank[i] == 0 || !((u0 - root) * (u1 - root) < 0.0 || (u0 != root && root == u1))) continue;
        Vector x, slope, bend;
        curve.point(root, x, slope, bend);
        found.push_back({course.when(x[space.chosen[0]]), cluster, shape.corank[i], shape.closure,
                         shape.transversality, shape.near_miss, shape.order(i), x, shape.space});
    }
}

// With several coordinates: Newton in time on the pencil along the velocity.
inline void on_patch(Tracker& tracker, int cluster, const Step& step, const Path& path, std::vector<Passage>& found) {
    // Shares of a step: times that are one, and those between which the ends' first order does not tell.
    // Seconds by which what is passed where two steps meet belongs to the first: both find it, to rounding.
    constexpr double SAME = 1e-7, NEXT = 1e-2, BORDER = 1e-10;
    Space& space = *tracker.anchor->space;
    const std::shared_ptr<Patch> bridge = tracker.touched_patch;
    const JetPtr anchor = tracker.anchor;
    const CurvePtr curve = tracker.curve;
    const std::shared_ptr<Patch> patch = tracker.patch;
    const double u = tracker.u, h = step.t1 - step.t0;
    const Course course(space, step, path);
    JetPtr point;
    const auto real = [&](const Roots& all) {
        std::vector<double> kept;
        for (const auto& mu : all)
            if (std::fabs(mu.imag()) <= 0.5 * std::abs(mu) + 1e-9 * h) kept.push_back(mu.real());
        return kept;
    };
    const auto at_end = [&](Point& end) -> const std::vector<double>& {
        std::vector<double> v(static_cast<std::size_t>(path.layout.nv));
        path.velocity(end, v.data());
        Vector own(space.nv);
        for (int i = 0; i < space.nv; ++i) own[i] = v[static_cast<std::size_t>(space.iv[i])];
        const Vector x = space.x(end.q()), way = space.rate(x, own);
        if (tracker.end.x.size() == 0 || x != tracker.end.x || way != tracker.end.way)
            tracker.end = {x, way, real(pencil_roots(space, *anchor->P, x, way, *anchor->C, tracker.zone))};
        return tracker.end.times;
    };
    const auto roots = [&](double t) {
        point = tracker.at(course.at(t));
        return real(pencil_roots(space, *point->P, point->x, point->J * course.rate(t), *point->C, tracker.zone));
    };
    try {
        std::vector<double> starts, met;
        for (const double mu : at_end(*step.before)) starts.push_back(step.t0 + mu);
        for (const double mu : at_end(*step.after)) starts.push_back(step.t1 + mu);
        for (std::size_t k = 0; k < starts.size(); ++k) {
            if (!(step.t0 - 0.5 * h <= starts[k] && starts[k] <= step.t1 + 0.5 * h)) continue;
            double t = starts[k], move = FAR;
            for (int i = 0; i < 10; ++i) {
                const std::vector<double> mu = roots(t);
                if (mu.empty()) break;
                move = *std::min_element(mu.begin(), mu.end(),
                                         [](double a, double b) { return std::fabs(a) < std::fabs(b); });
                t += move;
                if (!(step.t0 - 0.6 * h <= t && t <= step.t1 + 0.6 * h) || std::fabs(move) < 1e-11 * h) break;
            }
            const bool known =
                std::any_of(met.begin(), met.end(), [&](double one) { return std::fabs(t - one) < SAME * h; });
            if (!(std::fabs(move) < 1e-8 * h && step.t0 < t - BORDER && t - BORDER <= step.t1) || known) continue;
            met.push_back(t);
            int corank = 0;
            for (const double mu : roots(t)) {
                corank += std::fabs(mu) < SAME * h;
                if (SAME * h <= std::fabs(mu) && std::fabs(mu) < NEXT * h) starts.push_back(t + mu);
            }
            const Bridged& by = bridge->bridged();
            if (by.near_miss || is_singular(space, point->x))
                found.push_back(
                    {t, cluster, std::max(1, corank), by.closure, by.transversality, by.near_miss, 1, point->x, &space});
        }
    } catch (const Lost&) {  // beside the step the mode may end; what was found stands
    } catch (const Stop&) {
    }
    tracker.anchor = anchor, tracker.curve = curve, tracker.patch = patch, tracker.u = u;
}

}  // namespace rg
