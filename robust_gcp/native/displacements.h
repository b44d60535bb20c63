// How each independent coordinate and velocity displaces, quickens and hastens all bodies: X, P and Q of
// closure_slopes.h, with what the closures ask of the dependent velocities; see map_rates.py.
#pragma once

#include <algorithm>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "closure_slopes.h"
#include "motion.h"
#include "path.h"

namespace rg {

class Displacements {
  public:
    Cells<double> v_y, a_y, a_u;  // (nv, m): ∂v/∂y, ∂a/∂y and ∂a/∂u
    Cells<double> a;              // (nv,): accelerations
    Cells<Twist> S;               // of each velocity: how it moves what it carries
    Cells<Twist> V, A;            // of each body
    Vec near;                     // the common point of all twists, among the bodies
    std::vector<std::vector<LoopMoved>> loops;  // by part

    Displacements(const Description& d, Path& path, Motion& motion)
        : path_(path), motion_(motion), parts_(path.parts.list), first_(path.chain.bodies.size()) {
        const std::size_t nv = static_cast<std::size_t>(d.nv), m = static_cast<std::size_t>(d.m);
        V.resize(first_.size()), A.resize(first_.size()), S.resize(nv), a.resize(nv), u_.resize(nv);
        for (Cells<double>* changes : {&v_y, &a_y, &a_u, &zeros_}) changes->resize(nv * m);
        d_.resize(d.rows), dd_.resize(d.rows), part_of_.resize(m), local_of_.resize(m), loops.resize(parts_.size());
        for (std::size_t p = 0; p < parts_.size(); ++p) {
            const Part& part = parts_[p];
            for (int j : part.joints) {
                first_[j] = ways_;
                ways_ += part.inputs.size();
            }
            for (int a = 0; a < part.count(); ++a) {
                part_of_[part.inputs[a]] = static_cast<int>(p);
                local_of_[part.inputs[a]] = a;
            }
            if (path.loops(p) == nullptr) continue;
            const Closures& closures = path.loops(p)->closures;
            for (const Loop& loop : closures.loops()) loops[p].emplace_back(closures, loop);
        }
        own_.resize(ways_), to_.resize(ways_), by_u_.resize(ways_), more_.resize(ways_);
    }

    // At the point that the motion evaluated last, whose bodies are where the chain says.
    void at(const Chain& chain, Point& point) {
        for (Cells<double>* changes : {&v_y, &a_y, &a_u}) std::fill(changes->begin(), changes->end(), 0.0);
        near = chain.p[1];
        forward(chain, point);
        for (std::size_t p = 0; p < parts_.size(); ++p)
            if (parts_[p].count()) displace(p, chain, point);
    }

    // Entries by body and input of its part: how many, and where those of a body begin.
    std::size_t ways() const { return ways_; }
    std::size_t first(int body) const { return first_[body]; }
    // Along an input of its part: all, what its own joint adds to X, and what comes on top of A by the velocity.
    const Change& to(std::size_t way) const { return to_[way]; }
    const Twist& own(std::size_t way) const { return own_[way]; }
    const Twist& by_u(std::size_t way) const { return by_u_[way]; }

    // Along an input of a part: of a body of that part, nothing of others.
    Change change(std::size_t p, int body, int a) const {
        return path_.parts.of_joint[body] == static_cast<int>(p) ? to_[first_[body] + a] : still_;
    }

    // How input k displaces any body.
    Change displaced(int body, int k) const {
        while (body > 0 && path_.parts.of_joint[body] != part_of_[k]) body = parts_[path_.parts.of_joint[body]].root;
        return body > 0 ? to_[first_[body] + local_of_[k]] : still_;
    }

  private:
    // V and A of all bodies.
    void forward(const Chain& chain, Point& point) {
        path_.product(point, motion_.ydd.data(), a.data());
        const double *g = point.g(), *v = motion_.v.data();
        for (std::size_t i = 0; i < a.size(); ++i) a[i] += g[i];
        V[0] = {};
        A[0] = {Vec{} - chain.gravity, {}};
        for (int j : chain.all) {
            const Body& b = chain.bodies[j];
            const Vec from = chain.p[j] - near;
            Twist own, bent;
            for (int i = b.first; i < b.first + b.count; ++i) {
                const Vec& axis = chain.axes[j][chain.freedoms[i].column];
                S[i] = chain.freedoms[i].turning ? Twist{cross(from, axis), axis} : Twist{axis, {}};
                own += v[i] * S[i];
                bent += a[i] * S[i];
            }
            V[j] = V[b.parent] + own;
            A[j] = A[b.parent] + bent + bracket(V[b.parent], own);
        }
    }

    // Σ S_i x_i over a joint, of the column k of x (nv, m).
    Twist joint(const Body& b, const double* x, int k) const {
        Twist sum;
        for (int i = b.first; i < b.first + b.count; ++i) sum += x[i * path_.layout.m + k] * S[i];
        return sum;
    }

