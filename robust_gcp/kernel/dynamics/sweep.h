// u̇ of any tree of parts. A loop cluster is a joint of several bodies, which its inputs move with X_b = ∂V_b/∂u
// (6, m_part), and the articulated-body method goes over parts (Featherstone, Rigid Body Dynamics Algorithms, 2008,
// chapter 7): it eliminates Gᵀ M G, of which it forms one part's square at a time, from the last part to the first, at
// the same cost for each.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "tree/inertias.h"
#include "dynamics/moving.h"
#include "dynamics/part_square.h"
#include "path/path.h"
#include "linalg/rows.h"
#include "dynamics/tree_factor.h"
#include "dynamics/tree_round.h"

namespace rg {

class Sweep {
  public:
    // `parts`: the path's, or these with some of their inputs.
    Sweep(const Description& d, Path& path, const std::vector<Part>& parts)
        : path_(path), parts_(parts), armature_(d.armature, d.armature + d.nv),
          moving_(d, path, parts, composed(parts)), round_(static_cast<std::size_t>(d.m)) {
        if (path.groups.some()) {
            world_.reset(new Chain(path.chain));
            for (Body& b : world_->bodies) b.held = false;
        }
        const std::vector<int> independent(d.independent, d.independent + d.m);
        std::size_t square = 0;
        for (const Part& part : parts_) {
            factors_at_.push_back(square);
            square += part.inputs.size() * part.inputs.size();
            squares_.emplace_back(by_joints(part) ? new PartSquare(path.chain, part, independent) : nullptr);
        }
        const std::size_t m = static_cast<std::size_t>(d.m);
        factor_ = TreeFactor(parts_, moving_.ways_at, m, d.lines > 0);
        push_.resize(m), right_.resize(m), alone_.resize(m), factors_.resize(square), shares_ = Shares(m);
        yielded_.resize(path.chain.bodies.size());
    }

    // Where all bodies are, after `Path::step` or `Path::survey` at the point.
    const Chain& place(Point& point) {
        if (world_ == nullptr) return path_.chain;
        for (const Part& part : parts_)
            for (int j : part.joints) world_->place_like(path_.chain, j, point.q());
        return *world_;
    }

    // Eliminates Gᵀ M G beside −Gᵀ (M g + C − τ) at velocities v, after `place`; g: accelerations at u̇ = 0; τ (nv,)
    // may be null. False where a squared pivot is not above `least` times its entry of the diagonal.
    bool eliminate(const Chain& chain, Point& point, const double* g, const double* v, const double* tau, double least) {
        g_ = g;
        moving_.move(chain, point, g, v);
        for (std::size_t i = parts_.size(); i-- > 0;)
            if (!eliminate(i, point, tau, least)) return false;
        return true;
    }

    double kinetic() const { return moving_.kinetic; }

    // The diagonal of Gᵀ M G, by parts.
    template <typename Visit>
    void diagonal(Visit visit) const {
        for (const Part& part : parts_) visit(part, alone_.data() + part.first);
    }

    // u̇ after `eliminate`, carriers first.
    void solve(double* ydd) {
        yielded_[0] = {};
        for (std::size_t i = 0; i < parts_.size(); ++i) {
            const Part& part = parts_[i];
            const int count = part.count();
            const double* U = factors_.data() + factors_at_[i];
            double* right = right_.data() + part.first;
            const Twist& root = yielded_[part.root];
            for (int a = count; a-- > 0;) {
                if (part.root > 0) right[a] -= dot(root, push_[part.first + a]);
                for (int b = a + 1; b < count; ++b) right[a] -= U[a * count + b] * right[b];
                right[a] *= U[a * count + a];
                ydd[part.inputs[a]] = right[a];
            }
            for (int j : part.joints) {
                if (!moving_.bears[j]) continue;
                yielded_[j] = root;
                for (int a = 0; a < count; ++a) yielded_[j] += right[a] * moving_.X(j)[a];
            }
        }
    }

    // The same for more right sides after `eliminate`: rows (m, 3m) in y, `width` apart; what these are,
    // `TreeFactor` says.
    void solve_more(double* rows, std::size_t width) {
        const Swept swept{factors_.data(), factors_at_.data(), moving_.ways.data(), push_.data()};
        if (factor_.entries() > DEEP * right_.size())
            return round_.solve(parts_, swept, moving_.ways_at, moving_.bears, rows, width);
        factor_.solve(parts_, swept, rows, width);
    }

