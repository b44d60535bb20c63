// Builds a curve from a solved point beside singular places, and certifies it; see maps/cluster/curve_builder.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "cluster/certifying.h"
#include "cluster/curve.h"
#include "cluster/newton.h"

namespace rg {

constexpr double REACH = 0.4;  // continuation step, a share of the distance to the singular set

class CurveBuilder {
  public:
    CurveBuilder(JetPtr anchor, const BridgeOptions& options, double zone)
        : space_(*anchor->space), options_(options), zone_(zone) {
        shape_.space = &space_;
        shape_.C = std::make_shared<Matrix>(rounded(anchor->tangent(), COARSE));
        shape_.reference = rounded(Matrix(anchor->x), COARSE);
        anchor_ = recharted(anchor, shape_.C);
    }

    // The best certified curve of several widths.
    CurvePtr build() {
        CurveShape best = best_of([this](double half_width) { return attempt(half_width); }, zone_,
                                  {1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08});
        best.series = Series(best.through, best.left, best.right);
        return std::make_shared<Curve>(std::make_shared<CurveShape>(std::move(best)), Vector::Zero(space_.nv));
    }

  private:
    static constexpr double SAME = 1e-9;   // between places that are one
    static constexpr int MAX_STEPS = 400;  // off the mode, K may lose rank ten times nearer than along it
    static constexpr double ALONE = 0.05;  // share of the way to the next place at which a root is of this one

    double u(const Vector& x) const { return shape_.C->col(0).dot(x - shape_.reference); }

    // The curve between nodes this far from the singular places.
    CurveShape attempt(double half_width) {
        const double start = u(anchor_->x);
        auto [low, high] = ahead(half_width);
        low += start, high += start;
        for (int i = 0; i < 5; ++i) {
            const double center = 0.5 * (low + high), w = half_width + 0.5 * (high - low);
            place_nodes(center, w);
            find_places(center, w);
            const double first = shape_.roots.front(), last = shape_.roots.back();
            if (std::fabs(first - low) <= 0.2 * half_width && std::fabs(last - high) <= 0.2 * half_width)
                return certified();
            low = first, high = last;
        }
        throw NoBridge{};
    }

    // First-order range of the singular places that share a bridge, on the nearer side of the anchor.
    std::pair<double, double> ahead(double half_width) const {
        Roots mu;
        for (const auto& root : anchor_->roots(Vector::Ones(1)))
            if (std::abs(root) < 3.0 * zone_) mu.push_back(root);
        if (mu.empty()) throw NoBridge{};
        const double nearest = nearest_of(mu).real();
        double low = FAR, high = -FAR;
        for (const auto& root : mu)
            if (std::abs(root) < std::fabs(nearest) + 2.0 * half_width && root.real() * nearest > 0.0)
                low = std::min(low, root.real()), high = std::max(high, root.real());
        if (low > high) throw NoBridge{};
        return {low, high};
    }

    // Near nodes by continuation, far nodes by extrapolation of all so far, then Newton.
    void place_nodes(double center, double w) {
        const double side = center > u(anchor_->x) ? -1.0 : 1.0;
        center = rounded(center, FINE), w = rounded(w, FINE);
        std::vector<double> us, far;
        std::vector<JetPtr> nodes;
        JetPtr here = anchor_;
        for (const double factor : options_.nodes) {
            us.push_back(center + side * factor * w);
            far.push_back(center - side * factor * w);
            here = march(here, us.back());
            nodes.push_back(here);
        }
        const auto guess = [](const std::vector<double>& at, const std::vector<JetPtr>& known, double to) {
            Vector x, slope, bend;
            Hermite(at, known).evaluate(to, x, slope, bend);
            return x;
        };
        go_beyond(us, nodes, far, w, guess,
                  [this](const Vector& x, double to, const auto& P) { return solve_at(x, to, P); });
        shape_.through = Hermite(us, nodes);
        shape_.left = center - w, shape_.right = center + w;
    }

    // Along the curve by short steps that stay on the mode.
    JetPtr march(JetPtr here, double to) const {
        for (int i = 0; i < MAX_STEPS; ++i) {
            const double at = u(here->x), limit = REACH * std::min(here->delta(), 1.0);
            const bool last = std::fabs(to - at) <= limit;
            const double next = last ? to : at + std::min(std::max(to - at, -limit), limit);
            const auto [found, first] = solve_at(here->predicted(Vector::Constant(1, next - at)), next, here->P);
            here = found;
            const double allowed = 0.25 * std::fabs(next - at);
            if (first > allowed && first > allowed + 1e-14 / std::max(here->sigma(), 1e-12)) throw NoBridge{};
            if (last) return here;
        }
        throw NoBridge{};
    }

