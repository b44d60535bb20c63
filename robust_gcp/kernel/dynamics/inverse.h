// Inverse dynamics, M a + C, by the recursive Newton–Euler algorithm (Featherstone, Rigid Body Dynamics Algorithms,
// 2008, chapter 5) in world axes.
#pragma once

#include "abi.h"
#include "linalg/cells.h"
#include "linalg/spatial.h"
#include "tree/chain.h"

namespace rg {

class Inverse {
  public:
    Inverse(const Description& d, std::size_t bodies)
        : armature_(d.armature, d.armature + d.nv), moved_(bodies), force_(bodies), moment_(bodies) {}

    // The joints' forces (nv,) at velocities v and accelerations a where the chain is placed; gravity is a part of C.
    void at(const Chain& c, const double* v, const double* a, double* force) {
        moved_[0] = {{}, {}, Vec{} - c.gravity};
        force_[0] = moment_[0] = {};
        for (const int j : c.all) forward(c, j, v, a);
        for (std::size_t j = c.bodies.size(); --j > 0;) {
            const Body& b = c.bodies[j];
            for (int i = b.first; i < b.first + b.count; ++i) {
                const Vec& axis = c.axes[j][c.freedoms[i].column];
                force[i] = armature_[i] * a[i] + dot(axis, c.freedoms[i].turning ? moment_[j] : force_[j]);
            }
            force_[b.parent] += force_[j];
            moment_[b.parent] += moment_[j] + cross(c.r[j], force_[j]);
        }
    }

    // Adds ∂(λᵀ (M a + C))/∂π by the inertial parameters of each body in its joint's frame (bodies − 1, 10), in
    // Pinocchio's order, and then by gravity (3): λᵀ moves the bodies as virtual velocities, and each body's share of
    // the virtual power is linear in its parameters.
    void weigh(const Chain& c, const double* v, const double* a, const double* lambda, double* sums) {
        moved_[0] = {{}, {}, Vec{} - c.gravity};
        virtual_.resize(c.bodies.size());
        double* by_gravity = sums + 10 * (c.bodies.size() - 1);
        for (const int j : c.all) {
            forward(c, j, v, a);
            const Body& b = c.bodies[j];
            const Virtual& before = virtual_[b.parent];
            Vec turn, slide;
            for (int i = b.first; i < b.first + b.count; ++i)
                (c.freedoms[i].turning ? turn : slide) += lambda[i] * c.axes[j][c.freedoms[i].column];
            Virtual& here = virtual_[j];
            here.turn = before.turn + turn;
            here.slide = before.slide + cross(before.turn, c.r[j]) + slide;
            own_share(c.axes[j], moved_[j], here, sums + 10 * (j - 1));
            const Vec pushed = b.mass * (here.slide + cross(here.turn, c.axes[j].turn(b.centre)));
            by_gravity[0] -= pushed.x, by_gravity[1] -= pushed.y, by_gravity[2] -= pushed.z;
        }
    }

  private:
    struct Virtual {  // velocities of a body and of its origin
        Vec turn, slide;
    };

    struct Moved {  // angular velocity and acceleration, and that of the origin less gravity
        Vec omega, alpha, a;
    };

    // m (a_o + α × c + ω × (ω × c)) · w + (c × a_o) · λ_ω + λ_ω · (I α + ω × I ω), by m, m c and I about the origin.
    static void own_share(const Axes& axes, const Moved& moved, const Virtual& by, double* sums) {
        const Vec o = axes.local(moved.omega), al = axes.local(moved.alpha), a = axes.local(moved.a),
                  t = axes.local(by.turn), w = axes.local(by.slide), z = cross(t, o);
        const Vec first = cross(w, al) + centripetal(o, w) + cross(a, t);
        sums[0] += dot(a, w);
        sums[1] += first.x, sums[2] += first.y, sums[3] += first.z;
        sums[4] += t.x * al.x + z.x * o.x;
        sums[5] += t.x * al.y + t.y * al.x + z.x * o.y + z.y * o.x;
        sums[6] += t.y * al.y + z.y * o.y;
        sums[7] += t.x * al.z + t.z * al.x + z.x * o.z + z.z * o.x;
        sums[8] += t.y * al.z + t.z * al.y + z.y * o.z + z.z * o.y;
        sums[9] += t.z * al.z + z.z * o.z;
    }

    // How a body moves, and what it takes by itself, about its origin.
    void forward(const Chain& c, int j, const double* v, const double* a) {
        const Body& b = c.bodies[j];
        const Moved& before = moved_[b.parent];
        Vec turn, slide, turning, sliding;
        for (int i = b.first; i < b.first + b.count; ++i) {
            const Vec& axis = c.axes[j][c.freedoms[i].column];
            (c.freedoms[i].turning ? turn : slide) += v[i] * axis;
            (c.freedoms[i].turning ? turning : sliding) += a[i] * axis;
        }
        Moved& here = moved_[j];
        here.omega = before.omega + turn;
        here.alpha = before.alpha + cross(before.omega, turn) + turning;
        here.a = before.a + cross(before.alpha, c.r[j]) + centripetal(before.omega, c.r[j]) +
                 cross(before.omega + here.omega, slide) + sliding;
        force_[j] = moment_[j] = {};
        if (!b.heavy) return;
        const Axes& axes = c.axes[j];
        const Vec centre = axes.turn(b.centre), spin = axes.local(here.omega);
        const Vec momentum = axes.turn(times_inertia(b.inertia, spin));
        force_[j] = b.mass * (here.a + cross(here.alpha, centre) + centripetal(here.omega, centre));
        moment_[j] = axes.turn(times_inertia(b.inertia, axes.local(here.alpha))) + cross(here.omega, momentum) +
                     cross(centre, force_[j]);
    }

    const Cells<double> armature_;
    Cells<Virtual> virtual_;
    Cells<Moved> moved_;
    Cells<Vec> force_, moment_;  // of each body and what it carries, about its origin
};

}  // namespace rg
