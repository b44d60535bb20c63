// First derivatives of u̇ by position, velocity and torques, at a point that was evaluated; the same as
// derivatives.py, by one pass out and one back over the tree.
//
// With f = RNEA(q, v, a) − τ − Kᵀλ, which is zero for dependent velocities, ∂u̇/∂y_k = −M_r⁻¹ Gᵀ δf, λ held. Along
// y_k what a body carries is displaced as a whole, by X, P and Q of closure_slopes.h, so that the wrench that it
// takes in all, F, changes by X ×* F + I Q + B P (Featherstone 2008, chapter 2; Carpentier and Mansard 2018).
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "closure_slopes.h"
#include "motion.h"
#include "path.h"
#include "sweep.h"

namespace rg {

inline Twist operator-(const Twist& a, const Twist& b) { return {a.linear - b.linear, a.angular - b.angular}; }
inline Wrench operator-(const Wrench& a, const Wrench& b) { return {a.force - b.force, a.moment - b.moment}; }

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

class Slopes {
  public:
    Cells<double> rows;  // (m, 2m + nv): ∂u̇/∂y, ∂u̇/∂u, ∂u̇/∂τ
    Cells<double> v_y;   // (nv, m): ∂v/∂y

    Slopes(const Description& d, Path& path, Motion& motion)
        : path_(path), motion_(motion), parts_(path.parts.list), armature_(d.armature, d.armature + d.nv) {
        const std::size_t n = path.chain.bodies.size(), nv = static_cast<std::size_t>(d.nv),
                          m = static_cast<std::size_t>(d.m);
        V_.resize(n), A_.resize(n), massive_.resize(n), wrench_.resize(n), coriolis_.resize(n), all_.resize(n);
        first_.resize(n), S_.resize(nv), a_.resize(nv), u_.resize(nv), zeros_.resize(nv * m);
        rows.resize(m * (2 * m + nv)), v_y.resize(nv * m), a_y_.resize(nv * m), a_u_.resize(nv * m);
        lambda_.resize(d.rows), d_.resize(d.rows), dd_.resize(d.rows);
        part_of_.resize(m), local_of_.resize(m), moved_.resize(parts_.size());
        std::size_t ways = 0, widest = 0;
        for (std::size_t p = 0; p < parts_.size(); ++p) {
            const Part& part = parts_[p];
            for (int j : part.joints) {
                first_[j] = ways;
                ways += part.inputs.size();
            }
            widest = std::max(widest, part.inputs.size());
            for (int a = 0; a < part.count(); ++a) {
                part_of_[part.inputs[a]] = static_cast<int>(p);
                local_of_[part.inputs[a]] = a;
            }
            if (path.loops(p) == nullptr) continue;
            const Closures& closures = path.loops(p)->closures;
            for (const Loop& loop : closures.loops()) moved_[p].emplace_back(closures, loop);
        }
        own_.resize(ways), to_.resize(ways), by_u_.resize(ways), more_.resize(ways), push_y_.resize(ways);
        sum_y_.resize(widest), sum_u_.resize(widest), momentum_.resize(widest), rate_.resize(widest);
    }

    // At the point that the motion evaluated last; false where they are not finite.
    bool at(Point& point) {
        const Chain& chain = motion_.placed(point);
        const int m = path_.layout.m, width = 2 * m + path_.layout.nv;
        std::fill(rows.begin(), rows.end(), 0.0);
        for (Cells<double>* changes : {&v_y, &a_y_, &a_u_}) std::fill(changes->begin(), changes->end(), 0.0);
        near_ = chain.p[1];
        forward(chain, point);
        for (std::size_t p = 0; p < parts_.size(); ++p)
            if (parts_[p].count()) displace(p, chain, point);
        for (std::size_t p = parts_.size(); p-- > 0;) {
            if (parts_[p].count()) balance(p, chain, point);
            lump(parts_[p]);
        }
        for (const Forces::Line& line : motion_.forces().lines()) pull(line, chain, point);
        const double* G = point.G();
        for (int k = 0; k < m; ++k)
            for (int i = 0; i < path_.layout.nv; ++i) rows[k * width + 2 * m + i] = G[i * m + k];
        motion_.lift(rows.data(), width);
        return std::all_of(rows.begin(), rows.end(), [](double x) { return std::isfinite(x); });
    }

