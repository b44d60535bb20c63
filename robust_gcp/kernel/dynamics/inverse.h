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

  private:
    struct Moved {  // angular velocity and acceleration, and that of the origin less gravity
        Vec omega, alpha, a;
    };

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
    Cells<Moved> moved_;
    Cells<Vec> force_, moment_;  // of each body and what it carries, about its origin
};

}  // namespace rg
