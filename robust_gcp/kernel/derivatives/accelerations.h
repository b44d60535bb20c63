// First derivatives of u̇ by position, velocity and torques, at a point that was evaluated; the same as
// derivatives.py, by one pass out and one back over the tree.
//
// With f = RNEA(q, v, a) − τ − Kᵀλ, which is zero for dependent velocities, ∂u̇/∂y_k = −M_r⁻¹ Gᵀ δf, λ held. Along
// y_k what a body carries is displaced as a whole, by X, P and Q of closure_derivatives.h, so that the wrench that it
// takes in all, F, changes by X ×* F + I Q + B P (Featherstone 2008, chapter 2; Carpentier and Mansard 2018).
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "derivatives/closure_derivatives.h"
#include "derivatives/coriolis.h"
#include "derivatives/displacements.h"
#include "derivatives/line_derivatives.h"
#include "dynamics/motion.h"
#include "path/path.h"
#include "derivatives/spread.h"

namespace rg {

class Slopes {
  public:
    Slopes(const Description& d, Path& path, Motion& motion)
        : path_(path), motion_(motion), parts_(path.parts.list), armature_(d.armature, d.armature + d.nv),
          spread_(d, path), moved_(d, path, motion) {
        const std::size_t n = path.chain.bodies.size();
        massive_.resize(n), wrench_.resize(n), coriolis_.resize(n), all_.resize(n), force_.resize(d.nv);
        lambda_.resize(d.rows);
        push_y_.resize(moved_.ways()), push_u_.resize(moved_.ways());
        for (const Body& body : path.chain.bodies) loaded_.push_back(body.heavy);
        for (const Part& part : parts_) loaded_[part.root] = 1;
        std::size_t widest = 0;
        for (const Part& part : parts_) widest = std::max(widest, part.inputs.size());
        sum_y_.resize(widest), sum_u_.resize(widest), momentum_.resize(widest), rate_.resize(widest);
        force_y_.resize(widest), force_u_.resize(widest), square_.resize(2 * widest * widest);
    }

    // Accelerations, ∂v/∂y, and ∂a/∂y and ∂a/∂u at u̇ held.
    const Displacements& moved() const { return moved_; }

    // Into rows (m, 2m + nv), ∂u̇/∂y, ∂u̇/∂u and ∂u̇/∂τ, at the point that the motion evaluated last; false where they
    // are not finite.
    bool at(Point& point, double* rows) {
        const Chain& chain = motion_.placed(point);
        const int m = path_.layout.m, width = 2 * m + path_.layout.nv;
        rows_ = rows;
        std::fill(rows, rows + m * width, 0.0);
        moved_.at(chain, point);
        weigh(chain);
        for (std::size_t p = parts_.size(); p-- > 0;) {
            if (parts_[p].count()) balance(p, chain, point);
            lump(parts_[p]);
        }
        for (const Forces::Line& line : motion_.forces().lines()) pull(line, chain, point);
        for (int k = 0; k < m; ++k) rows[k * width + 2 * m + k] = 1.0;
        motion_.lift(chain, point, rows, width);
        spread_.at(rows, point.G());
        return all_finite(rows, static_cast<std::size_t>(m * width));
    }

  private:
    // −Gᵀ δf by y and by u.
    double& by_y(int j, int k) { return rows_[j * (2 * path_.layout.m + path_.layout.nv) + k]; }
    double& by_u(int j, int k) { return by_y(j, path_.layout.m + k); }

    // Inertias, the wrenches that V and A take, and how these change with V.
    void weigh(const Chain& chain) {
        for (int j : chain.all) {
            if (!chain.bodies[j].heavy) {
                massive_[j] = {}, wrench_[j] = {}, coriolis_[j] = {};
                continue;
            }
            const Twist& V = moved_.V[j];
            massive_[j] = Massive(chain.bodies[j], chain.axes[j], chain.p[j] - moved_.near);
            wrench_[j] = massive_[j] * moved_.A[j];
            wrench_[j] += carried(V, massive_[j] * V);
            coriolis_[j] = Coriolis(massive_[j], V);
        }
    }

