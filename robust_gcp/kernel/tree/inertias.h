// Forces on rigid bodies and inertias of these, about a point that all bodies share.
#pragma once

#include "tree/chain.h"
#include "tree/groups.h"
#include "linalg/spatial.h"

namespace rg {

struct Wrench {
    Vec force, moment;
};

inline Wrench& operator+=(Wrench& a, const Wrench& b) {
    a.force += b.force;
    a.moment += b.moment;
    return a;
}
inline Wrench& operator-=(Wrench& a, const Wrench& b) {
    a.force = a.force - b.force;
    a.moment = a.moment - b.moment;
    return a;
}
inline Wrench operator*(double s, const Wrench& a) { return {s * a.force, s * a.moment}; }
inline double dot(const Twist& v, const Wrench& f) { return dot(v.linear, f.force) + dot(v.angular, f.moment); }

// A rigid body's inertia about the common point: mass, mass times centre, second moments xx xy yy xz yz zz.
struct Massive {
    double mass = 0.0;
    Vec first;
    double second[6] = {};

    Massive() = default;
    Massive(const Body& b, const Axes& a, const Vec& from) : mass(b.mass) {
        const Vec c = from + a.turn(b.centre);
        first = mass * c;
        const double* I = b.inertia;
        const Vec x = I[0] * a.x + I[1] * a.y + I[3] * a.z, y = I[1] * a.x + I[2] * a.y + I[4] * a.z,
                  z = I[3] * a.x + I[4] * a.y + I[5] * a.z;
        second[0] = a.x.x * x.x + a.y.x * y.x + a.z.x * z.x + first.y * c.y + first.z * c.z;
        second[1] = a.x.x * x.y + a.y.x * y.y + a.z.x * z.y - first.x * c.y;
        second[2] = a.x.y * x.y + a.y.y * y.y + a.z.y * z.y + first.x * c.x + first.z * c.z;
        second[3] = a.x.x * x.z + a.y.x * y.z + a.z.x * z.z - first.x * c.z;
        second[4] = a.x.y * x.z + a.y.y * y.z + a.z.y * z.z - first.y * c.z;
        second[5] = a.x.z * x.z + a.y.z * y.z + a.z.z * z.z + first.x * c.x + first.y * c.y;
    }

    Wrench operator*(const Twist& v) const {
        return {mass * v.linear + cross(v.angular, first), times_inertia(second, v.angular) + cross(first, v.linear)};
    }
    Massive& operator+=(const Massive& o) {
        mass += o.mass;
        first += o.first;
        for (int i = 0; i < 6; ++i) second[i] += o.second[i];
        return *this;
    }
};

// What a body takes to accelerate while the parts that it carries move freely, but for rigid bodies: by blocks
// force by linear (symmetric: xx xy yy xz yz zz), force by angular (rows) and moment by angular (symmetric).
struct Articulated {
    double linear[6] = {}, angular[6] = {};
    Vec mixed[3];

    Wrench operator*(const Twist& v) const {
        Wrench f{times_inertia(linear, v.linear), times_inertia(angular, v.angular)};
        for (int i = 0; i < 3; ++i) {
            f.force[i] += dot(mixed[i], v.angular);
            f.moment += v.linear[i] * mixed[i];
        }
        return f;
    }
    Articulated& operator+=(const Articulated& o) {
        for (int i = 0; i < 6; ++i) linear[i] += o.linear[i], angular[i] += o.angular[i];
        for (int i = 0; i < 3; ++i) mixed[i] += o.mixed[i];
        return *this;
    }
    void add(const Massive& o) {
        linear[0] += o.mass, linear[2] += o.mass, linear[5] += o.mass;
        for (int i = 0; i < 6; ++i) angular[i] += o.second[i];
        mixed[0] += {0.0, o.first.z, -o.first.y};
        mixed[1] += {-o.first.z, 0.0, o.first.x};
        mixed[2] += {o.first.y, -o.first.x, 0.0};
    }
    // Less f fᵀ.
    void release(const Wrench& f) {
        less(linear, f.force);
        less(angular, f.moment);
        for (int i = 0; i < 3; ++i) mixed[i] += -f.force[i] * f.moment;
    }

  private:
    static void less(double* a, const Vec& x) {
        a[0] -= x.x * x.x, a[1] -= x.x * x.y, a[2] -= x.y * x.y;
        a[3] -= x.x * x.z, a[4] -= x.y * x.z, a[5] -= x.z * x.z;
    }
};

}  // namespace rg
