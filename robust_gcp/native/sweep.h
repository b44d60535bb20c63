// u̇ of any tree of parts, in one frame for all bodies: the world's axes at a point near by. What moves a
// part is X_b = ∂V_b/∂u (6, m_part) of its bodies; so a loop cluster is a joint of several bodies, and the
// articulated-body method goes over parts (Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 7):
// it eliminates Gᵀ M G, which it never forms, from the last part to the first, at the same cost for each.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "inertias.h"
#include "path.h"
#include "tree_factor.h"
#include "tree_round.h"

namespace rg {

class Sweep {
  public:
    double kinetic = 0.0;

    Sweep(const Description& d, Path& path)
        : path_(path), parts_(path.parts.list), armature_(d.armature, d.armature + d.nv),
          round_(static_cast<std::size_t>(d.m)) {
        const std::size_t n = path.chain.bodies.size();
        if (path.groups.some()) {
            world_.reset(new Chain(path.chain));
            for (Body& b : world_->bodies) b.held = false;
        }
        V_.resize(n), A_.resize(n), massive_.resize(n), wrench_.resize(n), ways_at_.resize(n);
        freed_.resize(n), yielded_.resize(n), bears_.assign(n, 0);
        std::size_t ways = 0, square = 0;
        for (const Part& part : parts_) {
            bears_[part.root] = part.root > 0;
            for (int j : part.joints) {
                ways_at_[j] = ways;
                ways += part.inputs.size();
            }
            factors_at_.push_back(square);
            square += part.inputs.size() * part.inputs.size();
        }
        ways_.resize(ways), factors_.resize(square);
        const std::size_t m = static_cast<std::size_t>(d.m);
        factor_ = TreeFactor(parts_, ways_at_, m, d.lines > 0);
        push_.resize(m), right_.resize(m), alone_.resize(m), columns_.resize(6 * m);
    }

    // Where all bodies are, after `Path::step` or `Path::survey` at the point.
    const Chain& place(Point& point) {
        if (world_ == nullptr) return path_.chain;
        for (const Part& part : parts_)
            for (int j : part.joints) world_->place_like(path_.chain, j, point.q());
        return *world_;
    }

    // Eliminates Gᵀ M G beside −Gᵀ (M g + C − τ) at velocities v, after `place`; τ (nv,) may be null. False
    // where a squared pivot is not above `least` times its entry of the diagonal.
    bool eliminate(const Chain& chain, Point& point, const double* v, const double* tau, double least) {
        forward(chain, point, v);
        kinetic *= 0.5;
        for (std::size_t i = parts_.size(); i-- > 0;)
            if (!eliminate(i, point, tau, least)) return false;
        return true;
    }

    // Entry k of the diagonal of Gᵀ M G, by input.
    template <typename Visit>
    void diagonal(Visit visit) const {
        for (const Part& part : parts_)
            for (int a = 0; a < part.count(); ++a) visit(part, part.inputs[a], alone_[part.first + a]);
    }

    // u̇ after `eliminate`, carriers first.
    void solve(double* ydd) {
        yielded_[0] = {};
        for (std::size_t i = 0; i < parts_.size(); ++i) {
            const Part& part = parts_[i];
            const int count = part.count();
            const double* L = factors_.data() + factors_at_[i];
            double* right = right_.data() + part.first;
            const Twist& root = yielded_[part.root];
            for (int a = count; a-- > 0;) {
                if (part.root > 0) right[a] -= dot(root, push_[part.first + a]);
                for (int b = a + 1; b < count; ++b) right[a] -= L[b * count + a] * right[b];
                right[a] *= L[a * count + a];
                ydd[part.inputs[a]] = right[a];
            }
            for (int j : part.joints) {
                if (!bears_[j]) continue;
                yielded_[j] = root;
                for (int a = 0; a < count; ++a) yielded_[j] += right[a] * ways_[ways_at_[j] + a];
            }
        }
    }

