// A choice of independent joints of a mechanism that was read from a file; and reasons in words.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>

#include "derivatives/step_derivatives.h"
#include "simulation/solver.h"

namespace rg {

// The words for a reason, as Python's errors have them.
inline const char* words(int reason) {
    switch (reason) {
        case ROWS:
        case OBSTACLE:
        case ZONE: return "it comes to a singular configuration without a certified bridge, or the independent joints turn back";
        case BRANCH: return "the step is so long that it may end on another branch";
        case NEWTON: return "Newton's method does not close the loops";
        case NON_FINITE: return "the state left the finite numbers";
        case INERTIA: return "the reduced inertia is singular";
        case FORCE: return "a point spring has no length";
        default: return "the kernel cannot go on";
    }
}

struct PublicChart {
    explicit PublicChart(const ExportedChart& c) : of(*c.description), watch(c), layout(of), solver(of), other(of) {}

    // Largest entry of J at G (nv, m).
    double steepness(const double* G) const {
        double worst = 0.0;
        for (int i = 0; i < of.nv; ++i)
            for (int k = 0; k < of.m; ++k) {
                const double unit = watch.sizes[of.independent[k]];
                if (unit > 0.0) worst = std::max(worst, std::fabs(G[i * of.m + k]) * watch.sizes[i] / unit);
            }
        return worst;
    }

    const Description& of;
    const ExportedChart& watch;
    const Layout layout;
    Solver solver, other;  // of the motion, and of what is looked at beside it
    std::unique_ptr<Derivation> derivation;
};

}  // namespace rg