  private:
    // −Gᵀ δf by y and by u.
    double& by_y(int j, int k) { return rows[j * (2 * path_.layout.m + path_.layout.nv) + k]; }
    double& by_u(int j, int k) { return by_y(j, path_.layout.m + k); }

    // V, A, and the wrenches that these take, of all bodies.
    void forward(const Chain& chain, Point& point) {
        path_.product(point, motion_.ydd.data(), a_.data());
        const double *g = point.g(), *v = motion_.v.data();
        for (std::size_t i = 0; i < a_.size(); ++i) a_[i] += g[i];
        V_[0] = {};
        A_[0] = {Vec{} - chain.gravity, {}};
        for (int j : chain.all) {
            const Body& b = chain.bodies[j];
            const Vec from = chain.p[j] - near_;
            Twist own, bent;
            for (int i = b.first; i < b.first + b.count; ++i) {
                const Vec& axis = chain.axes[j][chain.freedoms[i].column];
                S_[i] = chain.freedoms[i].turning ? Twist{cross(from, axis), axis} : Twist{axis, {}};
                own += v[i] * S_[i];
                bent += a_[i] * S_[i];
            }
            V_[j] = V_[b.parent] + own;
            A_[j] = A_[b.parent] + bent + bracket(V_[b.parent], own);
            massive_[j] = Massive(b, chain.axes[j], from);
            const Wrench momentum = massive_[j] * V_[j];
            wrench_[j] = massive_[j] * A_[j];
            wrench_[j] += carried(V_[j], momentum);
            coriolis_[j] = Coriolis(massive_[j], V_[j]);
        }
    }

    // Σ S_i x_i over a joint, of the column k of x (nv, m).
    Twist joint(const Body& b, const double* x, int k) const {
        Twist sum;
        for (int i = b.first; i < b.first + b.count; ++i) sum += x[i * path_.layout.m + k] * S_[i];
        return sum;
    }

