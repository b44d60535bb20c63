// The bridge of a cluster of mobility 1: its curve through singular places, with certificate; see
// maps/cluster/curve.py, whose docstrings say why.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "cluster/hermite.h"
#include "cluster/singular.h"

namespace rg {

struct BridgeOptions {
    std::vector<double> nodes;
    bool error_controlled = false;  // the caller controls its error: places without a bridge may be passed
    double reach = 0.0, reach_of_several = 0.0, closure_tolerance = 0.0, geometric_tolerance = 0.0, transversality = 0.0;

    double largest_gap() const { return std::max(closure_tolerance, geometric_tolerance); }
};

// What all whole turns of a curve have in common.
struct CurveShape {
    Space* space = nullptr;
    Chart C;           // the direction of the parameter, (nv, 1)
    Vector reference;  // its origin
    Hermite through;
    double left = 0.0, right = 0.0, closure = 0.0, transversality = 0.0, error = 0.0;
    bool near_miss = false;
    std::vector<double> roots;
    std::vector<int> corank;
    std::vector<int> orders;  // of contact at each place, where one is above one; see maps/cluster/curve.py
    bool inside = false;      // whether the series is one of its own, not that of the nodes' polynomial
    Series series;            // of x, x′ and x″ between left and right

    int order(std::size_t i) const { return orders.empty() ? 1 : orders[i]; }
    double times_as_far(std::size_t i) const {
        return orders.empty() ? 1.0 : double(orders[i]) / std::max(corank[i], 1);
    }
};

class Curve {
  public:
    Curve(std::shared_ptr<const CurveShape> shape, Vector shift) : shape_(std::move(shape)), shift_(std::move(shift)) {}

    const CurveShape& shape() const { return *shape_; }
    const std::shared_ptr<const CurveShape>& shared() const { return shape_; }
    const Vector& shift() const { return shift_; }
    double center() const { return 0.5 * (shape_->left + shape_->right); }
    bool contains(double u) const { return shape_->left <= u && u <= shape_->right; }
    double u(const Vector& x) const { return shape_->C->col(0).dot(x - shift_ - shape_->reference); }

    // x, dx/du and d²x/du² at u.
    void point(double u, Vector& x, Vector& slope, Vector& bend) const {
        if (contains(u))
            shape_->series.evaluate(u, x, slope, bend);
        else
            shape_->through.evaluate(u, x, slope, bend);
        x += shift_;
    }

    // The innermost node on u's side.
    JetPtr inner(double u) const {
        const auto& nodes = shape_->through.nodes;
        const std::size_t half = nodes.size() / 2;
        auto moved = std::make_shared<Jet>(*nodes[u > center() ? half : half - 1]);
        moved->x += shift_;
        return moved;
    }

    // u with Cᵀ x(u) = y for the component c, from a guess; nothing once it leaves the nodes.
    std::optional<double> parameter(int c, double y, double u) const {
        const Hermite& through = shape_->through;
        const double width = shape_->right - shape_->left;
        u = std::min(std::max(u, through.us.front()), through.us.back());
        for (int i = 0; i < 30; ++i) {
            if (!through.reaches(u)) return {};
            double x = 0.0, slope = 0.0;
            component(c, u, x, slope);
            const double du = std::min(std::max((y - x) / slope, -0.5 * width), 0.5 * width);
            u += du;
            if (std::fabs(du) < 1e-15 + 4e-16 * std::fabs(u)) break;
        }
        return through.reaches(u) ? std::optional<double>(u) : std::nullopt;
    }

    // u of y by the slope at u, where y lies beyond the nodes.
    double beyond(int c, double y, double u) const {
        u = std::min(std::max(u, shape_->left), shape_->right);
        double x = 0.0, slope = 0.0;
        component(c, u, x, slope);
        return u + (y - x) / slope;
    }

    // The point at u in the chart that picks component c: J = x′/y_u, Γ = x″/y_u² − J (C x″/y_u²).
    JetPtr jet(const Chart& C, int c, double u) const {
        auto made = std::make_shared<Jet>();
        made->space = shape_->space, made->C = C, made->P = shape_->through.nodes.front()->P;
        Vector slope, bend;
        point(u, made->x, slope, bend);
        const double pace = slope[c];
        made->J = slope / pace;
        const Vector second = bend / (pace * pace);
        made->bend = second - made->J.col(0) * second[c];
        return made;
    }

    // Whether it is a window of a mode that lies in the singular set; see maps/cluster/touching/singular_mode.py.
    bool within() const { return shape_->roots.empty(); }

    // Whether the singular place next to a point of the mode, which is not on the curve, is one of the curve's.
    bool is_beside(const JetPtr& here) const {
        constexpr double FARTHEST = 4.0, SAME_ROOT = 0.3;
        const Roots mu = recharted(here, shape_->C)->roots(Vector::Ones(1));
        const double at = u(here->x);
        if (mu.empty() || std::fabs(at - center()) > FARTHEST * (shape_->right - shape_->left)) return false;
        const double first = nearest_of(mu).real();
        for (std::size_t i = 0; i < shape_->roots.size(); ++i)
            if (std::fabs(at + shape_->times_as_far(i) * first - shape_->roots[i]) < SAME_ROOT * std::fabs(at - shape_->roots[i]))
                return true;
        return false;
    }

    // u of a configuration that lies on the curve; nothing for another.
    std::optional<double> passes(const Vector& at) const {
        constexpr double SAME_PLACE = 1e-7;
        const double here = u(at);
        const auto& us = shape_->through.us;
        if (!(us.front() <= here && here <= us.back())) return {};
        Vector x, slope, bend;
        point(here, x, slope, bend);
        return (x - at).cwiseAbs().maxCoeff() < SAME_PLACE ? std::optional<double>(here) : std::nullopt;
    }

  private:
    void component(int c, double u, double& x, double& slope) const {
        if (contains(u))
            shape_->series.component(c, u, x, slope);
        else
            shape_->through.component(c, u, x, slope);
        x += shift_[c];
    }

    std::shared_ptr<const CurveShape> shape_;
    Vector shift_;
};

using CurvePtr = std::shared_ptr<const Curve>;

}  // namespace rg
