// The regular path: prediction, Newton, G and g with K_d factorised once, the test of the branch.
// The same steps as regular_path.py and march.py, whose docstrings say why; constants come from there.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "abi.h"
#include "blocks.h"
#include "cells.h"
#include "chain.h"
#include "closures.h"
#include "groups.h"
#include "parts.h"
#include "point.h"
#include "rigid_bodies.h"

namespace rg {

constexpr double CONVERGED = 2e-15, STAGNANT = 1e-12;
constexpr int MAX_NEWTON = 12;
constexpr double DETERMINANT_RATIO = 2.5, POOR = 0.3, CORRECTION = 0.25, ROUNDING = 1e-12,
                 FARTHEST = 0.5, PACE = 3.0;

class Path {
  public:
    // The closures and couplings of a part, and its share of K_d.
    struct Loops {
        Loops(const Description& d, Chain& chain, const Parts& parts, int number)
            : closures(d, chain, parts.list[number]), blocks(d, closures, parts, number) {
            for (int i : parts.list[number].velocities)
                if (std::find(d.independent, d.independent + d.m, i) == d.independent + d.m)
                    dependent.push_back(i);
            for (int j : parts.list[number].joints) {
                const Numbers& numbers = NUMBERS[chain.bodies[j].kind];
                flat = flat && numbers.q == numbers.v;
            }
        }

        Closures closures;
        Blocks blocks;  // refers to `closures`
        std::vector<int> dependent;
        bool flat = true;  // v is the rate of q
        std::int64_t iterations = 0, evaluations = 0;
    };

    Chain chain;  // as if joints on groups stood still
    const Parts parts;
    RigidBodies rigid;
    const Layout layout;
    const bool on_groups;
    const bool redundant;  // whether rows of φ are left over
    std::int64_t newton_iterations = 0, evaluations = 0;
    double enough = POOR;  // conditioning above which it need not be known

    explicit Path(const Description& d)
        : chain(d),
          parts(d, chain),
          rigid(d),
          layout(d),
          on_groups(std::any_of(parts.list.begin(), parts.list.end(), [](const Part& p) { return p.on_group; })),
          redundant(d.redundant != 0),
          independent_(d.independent, d.independent + d.m),
          independent_q_(d.independent_q, d.independent_q + d.m),
          input_(d.nv, -1),
          size_(d.size, d.size + d.nv),
          turn_(d.turn, d.turn + d.nv),
          scale_(d.scale, d.scale + d.nv),
          step_(d.nv),
          u_(d.nv),
          v_(d.nv) {
        for (int k = 0; k < d.m; ++k) input_[independent_[k]] = k;
        for (std::size_t i = 0; i < parts.list.size(); ++i) {
            const Part& part = parts.list[i];
            for (int j : part.joints) chain.bodies[j].held = part.on_group;
            loops_.emplace_back(part.tied() ? new Loops(d, chain, parts, static_cast<int>(i)) : nullptr);
        }
    }

    // The point at y from the anchor in one predicted step. Joints on groups are at origin ⊕ w, where
    // `origin` is a whole q and y has w for them.
    Reason step(Point& anchor, const double* origin, const double* y, const double* ydot, Point& point) {
        std::copy(y, y + layout.m, point.y());
        std::copy(ydot, ydot + layout.m, point.ydot());
        point.distance = point.turn = 0.0;
        for (std::size_t i = 0; i < loops_.size(); ++i) {
            const Part& part = parts.list[i];
            if (part.on_group)
                on_group(part, origin, point);
            else
                predict(part, anchor, point);
        }
        if (!settle(point)) return NEWTON;
        if (!(point.correction > 0.0)) point.distance = point.turn = 0.0;
        return DONE;
    }

    // The point that Newton finds from its own q, y and u; false where it is lost.
    bool settle(Point& point) {
        std::int64_t iterations = 0, looked = 0;
        point.correction = 0.0;
        point.conditioning() = 1.0;
        for (std::size_t i = 0; i < loops_.size(); ++i) {
            if (loops_[i] == nullptr) {
                chain.place(parts.list[i].joints, point.q());
                continue;
            }
            if (!close(parts.list[i], *loops_[i], point)) return false;
            iterations = std::max(iterations, loops_[i]->iterations);
            looked = std::max(looked, loops_[i]->evaluations);
        }
        newton_iterations += iterations;
        evaluations += looked;
        derivatives(point);
        return true;
    }

    // Largest rotation, rad, or slide in lengths, of the straight way from the anchor to y.
    double turn(Point& anchor, const double* y) const {
        const int m = layout.m;
        double worst = 0.0;
        for (const Part& part : parts.list)
            for (int i : part.velocities) {
                double sum = 0.0;
                for (int k : part.inputs) sum += anchor.G()[i * m + k] * (y[k] - anchor.y()[k]);
                worst = std::max(worst, std::fabs(sum * turn_[i]));
            }
        return worst;
    }