  private:
    static constexpr std::size_t MANY = 5;   // inputs of a part from which the inertia of its joints costs less
    static constexpr std::size_t DEEP = 24;  // inputs that carry another one, on average, too many to go one by one

    static bool by_joints(const Part& part) { return part.inputs.size() >= MANY; }
    static std::vector<char> composed(const std::vector<Part>& parts) {
        std::vector<char> which;
        for (const Part& part : parts) which.push_back(by_joints(part));
        return which;
    }

    // One part: its square of what is left of Gᵀ M G becomes U = Lᵀ with inverse pivots, its right-hand side L⁻¹ of
    // that, and `push_` L⁻¹ of what its inputs ask of the body that carries it, to which it is added.
    bool eliminate(std::size_t i, Point& point, const double* tau, double least) {
        const Part& part = parts_[i];
        if (part.single()) return eliminate_one(part, i, tau, least);
        if (squares_[i] != nullptr) return eliminate_by_joints(part, i, point, tau, least);
        collect(part, i, point, tau);
        const std::size_t count = part.inputs.size();
        double *U = factors_.data() + factors_at_[i], *right = right_.data() + part.first;
        const double* alone = alone_.data() + part.first;
        Wrench* push = push_.data() + part.first;
        for (std::size_t a = 0; a < count; ++a) {
            for (std::size_t b = 0; b < a; ++b) {
                double &entry = U[b * count + a], *pivot = U + a * count + a;
                for (std::size_t c = 0; c < b; ++c) entry -= U[c * count + a] * U[c * count + b];
                entry *= U[b * count + b];
                *pivot -= entry * entry;
                push[a] -= entry * push[b];
                right[a] -= entry * right[b];
            }
            double& pivot = U[a * count + a];
            if (!(pivot > least * alone[a])) return false;
            pivot = 1.0 / std::sqrt(pivot);
            right[a] *= pivot;
            take_off(part, part.first + static_cast<int>(a), pivot * push[a]);
        }
        return true;
    }

    // A part's share of Gᵀ M G and of the right-hand side, body by body.
    void collect(const Part& part, std::size_t i, Point& point, const double* tau) {
        const std::size_t count = part.inputs.size();
        double *U = factors_.data() + factors_at_[i], *right = right_.data() + part.first;
        double* alone = alone_.data() + part.first;
        Wrench* push = push_.data() + part.first;
        std::fill(U, U + count * count, 0.0);
        std::fill(right, right + count, 0.0);
        std::fill(alone, alone + count, 0.0);
        std::fill(push, push + count, Wrench{});
        for (int j : part.joints) {
            const bool bears = moving_.bears[j];
            if (!path_.chain.bodies[j].heavy && !bears) continue;
            const Twist* X = moving_.X(j);
            for (std::size_t a = 0; a < count; ++a) {
                if (at_rest(X[a])) continue;  // of inputs that do not move this body
                const Wrench f = moving_.needed(j, X[a]);
                push[a] += f;
                for (std::size_t b = 0; b <= a; ++b) U[b * count + a] += dot(X[b], f);
                alone[a] += dot(X[a], bears ? moving_.massive[j] * X[a] : f);
                right[a] -= dot(X[a], moving_.wrench[j]);
            }
            moving_.hand_down(j, part.root);
        }
        with_rotors(part, point, tau, U);
    }

    // The same of a joint with one velocity, in no loop.
    bool eliminate_one(const Part& part, std::size_t i, const double* tau, double least) {
        const int j = part.joints[0], v = part.velocities[0];
        const Twist& S = *moving_.S(i);
        const Wrench needed = moving_.needed(j, S);
        const double inertia = dot(S, needed) + armature_[v];
        double& alone = alone_[part.first];
        alone = moving_.bears[j] ? dot(S, moving_.massive[j] * S) + armature_[v] : inertia;
        const double force = dot(S, moving_.wrench[j]) + armature_[v] * g_[v] - (tau == nullptr ? 0.0 : tau[v]);
        moving_.hand_down(j, part.root);
        if (!(inertia > least * alone)) return false;
        const double inverse = factors_[factors_at_[i]] = 1.0 / std::sqrt(inertia);
        right_[part.first] = -inverse * force;
        take_off(part, part.first, inverse * needed);
        return true;
    }

