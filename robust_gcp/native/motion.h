// Equations of motion in minimal coordinates: ÿ = (Gᵀ M G)⁻¹ Gᵀ (τ − C − M g).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "forces.h"
#include "path.h"

namespace rg {

// As in reduced_inertia.py, which also takes the cases that are handed back here.
constexpr double LOST = 1e-13, CANCELLED = 1e-6, DEFINITE = 1e-11;

class Motion {
  public:
    Cells<double> v, tau, ydd;
    double power = 0.0;
    std::int64_t force_evaluations = 0;

    Motion(const Description& d, Path& path)
        : v(d.nv), tau(d.nv), ydd(d.m), path_(path), forces_(d),
          own_(*d.own), size_(d.size, d.size + d.nv), armature_(d.armature, d.armature + d.nv),
          bias_(d.nv), order_(d.nv) {
        if (d.m == 1) return;
        M_.resize(static_cast<std::size_t>(d.nv) * d.nv);
        MG_.resize(static_cast<std::size_t>(d.nv) * d.m);
        reduced_.resize(static_cast<std::size_t>(d.m) * d.m);
        unit_.resize(d.m);
    }

    // ÿ at a point whose placements (m = 1: velocities too) the chain holds.
    Reason evaluate(double t, Point& point, const Request& r) {
        const int m = path_.layout.m, nv = path_.layout.nv;
        const double *G = point.G(), *ydot = point.ydot();
        if (m == 1) {
            for (int i = 0; i < nv; ++i) v[i] = G[i] * ydot[0];
        } else {
            for (int i = 0; i < nv; ++i) {
                v[i] = 0.0;
                for (int j = 0; j < m; ++j) v[i] += G[i * m + j] * ydot[j];
            }
        }
        const Reason acted = act(t, point, r);
        if (acted != DONE) return acted;
        return m == 1 ? by_virtual_power(point) : by_inertia(point);
    }

    // Kinetic and potential energy at the point evaluated last, J.
    double energy(Point& point) {
        if (path_.layout.m > 1) place_all(point);
        double potential = 0.0;
        const Chain& chain = path_.chain;
        for (std::size_t j = 1; j < chain.bodies.size(); ++j) {
            const Body& b = chain.bodies[j];
            potential -= b.mass * dot(chain.gravity, chain.p[j] + chain.axes[j].turn(b.centre));
        }
        return kinetic_ + potential + forces_.energy(chain, point.q());
    }

  private:
    Reason act(double t, Point& point, const Request& r) {
        power = 0.0;
        acting_ = forces_.some() || r.torque != nullptr;
        if (!acting_) return DONE;
        ++force_evaluations;
        if (forces_.some()) {
            if (path_.layout.m > 1 && forces_.need_placements()) place_all(point);
            if (!forces_.at(path_.chain, point.q(), v.data(), tau.data(), power)) return FORCE;
        }
        if (r.torque != nullptr) {
            if (!forces_.some()) std::fill(tau.begin(), tau.end(), 0.0);
            std::copy(point.q(), point.q() + path_.layout.nq, r.torque_q);
            std::copy(v.begin(), v.end(), r.torque_v);
            // an exception that no handler of the callback's met leaves NaN
            std::fill(r.torque_tau, r.torque_tau + v.size(), std::numeric_limits<double>::quiet_NaN());
            if (r.torque(t) != 0 || std::isnan(r.torque_tau[0])) return TORQUE;
            for (std::size_t i = 0; i < v.size(); ++i) {
                tau[i] += r.torque_tau[i];
                power += r.torque_tau[i] * v[i];
            }
        }
        return DONE;
    }

    void place_all(Point& point) {
        if (path_.layout.blocks == 0) path_.chain.place(path_.chain.loop, point.q());
        path_.chain.place(path_.chain.free, point.q());
    }

    // One coordinate: each body's momentum and inertia force times its velocity at ẏ = 1, with no pass
    // back along the chain (Kane's form). Of the acceleration, γ'' ẏ² is what `move` left out.
    Reason by_virtual_power(Point& point) {
        Chain& c = path_.chain;
        const double *G = point.G(), *bend = point.curvature();
        double mass = 0.0, bent = 0.0, weight = 0.0;
        turned_.resize(c.bodies.size());
        shifted_.resize(c.bodies.size());
        for (std::size_t j = 1; j < c.bodies.size(); ++j) {
            const Body& b = c.bodies[j];
            Vec turned = turned_[b.parent];
            Vec shifted = shifted_[b.parent] + cross(turned, c.r[j]);
            for (int i = b.first; i < b.first + b.count; ++i) {
                const Vec add = bend[i] * c.axes[j][c.freedoms[i].column];
                (c.freedoms[i].turning ? turned : shifted) += add;
                mass += armature_[i] * G[i] * G[i];
                bent += armature_[i] * G[i] * bend[i];
            }
            turned_[j] = turned;
            shifted_[j] = shifted;
            const Axes& axes = c.axes[j];
            const Vec centre = axes.turn(b.centre);
            const Vec& omega = c.omega[j];
            const Vec alpha = c.alpha[j] + turned;
            const Vec velocity = c.u[j] + cross(omega, centre);
            const Vec acceleration = c.a[j] + shifted + cross(alpha, centre) + centripetal(omega, centre);
            const Vec spin = axes.local(omega), moment = times_inertia(b.inertia, spin);
            mass += b.mass * dot(velocity, velocity) + dot(moment, spin);
            bent += b.mass * dot(velocity, acceleration) + dot(moment, axes.local(alpha));
            weight += b.mass * dot(c.gravity, velocity);
        }
        if (!(mass > LOST * alone(G, 0))) return INERTIA;
        const double speed = point.ydot()[0];
        double force = weight - speed * speed * bent;
        if (acting_)
            for (std::size_t i = 0; i < tau.size(); ++i) force += G[i] * tau[i];
        ydd[0] = force / mass;
        kinetic_ = 0.5 * mass * speed * speed;
        return DONE;
    }

