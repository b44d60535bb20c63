// How each independent coordinate and velocity displaces, quickens and hastens all bodies: X, P and Q of
// closure_derivatives.h, with what the closures ask of the dependent velocities; see map_rates.py.
#pragma once

#include <algorithm>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "derivatives/closure_derivatives.h"
#include "dynamics/motion.h"
#include "path/path.h"

namespace rg {

class Displacements {
  public:
    Cells<double> v_y, a_y, a_u;  // (nv, m): ∂v/∂y, ∂a/∂y and ∂a/∂u; but in loops they stay zero
    Cells<double> a;              // (nv,): accelerations
    Cells<Twist> S;               // of each velocity: how it moves what it carries
    Cells<Twist> V, A;            // of each body
    Vec near;                     // the common point of all twists, among the bodies
    std::vector<std::vector<LoopMoved>> loops;  // by part

    Displacements(const Description& d, Path& path, Motion& motion)
        : path_(path), motion_(motion), parts_(path.parts.list), first_(path.chain.bodies.size()) {
        const std::size_t nv = static_cast<std::size_t>(d.nv), m = static_cast<std::size_t>(d.m);
        V.resize(first_.size()), A.resize(first_.size()), S.resize(nv), faster_.resize(nv), harder_.resize(nv), twice_.resize(nv);
        a.resize(nv);
        for (Cells<double>* changes : {&v_y, &a_y, &a_u}) changes->resize(nv * m);
        part_of_.resize(m), local_of_.resize(m), loops.resize(parts_.size()), spins_.resize(parts_.size());
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
            for (int a = 0; part.charted && a < part.count(); ++a)
                if (d.independent_q[part.inputs[a]] < 0) spins_[p].push_back({0, d.independent[part.inputs[a]], a, {}});
            for (Spin& spin : spins_[p]) {
                for (int j : part.joints)
                    if (path.chain.bodies[j].first <= spin.velocity) spin.body = std::max(spin.body, j);
                spin.bent.resize(part.inputs.size());
            }
            if (path.loops(p) == nullptr) continue;
            const Closures& closures = path.loops(p)->closures;
            for (const Loop& loop : closures.loops()) loops[p].emplace_back(closures, loop);
        }
        std::size_t widest = 0;
        for (const Part& part : parts_) widest = std::max(widest, part.inputs.size());
        idle_.resize(d.rows), rows_.resize(widest * d.rows), u_.resize(widest * nv);
        to_.resize(ways_), by_u_.resize(ways_), more_.resize(ways_), further_.resize(ways_);
    }

    // At the point that the motion evaluated last, whose bodies are where the chain says.
    void at(const Chain& chain, Point& point) {
        near = chain.p[1];
        forward(chain, point);
        for (std::size_t p = 0; p < parts_.size(); ++p)
            if (parts_[p].count()) displace(p, chain, point);
    }

