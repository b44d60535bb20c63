// What each velocity adds to the rate of a line's length through one of its ends.
#pragma once

#include "linalg/spatial.h"
#include "tree/chain.h"

namespace rg {

// Visits the velocities that carry a point of a joint's body, each with u · (the point's velocity at rate 1).
template <typename Visit>
void over_freedoms(const Chain& chain, int joint, const Vec& at, const Vec& u, Visit visit) {
    for (int j = joint; j > 0; j = chain.bodies[j].parent) {
        const Body& b = chain.bodies[j];
        for (int i = b.first; i < b.first + b.count; ++i) {
            const Vec& axis = chain.axes[j][chain.freedoms[i].column];
            const Vec way = chain.freedoms[i].turning ? cross(axis, at - chain.p[j]) : axis;
            visit(i, dot(u, way));
        }
    }
}

}  // namespace rg
