// Bridges of one coordinate that were built, to be met again; see maps/cluster/known_curves.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "cluster/curve.h"
#include "cluster/singular.h"

namespace rg {

class KnownCurves {
  public:
    // A singular place that modes pass without a bridge, and half how far from it one was tried: nearer, one is tried
    // again; 0 where no look decides more.
    struct Miss {
        Vector x;
        double since;
    };

    std::vector<CurvePtr> curves;
    std::vector<Miss> misses;
    Vector ahead;           // where modes seemed to touch farther ahead, as Python found, or empty:
    double unlooked = 0.0;  // within this distance from there it is not looked at again

    // A kept curve through this point and its u, if the nearest singular place is one of its own.
    std::pair<CurvePtr, double> through(const JetPtr& here, double zone) {
        for (std::size_t i = curves.size(); i-- > 0;) {
            const CurvePtr known = curves[i], candidate = turned(known, here->x, *here->space);
            const std::optional<double> at = candidate->passes(here->x);
            if (!at) continue;
            const Roots mu = recharted(here, candidate->shape().C)->roots(Vector::Ones(1));
            if (mu.empty()) continue;
            const double first = nearest_of(mu).real();
            const CurveShape& shape = candidate->shape();
            double apart = FAR;  // of modes in contact of order k, k times as far
            for (std::size_t k = 0; k < shape.roots.size(); ++k)
                apart = std::min(apart, std::fabs(*at + shape.times_as_far(k) * first - shape.roots[k]));
            if (!candidate->contains(*at) && apart >= 0.5 * zone) continue;
            if (candidate != known) keep(candidate);
            return {candidate, *at};
        }
        return {nullptr, 0.0};
    }

    // The curve at a point where K may tell nothing, and its u there: in use, touched, or a window built before.
    std::pair<CurvePtr, double> used_at(const Vector& x, const CurvePtr& now, const std::vector<CurvePtr>& touched) const {
        std::vector<CurvePtr> used = touched;
        if (now) used.insert(used.begin(), now);
        for (std::size_t i = curves.size(); i-- > 0;)
            if (curves[i]->within()) used.push_back(curves[i]);
        for (const CurvePtr& one : used) {
            const std::optional<double> found = one->shape().inside ? one->passes(x) : std::nullopt;
            if (found && one->contains(*found)) return {one, *found};
        }
        return {nullptr, 0.0};
    }

    // Whether the singular place next to a point is one of a meeting's whose curve does not reach there, or one that
    // is too far away yet to be told.
    bool beside(const JetPtr& here) const {
        if (ahead.size() && (here->x - ahead).norm() <= unlooked) return true;
        return std::any_of(curves.begin(), curves.end(), [&here](const CurvePtr& known) {
            return !known->shape().orders.empty() && known->is_beside(here);
        });
    }

    // Whether no bridge was found before at the singular place next to a point.
    bool missed(const Jet& here) const {
        if (misses.empty()) return false;
        const Vector at = place(here).x;
        return std::any_of(misses.begin(), misses.end(), [&](const Miss& one) {
            const Vector off = at - one.x;
            return here.nearest().size > one.since && (off - here.space->whole_turns(off)).lpNorm<Eigen::Infinity>() < SAME;
        });
    }

    // Remember that there is none, where modes pass each other.
    void miss(const Jet& here, double largest_gap) {
        const Place at = place(here);
        if (!at.found() || at.cone() || at.gap <= largest_gap) return;
        if (misses.size() >= std::size_t{MOST}) misses.erase(misses.begin());
        const double distance = here.nearest().size;
        misses.push_back({at.x, distance <= TOLD ? 0.0 : 0.5 * distance});
    }

    // Whether the singular place next to a point, to first order, is a crossing on a kept curve.
    bool crosses(const Jet& here) const {
        constexpr double SHARE = 0.3;  // of the distance, that first order may err by
        const Roots mu = curves.empty() ? Roots() : here.roots(Vector::Ones(1));
        if (mu.empty()) return false;
        const Vector place = here.x + nearest_of(mu).real() * here.J.col(0);
        return std::any_of(curves.begin(), curves.end(), [&](const CurvePtr& known) {
            const CurvePtr candidate = turned(known, here.x, *here.space);
            const CurveShape& shape = candidate->shape();
            if (shape.near_miss || !shape.orders.empty()) return false;
            Vector x, slope, bend;
            for (std::size_t k = 0; k < shape.roots.size(); ++k) {
                if (shape.corank[k] == 0) continue;
                candidate->point(shape.roots[k], x, slope, bend);
                if ((x - place).norm() <= SHARE * (x - here.x).norm()) return true;
            }
            return false;
        });
    }

    void keep(const CurvePtr& found) {
        if (curves.size() >= std::size_t{MOST}) curves.erase(curves.begin());
        curves.push_back(found);
    }

  private:
    static constexpr int MOST = 16;
    static constexpr double SAME = 1e-8, TOLD = 0.12;  // as in known_curves.py and touching/meeting_ahead.py

    // The curve after the whole turns of the revolute joints that bring it next to x.
    static CurvePtr turned(const CurvePtr& known, const Vector& x, const Space& space) {
        Vector center, slope, bend;
        known->point(known->center(), center, slope, bend);
        const Vector turns = space.whole_turns(x - center);
        if (turns.isZero(0.0)) return known;
        return std::make_shared<Curve>(known->shared(), known->shift() + turns);
    }
};

}  // namespace rg
