// Equations of motion in minimal coordinates: ÿ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "dynamics/driven.h"
#include "dynamics/forces.h"
#include "path/path.h"
#include "dynamics/sweep.h"

namespace rg {

// As in reduced_inertia.py, which also takes the cases that are handed back here.
constexpr double LOST = 1e-13, DEFINITE = 1e-11;

class Motion {
  public:
    Cells<double> v, tau, ydd;
    double power = 0.0;
    std::unique_ptr<Driven> driven;  // none where nothing is
    std::int64_t force_evaluations = 0;
    const double* control = nullptr;  // of the actuators, or null

    Motion(const Description& d, Path& path)
        : v(d.nv), tau(d.nv), ydd(d.m), driven(d.driven > 0 ? new Driven(d, path) : nullptr), path_(path), sweep_(d, path, path.parts.list), forces_(d),
          own_(*d.own), size_(d.size, d.size + d.nv), armature_(d.armature, d.armature + d.nv), paces_(d.m),
          turned_(path.chain.bodies.size()), shifted_(path.chain.bodies.size()) {}

    // ÿ at a point whose placements (m = 1: velocities too) the path's chain holds.
    Reason evaluate(double t, Point& point, const Request& r) {
        path_.velocity(point, v.data());
        const Chain& chain = sweep_.place(point);
        const Reason acted = act(t, chain, point, r);
        if (acted != DONE) return acted;
        if (driven) return with_drive(chain, point);
        return by_virtual_power() ? one_coordinate(point) : several(chain, point);
    }

    // Kinetic and potential energy at the point evaluated last, J.
    double energy(Point& point) {
        const Chain& chain = sweep_.place(point);
        if (driven && !driven->leaves_some()) eliminated(driven->sweep, chain, point, point.g());
        return kinetic_ + gravity_energy(chain) + forces_.energy(chain, point.q()) + stored_;
    }

    // Where all bodies are, at the point evaluated last.
    const Chain& placed(Point& point) { return sweep_.place(point); }
    const Forces& forces() const { return forces_; }
    bool acting() const { return acting_; }

    // (Gᵀ M G)⁻¹ of all inputs, driven or not, times rows (m, 3m) that are `width` apart, at the point evaluated last;
    // see `Sweep::solve_more`.
    void lift(const Chain& chain, Point& point, double* rows, int width) {
        if (driven) {
            const Cells<double> present = ydd;
            eliminated(sweep_, chain, point, point.g());
            ydd = present;
        }
        if (driven || !by_virtual_power()) return sweep_.solve_more(rows, width);
        for (int i = 0; i < 3; ++i) rows[i] /= mass_;
    }

  private:
    bool by_virtual_power() const { return path_.layout.m == 1 && !path_.groups.some(); }

    Reason act(double t, const Chain& chain, Point& point, const Request& r) {
        power = stored_ = 0.0;
        acting_ = forces_.some() || r.torque != nullptr || r.held != nullptr || control != nullptr;
        if (!acting_) return DONE;
        ++force_evaluations;
        if (forces_.some() && !forces_.at(chain, point.q(), v.data(), tau.data(), power)) return FORCE;
        if (!forces_.some()) std::fill(tau.begin(), tau.end(), 0.0);
        if (r.held != nullptr) add(r.held);
        if (control != nullptr) forces_.drive(chain, point.q(), v.data(), control, tau.data(), power);
        if (r.torque != nullptr) {
            std::copy(point.q(), point.q() + path_.layout.nq, r.torque_q);
            std::copy(v.begin(), v.end(), r.torque_v);
            // an exception that no handler of the callback's met leaves NaN
            std::fill(r.torque_tau, r.torque_tau + v.size(), std::numeric_limits<double>::quiet_NaN());
            if (r.torque(t) != 0 || std::isnan(r.torque_tau[0])) return TORQUE;
            add(r.torque_tau);
            power -= r.torque_stored[0];
            stored_ = r.torque_stored[1];
        }
        return DONE;
    }

    void add(const double* torque) {
        for (std::size_t i = 0; i < v.size(); ++i) {
            tau[i] += torque[i];
            power += torque[i] * v[i];
        }
    }