    // Largest dimensionless difference of q, one number a joint, from that of a point.
    double apart(const double* q, Point& point) const {
        double worst = 0.0;
        for (int i = 0; i < layout.nv; ++i) worst = std::max(worst, std::fabs((point.q()[i] - q[i]) * size_[i]));
        return worst;
    }

    // q at a share of the step of h from a to b, one number a joint: cubic Hermite in q and v.
    void between(Point& a, Point& b, double h, double share, double* q) {
        velocity(a, u_.data());
        velocity(b, v_.data());
        for (int i = 0; i < layout.nv; ++i) {
            const double r0 = h * u_[i], r1 = h * v_[i], towards = b.q()[i] - a.q()[i];
            q[i] = a.q()[i] + share * (r0 + share * (3.0 * towards - 2.0 * r0 - r1 +
                                                     share * (r0 + r1 - 2.0 * towards)));
        }
    }

    // Whether Newton, started from the prediction, stayed on the branch of `before`.
    bool same_branch(Point& before, Point& after) const {
        const int n = layout.blocks;
        if (n > 0 && after.turn > FARTHEST) return false;
        const double conditioning = after.conditioning();
        const double allowed =
            CORRECTION * after.distance + ROUNDING / std::max(conditioning, 1e-12);
        if (n > 0 && after.correction > 0.0 && after.correction > allowed) return false;
        const bool watched = !(conditioning >= POOR && before.conditioning() >= POOR);
        const double *a = before.det(), *b = after.det();
        for (int i = 0; i < n; ++i) {
            if (!(a[i] * b[i] > 0.0)) return false;
            if (!watched || std::min(before.rcond()[i], after.rcond()[i]) >= POOR) continue;
            const double ratio = b[i] / a[i];
            if (!(1.0 / DETERMINANT_RATIO < ratio && ratio < DETERMINANT_RATIO)) return false;
        }
        return true;
    }

    // All placements and, for v = G at m = 1, all velocities and accelerations at q̈ = 0.
    void survey(Point& point) {
        chain.place(chain.all, point.q());
        if (layout.m == 1) chain.move(chain.all, point.G());
    }

    // v = G u.
    void velocity(Point& point, double* v) const { product(point, point.ydot(), v); }

    // G times numbers (m,).
    void product(Point& point, const double* u, double* v) const {
        for (const Part& part : parts.list) product(part, point, u, v);
    }

    // max |g| / (max |v|)² of a part, in radians and lengths; 0 at rest. See simulation/evenness.py.
    double unevenness(const Part& part, Point& point) const {
        const double *G = point.G(), *g = point.g(), *u = point.ydot();
        double bent = 0.0, fastest = 0.0;
        for (int i : part.velocities) {
            double v = 0.0;
            for (int k : part.inputs) v += G[i * layout.m + k] * u[k];
            bent = std::max(bent, std::fabs(g[i] * turn_[i]));
            fastest = std::max(fastest, std::fabs(v * turn_[i]));
        }
        return fastest > 0.0 ? bent / (fastest * fastest) : 0.0;
    }

    // ẏ of joints on groups, whose y is w in a chart; of others it is u.
    void rate_on_groups(Point& point, double* rate) const {
        double w[6], u[6], turned[6];
        for (const Part& part : parts.list) {
            if (!part.on_group) continue;
            const Body& b = chain.bodies[part.joints[0]];
            for (int i = 0; i < b.count; ++i) {
                w[i] = point.y()[input_[b.first + i]];
                u[i] = point.ydot()[input_[b.first + i]];
            }
            rate_in_chart(b.kind, w, u, turned);
            for (int i = 0; i < b.count; ++i) rate[input_[b.first + i]] = turned[i];
        }
    }

    // Those of a part; none where nothing is tied.
    Loops* loops(std::size_t part) const { return loops_[part].get(); }
    // What a correction of a velocity is multiplied by.
    double scale(int velocity) const { return scale_[velocity]; }

  private:
    void product(const Part& part, Point& point, const double* u, double* v) const {
        const int m = layout.m;
        const double* G = point.G();
        for (int i : part.velocities) {
            v[i] = 0.0;
            for (int k : part.inputs) v[i] += G[i * m + k] * u[k];
        }
    }

    void on_group(const Part& part, const double* origin, Point& point) {
        double w[6];
        const Body& b = chain.bodies[part.joints[0]];
        for (int i = 0; i < b.count; ++i) w[i] = point.y()[input_[b.first + i]];
        integrate_joint(b.kind, origin + b.q, w, point.q() + b.q);
    }

