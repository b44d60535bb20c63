// Following one cluster's mode: regular ground by continuation, singular places by bridges; see
// maps/cluster/tracker.py, whose docstrings say why. What ends a motion is left to Python.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "cluster/chart.h"
#include "cluster/curve_builder.h"
#include "cluster/known_curves.h"
#include "cluster/newton.h"
#include "cluster/obstacles.h"

namespace rg {

struct Tally {
    std::int64_t marching = 0, svds = 0, built = 0, second_order = 0;
};

class Patch;

// Where a step ended, and the times until K is singular along the motion there, to first order.
struct End {
    Vector x, way;
    std::vector<double> times;
};

class Tracker {
  public:
    JetPtr anchor;
    Chart C;
    KnownCurves known_curves;
    CurvePtr curve;                // in use, or null
    std::shared_ptr<Patch> patch;  // in use, or null
    double u = 0.0;
    std::vector<CurvePtr> touched;  // since the list was emptied
    std::shared_ptr<Patch> touched_patch;
    End end;  // of the last step that was looked through
    bool crossed = false;  // whether a root of a touched curve may lie between points since then
    double zone;

    Tracker(JetPtr at, const BridgeOptions& options, double zone, Tally& tally)
        : anchor(std::move(at)), C(anchor->C), zone(zone), space_(anchor->space), options_(&options),
          tally_(&tally) {}

    bool on_bridge() const { return curve != nullptr || patch != nullptr; }

    // Another tracker at the same point, which knows the same curves.
    Tracker copy() const {
        Tracker other(anchor, *options_, zone, *tally_);
        other.known_curves = known_curves, other.u = u, other.curve = curve;
        return other;
    }

    // A tracker of a smaller zone for a node.
    Tracker nested(JetPtr at, double smaller) const {
        Tracker other(std::move(at), *options_, smaller, *tally_);
        other.node_ = true;
        return other;
    }

    // Go on from another solved point of the mode.
    void place_at(JetPtr at) {
        anchor = std::move(at);
        C = anchor->C;
        if (patch) left_ = patch;
        curve = nullptr, patch = nullptr;
        space_->apex.reset();
    }

    // At a point without a bridge: what rounding costs of G at most, the tolerance to ask for, δ; see maps/cluster/apex.py.
    std::array<double, 3> rounding() const {
        if (on_bridge()) return {0.0, 0.0, FAR};
        const double near = std::max(anchor->delta(), APEX), apex = 2e-15 / near, usual = 1e-16 / (near * near);
        return space_->apex ? std::array{apex, apex, near} : std::array{8.0 * usual, 0.01 * usual, near};
    }

    // Go on at a point of a bridge where K may tell nothing; whether there is one.
    bool back_at(const Vector& x) {
        const auto [found, there] = known_curves.used_at(x, curve, touched);
        if (found) curve = found, u = there, anchor = curve->jet(C, space_->chosen[0], u);
        return found != nullptr;
    }

    // The point at y on the mode.
    JetPtr at(const Vector& y) {
        for (int i = 0; i < 40; ++i) {
            JetPtr found = curve ? on_curve(y[0]) : patch ? on_patch(y) : walk(y);
            if (found != nullptr) return anchor = found;
        }
        throw Lost{};
    }

    void forget_touched() {
        crossed = false;
        touched.clear();
        if (curve) touched.push_back(curve);
        touched_patch = patch;
    }

  private:
    static constexpr double CORRECTION = 0.25, STAGES_AHEAD = 40.0;
    static constexpr double BESIDE = 1e-2, LEFT = 2e-2, NEAR_APEX = 0.1, TURNED = 0.3;  // as in maps/cluster/apex.py
    static constexpr double CLEAR = 1.5;  // zones from a surface, beyond which no line across it is asked for
    static constexpr int MAX_STEPS = 400, MAX_OBSTACLES = 400;