    // A part's share of Gᵀ δf, after all that it carries.
    void balance(std::size_t p, const Chain& chain, Point& point) {
        const Part& part = parts_[p];
        const int count = part.count();
        Loops* loops = path_.loops(p);
        for (int a = 0; a < count; ++a) sum_y_[a] = sum_u_[a] = momentum_[a] = {}, rate_[a] = {};
        for (int j : part.joints) {
            all_[j] = wrench_[j];
            for (std::size_t at = moved_.first(j), end = at + part.inputs.size(); at != end; ++at) {
                if (!loaded_[j]) {
                    push_y_[at] = push_u_[at] = {};
                    continue;
                }
                const Change& c = moved_.to(at);
                push_y_[at] = carried(c.X, wrench_[j]);
                push_y_[at] += massive_[j] * c.Q;
                push_y_[at] += coriolis_[j] * c.P.angular;
                push_u_[at] = massive_[j] * moved_.by_u(at);
                push_u_[at] += coriolis_[j] * c.X.angular;
            }
        }
        gather(part, chain);
        if (loops != nullptr) path_.on_mode(p) ? bow(part, chain) : react(p, chain, point, *loops);
        gather_pushes(part, chain);
        project(part, chain, point.G());
        for (const Forces::Spring& spring : motion_.forces().springs())
            if (path_.parts.of_velocity[spring.v] == static_cast<int>(p)) stiffen(part, spring.v, spring.stiffness, point.G());
        if (part.carrier >= 0) with_carriers(part);
    }

    // −Gᵀ F of the part's own inputs: what each joint's force changes by along each of them, F, is that of its
    // axis with what follows in the part, and that of what follows with its axis.
    void project(const Part& part, const Chain& chain, const double* G) {
        const int count = part.count(), m = path_.layout.m;
        const Cells<double>& damping = motion_.forces().damping();
        std::fill(square_.begin(), square_.begin() + 2 * count * count, 0.0);
        double *y = force_y_.data(), *u = force_u_.data();
        for (int j : part.joints) {
            const Body& body = chain.bodies[j];
            const std::size_t at = moved_.first(j);
            for (int i = body.first; i < body.first + body.count; ++i) {
                const Twist& S = moved_.S[i];
                const Wrench turned = carried(S, all_[j]);
                for (int b = 0; b < count; ++b) {
                    y[b] = dot(S, push_y_[at + b]) + dot(moved_.to(at + b).X, turned);
                    u[b] = dot(S, push_u_[at + b]);
                }
                if (armature_[i] != 0.0 || damping[i] != 0.0)
                    for (int b = 0; b < count; ++b) {
                        const int to = i * m + part.inputs[b];
                        y[b] += armature_[i] * moved_.a_y[to] + damping[i] * moved_.v_y[to];
                        u[b] += armature_[i] * moved_.a_u[to] + damping[i] * G[to];
                    }
                for (int a = 0; a < count; ++a) {
                    const double share = G[i * m + part.inputs[a]];
                    if (share == 0.0) continue;
                    double* row = square_.data() + 2 * count * a;
                    for (int b = 0; b < count; ++b) row[b] += share * y[b];
                    for (int b = 0; b < count; ++b) row[count + b] += share * u[b];
                }
            }
        }
        const double* row = square_.data();
        for (int a : part.inputs) {
            for (int b : part.inputs) by_y(a, b) -= *row++;
            for (int b : part.inputs) by_u(a, b) -= *row++;
        }
    }