    // The same for more right sides after `eliminate`: rows (m, 3m) in y, `width` apart; what these are,
    // `TreeFactor` says.
    void solve_more(double* rows, std::size_t width) {
        const Swept swept{factors_.data(), factors_at_.data(), ways_.data(), push_.data()};
        if (factor_.entries() > DEEP * right_.size())
            return round_.solve(parts_, swept, ways_at_, bears_, rows, width);
        factor_.solve(parts_, swept, rows, width);
    }

  private:
    static constexpr std::size_t DEEP = 24;  // inputs that carry another one, on average, too many to go one by one
    // One part: its square of what is left of Gᵀ M G becomes L with inverse pivots, its right-hand side L⁻¹ of
    // that, and `push_` L⁻¹ of what its inputs ask of the body that carries it, to which it is added.
    bool eliminate(std::size_t i, Point& point, const double* tau, double least) {
        const Part& part = parts_[i];
        const int count = part.count(), root = part.root;
        double *L = factors_.data() + factors_at_[i], *right = right_.data() + part.first;
        double* alone = alone_.data() + part.first;
        Wrench* push = push_.data() + part.first;
        std::fill(L, L + count * count, 0.0);
        std::fill(right, right + count, 0.0);
        std::fill(alone, alone + count, 0.0);
        std::fill(push, push + count, Wrench{});
        double* columns[6];  // X, by number and input
        for (int k = 0; k < 6; ++k) columns[k] = columns_.data() + k * count;
        for (int j : part.joints) {
            if (!path_.chain.bodies[j].heavy && !bears_[j]) continue;
            const Twist* X = ways_.data() + ways_at_[j];
            for (int a = 0; a < count; ++a)
                for (int k = 0; k < 3; ++k) columns[k][a] = X[a].linear[k], columns[3 + k][a] = X[a].angular[k];
            for (int a = 0; a < count; ++a) {
                if (at_rest(X[a])) continue;  // of inputs that do not move this body
                const Wrench f = bears_[j] ? freed_[j] * X[a] : massive_[j] * X[a];
                const double own = dot(X[a], f);
                push[a] += f;
                add_products(columns, f, a, L + a * count);
                L[a * count + a] += own;
                alone[a] += bears_[j] ? dot(X[a], massive_[j] * X[a]) : own;
                right[a] -= dot(X[a], wrench_[j]);
            }
            if (root == 0) continue;
            if (bears_[j])
                freed_[root] += freed_[j];
            else
                freed_[root].add(massive_[j]);
            massive_[root] += massive_[j];
            wrench_[root] += wrench_[j];
        }
        with_rotors(part, point, tau, L);
        for (int a = 0; a < count; ++a) {
            double* row = L + a * count;
            for (int b = 0; b < a; ++b) {
                for (int c = 0; c < b; ++c) row[b] -= row[c] * L[b * count + c];
                row[b] *= L[b * count + b];
                row[a] -= row[b] * row[b];
                push[a] -= row[b] * push[b];
                right[a] -= row[b] * right[b];
            }
            if (!(row[a] > least * alone[a])) return false;
            row[a] = 1.0 / std::sqrt(row[a]);
            push[a] = row[a] * push[a];
            right[a] *= row[a];
            if (root == 0) continue;
            freed_[root].release(push[a]);
            wrench_[root] += right[a] * push[a];
        }
        return true;
    }

    static bool at_rest(const Twist& v) {
        return v.angular.x == 0.0 && v.angular.y == 0.0 && v.angular.z == 0.0 && v.linear.x == 0.0 &&
               v.linear.y == 0.0 && v.linear.z == 0.0;
    }

    // The first of a row's entries, of inputs before this one: X · f.
    static void add_products(double* const* X, const Wrench& f, int count, double* __restrict row) {
        const double *__restrict x = X[0], *__restrict y = X[1], *__restrict z = X[2];
        const double *__restrict rx = X[3], *__restrict ry = X[4], *__restrict rz = X[5];
        for (int b = 0; b < count; ++b)
            row[b] += (x[b] * f.force.x + y[b] * f.force.y + z[b] * f.force.z) +
                      (rx[b] * f.moment.x + ry[b] * f.moment.y + rz[b] * f.moment.z);
    }