    std::pair<JetPtr, double> solve_at(const Vector& guess, double at,
                                       const std::shared_ptr<const Matrix>& P) const {
        const Vector y = shape_.C->transpose() * shape_.reference + Vector::Constant(1, at);
        return solved(space_, guess, shape_.C, y, P);
    }

    // Places to first order from the curve at u, real ones.
    std::vector<double> places(double at, double w) const {
        Vector x, slope, bend;
        shape_.through.evaluate(at, x, slope, bend);
        std::vector<double> found;
        for (const auto& mu : pencil_roots(space_, *shape_.through.nodes[0]->P, x, slope, *shape_.C, w))
            if (std::fabs(mu.imag()) <= 0.5 * std::abs(mu) + 1e-6) found.push_back(mu.real());
        return found;
    }

    // u of all singular places between the inner nodes, to rounding, and how many roots of the pencil are at each. Of
    // loops that are singular at once it has as many roots that are one: they are not looked for again. Those
    // next to a place are known best from there.
    void find_places(double center, double w) {
        const Hermite& through = shape_.through;
        struct Found {
            double at, next;  // next: how far the next one is
            int count;
        };
        std::vector<Found> found;
        std::vector<double> starts = places(center, w);
        for (double& start : starts) start += center;
        for (std::size_t k = 0; k < starts.size(); ++k) {
            double at = starts[k];
            if (std::any_of(found.begin(), found.end(),
                            [at](const Found& one) { return std::fabs(at - one.at) < ALONE * one.next; }))
                continue;
            for (int i = 0; i < 10; ++i) {
                if (!(through.us.front() <= at && at <= through.us.back())) break;
                const std::vector<double> mu = places(at, w);
                if (mu.empty()) break;
                const double step = *std::min_element(
                    mu.begin(), mu.end(), [](double a, double b) { return std::fabs(a) < std::fabs(b); });
                at += step;
                if (std::fabs(step) >= SAME) continue;
                const bool known = std::any_of(found.begin(), found.end(),
                                               [at](const Found& one) { return std::fabs(at - one.at) < SAME; });
                if (known || !(shape_.left < at && at < shape_.right)) break;
                Found here{at, shape_.right - shape_.left, 0};
                for (const double one : mu) {
                    const double away = one - step;
                    if (std::fabs(away) < SAME) {
                        ++here.count;
                        continue;
                    }
                    here.next = std::min(here.next, std::fabs(away));
                    if (shape_.left < at + away && at + away < shape_.right) starts.push_back(at + away);
                }
                found.push_back(here);
                break;
            }
        }
        if (found.empty()) throw NoBridge{};
        std::sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.at < b.at; });
        shape_.roots.clear(), shape_.corank.clear();
        for (const Found& one : found) shape_.roots.push_back(one.at), shape_.corank.push_back(one.count);
    }

    // The curve through the nodes, with what vouches for it.
    CurveShape certified() {
        Vector x, slope, bend;
        const Closure closure = closure_of(space_, options_, shape_.left, shape_.right, 14, shape_.reference,
                                           [&](double at) {
                                               shape_.through.evaluate(at, x, slope, bend);
                                               return x;
                                           });
        shape_.closure = closure.left;
        shape_.transversality = FAR;
        int singular = 0;
        for (std::size_t i = 0; i < shape_.roots.size(); ++i) {
            shape_.through.evaluate(shape_.roots[i], x, slope, bend);
            const auto [r, parted] = null_pairing(space_, *shape_.through.nodes[0]->P, x, slope, *shape_.C);
            if (!closure.open && !is_singular(space_, x)) shape_.corank[i] = 0;
            shape_.transversality = std::min(shape_.transversality, parted);
            singular += r;
        }
        if (shape_.transversality < options_.transversality) throw NoBridge{true};
        shape_.near_miss = closure.open || singular == 0;
        const auto off = [this](double at, std::size_t inner) {
            Vector y, slope, bend;
            shape_.through.evaluate(at, y, slope, bend);
            return relative(bend, solve_at(y, at, shape_.through.nodes[inner]->P).first->bend.col(0));
        };
        const double error = held_out(shape_.through.us, 0.5 * (shape_.left + shape_.right), off,
                                      [](double growth) { return std::min(growth * growth, 1e3); });
        shape_.error = std::max(error, shape_.closure);
        return shape_;
    }

    Space& space_;
    const BridgeOptions& options_;
    double zone_;
    JetPtr anchor_;
    CurveShape shape_;
};

}  // namespace rg