    JetPtr on_patch(const Vector& y);
    bool enter_patch(const JetPtr& here, const Vector& y);
    JetPtr on_curve(double y) {
        const int c = space_->chosen[0];
        const std::optional<double> found = curve->parameter(c, y, u);
        if (found && curve->contains(*found)) {
            touch(curve);
            move_to(*found);
            return curve->jet(C, c, u);
        }
        if (curve->within()) throw Stop{};  // the next window is Python's to build
        const double side = found ? *found : curve->beyond(c, y, u);
        move_to(side);
        anchor = recharted(curve->inner(side), C);
        curve = nullptr;
        return nullptr;
    }

    // Another place on the curve. What is near a root may be on its other side before a solver's step ends.
    void move_to(double there) {
        const CurveShape& shape = curve->shape();
        const double margin = 1e-3 * (shape.right - shape.left);
        const double low = std::min(u, there) - margin, high = std::max(u, there) + margin;
        crossed = crossed || std::any_of(shape.roots.begin(), shape.roots.end(),
                                         [=](double root) { return low <= root && root <= high; });
        u = there;
    }

    // March towards y; null with a bridge in use where one is entered.
    JetPtr walk(const Vector& y) {
        if (!anchor->solved) anchor = jet_at(*space_, anchor->x, C);
        JetPtr here = anchor;
        double limit = 1.0;
        for (int i = 0; i < MAX_STEPS; ++i) {
            Vector step = y;
            step.noalias() -= C->transpose().lazyProduct(here->x);
            const double size = here->J.lazyProduct(step).norm();
            if (options_->error_controlled && space_->m > 1 && !node_) look_for_apex(*here);
            const double ahead = std::min(std::max(zone, STAGES_AHEAD * size), FARTHEST_LOOK);
            const double delta = room(*here, std::max({zone, ahead, size / REACH}));
            if (delta < zone && in_zone(*here) && enter(here, y)) return nullptr;
            if (delta < ahead) look_ahead(*here, size);
            const double reach = (space_->apex ? NEAR_APEX : REACH) * std::min(delta, limit);
            const double share = size > 0.0 ? std::min(1.0, reach / size) : 1.0;
            JetPtr found = share == 1.0 ? this->step(here, step, y, size)
                                        : this->step(here, share * step, here->y() + share * step, share * size);
            if (found == nullptr) {
                limit = 0.5 * std::min(limit, share * size / REACH);
                if (limit < 1e-9) throw Lost{};
                continue;
            }
            limit = std::min(1.0, 2.0 * limit);
            here = anchor = found;
            if (share == 1.0) {
                return room(*here, zone) < zone && in_zone(*here) && enter(here, y) ? nullptr : here;
            }
        }
        throw Lost{};
    }

    bool in_zone(const Jet& here) const { return here.nearest().size < zone; }

    // Stop before a step that would pass too fast by modes that veer away from each other.
    void look_ahead(const Jet& here, double size) {
        if (options_->error_controlled) return;
        const Obstacle& ahead = seen_.at(here, options_->largest_gap(), [&] { return known_curves.crosses(here); });
        if (ahead.kind != Obstacle::CROSSING && ahead.approach < STAGES_AHEAD * size) throw Stop{};
    }

    // Take φ relative to the apex of a cone that is near; a stop where it is too near.
    void look_for_apex(const Jet& here) {
        const double distance = here.nearest().size;
        if (space_->apex) {
            if (distance > LEFT)
                space_->apex.reset();
            else if (distance < APEX)
                throw Stop{};
        } else if (distance < BESIDE && !(apexless_.size() && (here.x - apexless_).norm() <= 0.5 * distance)) {
            const Place found = place(here);
            if (found.cone() && found.gap <= options_->largest_gap())
                space_->apex = found.x;
            else
                apexless_ = here.x;
        }
    }

    // One continuation step; null where Newton left the mode.
    JetPtr step(const JetPtr& here, const Vector& step, const Vector& target, double size) {
        ++tally_->marching;
        std::optional<Newton> newton;
        try {
            newton.emplace(*space_, here->predicted(step), *C, target, *here->P);
        } catch (const Lost&) { return nullptr; }
        ++tally_->svds;
        JetPtr found = newton->jet(*space_, C, here->P);
        const double first = newton->first, allowed = CORRECTION * size + 1e-12;
        // rounding of φ looks like a lost branch where K is poor
        if (first > allowed && first > allowed + 1e-14 / std::max(std::min(here->sigma(), found->sigma()), 1e-12))
            return nullptr;
        return turned_over(*here, *found) || (space_->apex && apart(*here, *found) > TURNED) ? nullptr : found;
    }