    // X, P and Q along each input of a part, and what comes on top of A by each velocity, of its bodies.
    void displace(std::size_t p, const Chain& chain, Point& point) {
        const Part& part = parts_[p];
        const int count = part.count();
        Path::Loops* loops = path_.loops(p);
        const double* G = point.G();
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            for (int a = 0; a < count; ++a) {
                const Change* before = b.parent == part.root ? &still_ : &to_[first_[b.parent] + a];
                const Twist own = own_[first_[j] + a] = joint(b, G, part.inputs[a]);
                to_[first_[j] + a] = {before->X + own, before->P + bracket(V_[b.parent], own), {}};
            }
        }
        if (loops != nullptr) {
            for (LoopMoved& loop : moved_[p]) loop.place(chain, near_, turned(part, chain), V_.data(), A_.data());
            for (int a = 0; a < count; ++a) {
                for (LoopMoved& loop : moved_[p]) {
                    const Change ends[2] = {change(p, loop.loop.joint[0], a), change(p, loop.loop.joint[1], a)};
                    loop.rows_changed(ends, d_.data(), dd_.data());
                }
                tied(*loops, point, G + part.inputs[a], zeros_.data());
                solve(*loops, d_, v_y.data() + part.inputs[a]);
            }
            for (int j : part.joints)
                for (int a = 0; a < count; ++a)
                    to_[first_[j] + a].P += along(part, chain, j, a, joint(chain.bodies[j], v_y.data(), part.inputs[a]));
        }
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            const Twist &V = V_[b.parent], twice = V + V_[j];
            for (int a = 0; a < count; ++a) {
                const bool rooted = b.parent == part.root;
                const Twist& own = own_[first_[j] + a];
                Twist Q = bracket(A_[b.parent], own) + bracket(V, bracket(V, own)), U = bracket(twice, own);
                if (loops != nullptr) Q += bracket(twice, joint(b, v_y.data(), part.inputs[a]));
                to_[first_[j] + a].Q = rooted ? Q : to_[first_[b.parent] + a].Q + Q;
                by_u_[first_[j] + a] = rooted ? U : by_u_[first_[b.parent] + a] + U;
            }
        }
        if (loops == nullptr) return;
        for (int a = 0; a < count; ++a) {
            const int k = part.inputs[a];
            for (LoopMoved& loop : moved_[p]) {
                const Change ends[2] = {change(p, loop.loop.joint[0], a), change(p, loop.loop.joint[1], a)};
                loop.rows_changed(ends, d_.data(), dd_.data());
            }
            tied(*loops, point, G + k, v_y.data() + k);
            solve(*loops, dd_, a_y_.data() + k);
            for (LoopMoved& loop : moved_[p]) {
                const Change ends[2] = {hastened(p, loop.loop.joint[0], a), hastened(p, loop.loop.joint[1], a)};
                loop.rows_changed(ends, d_.data(), dd_.data());
            }
            tied(*loops, point, zeros_.data(), G + k);
            solve(*loops, dd_, a_u_.data() + k);
        }
        for (int j : part.joints)
            for (int a = 0; a < count; ++a)
                to_[first_[j] + a].Q += along(part, chain, j, a, joint(chain.bodies[j], a_y_.data(), part.inputs[a]));
        for (int j : part.joints)
            for (int a = 0; a < count; ++a)
                by_u_[first_[j] + a] += along(part, chain, j, a, joint(chain.bodies[j], a_u_.data(), part.inputs[a]));
    }

    // The sum of what each joint adds, from the part's root to a body; bodies are asked for in order.
    const Twist& along(const Part& part, const Chain& chain, int j, int a, const Twist& own) {
        const int parent = chain.bodies[j].parent;
        Twist& sum = more_[first_[j] + a];
        sum = own;
        if (parent != part.root) sum += more_[first_[parent] + a];
        return sum;
    }

    Change change(std::size_t p, int body, int a) const {
        return path_.parts.of_joint[body] == static_cast<int>(p) ? to_[first_[body] + a] : still_;
    }

    // The same where velocities change in place of positions.
    Change hastened(std::size_t p, int body, int a) const {
        if (path_.parts.of_joint[body] != static_cast<int>(p)) return still_;
        return {{}, to_[first_[body] + a].X, by_u_[first_[body] + a]};
    }

    void tied(Path::Loops& loops, Point& point, const double* dq, const double* dv) {
        loops.closures.couplings().rows_changed(point.q(), motion_.v.data(), a_.data(), dq, dv, path_.layout.m,
                                                d_.data(), dd_.data());
    }

    // −K_d⁻¹ rows into a column of x (nv, m).
    void solve(Path::Loops& loops, const Cells<double>& rows, double* x) {
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

    // A part's share of Gᵀ δf, after all that it carries.
    void balance(std::size_t p, const Chain& chain, Point& point) {
        const Part& part = parts_[p];
        const int count = part.count(), m = path_.layout.m;
        Path::Loops* loops = path_.loops(p);
        const double* G = point.G();
        for (int a = 0; a < count; ++a) sum_y_[a] = sum_u_[a] = momentum_[a] = {}, rate_[a] = {};
        for (int j : part.joints) {
            all_[j] = wrench_[j];
            for (int a = 0; a < count; ++a) {
                const Change& c = to_[first_[j] + a];
                Wrench& push = push_y_[first_[j] + a] = carried(c.X, wrench_[j]);
                push += massive_[j] * c.Q;
                push += coriolis_[j] * c.P.angular;
            }
        }
        gather(part, chain);
        if (loops != nullptr) react(p, chain, point, *loops);
        for (int j : part.joints) {
            const std::size_t at = first_[j];
            for (int a = 0; a < count; ++a) {
                const Twist& X = to_[at + a].X;
                const Wrench momentum = massive_[j] * X;
                Wrench push = massive_[j] * by_u_[at + a];
                push += coriolis_[j] * X.angular;
                const Wrench turned = carried(own_[at + a], all_[j]);
                for (int b = 0; b < count; ++b) {
                    by_y(part.inputs[b], part.inputs[a]) -= dot(to_[at + b].X, push_y_[at + a]);
                    by_u(part.inputs[b], part.inputs[a]) -= dot(to_[at + b].X, push);
                    by_y(part.inputs[a], part.inputs[b]) -= dot(to_[at + b].X, turned);
                }
                sum_y_[a] += push_y_[at + a];
                sum_u_[a] += push;
                momentum_[a] += momentum;
                rate_[a] += coriolis_[j].transposed(X);
            }
        }
        const Cells<double>& damping = motion_.forces().damping();
        for (int i : part.velocities) {
            if (armature_[i] == 0.0 && damping[i] == 0.0) continue;
            for (int j : part.inputs)
                for (int k : part.inputs) {
                    const int to = i * m + k;
                    by_y(j, k) -= G[i * m + j] * (armature_[i] * a_y_[to] + damping[i] * v_y[to]);
                    by_u(j, k) -= G[i * m + j] * (armature_[i] * a_u_[to] + damping[i] * G[to]);
                }
        }
        for (const Forces::Spring& spring : motion_.forces().springs())
            if (path_.parts.of_velocity[spring.v] == static_cast<int>(p)) stiffen(part, spring.v, spring.stiffness, G);
        for (int root = part.root, c = part.carrier; c >= 0; root = parts_[c].root, c = parts_[c].carrier)
            for (int b = 0; b < parts_[c].count(); ++b) {
                const Change& change = to_[first_[root] + b];
                const Twist& U = by_u_[first_[root] + b];
                const int k = parts_[c].inputs[b];
                for (int a = 0; a < count; ++a) {
                    const int j = part.inputs[a];
                    by_y(k, j) = -dot(change.X, sum_y_[a]);
                    by_u(k, j) = -dot(change.X, sum_u_[a]);
                    by_y(j, k) = -dot(change.Q, momentum_[a]) - dot(rate_[a], change.P.angular);
                    by_u(j, k) = -dot(U, momentum_[a]) - dot(rate_[a], change.X.angular);
                }
            }
    }

    // all_: what each body of a part takes with those of the part that follow it.
    void gather(const Part& part, const Chain& chain) {
        for (std::size_t i = part.joints.size(); i-- > 0;) {
            const int j = part.joints[i], parent = chain.bodies[j].parent;
            if (parent != part.root) all_[parent] += all_[j];
        }
    }

    // A joint's force that falls by `stiffness` with its own number.
    void stiffen(const Part& part, int velocity, double stiffness, const double* G) {
        const int m = path_.layout.m;
        for (int j : part.inputs)
            for (int k : part.inputs) by_y(j, k) -= stiffness * G[velocity * m + j] * G[velocity * m + k];
    }

    // Takes the closures' reactions off what the bodies take.
    void react(std::size_t p, const Chain& chain, Point& point, Path::Loops& loops) {
        const Part& part = parts_[p];
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            for (int i = b.first; i < b.first + b.count; ++i) {
                const double acting = motion_.acting() ? motion_.tau[i] : 0.0;
                u_[i] = path_.scale(i) * (dot(S_[i], all_[j]) + armature_[i] * a_[i] - acting);
            }
        }
        loops.blocks.solve_transposed(u_.data(), lambda_.data());
        for (int j : part.joints) all_[j] = wrench_[j];
        for (const LoopMoved& loop : moved_[p]) {
            Wrench on[2];
            loop.reactions(lambda_.data(), on);
            for (int side = 0; side < 2; ++side) {
                const int body = loop.loop.joint[side];
                if (path_.parts.of_joint[body] == static_cast<int>(p)) all_[body] = all_[body] - on[side];
            }
            for (int a = 0; a < part.count(); ++a) {
                const Change ends[2] = {change(p, loop.loop.joint[0], a), change(p, loop.loop.joint[1], a)};
                Wrench changed[2];
                loop.reactions_changed(lambda_.data(), ends, changed);
                for (int side = 0; side < 2; ++side) {
                    const int body = loop.loop.joint[side];
                    if (path_.parts.of_joint[body] != static_cast<int>(p)) continue;
                    Wrench& push = push_y_[first_[body] + a];
                    push = push - changed[side];
                }
            }
        }
        gather(part, chain);
        loops.closures.couplings().each_bend([&](int row, int velocity, double bend) {
            stiffen(part, velocity, -lambda_[row] * bend, point.G());
        });
    }

    // What a part takes goes to the body that carries it.
    void lump(const Part& part) {
        if (part.root == 0) return;
        for (int j : part.joints) {
            massive_[part.root] += massive_[j];
            wrench_[part.root] += wrench_[j];
            coriolis_[part.root] += coriolis_[j];
        }
    }

    // How input k displaces any body.
    Change displaced(int body, int k) const {
        while (body > 0 && path_.parts.of_joint[body] != part_of_[k]) body = parts_[path_.parts.of_joint[body]].root;
        return body > 0 ? to_[first_[body] + local_of_[k]] : still_;
    }

    // Share of a point spring, which may tie any two bodies.
    void pull(const Forces::Line& line, const Chain& chain, Point& point) {
        const int m = path_.layout.m;
        Moved ends[2];
        for (int end = 0; end < 2; ++end)
            ends[end] = point_moved(Forces::point(chain, line, end) - near_, V_[line.joint[end]], A_[line.joint[end]]);
        const Moved apart = ends[1] - ends[0];
        const double length = std::sqrt(dot(apart.x, apart.x));
        const Vec u = length > 0.0 ? (1.0 / length) * apart.x : Vec{};
        const double tension = line.stiffness * (length - line.rest) + line.damping * dot(u, apart.d);
        for (int k = 0; k < m; ++k) {
            Moved moved[2];
            Change changes[2];
            for (int end = 0; end < 2; ++end) {
                changes[end] = displaced(line.joint[end], k);
                moved[end] = point_changed(ends[end], changes[end]);
            }
            const Moved change = moved[1] - moved[0];
            const double longer = dot(u, change.x);
            // of the force on the second body, by y and by u
            Vec stiff = line.stiffness * change.x, damped;
            if (length > 0.0) {
                const Vec turn = (1.0 / length) * (change.x - longer * u);
                const double faster = dot(turn, apart.d) + dot(u, change.d);
                stiff = (line.stiffness * longer + line.damping * faster) * u + tension * turn;
                damped = line.damping * longer * u;
            }
            for (int end = 0; end < 2; ++end) {
                const double sign = end == 1 ? 1.0 : -1.0;
                const Vec &at = ends[end].x, f = sign * tension * u, df = sign * stiff, du = sign * damped;
                const Wrench w{f, cross(at, f)}, dw{df, cross(at, df) + cross(moved[end].x, f)}, dwu{du, cross(at, du)};
                for (int j = line.joint[end]; j > 0; j = chain.bodies[j].parent) {
                    const Body& b = chain.bodies[j];
                    const Twist X = displaced(j, k).X;
                    for (int i = b.first; i < b.first + b.count; ++i) {
                        const double y = dot(S_[i], dw) + dot(bracket(X, S_[i]), w), v = dot(S_[i], dwu);
                        for (int input : parts_[path_.parts.of_velocity[i]].inputs) {
                            by_y(input, k) -= point.G()[i * m + input] * y;
                            by_u(input, k) -= point.G()[i * m + input] * v;
                        }
                    }
                }
            }
        }
    }

    Path& path_;
    Motion& motion_;
    const std::vector<Part>& parts_;
    Cells<double> armature_;
    Vec near_;
    const Change still_{};
    Cells<Twist> S_;                   // of each velocity
    Cells<Twist> V_, A_;               // of each body, and what follows
    Cells<Massive> massive_;           // with what other parts it carries, as the next two
    Cells<Wrench> wrench_;
    Cells<Coriolis> coriolis_;
    Cells<Wrench> all_;                // with what follows in the part, less reactions
    std::vector<std::size_t> first_;   // where its entries by input begin
    Cells<Change> to_;                 // of each body along each input of its part, and what follows
    Cells<Twist> own_, by_u_, more_;
    Cells<Wrench> push_y_;
    Cells<Wrench> sum_y_, sum_u_, momentum_;  // of each input of a part
    Cells<Vec> rate_;
    Cells<double> a_, u_, a_y_, a_u_, zeros_, lambda_, d_, dd_;
    std::vector<int> part_of_, local_of_;     // of each input
    std::vector<std::vector<LoopMoved>> moved_;
};

}  // namespace rg