    // X, P and Q along each input of a part, and what comes on top of A by each velocity, of its bodies.
    void displace(std::size_t p, const Chain& chain, Point& point) {
        const Part& part = parts_[p];
        const int count = part.count();
        Loops* tie = path_.loops(p);
        const double* G = point.G();
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            for (int a = 0; a < count; ++a) {
                const Change* before = b.parent == part.root ? &still_ : &to_[first_[b.parent] + a];
                const Twist own = own_[first_[j] + a] = joint(b, G, part.inputs[a]);
                to_[first_[j] + a] = {before->X + own, before->P + bracket(V[b.parent], own), {}};
            }
        }
        if (tie != nullptr) {
            for (LoopMoved& loop : loops[p]) loop.place(chain, near, turned(part, chain), V.data(), A.data());
            for (int a = 0; a < count; ++a) {
                for (LoopMoved& loop : loops[p]) {
                    const Change ends[2] = {change(p, loop.loop.joint[0], a), change(p, loop.loop.joint[1], a)};
                    loop.rows_changed(ends, d_.data(), dd_.data());
                }
                tied(*tie, point, G + part.inputs[a], zeros_.data());
                solve(*tie, d_, v_y.data() + part.inputs[a]);
            }
            for (int j : part.joints)
                for (int a = 0; a < count; ++a)
                    to_[first_[j] + a].P += along(part, chain, j, a, joint(chain.bodies[j], v_y.data(), part.inputs[a]));
        }
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            const Twist &before = V[b.parent], twice = before + V[j];
            for (int a = 0; a < count; ++a) {
                const bool rooted = b.parent == part.root;
                const Twist& own = own_[first_[j] + a];
                Twist Q = bracket(A[b.parent], own) + bracket(before, bracket(before, own)), U = bracket(twice, own);
                if (tie != nullptr) Q += bracket(twice, joint(b, v_y.data(), part.inputs[a]));
                to_[first_[j] + a].Q = rooted ? Q : to_[first_[b.parent] + a].Q + Q;
                by_u_[first_[j] + a] = rooted ? U : by_u_[first_[b.parent] + a] + U;
            }
        }
        if (tie == nullptr) return;
        for (int a = 0; a < count; ++a) {
            const int k = part.inputs[a];
            for (LoopMoved& loop : loops[p]) {
                const Change ends[2] = {change(p, loop.loop.joint[0], a), change(p, loop.loop.joint[1], a)};
                loop.rows_changed(ends, d_.data(), dd_.data());
            }
            tied(*tie, point, G + k, v_y.data() + k);
            solve(*tie, dd_, a_y.data() + k);
            for (LoopMoved& loop : loops[p]) {
                const Change ends[2] = {hastened(p, loop.loop.joint[0], a), hastened(p, loop.loop.joint[1], a)};
                loop.rows_changed(ends, d_.data(), dd_.data());
            }
            tied(*tie, point, zeros_.data(), G + k);
            solve(*tie, dd_, a_u.data() + k);
        }
        for (int j : part.joints)
            for (int a = 0; a < count; ++a)
                to_[first_[j] + a].Q += along(part, chain, j, a, joint(chain.bodies[j], a_y.data(), part.inputs[a]));
        for (int j : part.joints)
            for (int a = 0; a < count; ++a)
                by_u_[first_[j] + a] += along(part, chain, j, a, joint(chain.bodies[j], a_u.data(), part.inputs[a]));
    }

    // The sum of what each joint adds, from the part's root to a body; bodies are asked for in order.
    const Twist& along(const Part& part, const Chain& chain, int j, int a, const Twist& own) {
        const int parent = chain.bodies[j].parent;
        Twist& sum = more_[first_[j] + a];
        sum = own;
        if (parent != part.root) sum += more_[first_[parent] + a];
        return sum;
    }

    // The same where velocities change in place of positions.
    Change hastened(std::size_t p, int body, int a) const {
        if (path_.parts.of_joint[body] != static_cast<int>(p)) return still_;
        return {{}, to_[first_[body] + a].X, by_u_[first_[body] + a]};
    }

    void tied(Loops& loops, Point& point, const double* dq, const double* dv) {
        loops.closures.couplings().rows_changed(point.q(), motion_.v.data(), a.data(), dq, dv, path_.layout.m,
                                                d_.data(), dd_.data());
    }

    // −K_d⁻¹ rows into a column of x (nv, m).
    void solve(Loops& loops, const Cells<double>& rows, double* x) {
        loops.blocks.solve(rows.data(), u_.data());
        for (int i : loops.dependent) x[i * path_.layout.m] = -path_.scale(i) * u_[i];
    }

    // The axes of the path's chain, in which a part's root may be held still.
    Axes turned(const Part& part, const Chain& chain) const {
        if (!path_.on_groups || part.root == 0) return {};
        const Axes &here = chain.axes[part.root], &held = path_.chain.axes[part.root];
        return {here.turn(held.local({1.0, 0.0, 0.0})), here.turn(held.local({0.0, 1.0, 0.0})),
                here.turn(held.local({0.0, 0.0, 1.0}))};
    }

    Path& path_;
    Motion& motion_;
    const std::vector<Part>& parts_;
    const Change still_{};
    std::size_t ways_ = 0;
    std::vector<std::size_t> first_;
    Cells<Change> to_;
    Cells<Twist> own_, by_u_, more_;
    Cells<double> u_, zeros_, d_, dd_;
    std::vector<int> part_of_, local_of_;  // of each input
};

}  // namespace rg