    void predict(const Part& part, Point& anchor, Point& point) {
        const int m = layout.m;
        const double *G = anchor.G(), *from = anchor.y(), *ydot = anchor.ydot(), *y = point.y();
        const double* bend = m == 1 ? anchor.curvature() : anchor.g();
        double weight = 0.0;
        if (m == 1) {
            weight = 0.5 * (y[0] - from[0]) * (y[0] - from[0]);
        } else {
            double speed = 0.0, along = 0.0;
            for (int k : part.inputs) {
                speed += ydot[k] * ydot[k];
                along += (y[k] - from[k]) * ydot[k];
            }
            if (speed > 0.0) {
                along /= speed;
                weight = 0.5 * along * along;
            }
        }
        for (int i : part.velocities) {
            double sum = weight * bend[i];
            for (int k : part.inputs) sum += G[i * m + k] * (y[k] - from[k]);
            step_[i] = sum;
            point.distance = std::max(point.distance, std::fabs(sum * size_[i]));
            point.turn = std::max(point.turn, std::fabs(sum * turn_[i]));
        }
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            integrate_joint(b.kind, anchor.q() + b.q, step_.data() + b.first, point.q() + b.q);
        }
        for (int k : part.inputs) point.q()[independent_q_[k]] = y[k];
    }

    // Newton on the dependent joints; leaves the chain placed and K evaluated at the result.
    bool close(const Part& part, Loops& loops, Point& point) {
        double* q = point.q();
        const double infinite = std::numeric_limits<double>::infinity();
        double last_size = infinite, last_step = infinite;
        loops.iterations = loops.evaluations = 0;
        for (int iteration = 0; iteration < MAX_NEWTON; ++iteration) {
            if (iteration == 0)
                chain.place(part.joints, q);
            else
                chain.place_after(part.joints, q, step_.data());
            const double size = loops.closures.residual(q);
            ++loops.evaluations;
            if (!std::isfinite(size)) return false;
            loops.closures.jacobian();
            if (size <= CONVERGED || (size <= STAGNANT && size >= 0.25 * last_size)) return true;
            loops.blocks.factor();
            const double step = loops.blocks.solve(loops.closures.phi.data(), u_.data());
            if (iteration == 0)
                point.correction = std::max(point.correction, step);
            else if (!(step <= 0.5 * last_step) && size > STAGNANT)
                return false;
            last_size = size;
            last_step = step;
            correct(part, loops, q);
            ++loops.iterations;
        }
        return false;
    }

    // Takes u off q, and leaves the step in `step_`.
    void correct(const Part& part, const Loops& loops, double* q) {
        for (int k : part.inputs) step_[independent_[k]] = 0.0;
        for (int i : loops.dependent) step_[i] = -u_[i] * scale_[i];
        if (loops.flat) {
            for (int i : loops.dependent) q[chain.number_at[i]] += step_[i];
            return;
        }
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            integrate_joint(b.kind, q + b.q, step_.data() + b.first, q + b.q);
        }
    }

    // G = [I; −K_d⁻¹ K_i] and g = [0; K_d⁻¹ k] where `close` has ended. Entries that are always zero stay so.
    void derivatives(Point& point) {
        const int m = layout.m;
        double *G = point.G(), *g = point.g();
        for (int k = 0; k < m; ++k) G[independent_[k] * m + k] = 1.0;
        for (std::size_t i = 0; i < loops_.size(); ++i) {
            if (loops_[i] == nullptr) continue;
            const Part& part = parts.list[i];
            Blocks& blocks = loops_[i]->blocks;
            blocks.factor();
            const double conditioning = blocks.measure(enough, point.det(), point.rcond());
            if (!(conditioning >= point.conditioning())) point.conditioning() = conditioning;  // keeps a NaN
            for (int a = 0; a < part.count(); ++a) {
                blocks.solve_given(a, u_.data());
                for (int v : loops_[i]->dependent) G[v * m + part.inputs[a]] = scale_[v] * u_[v];
            }
            if (m > 1) {
                product(part, point, point.ydot(), v_.data());
                chain.move(part.joints, v_.data(), part.root);
                bend(*loops_[i], v_.data(), g);
            }
        }
        if (m > 1) return;
        double* curvature = point.curvature();
        chain.move(chain.all, G);
        for (auto& loops : loops_)
            if (loops != nullptr) bend(*loops, G, curvature);
        const double square = point.ydot()[0] * point.ydot()[0];
        for (int i = 0; i < layout.nv; ++i) g[i] = curvature[i] * square;
    }

    // g = [0; K_d⁻¹ k] for velocities v, with which the chain moves.
    void bend(Loops& loops, const double* v, double* g) {
        loops.closures.bias(v);
        loops.blocks.solve(loops.closures.k.data(), u_.data());
        for (int i : loops.dependent) g[i] = scale_[i] * u_[i];
    }

    std::vector<std::unique_ptr<Loops>> loops_;  // by part; none where nothing is tied
    std::vector<int> independent_, independent_q_;
    std::vector<int> input_;  // by velocity, −1 where it is dependent
    Cells<double> size_, turn_, scale_, step_, u_, v_;
};

}  // namespace rg