    // What motors and τ add to a part's square and right-hand side.
    void with_rotors(const Part& part, Point& point, const double* tau, double* L) {
        const int count = part.count(), m = path_.layout.m;
        const double *G = point.G(), *g = point.g();
        for (int v : part.velocities) {
            const double rotor = armature_[v], force = rotor * g[v] - (tau == nullptr ? 0.0 : tau[v]);
            if (rotor == 0.0 && force == 0.0) continue;
            for (int a = 0; a < count; ++a) {
                const double turn = G[v * m + part.inputs[a]], inertia = rotor * turn;
                if (turn == 0.0) continue;
                right_[part.first + a] -= turn * force;
                alone_[part.first + a] += inertia * turn;
                for (int b = 0; rotor != 0.0 && b <= a; ++b) L[a * count + b] += inertia * G[v * m + part.inputs[b]];
            }
        }
    }

    // X, V, and A at u̇ = 0, of all bodies, and the wrenches that these take.
    void forward(const Chain& chain, Point& point, const double* v) {
        const Vec near = chain.p[1];
        V_[0] = {};
        A_[0] = {Vec{} - chain.gravity, {}};
        kinetic = 0.0;
        for (const Part& part : parts_)
            for (int j : part.joints) {
                const Vec from = chain.p[j] - near;
                move(chain, part, j, from, point, v);
                if (bears_[j]) freed_[j] = {}, massive_[j] = {}, wrench_[j] = {};
                if (!chain.bodies[j].heavy) continue;
                massive_[j] = Massive(chain.bodies[j], chain.axes[j], from);
                if (bears_[j]) freed_[j].add(massive_[j]);
                const Wrench momentum = massive_[j] * V_[j];
                kinetic += dot(V_[j], momentum);
                wrench_[j] = massive_[j] * A_[j];
                wrench_[j].force += cross(V_[j].angular, momentum.force);
                wrench_[j].moment += cross(V_[j].angular, momentum.moment) + cross(V_[j].linear, momentum.force);
            }
    }

    // X, V and A of a joint's body.
    void move(const Chain& chain, const Part& part, int j, const Vec& from, Point& point, const double* v) {
        const int count = part.count(), m = path_.layout.m;
        const double *G = point.G(), *g = point.g();
        const Body& b = chain.bodies[j];
        Twist* X = ways_.data() + ways_at_[j];
        if (b.parent == part.root)
            std::fill(X, X + count, Twist{});
        else
            std::copy(ways_.data() + ways_at_[b.parent], ways_.data() + ways_at_[b.parent] + count, X);
        Twist own, bent;
        for (int i = b.first; i < b.first + b.count; ++i) {
            const Vec& axis = chain.axes[j][chain.freedoms[i].column];
            const Twist S = chain.freedoms[i].turning ? Twist{cross(from, axis), axis} : Twist{axis, {}};
            own += v[i] * S;
            bent += g[i] * S;
            for (int a = 0; a < count; ++a) {
                const double turn = G[i * m + part.inputs[a]];
                if (turn != 0.0) X[a] += turn * S;
            }
            kinetic += armature_[i] * v[i] * v[i];
        }
        V_[j] = V_[b.parent] + own;
        A_[j] = A_[b.parent] + bent + bracket(V_[b.parent], own);
    }

    Path& path_;
    const std::vector<Part>& parts_;
    std::unique_ptr<Chain> world_;  // where joints on groups are, which the path's chain holds still
    Cells<double> armature_;
    std::vector<char> bears_;  // by body: whether it carries parts
    Cells<Twist> V_, A_;
    Cells<Massive> massive_;    // of each body, then with all that it carries
    Cells<Articulated> freed_;  // of bodies that carry parts: with these moving freely
    Cells<Wrench> wrench_;
    Cells<Twist> ways_;     // X of all bodies
    Cells<Twist> yielded_;  // how u̇ accelerates bodies that carry parts
    std::vector<std::size_t> ways_at_, factors_at_;
    Cells<Wrench> push_;     // by input in a row
    Cells<double> factors_;  // L of each part
    Cells<double> right_, alone_, columns_;
    TreeFactor factor_;
    TreeRound round_;
};

}  // namespace rg
