// The loops of one part: Newton on its dependent joints, and its share of G and g. See maps/regular_path.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "abi.h"
#include "path/blocks.h"
#include "linalg/cells.h"
#include "tree/chain.h"
#include "path/charts.h"
#include "constraint/closures.h"
#include "constraint/extended.h"
#include "tree/groups.h"
#include "tree/parts.h"
#include "path/point.h"

namespace rg {

constexpr double CONVERGED = 2e-15, STAGNANT = 1e-12;
constexpr int MAX_NEWTON = 12;
constexpr double CHORD = 10.0;  // how many turns of joints K_d changes by at most, relative to itself

// Room for numbers (nv,) that one part after the other uses.
struct Scratch {
    explicit Scratch(const Description& d) : scale(d.scale, d.scale + d.nv), step(d.nv), u(d.nv) {}

    const Cells<double> scale;  // what a correction of a velocity is multiplied by
    Cells<double> step, u;
};

// The closures and couplings of a part, and its share of K_d.
class Loops {
  public:
    Closures closures;
    Blocks blocks;  // refers to `closures`
    Charts charts;
    std::vector<int> dependent;
    std::int64_t iterations = 0, evaluations = 0;  // of the last `close`

    Loops(const Description& d, Chain& chain, const Parts& parts, int number, Scratch& scratch)
        : closures(d, chain, parts.list[number]),
          blocks(d, closures, parts, number),
          charts(d, chain, parts.list[number]),
          part_(parts.list[number]),
          chain_(chain),
          scratch_(scratch),
          independent_(d.independent, d.independent + d.m),
          given_(d.nv * part_.inputs.size()) {
        for (int i : part_.velocities)
            if (std::find(independent_.begin(), independent_.end(), i) == independent_.end()) dependent.push_back(i);
        for (int j : part_.joints) {
            const Numbers& numbers = NUMBERS[chain.bodies[j].kind];
            flat_ = flat_ && numbers.q == numbers.v;
        }
    }

    // Newton on the dependent joints; leaves the chain placed and K evaluated at the result. `origin` is a whole q
    // about which charts are.
    bool close(Point& point, const double* origin) {
        double* q = point.q();
        double* step = scratch_.step.data();
        double* u = scratch_.u.data();
        const double infinite = std::numeric_limits<double>::infinity();
        double last_size = infinite, last_length = infinite;
        iterations = evaluations = 0;
        charts.begin(origin, point.y(), q);
        for (int iteration = 0; iteration < MAX_NEWTON; ++iteration) {
            if (iteration == 0)
                chain_.place(part_.joints, q);
            else
                chain_.place_after(part_.joints, q, step);
            const double size = closures.residual(q);
            ++evaluations;
            if (!std::isfinite(size)) return false;
            double length = iteration == 0 && size > CONVERGED ? by_chord(point, u) : infinite;
            if (!(length < infinite)) {
                closures.jacobian();
                if (size <= CONVERGED || (size <= STAGNANT && size >= 0.25 * last_size)) return true;
                charts.turn(closures);
                blocks.factor();
                length = blocks.solve(closures.phi.data(), u);
            }
            if (iteration == 0)
                point.correction = std::max(point.correction, length);
            else if (!(length <= 0.5 * last_length) && size > STAGNANT)
                return false;
            last_size = size;
            last_length = length;
            correct(q, step, u);
            charts.move(origin, step, q);
            ++iterations;
        }
        return false;
    }

    // K_d factorised at q, where the chain is placed.
    void prime(const double* q) {
        closures.residual(q);
        closures.jacobian();
        blocks.factor();
    }

    // Newton's step to where q is closed to its own rounding, by what is known of φ in more digits, where K_d is
    // factorised: a second one would be rounding.
    void refine(Extended& known, double* q) {
        known.residual(q, chain_.numbers, closures.phi.data());
        reopen(closures.phi.data(), q);
    }

    // q where φ is less by so much, by row, where K_d is factorised.
    void reopen(const double* errors, double* q) {
        blocks.solve(errors, scratch_.u.data());
        correct(q, scratch_.step.data(), scratch_.u.data());
    }

    // −K_d⁻¹ K_i, the dependent rows of G, where `close` has ended and K_d is factorised.
    void velocities(double* G, int m) {
        const int count = part_.count();
        blocks.solve_given(given_.data());
        for (int i : dependent)
            for (int a = 0; a < count; ++a) G[i * m + part_.inputs[a]] = scratch_.scale[i] * given_[i * count + a];
    }

    // g = [0; K_d⁻¹ k] for velocities v, with which the chain moves.
    void bend(const double* v, double* g) {
        double* u = scratch_.u.data();
        closures.bias(v);
        blocks.solve(closures.k.data(), u);
        for (int i : dependent) g[i] = scratch_.scale[i] * u[i];
    }

  private:
    // Newton's first step with the K_d that was factorised last, by velocities where the step is one of w; infinite
    // unless it is so small that the turn since then, or from the chart's origin, does not show in it.
    double by_chord(const Point& point, double* u) {
        const double infinite = std::numeric_limits<double>::infinity();
        if (!blocks.factorised || !(point.turn > 0.0)) return infinite;
        const double length = blocks.solve(closures.phi.data(), u);
        return CHORD * length * std::max(point.turn, charts.largest()) <= CONVERGED ? length : infinite;
    }

    // Takes u off q, and leaves the step in `step`.
    void correct(double* q, double* step, const double* u) const {
        for (int k : part_.inputs) step[independent_[k]] = 0.0;
        for (int i : dependent) step[i] = -u[i] * scratch_.scale[i];
        if (flat_) {
            for (int i : dependent) q[chain_.number_at[i]] += step[i];
            return;
        }
        for (int j : part_.joints) {
            const Body& b = chain_.bodies[j];
            integrate_joint(b.kind, q + b.q, step + b.first, q + b.q);
        }
    }

    const Part& part_;
    Chain& chain_;
    Scratch& scratch_;
    const std::vector<int> independent_;
    Cells<double> given_;  // −K_d⁻¹ K_i by velocity and input
    bool flat_ = true;  // v is the rate of q
};

}  // namespace rg
