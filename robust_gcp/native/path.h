// The regular path: prediction, Newton, G and g with K_d factorised once, the test of the branch.
// The same steps as regular_path.py and march.py, whose docstrings say why; constants come from there.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "blocks.h"
#include "chain.h"
#include "closures.h"
#include "point.h"
#include "rigid_bodies.h"

namespace rg {

constexpr double CONVERGED = 2e-15, STAGNANT = 1e-12;
constexpr int MAX_NEWTON = 12;
constexpr double DETERMINANT_RATIO = 2.5, POOR = 0.3, CORRECTION = 0.25, ROUNDING = 1e-12,
                 FARTHEST = 0.5;

class Path {
  public:
    Chain chain;
    Closures closures;
    Blocks blocks;
    RigidBodies rigid;
    const Layout layout;
    std::int64_t newton_iterations = 0, evaluations = 0;

    explicit Path(const Description& d)
        : chain(d),
          closures(d, chain),
          blocks(d, closures),
          rigid(d),
          layout(d),
          flat_(d.nq == d.nv),
          independent_(d.independent, d.independent + d.m),
          independent_q_(d.independent_q, d.independent_q + d.m),
          size_(d.size, d.size + d.nv),
          turn_(d.turn, d.turn + d.nv),
          scale_(d.scale, d.scale + d.nv),
          step_(d.nv),
          u_(d.nv),
          v_(d.nv) {
        std::vector<bool> chosen(d.nv, false);
        for (int v : independent_) chosen[v] = true;
        for (int v = 0; v < d.nv; ++v)
            if (!chosen[v]) dependent_.push_back(v);
    }

    // The point at y from the anchor in one predicted step.
    Reason step(Point& anchor, const double* y, const double* ydot, Point& point) {
        predict(anchor, y, point);
        std::copy(y, y + layout.m, point.y());
        std::copy(ydot, ydot + layout.m, point.ydot());
        if (!close(point)) return NEWTON;
        derivatives(point);
        if (!(point.correction > 0.0)) point.distance = point.turn = 0.0;
        return DONE;
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
        chain.place(chain.loop, point.q());
        chain.place(chain.free, point.q());
        if (layout.m == 1) {
            chain.move(chain.loop, point.G());
            chain.move(chain.free, point.G());
        }
    }

  private:
    void predict(Point& anchor, const double* y, Point& point) {
        const int m = layout.m, nv = layout.nv;
        const double *G = anchor.G(), *from = anchor.y(), *ydot = anchor.ydot();
        double weight = 0.0;
        if (m == 1) {
            const double delta = y[0] - from[0];
            weight = 0.5 * delta * delta;
            const double* bend = anchor.curvature();
            for (int i = 0; i < nv; ++i) step_[i] = G[i] * delta + weight * bend[i];
        } else {
            double speed = 0.0, along = 0.0;
            for (int j = 0; j < m; ++j) {
                speed += ydot[j] * ydot[j];
                along += (y[j] - from[j]) * ydot[j];
            }
            if (speed > 0.0) {
                along /= speed;
                weight = 0.5 * along * along;
            }
            const double* bend = anchor.g();
            for (int i = 0; i < nv; ++i) {
                double sum = 0.0;
                for (int j = 0; j < m; ++j) sum += G[i * m + j] * (y[j] - from[j]);
                step_[i] = sum + weight * bend[i];
            }
        }
        point.distance = point.turn = 0.0;
        for (int i = 0; i < nv; ++i) {
            point.distance = std::max(point.distance, std::fabs(step_[i] * size_[i]));
            point.turn = std::max(point.turn, std::fabs(step_[i] * turn_[i]));
        }
        const double* q = anchor.q();
        if (flat_) {
            for (int i = 0; i < nv; ++i) point.q()[i] = q[i] + step_[i];
        } else {
            rigid.integrate(q, step_.data(), point.q());
        }
        for (int j = 0; j < m; ++j) point.q()[independent_q_[j]] = y[j];
    }

    // Newton on the dependent joints; leaves the chain placed and K evaluated at the result.
    bool close(Point& point) {
        point.correction = 0.0;
        double* q = point.q();
        if (layout.blocks == 0) return true;
        const double infinite = std::numeric_limits<double>::infinity();
        double last_size = infinite, last_step = infinite;
        for (int iteration = 0; iteration < MAX_NEWTON; ++iteration) {
            chain.place(chain.loop, q);
            const double size = closures.residual(q);
            ++evaluations;
            if (!std::isfinite(size)) return false;
            closures.jacobian();
            if (size <= CONVERGED || (size <= STAGNANT && size >= 0.25 * last_size)) return true;
            blocks.factor();
            const double step = blocks.solve(closures.phi.data(), u_.data());
            if (iteration == 0)
                point.correction = step;
            else if (!(step <= 0.5 * last_step) && size > STAGNANT)
                return false;
            last_size = size;
            last_step = step;
            if (flat_) {
                for (int v : dependent_) q[v] -= u_[v] * scale_[v];
            } else {
                std::fill(step_.begin(), step_.end(), 0.0);
                for (int v : dependent_) step_[v] = -u_[v] * scale_[v];
                moved_.resize(layout.nq);
                rigid.integrate(q, step_.data(), moved_.data());
                std::copy(moved_.begin(), moved_.end(), q);
            }
            ++newton_iterations;
        }
        return false;
    }

    // G = [I; −K_d⁻¹ K_i] and g = [0; K_d⁻¹ k] where `close` has ended.
    void derivatives(Point& point) {
        const int m = layout.m, nv = layout.nv;
        double *G = point.G(), *g = point.g();
        std::fill(G, g + nv, 0.0);
        for (int j = 0; j < m; ++j) G[independent_[j] * m + j] = 1.0;
        point.conditioning() = 1.0;
        if (layout.blocks == 0) {
            if (m == 1) {
                std::fill(point.curvature(), point.curvature() + nv, 0.0);
                survey(point);
            }
            return;
        }
        blocks.factor();
        point.conditioning() = blocks.measure(point.det(), point.rcond());
        const double* v = G;
        for (int j = 0; j < m; ++j) {
            blocks.solve_given(j, u_.data());
            for (int i : dependent_) G[i * m + j] = scale_[i] * u_[i];
        }
        const double* ydot = point.ydot();
        if (m > 1) {
            for (int i = 0; i < nv; ++i) {
                v_[i] = 0.0;
                for (int j = 0; j < m; ++j) v_[i] += G[i * m + j] * ydot[j];
            }
            v = v_.data();
        }
        chain.move(chain.loop, v);
        if (m == 1) {
            chain.place(chain.free, point.q());
            chain.move(chain.free, v);
        }
        closures.bias(v);
        blocks.solve(closures.k.data(), u_.data());
        if (m == 1) {
            double* bend = point.curvature();
            std::fill(bend, bend + nv, 0.0);
            for (int i : dependent_) bend[i] = scale_[i] * u_[i];
            const double square = ydot[0] * ydot[0];
            for (int i = 0; i < nv; ++i) g[i] = bend[i] * square;
        } else {
            for (int i : dependent_) g[i] = scale_[i] * u_[i];
        }
    }

    bool flat_;
    std::vector<int> independent_, independent_q_, dependent_;
    Cells<double> size_, turn_, scale_, step_, u_, v_, moved_;
};

}  // namespace rg
