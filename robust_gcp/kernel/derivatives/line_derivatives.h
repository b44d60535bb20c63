// How the force of a point spring changes when the bodies that it ties are displaced.
#pragma once

#include <cmath>

#include "derivatives/closure_derivatives.h"
#include "derivatives/coriolis.h"
#include "derivatives/displacements.h"
#include "dynamics/forces.h"

namespace rg {

// Visits what it changes by along each of m inputs, by y and by u, of each velocity's force: velocity, input, both.
template <typename Visit>
void line_changed(const Forces::Line& line, const Chain& chain, const Displacements& moved, int m, Visit visit) {
    Moved ends[2];
    for (int end = 0; end < 2; ++end)
        ends[end] = point_moved(Forces::point(chain, line, end) - moved.near, moved.V[line.joint[end]],
                                moved.A[line.joint[end]]);
    const Moved apart = ends[1] - ends[0];
    const double length = std::sqrt(dot(apart.x, apart.x));
    const Vec u = length > 0.0 ? (1.0 / length) * apart.x : Vec{};
    const double tension = line.stiffness * (length - line.rest) + line.damping * dot(u, apart.d);
    for (int k = 0; k < m; ++k) {
        Moved changed[2];
        for (int end = 0; end < 2; ++end) changed[end] = point_changed(ends[end], moved.displaced(line.joint[end], k));
        const Moved change = changed[1] - changed[0];
        const double longer = dot(u, change.x);
        // of the force on the second body, by y and by u
        Vec stiff = line.stiffness * change.x, damped;
        if (length > 0.0) {
            const Vec turn = (1.0 / length) * (change.x - longer * u);
            const double faster = dot(turn, apart.d) + dot(u, change.d);
            stiff = (line.stiffness * longer + line.damping * faster) * u + tension * turn;
            damped = line.damping * longer * u;
        }
        for (int end = 0; end < 2; ++end) {
            const double sign = end == 1 ? 1.0 : -1.0;
            const Vec &at = ends[end].x, f = sign * tension * u, df = sign * stiff, du = sign * damped;
            const Wrench w{f, cross(at, f)}, dw{df, cross(at, df) + cross(changed[end].x, f)}, dwu{du, cross(at, du)};
            for (int j = line.joint[end]; j > 0; j = chain.bodies[j].parent) {
                const Body& b = chain.bodies[j];
                const Twist X = moved.displaced(j, k).X;
                for (int i = b.first; i < b.first + b.count; ++i)
                    visit(i, k, dot(moved.S[i], dw) + dot(bracket(X, moved.S[i]), w), dot(moved.S[i], dwu));
            }
        }
    }
}

}  // namespace rg
