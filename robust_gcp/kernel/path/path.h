// The regular path: prediction, Newton, G and g with K_d factorised once.
// The same steps as regular_path.py and regular_ground.py, whose docstrings say why; constants come from there.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "tree/chain.h"
#include "tree/groups.h"
#include "path/branch.h"
#include "path/loops.h"
#include "path/modes.h"
#include "path/on_groups.h"
#include "tree/parts.h"
#include "path/point.h"

namespace rg {

class Path {
  public:
    Chain chain;  // as if joints on groups stood still
    const Parts parts;
    const Layout layout;
    const OnGroups groups;
    const bool charted;  // whether any part is
    const bool redundant;  // whether rows of φ are left over
    std::int64_t newton_iterations = 0, evaluations = 0;
    double enough = POOR;  // conditioning above which it need not be known
    std::unique_ptr<Modes> modes;  // what derivatives know of them; null in steps

    explicit Path(const Description& d)
        : chain(d),
          parts(d, chain),
          layout(d),
          groups(d, chain, parts),
          charted(std::any_of(parts.list.begin(), parts.list.end(), [](const Part& p) { return p.charted; })),
          redundant(d.redundant != 0),
          independent_(d.independent, d.independent + d.m),
          independent_q_(d.independent_q, d.independent_q + d.m),
          size_(d.size, d.size + d.nv),
          turn_(d.turn, d.turn + d.nv),
          scratch_(d),
          v_(d.nv), change_(d.m) {
        for (std::size_t i = 0; i < parts.list.size(); ++i) {
            const Part& part = parts.list[i];
            for (int j : part.joints) chain.bodies[j].held = part.on_group;
            loops_.emplace_back(part.tied() ? new Loops(d, chain, parts, static_cast<int>(i), scratch_) : nullptr);
        }
    }

    // The point at y from the anchor in one predicted step. Joints on groups, and charts in loops, are at
    // origin ⊕ w, where `origin` is a whole q and y has w for them.
    Reason step(Point& anchor, const double* origin, const double* y, const double* ydot, Point& point) {
        std::copy(y, y + layout.m, point.y());
        std::copy(ydot, ydot + layout.m, point.ydot());
        point.distance = point.turn = 0.0;
        for (std::size_t i = 0; i < loops_.size(); ++i) {
            const Part& part = parts.list[i];
            if (part.on_group)
                groups.place(part, origin, point);
            else
                predict(i, anchor, loops_[i] ? loops_[i]->charts.aim(origin, anchor, y) : y, point);
        }
        if (!settle(point, origin)) return NEWTON;
        if (!(point.correction > 0.0)) point.distance = point.turn = 0.0;
        return DONE;
    }

    // The point that Newton finds from its own q, y and u; false where it is lost. `origin` is another array than q.
    bool settle(Point& point, const double* origin) {
        std::int64_t iterations = 0, looked = 0;
        point.correction = 0.0;
        point.conditioning() = 1.0;
        point.by_modes = false;
        for (std::size_t i = 0; i < loops_.size(); ++i) {
            if (loops_[i] == nullptr) {
                chain.place(parts.list[i].joints, point.q());
                continue;
            }
            if (modes != nullptr && modes->place(i, point, chain)) {
                chain.place(parts.list[i].joints, point.q());
                point.by_modes = true;
                continue;
            }
            if (!loops_[i]->close(point, origin)) return false;
            iterations = std::max(iterations, loops_[i]->iterations);
            looked = std::max(looked, loops_[i]->evaluations);
        }
        newton_iterations += iterations;
        evaluations += looked;
        derivatives(point);
        return true;
    }

    // K at the point's own q, closed or not, and G and g there.
    void look(Point& point) {
        for (std::size_t i = 0; i < loops_.size(); ++i) {
            chain.place(parts.list[i].joints, point.q());
            if (loops_[i] != nullptr) loops_[i]->prime(point.q());
        }
        point.conditioning() = 1.0;
        derivatives(point);
    }

    // ẏ of what is in charts, into that of all; of other joints it is u.
    void rate(Point& point, const double* origin, double* rate) const {
        groups.rate(point, rate);
        if (!charted) return;
        for (const auto& loops : loops_)
            if (loops != nullptr) loops->charts.rate(origin, point, point.ydot(), rate);
    }

    // Joints in loops that are in charts at their y; of use where all others are in place.
    void place_charts(const double* origin, Point& point) {
        for (const auto& loops : loops_)
            if (loops != nullptr) loops->charts.begin(origin, point.y(), point.q());
    }

    // Puts joints in loops that are in charts where another whole q has them.
    void keep_charts(const double* from, double* q) const {
        for (const auto& loops : loops_)
            if (loops != nullptr) loops->charts.copy(from, q);
    }

    // Largest entry of w of joints in loops.
    double away(Point& point, const double* origin) const {
        double most = 0.0;
        for (const auto& loops : loops_)
            if (loops != nullptr) most = std::max(most, loops->charts.away(origin, point));
        return most;
    }

