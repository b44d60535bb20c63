// The joints of the spanning tree in world axes: placements, velocities, accelerations.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "tree/joints.h"
#include "linalg/spatial.h"

namespace rg {

struct Body {
    int parent = 0, kind = REVOLUTE, q = 0, first = 0, count = 1;  // first, count: its freedoms
    bool aligned = false;                                       // placed without a rotation
    bool held = false;                                          // in its neutral position
    bool upright = false;                                       // turns about its own z only, seen from the ground
    bool heavy = false;                                         // has mass or inertia
    Axes placed;
    Vec at;
    double mass = 0.0;
    Vec centre;
    double inertia[6] = {};  // at the centre: xx xy yy xz yz zz
};

inline Vec times_inertia(const double* I, const Vec& w) {
    return {I[0] * w.x + I[1] * w.y + I[3] * w.z, I[1] * w.x + I[2] * w.y + I[4] * w.z,
            I[3] * w.x + I[4] * w.y + I[5] * w.z};
}

struct Chain {
    std::vector<Body> bodies;        // 0 is the ground
    std::vector<Freedom> freedoms;   // by index in v
    std::vector<int> number_at;      // by index in v, in q; of use where v is the rate of q
    std::vector<int> all;            // joints, parents first
    std::size_t numbers = 0;         // in q
    Vec gravity, ground;
    // state
    Cells<Axes> axes;
    Cells<Vec> p, r;                // origins, and those seen from the parent's origin
    Cells<double> cosine, sine;     // of revolute joints
    bool anew = false;              // whether `place_after` takes them from the angle, as `place` does
    Cells<Vec> omega, u, alpha, a;  // u: velocity of the origin

    explicit Chain(const Description& d)
        : gravity{d.gravity[0], d.gravity[1], d.gravity[2]},
          ground{d.ground[0], d.ground[1], d.ground[2]} {
        bodies.resize(static_cast<std::size_t>(d.joints) + 1);
        int q = 0;
        for (int j = 1; j <= d.joints; ++j) {
            Body& b = bodies[j];
            b.parent = d.parent[j - 1];
            b.kind = d.kind[j - 1];
            const double* m = d.placement + 12 * (j - 1);
            b.placed = {{m[0], m[3], m[6]}, {m[1], m[4], m[7]}, {m[2], m[5], m[8]}};
            b.at = {m[9], m[10], m[11]};
            b.aligned = m[0] == 1.0 && m[4] == 1.0 && m[8] == 1.0;
            const double* i = d.inertia + 10 * (j - 1);
            b.mass = i[0];
            b.centre = {i[1], i[2], i[3]};
            for (int k = 0; k < 6; ++k) b.inertia[k] = i[4 + k];
            b.heavy = std::any_of(i, i + 10, [](double x) { return x != 0.0; });
            const bool along = m[2] == 0.0 && m[5] == 0.0 && m[8] == 1.0;
            b.upright = (is_revolute(b.kind) || b.kind == PRISMATIC) && (b.parent == 0 || (along && bodies[b.parent].upright));
            b.q = q;
            for (int i = 0; i < NUMBERS[b.kind].v; ++i) number_at.push_back(q + i);
            b.first = static_cast<int>(freedoms.size());
            const Numbers& numbers = NUMBERS[b.kind];
            q += numbers.q;
            b.count = numbers.v;
            freedoms.insert(freedoms.end(), numbers.freedoms, numbers.freedoms + numbers.v);
        }
        numbers = static_cast<std::size_t>(q);
        const std::size_t n = bodies.size();
        axes.resize(n);
        for (auto* vectors : {&p, &r, &omega, &u, &alpha, &a}) vectors->resize(n);
        for (auto* numbers : {&cosine, &sine}) numbers->resize(n);
        for (int j = 1; j < static_cast<int>(n); ++j) all.push_back(j);
    }

    void place(const std::vector<int>& joints, const double* q) {
        for (int j : joints) {
            if (bodies[j].kind == REVOLUTE) turn_to(j, q[bodies[j].q]);
            put(j, q);
        }
    }

    // The same after `place`, since when q was changed by `step` (nv).
    void place_after(const std::vector<int>& joints, const double* q, const double* step) {
        for (int j : joints) {
            if (bodies[j].kind == REVOLUTE) turn_by(j, q[bodies[j].q], step[bodies[j].first]);
            put(j, q);
        }
    }

    // The same joint after `place` of another chain with these numbers in q.
    void place_like(const Chain& other, int j, const double* q) {
        cosine[j] = other.cosine[j];
        sine[j] = other.sine[j];
        put(j, q);
    }

    // Velocities, and accelerations where all joints' accelerations are zero, for velocities v, as seen from
    // the body `still`, which closures of these joints may end on.
    void move(const std::vector<int>& joints, const double* v, int still = 0) {
        const Vec none;
        omega[still] = alpha[still] = u[still] = a[still] = none;
        for (int j : joints) {
            const Body& b = bodies[j];
            const Vec w = omega[b.parent], turning = alpha[b.parent], &arm = r[j];
            u[j] = u[b.parent] + cross(w, arm);
            a[j] = a[b.parent] + centripetal(w, arm);
            if (!b.upright) a[j] += cross(turning, arm);  // 0 where all turn about one axis
            if (is_revolute(b.kind)) {
                const Vec turn = v[b.first] * axes[j].z;
                omega[j] = w + turn;
                alpha[j] = b.upright ? none : turning + cross(w, turn);
                continue;
            }
            omega[j] = w;
            alpha[j] = turning;
            Vec turn, slide;
            for (int i = b.first; i < b.first + b.count; ++i)
                (freedoms[i].turning ? turn : slide) += v[i] * axes[j][freedoms[i].column];
            omega[j] += turn;
            alpha[j] += cross(w, turn);
            u[j] += slide;
            a[j] += cross(w + omega[j], slide);
        }
    }

  private:
    void turn_to(int j, double angle) {
        cosine[j] = std::cos(angle);
        sine[j] = std::sin(angle);
    }

    // By the sums of the angle before and a step, whose series end below the last place where it is small.
    void turn_by(int j, double angle, double step) {
        if (anew || !(std::fabs(step) < 1e-3)) {
            turn_to(j, angle);
            return;
        }
        const double s = step * step, sin = step * (1.0 - s / 6.0 * (1.0 - s / 20.0)),
                     versine = 0.5 * s * (1.0 - s / 12.0), c = cosine[j], e = sine[j];
        cosine[j] = c - (c * versine + e * sin);
        sine[j] = e - (e * versine - c * sin);
    }

    void put(int j, const double* q) {
        const Body& b = bodies[j];
        const Axes& parent = axes[b.parent];
        const Axes base = b.aligned ? parent : parent.turn(b.placed);
        r[j] = parent.turn(b.at);
        if (b.kind == REVOLUTE)
            axes[j] = base.about_z(cosine[j], sine[j]);
        else
            axes[j] = b.held ? base : moved(b.kind, q + b.q, base, r[j]);
        p[j] = p[b.parent] + r[j];
    }
};

}  // namespace rg
