// φ, the entries of K that are not always zero, and k, all scaled.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "tree/chain.h"
#include "constraint/closure_rows.h"
#include "constraint/couplings.h"
#include "tree/parts.h"

namespace rg {

class Closures {
  public:
    std::vector<Entry> entries;
    Cells<double> phi, k, values;  // values: one an entry

    // Those of one part; rows are numbered as in the description.
    Closures(const Description& d, Chain& chain, const Part& part) : chain_(chain) {
        for (int c : part.closures) {
            Loop loop;
            for (int side = 0; side < 2; ++side) {
                loop.joint[side] = d.closure_joint[2 * c + side];
                const double* p = d.closure_point + 6 * c + 3 * side;
                loop.point[side] = {p[0], p[1], p[2]};
            }
            find_levers(loop);
            loop.first_row = static_cast<int>(rows_.size());
            for (int row = 0; row < d.rows; ++row)
                if (d.row_closure[row] == c) add_row(d, loop, row);
            loop.rows = static_cast<int>(rows_.size()) - loop.first_row;
            for (int side = 0; side < 2; ++side) loop.turned[side] = loop.fixed[side];
            for (const Lever& lever : loop.levers)
                for (int i = 0; i < loop.rows; ++i) {
                    const int row = loop.first_row + i;
                    const double sign = lever.side == 0 ? 1.0 : -1.0;
                    entries.push_back(
                        {target_[row], lever.v, sign * rows_[row].weight * d.scale[lever.v]});
                }
            loops_.push_back(loop);
        }
        couplings_ = Couplings(d, part.couplings, entries);
        phi.resize(d.rows);
        k.resize(d.rows);
        values.resize(entries.size() + 1);  // the last one stays zero
    }

    // φ at the chain's placements and q; returns max |φ|, NaN where φ is not finite.
    double residual(const double* q) {
        double size = couplings_.residual(q, phi.data());
        if (std::isnan(size)) return size;
        for (Loop& loop : loops_) {
            for (int side = 0; side < 2; ++side) {
                const int j = loop.joint[side];
                loop.arm[side] = chain_.axes[j].turn(loop.point[side]);
                loop.at[side] = chain_.p[j] + loop.arm[side];
                for (std::size_t i = 0; i < loop.fixed[side].size(); ++i)
                    loop.turned[side][i] = chain_.axes[j].turn(loop.fixed[side][i]);
            }
            const Vec apart = loop.at[0] - loop.at[1];
            for (int row = loop.first_row; row < loop.first_row + loop.rows; ++row) {
                double value = 0.0;
                if (rows_[row].axis >= 0) {
                    value = apart[rows_[row].axis];
                } else if (rows_[row].axis == ALONG) {
                    value = dot(apart, loop.turned[1][rows_[row].terms[0].second]);
                } else {
                    for (const Term& t : rows_[row].terms)
                        value += t.w * dot(loop.turned[0][t.first], loop.turned[1][t.second]);
                }
                value *= rows_[row].weight;
                phi[target_[row]] = value;
                const double magnitude = std::fabs(value);
                if (!(magnitude <= size)) size = magnitude;  // keeps a NaN
                if (std::isnan(size)) return size;
            }
        }
        return size;
    }

    // K after `residual` at the same placements.
    void jacobian() {
        couplings_.jacobian(entries, values.data());
        std::size_t at = 0;
        for (const Loop& loop : loops_) {
            bool rotations = false;
            for (int i = 0; i < loop.rows; ++i) {
                const Row& row = rows_[loop.first_row + i];
                if (row.axis >= 0) continue;
                Vec normal;
                if (row.axis == ALONG) {
                    normals_[loop.first_row + i] = loop.turned[1][row.terms[0].second];
                    continue;
                }
                rotations = true;
                for (const Term& t : row.terms)
                    normal += t.w * cross(loop.turned[0][t.first], loop.turned[1][t.second]);
                normals_[loop.first_row + i] = normal;
            }
            for (const Lever& lever : loop.levers) {
                const Vec& axis = chain_.axes[lever.joint][lever.column];
                const Vec way = moved(lever, axis, loop.at[lever.side]);
                for (int i = 0; i < loop.rows; ++i, ++at) {
                    const int e = rows_[loop.first_row + i].axis;
                    if (e >= 0)
                        values[at] = entries[at].scale * way[e];
                    else if (e == ALONG)  // n · (ṗ₁ − ṗ₂ − ω₂ × d): either body moves the first point
                        values[at] = entries[at].scale *
                                     dot(normals_[loop.first_row + i], moved(lever, axis, loop.at[0]));
                    else
                        values[at] = lever.turning && rotations
                                         ? entries[at].scale * dot(axis, normals_[loop.first_row + i])
                                         : 0.0;
                }
            }
        }
    }