    // K_d factorised where a motion begins, so that it hangs on nothing that was done before.
    void prime(Point& point) {
        chain.place(chain.all, point.q());
        for (const auto& loops : loops_)
            if (loops != nullptr) loops->prime(point.q());
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

    // Largest dimensionless difference of q from that of a point.
    double apart(const double* q, Point& point) const {
        double worst = 0.0, w[6];
        for (const int j : chain.all) {
            const Body& b = chain.bodies[j];
            joint_difference(b.kind, q + b.q, point.q() + b.q, w);
            for (int i = 0; i < b.count; ++i) worst = std::max(worst, std::fabs(w[i] * size_[b.first + i]));
        }
        return worst;
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
        for (std::size_t i = 0; i < loops_.size(); ++i) product(i, point, u, v);
    }

    // v̇ = G ÿ + g.
    void acceleration(Point& point, const double* ydd, double* a) const {
        product(point, ydd, a);
        for (int i = 0; i < layout.nv; ++i) a[i] += point.g()[i];
    }

    // Whether a part was put on a series that its mode follows.
    bool on_mode(std::size_t part) const { return modes != nullptr && modes->used(part); }

    // Those of a part; none where nothing is tied.
    Loops* loops(std::size_t part) const { return loops_[part].get(); }
    // What a correction of a velocity is multiplied by.
    double scale(int velocity) const { return scratch_.scale[velocity]; }

  private:
    // That of one part, whose rows of G for independent velocities are those of the unit matrix.
    void product(std::size_t i, Point& point, const double* u, double* v) const {
        const Part& part = parts.list[i];
        for (int k : part.inputs) v[independent_[k]] = u[k];
        if (loops_[i] == nullptr) return;
        for (int j : loops_[i]->dependent) {
            const double* row = point.G() + j * layout.m;
            double sum = 0.0;
            for (int k : part.inputs) sum += row[k] * u[k];
            v[j] = sum;
        }
    }

    // `aim`: the y to which G Δy leads.
    void predict(std::size_t i, Point& anchor, const double* aim, Point& point) {
        const Part& part = parts.list[i];
        const double *from = anchor.y(), *ydot = anchor.ydot();
        const double* bend = layout.m == 1 ? anchor.curvature() : anchor.g();
        double *step = scratch_.step.data(), weight = 0.0;
        for (int k : part.inputs) change_[k] = aim[k] - from[k];
        product(i, anchor, change_.data(), step);
        if (layout.m == 1) {
            weight = 0.5 * change_[0] * change_[0];
        } else {
            double speed = 0.0, along = 0.0;
            for (int k : part.inputs) {
                speed += ydot[k] * ydot[k];
                along += change_[k] * ydot[k];
            }
            if (speed > 0.0) {
                along /= speed;
                weight = 0.5 * along * along;
            }
        }
        for (int v : part.velocities) {
            step[v] += weight * bend[v];  // 0 of independent ones
            point.distance = std::max(point.distance, std::fabs(step[v] * size_[v]));
            point.turn = std::max(point.turn, std::fabs(step[v] * turn_[v]));
        }
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            integrate_joint(b.kind, anchor.q() + b.q, step + b.first, point.q() + b.q);
        }
        for (int k : part.inputs)
            if (independent_q_[k] >= 0) point.q()[independent_q_[k]] = point.y()[k];
    }

    // G = [I; −K_d⁻¹ K_i] and g = [0; K_d⁻¹ k] where `close` has ended. Entries that are always zero stay so.
    void derivatives(Point& point) {
        const int m = layout.m;
        double *G = point.G(), *g = point.g();
        for (int k = 0; k < m; ++k) G[independent_[k] * m + k] = 1.0;
        for (std::size_t i = 0; i < loops_.size(); ++i) {
            if (loops_[i] == nullptr) continue;
            const Part& part = parts.list[i];
            if (on_mode(i)) {
                modes->rates(i, point, g);
                continue;
            }
            Blocks& blocks = loops_[i]->blocks;
            blocks.factor();
            const double conditioning = blocks.measure(enough, point.det(), point.rcond());
            if (!(conditioning >= point.conditioning())) point.conditioning() = conditioning;  // keeps a NaN
            loops_[i]->velocities(G, m);
            if (m > 1) {
                product(i, point, point.ydot(), v_.data());
                chain.move(part.joints, v_.data(), part.root);
                loops_[i]->bend(v_.data(), g);
            }
        }
        if (m > 1) return;
        double* curvature = point.curvature();
        chain.move(chain.all, G);
        for (std::size_t i = 0; i < loops_.size(); ++i)
            if (on_mode(i))
                for (int v : parts.list[i].velocities) curvature[v] = modes->bend[4 * v];
            else if (loops_[i] != nullptr)
                loops_[i]->bend(G, curvature);
        const double square = point.ydot()[0] * point.ydot()[0];
        for (int i = 0; i < layout.nv; ++i) g[i] = curvature[i] * square;
    }

    std::vector<std::unique_ptr<Loops>> loops_;  // by part; none where nothing is tied
    std::vector<int> independent_, independent_q_;
    Cells<double> size_, turn_;
    Scratch scratch_;  // of all loops, in turn
    Cells<double> v_, change_;
};

}  // namespace rg
