// Gᵀ M G and Gᵀ (M g + C) of any tree of parts, in one frame for all bodies: the world's axes at a point
// near by. What moves a part is X_b = ∂V_b/∂u (6, m_part) of its bodies; so a loop cluster is a joint of
// several bodies, and the composite-rigid-body method goes over parts (Featherstone, Rigid Body Dynamics
// Algorithms, 2008, chapters 6 and 8). It costs the same for each part, but for those that carry it.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "groups.h"
#include "path.h"

namespace rg {

struct Wrench {
    Vec force, moment;
};

inline Wrench& operator+=(Wrench& a, const Wrench& b) {
    a.force += b.force;
    a.moment += b.moment;
    return a;
}
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

class Sweep {
  public:
    double kinetic = 0.0;

    Sweep(const Description& d, Path& path)
        : path_(path), parts_(path.parts.list), armature_(d.armature, d.armature + d.nv) {
        const std::size_t n = path.chain.bodies.size();
        if (path.on_groups) {
            world_.reset(new Chain(path.chain));
            for (Body& b : world_->bodies) b.held = false;
        }
        V_.resize(n), A_.resize(n), massive_.resize(n), wrench_.resize(n), ways_at_.resize(n);
        std::size_t ways = 0, widest = 0;
        for (const Part& part : parts_)
            for (int j : part.joints) {
                ways_at_[j] = ways;
                ways += part.inputs.size();
                widest = std::max(widest, part.inputs.size());
            }
        ways_.resize(ways);
        push_.resize(widest);
        const std::size_t m = static_cast<std::size_t>(d.m);
        H_.resize(m * m), right_.resize(m), unit_.resize(m), before_.resize(m);
        for (const Part& part : parts_) {
            int last = -1;  // the last input of the parts that carry it
            for (int c = part.carrier; c >= 0 && last < 0; c = parts_[c].carrier)
                if (parts_[c].count()) last = parts_[c].first + parts_[c].count() - 1;
            for (int k = 0; k < part.count(); ++k) before_[part.first + k] = k ? part.first + k - 1 : last;
        }
    }

    // Where all bodies are, after `Path::step` or `Path::survey` at the point.
    const Chain& place(Point& point) {
        if (world_ == nullptr) return path_.chain;
        for (const Part& part : parts_)
            for (int j : part.joints) world_->place_like(path_.chain, j, point.q());
        return *world_;
    }

    // Forms Gᵀ M G and −Gᵀ (M g + C − τ) at velocities v, after `place`; τ (nv,) may be null.
    void form(const Chain& chain, Point& point, const double* v, const double* tau) {
        forward(chain, point, v);
        kinetic *= 0.5;
        std::fill(right_.begin(), right_.end(), 0.0);
        const int m = path_.layout.m;
        const double *G = point.G(), *g = point.g();
        for (std::size_t i = parts_.size(); i-- > 0;) {
            const Part& part = parts_[i];
            const int count = part.count();
            for (int a = 0; a < count; ++a) {
                push_[a] = {};
                for (int b = 0; b <= a; ++b) H(part.first + a, part.first + b) = 0.0;
            }
            for (int j : part.joints) {
                const Twist* X = &ways_[ways_at_[j]];
                for (int a = 0; a < count; ++a) {
                    const Wrench f = massive_[j] * X[a];
                    push_[a] += f;
                    for (int b = 0; b <= a; ++b) H(part.first + a, part.first + b) += dot(X[b], f);
                    right_[part.first + a] -= dot(X[a], wrench_[j]);
                }
                if (part.root > 0) {
                    massive_[part.root] += massive_[j];
                    wrench_[part.root] += wrench_[j];
                }
            }
            for (int v : part.velocities) {
                const double rotor = armature_[v], force = rotor * g[v] - (tau == nullptr ? 0.0 : tau[v]);
                for (int a = 0; a < count; ++a) {
                    const double turn = G[v * m + part.inputs[a]];
                    right_[part.first + a] -= turn * force;
                    if (rotor == 0.0) continue;
                    for (int b = 0; b <= a; ++b)
                        H(part.first + a, part.first + b) += rotor * turn * G[v * m + part.inputs[b]];
                }
            }
            for (int root = part.root, c = part.carrier; c >= 0; root = parts_[c].root, c = parts_[c].carrier) {
                const Twist* X = &ways_[ways_at_[root]];
                for (int b = 0; b < parts_[c].count(); ++b)
                    for (int a = 0; a < count; ++a) H(part.first + a, parts_[c].first + b) = dot(X[b], push_[a]);
            }
        }
    }