    // What an input asks of the body that carries its part is not asked of the part any more.
    void take_off(const Part& part, int input, const Wrench& push) {
        if (part.root == 0) return;
        push_[input] = push;
        moving_.release(part.root, push, right_[input]);
    }

    // The same joint by joint, with composite bodies.
    bool eliminate_by_joints(const Part& part, std::size_t i, Point& point, const double* tau, double least) {
        PartSquare& square = *squares_[i];
        const std::size_t count = part.inputs.size(), width = square.width();
        double *U = factors_.data() + factors_at_[i], *alone = alone_.data() + part.first;
        held_still(part, alone);
        const Twist* S = moving_.S(i);
        int place = static_cast<int>(part.velocities.size());
        for (std::size_t n = part.joints.size(); n-- > 0;) {
            const int j = part.joints[n];
            const Body& b = path_.chain.bodies[j];
            place -= b.count;
            for (int k = 0; k < b.count; ++k) {
                const double rotor = armature_[b.first + k], acting = tau == nullptr ? 0.0 : tau[b.first + k];
                const double force = dot(S[place + k], moving_.wrench[j]) + rotor * g_[b.first + k] - acting;
                square.put(place + k, moving_.needed(j, S[place + k]), rotor, force, S);
            }
            moving_.hand_down(j, b.parent);
        }
        double* rows = square.reduce(point.G(), right_.size());
        for (std::size_t a = 0; a < count; ++a) {
            double* row = rows + a * width;
            alone[a] += row[a];
            for (std::size_t b = 0; b < a; ++b) shares_.add(-rows[b * width + a], rows + b * width);
            shares_.into(row, a, width);
            shares_.clear();
            if (!(row[a] > least * alone[a])) return false;
            row[a] = 1.0 / std::sqrt(row[a]);
            for (std::size_t c = a + 1; c < width; ++c) row[c] *= row[a];
            std::copy(row + a, row + count, U + a * count + a);
            right_[part.first + a] = row[count];
            if (part.root == 0) continue;
            const double* f = row + count + 1;
            take_off(part, part.first + static_cast<int>(a), {{f[0], f[1], f[2]}, {f[3], f[4], f[5]}});
        }
        return true;
    }

    // What is more on the diagonal of a part's Gᵀ M G where all that it carries is held still.
    void held_still(const Part& part, double* more) const {
        std::fill(more, more + part.count(), 0.0);
        for (int j : part.joints)
            for (int a = 0; moving_.bears[j] && a < part.count(); ++a) {
                const Twist& X = moving_.X(j)[a];
                more[a] += dot(X, moving_.massive[j] * X) - dot(X, moving_.freed[j] * X);
            }
    }

    static bool at_rest(const Twist& v) {
        return v.angular.x == 0.0 && v.angular.y == 0.0 && v.angular.z == 0.0 && v.linear.x == 0.0 &&
               v.linear.y == 0.0 && v.linear.z == 0.0;
    }

    // What motors and τ add to a part's square and right-hand side.
    void with_rotors(const Part& part, Point& point, const double* tau, double* U) {
        const int count = part.count(), m = path_.layout.m;
        const double* G = point.G();
        for (int v : part.velocities) {
            const double rotor = armature_[v], force = rotor * g_[v] - (tau == nullptr ? 0.0 : tau[v]);
            if (rotor == 0.0 && force == 0.0) continue;
            for (int a = 0; a < count; ++a) {
                const double turn = G[v * m + part.inputs[a]], inertia = rotor * turn;
                if (turn == 0.0) continue;
                right_[part.first + a] -= turn * force;
                alone_[part.first + a] += inertia * turn;
                for (int b = 0; rotor != 0.0 && b <= a; ++b) U[b * count + a] += inertia * G[v * m + part.inputs[b]];
            }
        }
    }

    Path& path_;
    const std::vector<Part>& parts_;
    const double* g_ = nullptr;     // of the last elimination
    std::unique_ptr<Chain> world_;  // where joints on groups are, which the path's chain holds still
    Cells<double> armature_;
    Moving moving_;
    std::vector<std::unique_ptr<PartSquare>> squares_;  // of parts that go by joints
    Cells<Twist> yielded_;  // how u̇ accelerates bodies that carry parts
    std::vector<std::size_t> factors_at_;
    Cells<Wrench> push_;     // by input in a row
    Cells<double> factors_;  // U of each part
    Cells<double> right_, alone_;
    Shares shares_;
    TreeFactor factor_;
    TreeRound round_;
};

}  // namespace rg
