// How the wrenches that bodies take change as they are displaced.
#pragma once

#include "tree/groups.h"
#include "tree/inertias.h"

namespace rg {

// How a wrench changes that is displaced by X.
inline Wrench carried(const Twist& X, const Wrench& f) {
    return {cross(X.angular, f.force), cross(X.angular, f.moment) + cross(X.linear, f.force)};
}

// Σ m r × (2 P × ṙ) over a body's masses, and the forces to it: what P adds to the wrench at the velocity V.
struct Coriolis {
    Vec momentum, column[3];  // Σ m ṙ, and Σ m ṙ rᵀ

    Coriolis() = default;
    Coriolis(const Massive& body, const Twist& V)
        : momentum(body.mass * V.linear + cross(V.angular, body.first)) {
        const double *J = body.second, half = 0.5 * (J[0] + J[2] + J[5]);
        const Vec moments[3] = {{half - J[0], -J[1], -J[3]}, {-J[1], half - J[2], -J[4]}, {-J[3], -J[4], half - J[5]}};
        for (int i = 0; i < 3; ++i) column[i] = body.first[i] * V.linear + cross(V.angular, moments[i]);
    }

    double trace() const { return column[0].x + column[1].y + column[2].z; }
    Wrench operator*(const Vec& P) const {
        const Vec turned = P.x * column[0] + P.y * column[1] + P.z * column[2];
        return {2.0 * cross(P, momentum), 2.0 * (trace() * P - turned)};
    }
    // What X · (B P) is, as a product with P.
    Vec transposed(const Twist& X) const {
        const Vec& w = X.angular;
        return 2.0 * (cross(momentum, X.linear) + trace() * w -
                      Vec{dot(column[0], w), dot(column[1], w), dot(column[2], w)});
    }
    Coriolis& operator+=(const Coriolis& o) {
        momentum += o.momentum;
        for (int i = 0; i < 3; ++i) column[i] += o.column[i];
        return *this;
    }
};

}  // namespace rg
