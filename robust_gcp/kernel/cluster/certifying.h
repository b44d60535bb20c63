// What the builders of curves and of lines share: widths tried, nodes on the far side, what is certified; see
// maps/cluster/certifying.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "cluster/curve.h"

namespace rg {

constexpr double COARSE = 0.015625, FINE = 0.000244140625;

// Near enough, in numbers that do not carry a solved point's rounding.
inline double rounded(double x, double grid) { return grid * std::nearbyint(x / grid); }
inline Matrix rounded(const Matrix& numbers, double grid) {
    return numbers.unaryExpr([grid](double x) { return rounded(x, grid); });
}

// The best bridge of several half widths: the first that is good, else that of the least error.
template <typename Attempt>
auto best_of(Attempt attempt, double zone, std::initializer_list<double> shrinks,
             std::initializer_list<double> shorter = {}) {
    constexpr double GOOD = 1e-9;
    std::optional<decltype(attempt(zone))> best;
    NoBridge failure;
    const auto good = [&](double shrink) {
        try {
            auto made = attempt(zone * shrink);
            const bool enough = made.error <= GOOD && !made.near_miss;
            if (!best || made.error < best->error) best = std::move(made);
            return enough;
        } catch (const NoBridge& now) {
            failure.tangential = failure.tangential || now.tangential;
        } catch (const Lost&) {
        }
        return false;
    };
    for (const double shrink : shrinks)
        if (good(shrink)) break;
    for (const double shrink : shorter)
        if (!best) good(shrink);
    if (!best) throw failure;
    return *std::move(best);
}

// Adds nodes on the far side to those on the near one: by extrapolation of all so far, then Newton.
template <typename Guess, typename Solve>
void go_beyond(std::vector<double>& places, std::vector<JetPtr>& nodes, const std::vector<double>& far,
               double half_width, Guess guess, Solve solve) {
    constexpr double FAR_SIDE[] = {0.1, 0.02};
    std::shared_ptr<const Matrix> P = nodes.front()->P;
    for (std::size_t k = 0; k < far.size(); ++k) {
        const auto [node, first] = solve(guess(places, nodes, far[k]), far[k], P);
        if (first > FAR_SIDE[std::min<std::size_t>(k, 1)] * half_width) throw NoBridge{};
        P = node->P;
        places.push_back(far[k]);
        nodes.push_back(node);
    }
}

// max |φ| between the nodes, in lengths, and whether that is more than rounding.
struct Closure {
    double left = 0.0;
    bool open = false;
};

// `at` gives x at a place, `beside` is a point near by.
template <typename At>
Closure closure_of(Space& space, const BridgeOptions& options, double left, double right, int parts,
                   const Vector& beside, At at) {
    double worst = 0.0;
    for (int i = 1; i < parts; ++i) worst = std::max(worst, space.residual(at(left + i * (right - left) / parts)));
    const double allowed = options.closure_tolerance + space.noise(beside);
    if (worst > std::max(allowed, options.geometric_tolerance)) throw NoBridge{};
    return {worst, worst > allowed};
}

// Error of Γ in the middle, from its error `off` between two nodes on each side; that in the middle is `growth` of
// Π|(s_i − center)/(s_i − s)| times it.
template <typename Off, typename Growth>
double held_out(const std::vector<double>& places, double center, Off off, Growth growth) {
    const std::size_t n = places.size();
    const std::size_t pairs[2][2] = {{n / 2 - 1, n / 2 - 2}, {n / 2, n / 2 + 1}};
    double worst = 0.0;
    for (const auto& [inner, outer] : pairs) {
        const double at = 0.5 * (places[inner] + places[outer]);
        double product = 1.0;
        for (const double place : places) product *= std::fabs((place - center) / (place - at));
        worst = std::max(worst, off(at, inner) * growth(product));
    }
    return worst;
}

inline double relative(const Matrix& found, const Matrix& known) {
    return (known - found).cwiseAbs().maxCoeff() / (1.0 + known.cwiseAbs().maxCoeff());
}

}  // namespace rg