    // Whether y is so far on this side of the surface that no line across it, from here, would reach it.
    bool leaves(const Jet& here, const Vector& y) const {
        const Distance& nearest = here.nearest();  // σ grows that way, of unit arc length
        const Vector step = here.J * (y - here.y()), way = here.J * nearest.way;
        return nearest.size + step.dot(way) > CLEAR * zone;
    }

    // What the distance to singular places is at least, which need not be known beyond `wanted`: next to a point
    // where it was looked at, it is not looked at again while it is clearly enough.
    double room(const Jet& here, double wanted) {
        const double left = 0.8 * clear_;
        if (clear_ < FAR && left >= wanted && (here.x - cleared_).norm() <= 0.05 * clear_) return left;
        cleared_ = here.x;
        return clear_ = here.delta();
    }

    // Put a bridge in use at a point in the zone, when y lies on it or beyond it.
    bool enter(const JetPtr& here, const Vector& y) {
        if (known(*here)) return false;
        return space_->m > 1 ? enter_patch(here, y) : enter_curve(here, y[0]);
    }

    bool enter_curve(const JetPtr& here, double y) {
        auto [found, from] = known_curves.through(here, zone);
        if (found == nullptr) {
            if (known_curves.beside(here)) return false;
            if (known_curves.missed(*here)) return blocked(*here, {});
            try {
                found = CurveBuilder(here, *options_, zone).build();
            } catch (const NoBridge& failure) {
                if (!failure.tangential) known_curves.miss(*here, options_->largest_gap());
                return blocked(*here, failure);
            }
            ++tally_->built, ++tally_->second_order;
            known_curves.keep(found);
            from = found->u(here->x);
        }
        const int c = space_->chosen[0];
        const double to = found->parameter(c, y, from).value_or(found->beyond(c, y, from));
        if (!found->contains(to) && (from - found->center()) * (to - found->center()) > 0.0)
            return false;  // beside it, not across
        touch(found);
        curve = found, u = from;
        return true;
    }

    // Remember a place without a bridge; a stop unless the caller controls its error.
    bool blocked(const Jet& here, const NoBridge& failure) {
        if (!options_->error_controlled) throw Stop{};
        Obstacle met = judge(here, options_->largest_gap(), zone);
        if (failure.tangential) met.kind = Obstacle::UNKNOWN;
        if (obstacles_.size() >= std::size_t{MAX_OBSTACLES}) obstacles_.erase(obstacles_.begin());
        obstacles_.push_back(met);
        if (met.stops(here.nearest().size, zone)) throw Stop{};
        return false;
    }

    // Whether a point is still at an obstacle.
    bool known(const Jet& here) const {
        for (std::size_t i = obstacles_.size(); i-- > 0;) {
            const Obstacle& one = obstacles_[i];
            if (!one.covers(here.x)) continue;
            if (!options_->error_controlled || one.stops(here.nearest().size, zone)) throw Stop{};
            return true;
        }
        return false;
    }

    void touch(const CurvePtr& found) {
        if (std::find(touched.begin(), touched.end(), found) == touched.end()) touched.push_back(found);
    }

    Space* space_;
    const BridgeOptions* options_;
    Tally* tally_;
    Seen seen_;
    std::vector<Obstacle> obstacles_;  // passed with error control
    std::shared_ptr<Patch> beside_;  // built last where the motion had not reached it
    std::shared_ptr<Patch> left_;    // in use before the tracker was put elsewhere
    Vector apexless_;                // where no apex was found last
    bool node_ = false;              // of a line
    Vector cleared_;      // where the distance to singular places was looked at last
    double clear_ = FAR;  // that distance
};

}  // namespace rg