    // After `jacobian`: the columns of a joint's velocities by other rates of its own, with which the velocities are
    // D times these (count, count), by columns.
    void recombine(int first, int count, const double* D) {
        std::size_t at = 0;
        for (const Loop& loop : loops_) {
            const std::size_t rows = loop.rows;
            for (const Lever& lever : loop.levers) {
                for (std::size_t i = 0; lever.v == first && i < rows; ++i) {
                    double own[6];
                    for (int c = 0; c < count; ++c) own[c] = values[at + c * rows + i] / entries[at + c * rows + i].scale;
                    for (int c = 0; c < count; ++c) {
                        double sum = 0.0;
                        for (int a = 0; a < count; ++a) sum += own[a] * D[c * count + a];
                        values[at + c * rows + i] = entries[at + c * rows + i].scale * sum;
                    }
                }
                at += rows;
            }
        }
    }

    // k = −K̇ v after the chain's `move` with v.
    void bias(const double* v) {
        couplings_.bias(v, k.data());
        for (const Loop& loop : loops_) {
            const int j1 = loop.joint[0], j2 = loop.joint[1];
            const Vec apart = pull(j2, loop.arm[1]) - pull(j1, loop.arm[0]);
            for (int row = loop.first_row; row < loop.first_row + loop.rows; ++row) {
                double value = 0.0;
                if (rows_[row].axis >= 0) {
                    value = apart[rows_[row].axis];
                } else if (rows_[row].axis == ALONG) {
                    const Vec &n = loop.turned[1][rows_[row].terms[0].second], &w = chain_.omega[j2];
                    const Vec rate = cross(w, n), bend = cross(chain_.alpha[j2], n) + cross(w, rate);
                    value = dot(n, apart) + 2.0 * dot(rate, speed(j2, loop.arm[1]) - speed(j1, loop.arm[0])) -
                            dot(bend, loop.at[0] - loop.at[1]);
                } else {
                    const Vec &w1 = chain_.omega[j1], &w2 = chain_.omega[j2];
                    for (const Term& t : rows_[row].terms) {
                        const Vec &u = loop.turned[0][t.first], &n = loop.turned[1][t.second];
                        const Vec rate = cross(cross(w1, u), n) + cross(u, cross(w2, n));
                        value -= t.w * (dot(chain_.alpha[j1] - chain_.alpha[j2], cross(u, n)) +
                                        dot(w1 - w2, rate));
                    }
                }
                k[target_[row]] = rows_[row].weight * value;
            }
        }
    }