    // Entries by body and input of its part: how many, and where those of a body begin.
    std::size_t ways() const { return ways_; }
    std::size_t first(int body) const { return first_[body]; }
    // Along an input of its part: all, and what comes on top of A by the velocity.
    const Change& to(std::size_t way) const { return to_[way]; }
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
    // An input of a part that is no rate of a number in q: its joint, its velocity, its place among the inputs, and
    // for each of these [G, v] in it.
    struct Spin {
        int body, velocity, local;
        Cells<double> bent;
    };

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
            const Twist& before = V[b.parent];
            Twist own, bent;
            for (int i = b.first; i < b.first + b.count; ++i) {
                const Vec& axis = chain.axes[j][chain.freedoms[i].column];
                S[i] = chain.freedoms[i].turning ? Twist{cross(from, axis), axis} : Twist{axis, {}};
                faster_[i] = bracket(before, S[i]);
                own += v[i] * S[i];
                bent += a[i] * S[i] + v[i] * faster_[i];
            }
            V[j] = before + own;
            A[j] = A[b.parent] + bent;
            for (int i = b.first; i < b.first + b.count; ++i) {
                harder_[i] = bracket(A[b.parent], S[i]) + bracket(before, faster_[i]);
                twice_[i] = faster_[i] + bracket(V[j], S[i]);
            }
        }
    }

    // sum += Σ way_i x_i over a joint, of the column k of x (nv, m).
    void take(Twist& sum, const Body& b, const Cells<Twist>& way, const double* x, int k) const {
        for (int i = b.first; i < b.first + b.count; ++i) {
            const double share = x[i * path_.layout.m + k];
            if (share != 0.0) sum += share * way[i];
        }
    }

    // X, P and Q along each input of a part, and what comes on top of A by each velocity, of its bodies.
    void displace(std::size_t p, const Chain& chain, Point& point) {
        const Part& part = parts_[p];
        Loops* tie = path_.loops(p);
        const double* G = point.G();
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            const bool rooted = b.parent == part.root;
            for (int a = 0; a < part.count(); ++a) {
                const std::size_t at = first_[j] + a, from = first_[b.parent] + a;
                to_[at] = rooted ? still_ : to_[from];
                take(to_[at].X, b, S, G, part.inputs[a]);
                take(to_[at].P, b, faster_, G, part.inputs[a]);
                take(to_[at].Q, b, harder_, G, part.inputs[a]);
                if (tie != nullptr) continue;
                by_u_[at] = rooted ? Twist{} : by_u_[from];
                take(by_u_[at], b, twice_, G, part.inputs[a]);
            }
        }
        if (tie == nullptr) return;
        const bool on_mode = path_.on_mode(p);
        if (on_mode) {
            follow(part, point);
        } else {
            for (LoopMoved& loop : loops[p]) loop.place(chain, near, turned(part, chain), V.data(), A.data());
            depend<false>(p, *tie, point, v_y);
        }
        for (Spin& spin : spins_[p])
            for (int a = 0; a < part.count(); ++a)
                spin.bent[a] = entry(bent(chain, spin.body, part.inputs[a], G), chain.freedoms[spin.velocity]);
        for (int j : part.joints)
            for (int a = 0; a < part.count(); ++a) {
                Change& change = to_[first_[j] + a];
                change.P += along(part, chain, j, a, S, v_y, more_);
                change.Q += along(part, chain, j, a, twice_, v_y, further_);
                // as the map's second derivatives are symmetric, but for inputs that are no rates
                Twist& hastened = by_u_[first_[j] + a] = 2.0 * change.P;
                for (const Spin& spin : spins_[p]) hastened += -spin.bent[a] * to_[first_[j] + spin.local].X;
            }
        if (!on_mode) depend<true>(p, *tie, point, a_y);
        for (int j : part.joints)
            for (int a = 0; a < part.count(); ++a) to_[first_[j] + a].Q += along(part, chain, j, a, S, a_y, more_);
        for (int j : part.joints) by_velocity(p, chain, j, G);
    }

    // ∂v/∂y and ∂a/∂y of a part on a series: γ_ab u_b and γ_abc u_b u_c + γ_ab u̇_b.
    void follow(const Part& part, Point& point) {
        const int m = path_.layout.m;
        const Modes& modes = *path_.modes;
        double u[2] = {}, faster[2] = {};
        for (std::size_t a = 0; a < part.inputs.size(); ++a)
            u[a] = point.ydot()[part.inputs[a]], faster[a] = motion_.ydd[part.inputs[a]];
        for (int i : part.velocities)
            for (std::size_t a = 0; a < part.inputs.size(); ++a) {
                v_y[i * m + part.inputs[a]] = modes.by(i, a, u);
                a_y[i * m + part.inputs[a]] = modes.third[2 * i + a] + modes.by(i, a, faster);
            }
    }

    // ∂a/∂u of a joint in a loop: 2 ∂v/∂y, and where its velocities are no rates, [G, v]; less what brings inputs
    // that are none to rest.
    void by_velocity(std::size_t p, const Chain& chain, int j, const double* G) {
        const Body& b = chain.bodies[j];
        const int m = path_.layout.m;
        const std::vector<int>& inputs = parts_[p].inputs;
        const bool rates = NUMBERS[b.kind].q == b.count || b.count == 1;
        for (std::size_t a = 0; a < inputs.size(); ++a) {
            const int k = inputs[a];
            const Twist turned = rates ? Twist{} : bent(chain, j, k, G);
            for (int i = b.first; i < b.first + b.count; ++i) {
                double& change = a_u[i * m + k] = 2.0 * v_y[i * m + k] + entry(turned, chain.freedoms[i]);
                for (const Spin& spin : spins_[p]) change -= spin.bent[a] * G[i * m + inputs[spin.local]];
            }
        }
    }

    // [G_k, v] of a joint, in its own axes.
    Twist bent(const Chain& chain, int j, int k, const double* G) const {
        const Body& b = chain.bodies[j];
        Twist way, speed;
        for (int i = b.first; i < b.first + b.count; ++i) {
            const Freedom& freedom = chain.freedoms[i];
            (freedom.turning ? way.angular : way.linear)[freedom.column] = G[i * path_.layout.m + k];
            (freedom.turning ? speed.angular : speed.linear)[freedom.column] = motion_.v[i];
        }
        return bracket(way, speed);
    }

    static double entry(const Twist& x, const Freedom& freedom) {
        return (freedom.turning ? x.angular : x.linear)[freedom.column];
    }

    // The sum of what each joint adds, from the part's root to a body; bodies are asked for in order.
    const Twist& along(const Part& part, const Chain& chain, int j, int a, const Cells<Twist>& way,
                       const Cells<double>& x, Cells<Twist>& sums) {
        const Body& b = chain.bodies[j];
        Twist& sum = sums[first_[j] + a];
        sum = b.parent == part.root ? Twist{} : sums[first_[b.parent] + a];
        take(sum, b, way, x.data(), part.inputs[a]);
        return sum;
    }

    // What closures ask of the dependent velocities, or accelerations, along each input, into columns of x (nv, m).
    template <bool SECOND>
    void depend(std::size_t p, Loops& tie, Point& point, Cells<double>& x) {
        const Part& part = parts_[p];
        const int count = part.count(), m = path_.layout.m;
        const double *v = motion_.v.data(), *G = point.G();
        for (int a = 0; a < count; ++a) {
            const int k = part.inputs[a];
            double *rows = rows_.data() + static_cast<std::size_t>(a) * idle_.size(), *other = idle_.data();
            for (LoopMoved& loop : loops[p]) {
                const Change ends[2] = {change(p, loop.loop.joint[0], a), change(p, loop.loop.joint[1], a)};
                loop.rows_changed<SECOND>(ends, rows);
            }
            tie.closures.couplings().rows_changed(point.q(), v, this->a.data(), G + k, v_y.data() + k, m,
                                                  SECOND ? other : rows, SECOND ? rows : other);
        }
        tie.blocks.solve(rows_.data(), idle_.size(), u_.data(), count);
        for (int i : tie.dependent)
            for (int a = 0; a < count; ++a) x[i * m + part.inputs[a]] = -path_.scale(i) * u_[i * count + a];
    }

    // The axes of the path's chain, in which a part's root may be held still.
    Axes turned(const Part& part, const Chain& chain) const {
        if (!path_.groups.some() || part.root == 0) return {};
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
    Cells<Twist> by_u_, more_, further_;
    Cells<Twist> faster_, harder_, twice_;  // of each velocity: what it adds to P, to Q, and by u
    Cells<double> rows_, idle_, u_;  // of closures by input, of one input that are not asked for; of velocities
    std::vector<std::vector<Spin>> spins_;  // by part
    std::vector<int> part_of_, local_of_;  // of each input
};

}  // namespace rg
