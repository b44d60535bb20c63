// Closing the loops from afar: Levenberg–Marquardt on points first, then on points and rotations, then Newton on φ.
// The same steps as mechanism/assembly/assembly.py, whose docstrings say why; constants come from there.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "abi.h"
#include "constraint/closures.h"
#include "linalg/dense.h"
#include "tree/chain.h"
#include "tree/groups.h"
#include "tree/parts.h"

namespace rg {

// w of a rotation R = exp(w), |w| ≤ π.
inline Vec logarithm(const Axes& R) {
    const double trace = R.x.x + R.y.y + R.z.z;
    Vec axis{R.y.z - R.z.y, R.z.x - R.x.z, R.x.y - R.y.x};  // 2 sin θ times the axis
    const double sine = 0.5 * std::sqrt(dot(axis, axis)), cosine = 0.5 * (trace - 1.0);
    const double angle = std::atan2(sine, cosine);
    if (cosine > -0.9) return (sine > 1e-8 ? 0.5 * angle / sine : 0.5) * axis;
    int i = R.x.x > R.y.y ? 0 : 1;  // near half a turn (R + 1)/2 is axis axisᵀ
    if (R.z.z > R[i][i]) i = 2;
    Vec along = R[i] + Vec{R.x[i], R.y[i], R.z[i]};
    along[i] += 1.0 - trace;
    const double length = std::sqrt(dot(along, along));
    return (dot(along, axis) < 0.0 ? -angle / length : angle / length) * along;
}

// d log(R exp(δ)) = J δ: δ + ½ w × δ + c w × (w × δ).
inline Vec logarithm_rate(const Vec& w, const Vec& delta) {
    const double s = dot(w, w), angle = std::sqrt(s);
    const double c = s < 1e-4 ? 1.0 / 12.0 + s / 720.0 : 1.0 / s - 0.5 / (angle * std::tan(0.5 * angle));
    const Vec across = cross(w, delta);
    return delta + 0.5 * across + c * cross(w, across);
}

class Assembler {
  public:
    Assembler(const Description& d, const Assembly& a)
        : chain_(d), whole_(all_of(d, chain_)), closures_(d, chain_, whole_), a_(a), nv_(d.nv), rows_(d.rows),
          column_(d.nv, -1), dv_(d.nv), step_(d.nq) {
        for (int k = 0; k < a.free_count; ++k) column_[a.free[k]] = k;
        for (int c = 0; c < d.closures; ++c)
            for (int side = 0; side < 2; ++side) {
                const double* f = a.frames + 18 * c + 9 * side;
                frames_[side].push_back({{f[0], f[3], f[6]}, {f[1], f[4], f[7]}, {f[2], f[5], f[8]}});
            }
    }

    // Closes q (nq,) as far as it goes; the dimensionless residual there.
    double close(double* q) {
        const double already = scaled_size(q);
        if (already <= CLOSED) return already;
        for (const bool turns : {false, true}) {
            if (descend(q, turns) < CLOSE) continue;
            if (turns) return std::numeric_limits<double>::infinity();
        }
        return polish(q);
    }

    // R₂ᵀ R₁ of a closure's frames where the chain was placed last, row by row.
    void turn(int c, double* R) const {
        const Axes one = frame(c, 0), two = frame(c, 1);
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) R[3 * i + j] = dot(two[i], one[j]);
    }

    // The velocities `free` of v (nv,) from the others, by K v = 0; false where they are not determined.
    bool velocities(const double* q, double* v, double rank) {
        evaluate(q);
        double size = 0.0;
        for (int i = 0; i < nv_; ++i)
            if (column_[i] < 0) size = std::max(size, std::fabs(v[i]) / a_.column_scale[i]);
        const Matrix K = jacobian();
        Vector rhs = Vector::Zero(rows_);
        for (std::size_t e = 0; e < closures_.entries.size(); ++e) {
            const Entry& entry = closures_.entries[e];
            if (column_[entry.v] < 0) rhs[entry.row] -= closures_.values[e] / a_.row_scale[entry.row] * v[entry.v];
        }
        bool full = true;
        const Vector u = shortest(K, rhs, rank, &full);
        for (int k = 0; k < a_.free_count; ++k) {
            v[a_.free[k]] = a_.column_scale[a_.free[k]] * u[k];
            size = std::max(size, std::fabs(u[k]));
        }
        for (int row = 0; row < rows_; ++row) {
            double left = rhs[row];
            for (int k = 0; k < a_.free_count; ++k) left -= K(row, k) * u[k];
            full = full && std::fabs(left) <= COMPATIBLE * size;
        }
        return full;
    }

