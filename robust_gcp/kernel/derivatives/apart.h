// How far a point is from a state that is given.
#pragma once

#include <algorithm>
#include <cmath>

#include "abi.h"
#include "dynamics/motion.h"
#include "linalg/cells.h"
#include "path/path.h"

namespace rg {

// The largest difference between a point and (q, v): of numbers in q, dimensionless, and of v relative to the largest
// one and `at_rest`. The motion's v becomes the point's.
inline double apart(const double* q, const double* v, double at_rest, Path& path, Motion& motion,
                    const Cells<double>& size, Point& point) {
    double worst = 0.0, fastest = 0.0, off = 0.0;
    for (int j : path.chain.all) {
        const Body& b = path.chain.bodies[j];
        const bool ball = b.kind == SPHERICAL || b.kind == FREE_FLYER;
        const int end = b.q + NUMBERS[b.kind].q, turns = ball ? end - 4 : end;
        const bool flat = NUMBERS[b.kind].q == b.count;
        for (int k = b.q; k < turns; ++k)
            keep(worst, (point.q()[k] - q[k]) * (flat ? size[b.first + k - b.q] : 1.0));
        double same = 0.0, opposite = 0.0;  // ± q is one rotation
        for (int k = turns; k < end; ++k) {
            keep(same, point.q()[k] - q[k]);
            keep(opposite, point.q()[k] + q[k]);
        }
        keep(worst, std::min(same, opposite));
    }
    path.product(point, point.ydot(), motion.v.data());
    for (int k = 0; k < path.layout.nv; ++k) {
        keep(fastest, v[k] * size[k]);
        keep(off, (motion.v[k] - v[k]) * size[k]);
    }
    keep(worst, off > 0.0 ? off / (at_rest + fastest) : 0.0);
    return worst;
}

}  // namespace rg