    // One coordinate: each body's momentum and inertia force times its velocity at ẏ = 1, with no pass
    // back along the chain (Kane's form). Of the acceleration, γ'' ẏ² is what `move` left out.
    Reason one_coordinate(Point& point) {
        Chain& c = path_.chain;
        const double *G = point.G(), *bend = point.curvature();
        double mass = 0.0, bent = 0.0;
        Vec momentum;
        for (std::size_t j = 1; j < c.bodies.size(); ++j) {
            const Body& b = c.bodies[j];
            const Axes& axes = c.axes[j];
            Vec turned = turned_[b.parent];
            Vec shifted = shifted_[b.parent] + cross(turned, c.r[j]);
            for (int i = b.first; i < b.first + b.count; ++i) {
                const Vec add = bend[i] * axes[c.freedoms[i].column];
                (c.freedoms[i].turning ? turned : shifted) += add;
                mass += armature_[i] * G[i] * G[i];
                bent += armature_[i] * G[i] * bend[i];
            }
            turned_[j] = turned;
            shifted_[j] = shifted;
            if (!b.heavy) continue;
            const Vec centre = axes.turn(b.centre);
            const Vec& omega = c.omega[j];
            const Vec alpha = c.alpha[j] + turned;
            const Vec velocity = c.u[j] + cross(omega, centre), push = b.mass * velocity;
            const Vec acceleration = c.a[j] + shifted + cross(alpha, centre) + centripetal(omega, centre);
            mass += dot(push, velocity);
            bent += dot(push, acceleration);
            momentum += push;
            if (b.upright) {
                const double spin = b.inertia[5] * dot(axes.z, omega);
                mass += spin * dot(axes.z, omega);
                bent += spin * dot(axes.z, alpha);
            } else {
                const Vec spin = axes.local(omega), moment = times_inertia(b.inertia, spin);
                mass += dot(moment, spin);
                bent += dot(moment, axes.local(alpha));
            }
        }
        if (!weighs(path_.parts.all_velocities, only_, G, &mass)) return INERTIA;
        const double speed = point.ydot()[0];
        double force = dot(c.gravity, momentum) - speed * speed * bent;
        if (acting_)
            for (std::size_t i = 0; i < tau.size(); ++i) force += G[i] * tau[i];
        ydd[0] = force / mass;
        mass_ = mass;
        kinetic_ = 0.5 * mass * speed * speed;
        return DONE;
    }

    // Several coordinates. Where digits were lost Python looks at it.
    Reason several(const Chain& chain, Point& point) {
        return eliminated(sweep_, chain, point, point.g()) ? DONE : INERTIA;
    }

    // The same beside driven ones, and what moves these.
    Reason with_drive(const Chain& chain, Point& point) {
        if (!acting_) std::fill(tau.begin(), tau.end(), 0.0);
        acting_ = true;
        if (driven->leaves_some() && !eliminated(driven->sweep, chain, point, driven->bias(point))) return INERTIA;
        power += driven->effort(chain, point, v.data(), ydd.data(), tau.data());
        return DONE;
    }

    bool eliminated(Sweep& sweep, const Chain& chain, Point& point, const double* g) {
        bool good = sweep.eliminate(chain, point, g, v.data(), acting_ ? tau.data() : nullptr, DEFINITE);
        kinetic_ = sweep.kinetic();
        sweep.diagonal([&](const Part& part, const double* inertia) {
            good = good && weighs(part.velocities, part.inputs, point.G(), inertia);
        });
        if (good) sweep.solve(ydd.data());
        return good;
    }

    // Whether each input's inertia is more than what rounding leaves of what the joints' motions in its column of G
    // would have as inertia one by one; others do not move.
    bool weighs(const std::vector<int>& velocities, const std::vector<int>& inputs, const double* G,
                const double* inertia) {
        const std::size_t count = inputs.size(), m = static_cast<std::size_t>(path_.layout.m);
        if (count == 1 && velocities.size() == 1)
            return *inertia > LOST * own_ * size_[velocities[0]] * size_[velocities[0]];
        double* paces = paces_.data();
        std::fill(paces, paces + count, 0.0);
        for (int i : velocities)
            for (std::size_t a = 0; a < count; ++a)
                paces[a] = std::max(paces[a], std::fabs(G[i * m + inputs[a]] * size_[i]));
        bool all = true;
        for (std::size_t a = 0; a < count; ++a) all = all && inertia[a] > LOST * own_ * paces[a] * paces[a];
        return all;
    }

    Path& path_;
    Sweep sweep_;
    Forces forces_;
    double own_;
    Cells<double> size_, armature_, paces_;
    const std::vector<int> only_{0};  // the input, where there is one
    Cells<Vec> turned_, shifted_;
    double kinetic_ = 0.0, mass_ = 0.0, stored_ = 0.0;
    bool acting_ = false;
};

}  // namespace rg