    // Several coordinates: Pinocchio's rnea and crba, then Gᵀ M G by Cholesky.
    Reason by_inertia(Point& point) {
        const int m = path_.layout.m, nv = path_.layout.nv;
        const double* G = point.G();
        path_.rigid.rnea(point.q(), v.data(), point.g(), bias_.data());
        path_.rigid.crba(point.q(), M_.data());
        if (acting_)
            for (int i = 0; i < nv; ++i) bias_[i] -= tau[i];
        kinetic_ = 0.0;
        for (int i = 0; i < nv; ++i) {
            double momentum = 0.0;
            for (int k = 0; k < nv; ++k) momentum += M_[i * nv + k] * v[k];
            kinetic_ += 0.5 * momentum * v[i];
        }
        for (int i = 0; i < m; ++i) {
            ydd[i] = 0.0;
            for (int k = 0; k < nv; ++k) ydd[i] -= G[k * m + i] * bias_[k];
        }
        path_.layout.blocks == 0 ? select(G) : project(G);
        return solve(G) ? DONE : INERTIA;
    }

    // Gᵀ M G.
    void project(const double* G) {
        const int m = path_.layout.m, nv = path_.layout.nv;
        std::fill(MG_.begin(), MG_.end(), 0.0);
        for (int i = 0; i < nv; ++i)
            for (int k = 0; k < nv; ++k) {
                const double inertia = M_[i * nv + k];
                if (inertia == 0.0) continue;
                for (int j = 0; j < m; ++j) MG_[i * m + j] += inertia * G[k * m + j];
            }
        std::fill(reduced_.begin(), reduced_.end(), 0.0);
        for (int k = 0; k < nv; ++k)
            for (int i = 0; i < m; ++i) {
                if (G[k * m + i] == 0.0) continue;
                for (int j = 0; j <= i; ++j) reduced_[i * m + j] += G[k * m + i] * MG_[k * m + j];
            }
    }

    // The same where there is no loop, so that G only puts the joints in order.
    void select(const double* G) {
        const int m = path_.layout.m, nv = path_.layout.nv;
        for (int k = 0; k < nv; ++k) order_[k] = static_cast<int>(std::find(G + k * m, G + k * m + m, 1.0) - G) - k * m;
        for (int i = 0; i < nv; ++i)
            for (int j = 0; j < nv; ++j) reduced_[order_[i] * m + order_[j]] = M_[i * nv + j];
    }

    // What the joints' motions in column j of G would have as inertia one by one.
    double alone(const double* G, int j) const {
        const int m = path_.layout.m;
        double pace = 0.0;
        for (std::size_t i = 0; i < size_.size(); ++i) pace = std::max(pace, std::fabs(G[i * m + j] * size_[i]));
        return own_ * pace * pace;
    }

    // Size of the products that make up Gᵀ M G of column j: |Σ g_i M_ik g_k| ≤ (Σ √M_ii |g_i|)².
    double products(const double* G, int j) const {
        const int m = path_.layout.m, nv = path_.layout.nv;
        double sum = 0.0;
        for (int i = 0; i < nv; ++i)
            if (G[i * m + j] != 0.0) sum += std::sqrt(std::max(M_[i * nv + i], 0.0)) * std::fabs(G[i * m + j]);
        return sum * sum;
    }

    // ÿ by Cholesky with a unit diagonal; false where digits were lost, which Python looks at.
    bool solve(const double* G) {
        const int m = path_.layout.m;
        double* L = reduced_.data();
        for (int j = 0; j < m; ++j) {
            const double inertia = L[j * m + j];
            if (!(inertia > CANCELLED * products(G, j) && inertia > LOST * alone(G, j))) return false;
            unit_[j] = 1.0 / std::sqrt(inertia);
        }
        for (int i = 0; i < m; ++i) {
            ydd[i] *= unit_[i];
            for (int j = 0; j <= i; ++j) L[i * m + j] *= unit_[i] * unit_[j];
        }
        for (int j = 0; j < m; ++j) {
            for (int k = 0; k < j; ++k) L[j * m + j] -= L[j * m + k] * L[j * m + k];
            if (!(L[j * m + j] > DEFINITE)) return false;
            L[j * m + j] = std::sqrt(L[j * m + j]);
            for (int i = j + 1; i < m; ++i) {
                for (int k = 0; k < j; ++k) L[i * m + j] -= L[i * m + k] * L[j * m + k];
                L[i * m + j] /= L[j * m + j];
            }
        }
        for (int i = 0; i < m; ++i) {
            for (int k = 0; k < i; ++k) ydd[i] -= L[i * m + k] * ydd[k];
            ydd[i] /= L[i * m + i];
        }
        for (int i = m - 1; i >= 0; --i) {
            for (int k = i + 1; k < m; ++k) ydd[i] -= L[k * m + i] * ydd[k];
            ydd[i] /= L[i * m + i];
        }
        for (int i = 0; i < m; ++i) ydd[i] *= unit_[i];
        return true;
    }

    Path& path_;
    Forces forces_;
    double own_;
    Cells<double> size_, armature_, bias_, M_, MG_, reduced_, unit_;
    std::vector<int> order_;
    Cells<Vec> turned_, shifted_;
    double kinetic_ = 0.0;
    bool acting_ = false;
};

}  // namespace rg