  private:
    static constexpr double CLOSED = 1e-12, CLOSE = 1e-8, LONGEST = 0.3, STALLED = 0.99, POLISHED = 1e-6, COMPATIBLE = 1e-6;
    static constexpr int POINT_STEPS = 60, STEPS = 200, PATIENCE = 8, NEWTON_STEPS = 10;

    Axes frame(int c, int side) const {
        return chain_.axes[closures_.loops()[c].joint[side]].turn(frames_[side][c]);
    }

    double evaluate(const double* q) {
        chain_.place(chain_.all, q);
        const double size = closures_.residual(q);
        if (std::isfinite(size)) closures_.jacobian();
        return size;
    }

    // K by the free velocities, dimensionless, where it was evaluated last.
    Matrix jacobian() const {
        Matrix K = Matrix::Zero(rows_, a_.free_count);
        for (std::size_t e = 0; e < closures_.entries.size(); ++e) {
            const Entry& entry = closures_.entries[e];
            if (column_[entry.v] >= 0)
                K(entry.row, column_[entry.v]) +=
                    closures_.values[e] * a_.column_scale[entry.v] / a_.row_scale[entry.row];
        }
        return K;
    }

    // Residual and Jacobian by dimensionless steps of the free velocities.
    void residual(const double* q, bool turns, Vector& r, Matrix& J) {
        evaluate(q);
        const auto& loops = closures_.loops();
        std::vector<int> at(rows_, -1);
        int count = 0;
        for (std::size_t c = 0; c < loops.size(); ++c) count += a_.sort[2 * c] ? 3 : 0;
        const int points = count;
        for (int i = 0; i < a_.point_count; ++i) at[a_.points[i]] = count++;
        const int tied = count;
        for (int i = 0; turns && i < a_.turn_count; ++i) at[a_.turns[i]] = count++;
        int first = count;
        for (std::size_t c = 0; turns && c < loops.size(); ++c) count += a_.sort[2 * c + 1] ? 3 : 0;
        r = Vector::Zero(count);
        J = Matrix::Zero(count, a_.free_count);
        const auto scale = [&](int row) { return at[row] < tied ? a_.row_scale[row] : 1.0; };
        for (int row = 0; row < rows_; ++row)
            if (at[row] >= points) r[at[row]] = closures_.phi[row] / scale(row);
        for (std::size_t e = 0; e < closures_.entries.size(); ++e) {
            const Entry& entry = closures_.entries[e];
            if (at[entry.row] >= 0 && column_[entry.v] >= 0)
                J(at[entry.row], column_[entry.v]) += closures_.values[e] * a_.units[entry.v] / scale(entry.row);
        }
        for (int c = 0, row = 0; c < static_cast<int>(loops.size()); ++c) {
            const Loop& loop = loops[c];
            if (a_.sort[2 * c]) {
                const Vec apart = loop.at[0] - loop.at[1];
                for (int i = 0; i < 3; ++i) r[row + i] = apart[i] / a_.length;
                for (const Lever& lever : loop.levers) {
                    const Vec& axis = chain_.axes[lever.joint][lever.column];
                    const Vec way = lever.turning ? cross(axis, loop.at[lever.side] - chain_.p[lever.joint]) : axis;
                    put(J, row, lever, (1.0 / a_.length) * way);
                }
                row += 3;
            }
            if (turns && a_.sort[2 * c + 1]) {
                rotation(c, loop, first, r, J);
                first += 3;
            }
        }
    }

    // log(R₁ᵀ R₂) of a weld, the chord a₁ − a₂ of a hinge's axes.
    void rotation(int c, const Loop& loop, int row, Vector& r, Matrix& J) const {
        const Axes one = frame(c, 0), two = frame(c, 1);
        if (a_.sort[2 * c + 1] == 1) {
            const Vec w = logarithm({one.local(two.x), one.local(two.y), one.local(two.z)});
            for (int i = 0; i < 3; ++i) r[row + i] = w[i];
            for (const Lever& lever : loop.levers)
                if (lever.turning)  // put changes the sign for side 1
                    put(J, row, lever, logarithm_rate(w, -1.0 * two.local(chain_.axes[lever.joint][lever.column])));
            return;
        }
        const double* x = a_.axis + 3 * c;
        const Vec ends[] = {one.turn(Vec{x[0], x[1], x[2]}), two.turn(Vec{x[0], x[1], x[2]})};
        const Vec apart = ends[0] - ends[1];
        for (int i = 0; i < 3; ++i) r[row + i] = apart[i];
        for (const Lever& lever : loop.levers)
            if (lever.turning)
                put(J, row, lever, cross(chain_.axes[lever.joint][lever.column], ends[lever.side]));
    }