    // Entry k of the diagonal of Gᵀ M G, by input.
    template <typename Visit>
    void diagonal(Visit visit) const {
        for (const Part& part : parts_)
            for (int a = 0; a < part.count(); ++a)
                visit(part, part.inputs[a], H_[(part.first + a) * unit_.size() + part.first + a]);
    }

    // u̇ from what was formed, by LᵀL with a unit diagonal, in which no entry appears between parts that do
    // not carry each other; false where a squared pivot is not above `least`.
    bool solve(double least, double* ydd) {
        const int m = static_cast<int>(unit_.size());
        for (int i = 0; i < m; ++i) {
            if (!(H(i, i) > 0.0)) return false;
            unit_[i] = 1.0 / std::sqrt(H(i, i));
        }
        for (int i = 0; i < m; ++i) {
            right_[i] *= unit_[i];
            for (int j = i; j >= 0; j = before_[j]) H(i, j) *= unit_[i] * unit_[j];
        }
        for (int k = m - 1; k >= 0; --k) {
            if (!(H(k, k) > least)) return false;
            H(k, k) = 1.0 / std::sqrt(H(k, k));
            for (int i = before_[k]; i >= 0; i = before_[i]) H(k, i) *= H(k, k);
            for (int i = before_[k]; i >= 0; i = before_[i]) {
                const double factor = H(k, i);
                for (int j = i; j >= 0; j = before_[j]) H(i, j) -= factor * H(k, j);
            }
            right_[k] *= H(k, k);
            for (int i = before_[k]; i >= 0; i = before_[i]) right_[i] -= H(k, i) * right_[k];
        }
        for (int k = 0; k < m; ++k) {
            for (int i = before_[k]; i >= 0; i = before_[i]) right_[k] -= H(k, i) * right_[i];
            right_[k] *= H(k, k);
        }
        for (const Part& part : parts_)
            for (int a = 0; a < part.count(); ++a)
                ydd[part.inputs[a]] = right_[part.first + a] * unit_[part.first + a];
        return true;
    }

  private:
    double& H(int i, int j) { return H_[static_cast<std::size_t>(i) * unit_.size() + j]; }

    // X, V, and A at u̇ = 0, of all bodies, and the wrenches that these take.
    void forward(const Chain& chain, Point& point, const double* v) {
        const int m = path_.layout.m;
        const double *G = point.G(), *g = point.g();
        const Vec near = chain.p[1];
        V_[0] = {};
        A_[0] = {Vec{} - chain.gravity, {}};
        kinetic = 0.0;
        for (const Part& part : parts_) {
            const int count = part.count();
            for (int j : part.joints) {
                const Body& b = chain.bodies[j];
                const Vec from = chain.p[j] - near;
                Twist* X = count ? &ways_[ways_at_[j]] : nullptr;
                const Twist* before = b.parent == part.root || !count ? nullptr : &ways_[ways_at_[b.parent]];
                for (int a = 0; a < count; ++a) X[a] = before == nullptr ? Twist{} : before[a];
                Twist own, bent;
                for (int i = b.first; i < b.first + b.count; ++i) {
                    const Vec& axis = chain.axes[j][chain.freedoms[i].column];
                    const Twist S = chain.freedoms[i].turning ? Twist{cross(from, axis), axis} : Twist{axis, {}};
                    for (int a = 0; a < count; ++a) X[a] += G[i * m + part.inputs[a]] * S;
                    own += v[i] * S;
                    bent += g[i] * S;
                    kinetic += armature_[i] * v[i] * v[i];
                }
                V_[j] = V_[b.parent] + own;
                A_[j] = A_[b.parent] + bent + bracket(V_[b.parent], own);
                massive_[j] = Massive(b, chain.axes[j], from);
                const Wrench momentum = massive_[j] * V_[j];
                kinetic += dot(V_[j], momentum);
                wrench_[j] = massive_[j] * A_[j];
                wrench_[j].force += cross(V_[j].angular, momentum.force);
                wrench_[j].moment += cross(V_[j].angular, momentum.moment) + cross(V_[j].linear, momentum.force);
            }
        }
    }

    Path& path_;
    const std::vector<Part>& parts_;
    std::unique_ptr<Chain> world_;  // where joints on groups are, which the path's chain holds still
    Cells<double> armature_;
    Cells<Twist> V_, A_;
    Cells<Massive> massive_;  // of each body, then with all parts that it carries
    Cells<Wrench> wrench_;
    Cells<Twist> ways_;  // X of all bodies
    std::vector<std::size_t> ways_at_;
    Cells<Wrench> push_;  // what each input of a part takes in all
    Cells<double> H_, right_, unit_;
    std::vector<int> before_;  // by input in a row: the one before it along the chain of parts, −1 for none
};

}  // namespace rg