    // The rate of K along v after `jacobian` and the chain's `move` with v at the same placements.
    void jacobian_rate(const double* v, double* rates) {
        couplings_.jacobian_rate(entries, v, rates);
        std::size_t at = 0;
        for (const Loop& loop : loops_) {
            const Vec &w1 = chain_.omega[loop.joint[0]], &w2 = chain_.omega[loop.joint[1]];
            Vec pace[2];
            for (int side = 0; side < 2; ++side) pace[side] = speed(loop.joint[side], loop.arm[side]);
            turns_.assign(loop.rows, Vec());  // of the normals
            for (int i = 0; i < loop.rows; ++i) {
                const Row& row = rows_[loop.first_row + i];
                if (row.axis == ALONG) turns_[i] = cross(w2, normals_[loop.first_row + i]);
                if (row.axis != ROTATION) continue;
                for (const Term& t : row.terms) {
                    const Vec &u = loop.turned[0][t.first], &n = loop.turned[1][t.second];
                    turns_[i] += t.w * (cross(cross(w1, u), n) + cross(u, cross(w2, n)));
                }
            }
            for (const Lever& lever : loop.levers) {
                const Vec& axis = chain_.axes[lever.joint][lever.column];
                const Vec turn = cross(chain_.omega[lever.joint], axis);
                const auto hastened = [&](int side) {  // how fast `moved` changes
                    return lever.turning ? cross(turn, loop.at[side] - chain_.p[lever.joint]) +
                                               cross(axis, pace[side] - chain_.u[lever.joint])
                                         : turn;
                };
                const Vec way = hastened(lever.side);
                for (int i = 0; i < loop.rows; ++i, ++at) {
                    const int e = rows_[loop.first_row + i].axis;
                    const Vec& normal = normals_[loop.first_row + i];
                    double value = 0.0;
                    if (e >= 0)
                        value = way[e];
                    else if (e == ALONG)
                        value = dot(turns_[i], moved(lever, axis, loop.at[0])) + dot(normal, hastened(0));
                    else if (lever.turning)
                        value = dot(turn, normal) + dot(axis, turns_[i]);
                    rates[at] = entries[at].scale * value;
                }
            }
        }
    }

    const std::vector<Loop>& loops() const { return loops_; }
    const Couplings& couplings() const { return couplings_; }
    // One of a loop's rows, and its number in the description.
    const Row& row(const Loop& loop, int i) const { return rows_[loop.first_row + i]; }
    int number(const Loop& loop, int i) const { return target_[loop.first_row + i]; }

  private:
    // How fast a lever moves a point.
    Vec moved(const Lever& lever, const Vec& axis, const Vec& at) const {
        return lever.turning ? cross(axis, at - chain_.p[lever.joint]) : axis;
    }

    Vec speed(int j, const Vec& arm) const { return chain_.u[j] + cross(chain_.omega[j], arm); }

    Vec pull(int j, const Vec& arm) const {
        return chain_.a[j] + cross(chain_.alpha[j], arm) + centripetal(chain_.omega[j], arm);
    }

    // Where a direction is among those of a body, at the end if it is new.
    static std::size_t place_of(const Vec& direction, std::vector<Vec>& fixed) {
        const auto same = [&](const Vec& v) { return v.x == direction.x && v.y == direction.y && v.z == direction.z; };
        const auto found = std::find_if(fixed.begin(), fixed.end(), same);
        if (found != fixed.end()) return static_cast<std::size_t>(found - fixed.begin());
        fixed.push_back(direction);
        return fixed.size() - 1;
    }

    void add_row(const Description& d, Loop& loop, int row) {
        Row made{d.row_axis[row], d.row_weight[row], {}};
        for (int t = d.row_terms[row]; t < d.row_terms[row + 1]; ++t) {
            const double* x = d.terms + 7 * t;
            const Vec u{x[1], x[2], x[3]}, n{x[4], x[5], x[6]};
            made.terms.push_back({x[0], u, n, place_of(u, loop.fixed[0]), place_of(n, loop.fixed[1])});
        }
        rows_.push_back(made);
        target_.push_back(row);
        normals_.push_back({});
    }

    // Joints that carry one of the two points but not both: the others move the loop as a whole.
    void find_levers(Loop& loop) const {
        for (int side = 0; side < 2; ++side)
            for (int j = loop.joint[side]; j > 0; j = chain_.bodies[j].parent) {
                if (carries(j, loop.joint[1 - side])) continue;
                const Body& b = chain_.bodies[j];
                for (int i = b.first; i < b.first + b.count; ++i)
                    loop.levers.push_back(
                        {j, i, chain_.freedoms[i].column, chain_.freedoms[i].turning, side});
            }
    }

    bool carries(int joint, int body) const {
        for (int j = body; j > 0; j = chain_.bodies[j].parent)
            if (j == joint) return true;
        return false;
    }

    Chain& chain_;
    std::vector<Loop> loops_;
    Couplings couplings_;
    std::vector<Row> rows_;
    std::vector<int> target_;  // the caller's number of each row
    Cells<Vec> normals_;  // Σ w u × n of a rotation row; n of a row along it
    Cells<Vec> turns_;    // rates of these, for the rows of one loop
};

}  // namespace rg