    void put(Matrix& J, int row, const Lever& lever, const Vec& way) const {
        const int column = column_[lever.v];
        if (column < 0) return;
        const double unit = (lever.side == 0 ? 1.0 : -1.0) * a_.units[lever.v];
        for (int i = 0; i < 3; ++i) J(row + i, column) += unit * way[i];
    }

    // q moved by dv.
    void move(const double* q, double* to) const {
        for (const int j : chain_.all) {
            const Body& b = chain_.bodies[j];
            integrate_joint(b.kind, q + b.q, dv_.data() + b.first, to + b.q);
        }
    }

    // Levenberg–Marquardt; the largest entry of the residual where it ends.
    double descend(double* q, bool turns) {
        double damping = 1e-2;
        Vector r, r_trial;
        Matrix J, J_trial;
        residual(q, turns, r, J);
        double cost = r.squaredNorm();
        std::vector<double> history{std::numeric_limits<double>::infinity()};
        for (int i = 0; i < (turns ? STEPS : POINT_STEPS); ++i) {
            Matrix A = transposed_times(J, J);
            A.diagonal().array() += damping;
            Vector step = solution(A, -(J.transpose() * r));
            step *= std::min(1.0, LONGEST / std::max(step.size() ? step.cwiseAbs().maxCoeff() : 0.0, 1e-300));
            for (int k = 0; k < a_.free_count; ++k) dv_[a_.free[k]] = step[k] * a_.units[a_.free[k]];
            move(q, step_.data());
            residual(step_.data(), turns, r_trial, J_trial);
            if (r_trial.squaredNorm() < cost) {
                std::copy(step_.begin(), step_.end(), q);
                r.swap(r_trial);
                J.swap(J_trial);
                cost = r.squaredNorm();
                damping = std::max(0.3 * damping, 1e-14);
            } else {
                damping = std::min(4.0 * damping, 1e3);
            }
            history.push_back(cost);
            const bool stalled = history.size() > PATIENCE && cost > STALLED * history[history.size() - PATIENCE];
            if (cost < CLOSE * CLOSE * 1e-4 || (stalled && damping < 1e2) || damping >= 1e3) break;
        }
        return r.size() ? r.cwiseAbs().maxCoeff() : 0.0;
    }

    // Newton's steps until φ stops shrinking; its dimensionless size there.
    double polish(double* q) {
        double size = scaled_size(q);
        for (int i = 0; i < NEWTON_STEPS && size > 0.0 && a_.free_count > 0; ++i) {
            Vector phi(rows_);
            for (int row = 0; row < rows_; ++row) phi[row] = closures_.phi[row] / a_.row_scale[row];
            const Matrix K = jacobian();
            const Vector step = shortest(K, phi, POLISHED);
            for (int k = 0; k < a_.free_count; ++k) dv_[a_.free[k]] = -step[k] * a_.column_scale[a_.free[k]];
            move(q, step_.data());
            const double trial = scaled_size(step_.data());
            if (!(trial < 0.5 * size)) break;
            std::copy(step_.begin(), step_.end(), q);
            size = trial;
        }
        chain_.place(chain_.all, q);
        return size;
    }

    double scaled_size(const double* q) {
        if (!std::isfinite(evaluate(q))) return std::numeric_limits<double>::infinity();
        double size = 0.0;
        for (int row = 0; row < rows_; ++row)
            size = std::max(size, std::fabs(closures_.phi[row]) / a_.row_scale[row]);
        return size;
    }

    Chain chain_;
    const Part whole_;
    Closures closures_;
    const Assembly& a_;
    const int nv_, rows_;
    std::vector<int> column_;  // of K, by velocity; −1: held
    std::vector<Axes> frames_[2];
    std::vector<double> dv_, step_;
};

}  // namespace rg