    // What a part's inputs and those of the parts that carry it change for each other.
    void with_carriers(const Part& part) {
        const int count = part.count();
        for (int j : part.joints) {
            if (!loaded_[j]) continue;
            for (int a = 0; a < count; ++a) {
                const Twist& X = moved_.to(moved_.first(j) + a).X;
                momentum_[a] += massive_[j] * X;
                rate_[a] += coriolis_[j].transposed(X);
            }
        }
        for (int root = part.root, c = part.carrier; c >= 0; root = parts_[c].root, c = parts_[c].carrier)
            for (int b = 0; b < parts_[c].count(); ++b) {
                const Change& change = moved_.to(moved_.first(root) + b);
                const Twist& U = moved_.by_u(moved_.first(root) + b);
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

    // push_y_ and push_u_: those of each body of a part with those of the part that follow it; all in all, sum_y_
    // and sum_u_.
    void gather_pushes(const Part& part, const Chain& chain) {
        const std::size_t count = part.inputs.size();
        for (std::size_t i = part.joints.size(); i-- > 0;) {
            const int j = part.joints[i], parent = chain.bodies[j].parent;
            const std::size_t at = moved_.first(j), to = moved_.first(parent);
            for (std::size_t a = 0; a < count; ++a) {
                (parent == part.root ? sum_y_[a] : push_y_[to + a]) += push_y_[at + a];
                (parent == part.root ? sum_u_[a] : push_u_[to + a]) += push_u_[at + a];
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

    // RNEA − τ of each of a part's velocities.
    template <typename Visit>
    void each_force(const Part& part, const Chain& chain, Visit visit) const {
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            for (int i = b.first; i < b.first + b.count; ++i) {
                const double acting = motion_.acting() ? motion_.tau[i] : 0.0;
                visit(i, dot(moved_.S[i], all_[j]) + armature_[i] * moved_.a[i] - acting);
            }
        }
    }

    // (∂G/∂y)ᵀ f of a part on a series, where K_d gives no reactions.
    void bow(const Part& part, const Chain& chain) {
        const std::size_t n = part.inputs.size();
        each_force(part, chain, [&](int i, double force) {
            for (std::size_t a = 0, b = 0; a < n; b + 1 < n ? ++b : (b = 0, ++a))
                by_y(part.inputs[a], part.inputs[b]) -= path_.modes->bend[4 * i + 2 * a + b] * force;
        });
    }

    // Takes the closures' reactions off what the bodies take.
    void react(std::size_t p, const Chain& chain, Point& point, Loops& loops) {
        const Part& part = parts_[p];
        each_force(part, chain, [&](int i, double force) { force_[i] = path_.scale(i) * force; });
        loops.blocks.solve_transposed(force_.data(), lambda_.data());
        for (int j : part.joints) all_[j] = wrench_[j];
        for (const LoopMoved& loop : moved_.loops[p]) {
            Wrench on[2];
            loop.reactions(lambda_.data(), on);
            for (int side = 0; side < 2; ++side) {
                const int body = loop.loop.joint[side];
                if (path_.parts.of_joint[body] == static_cast<int>(p)) all_[body] -= on[side];
            }
            for (int a = 0; a < part.count(); ++a) {
                const Change ends[2] = {moved_.change(p, loop.loop.joint[0], a), moved_.change(p, loop.loop.joint[1], a)};
                Wrench changed[2];
                loop.reactions_changed(lambda_.data(), ends, changed);
                for (int side = 0; side < 2; ++side) {
                    const int body = loop.loop.joint[side];
                    // on the root it counts where carriers move all of them: beside its opposite
                    const bool own = path_.parts.of_joint[body] == static_cast<int>(p);
                    (own ? push_y_[moved_.first(body) + a] : sum_y_[a]) -= changed[side];
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

    // Share of a point spring, which may tie any two bodies.
    void pull(const Forces::Line& line, const Chain& chain, Point& point) {
        line_changed(line, chain, moved_, path_.layout.m, [&](int i, int k, double y, double u) {
            for (int input : parts_[path_.parts.of_velocity[i]].inputs) {
                by_y(input, k) -= point.G()[i * path_.layout.m + input] * y;
                by_u(input, k) -= point.G()[i * path_.layout.m + input] * u;
            }
        });
    }

    double* rows_ = nullptr;
    Path& path_;
    Motion& motion_;
    const std::vector<Part>& parts_;
    Cells<double> armature_;
    Spread spread_;
    Displacements moved_;
    Cells<Massive> massive_;  // of each body with what other parts it carries, as the next two
    Cells<Wrench> wrench_;
    Cells<Coriolis> coriolis_;
    Cells<Wrench> all_;     // with what follows in the part, less reactions
    std::vector<char> loaded_;  // by body: whether it, or what it carries, weighs anything
    Cells<Wrench> push_y_, push_u_;  // along each input of its part
    Cells<Wrench> sum_y_, sum_u_, momentum_;  // of each input of a part
    Cells<Vec> rate_;
    Cells<double> force_, lambda_;
    Cells<double> force_y_, force_u_, square_;  // one row of F; and Gᵀ F of a part
};

}  // namespace rg
