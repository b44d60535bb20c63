// K_d block by block: factorisation, substitution, and the sign and conditioning of each block.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "closures.h"
#include "lu.h"
#include "parts.h"

namespace rg {

class Blocks {
  public:
    // Those of one part; det and rcond are told by their numbers in the description.
    Blocks(const Description& d, Closures& closures, const Parts& parts, int part) : values_(closures.values) {
        const int zero = static_cast<int>(closures.entries.size());
        std::vector<int> block_of_row(d.rows, -1), block_of_v(d.nv, -1), place_of_v(d.nv, -1);
        for (int b = 0; b < d.blocks; ++b)
            for (int i = d.block_start[b]; i < d.block_start[b + 1]; ++i) {
                block_of_row[d.block_rows[i]] = b;
                block_of_v[d.block_columns[i]] = b;
                place_of_v[d.block_columns[i]] = i - d.block_start[b];
            }
        for (int i = 0; i < d.m; ++i) place_of_v[d.independent[i]] = i;
        for (int b = 0; b < d.blocks; ++b) {
            if (parts.of_velocity[d.block_columns[d.block_start[b]]] != part) continue;
            Block block;
            block.number = b;
            block.n = d.block_start[b + 1] - d.block_start[b];
            block.rows.assign(d.block_rows + d.block_start[b], d.block_rows + d.block_start[b + 1]);
            block.columns.assign(d.block_columns + d.block_start[b], d.block_columns + d.block_start[b + 1]);
            block.at.assign(static_cast<std::size_t>(block.n) * block.n, zero);
            block.reference = d.reference[b];
            for (int i = 0; i < block.n; ++i) {
                for (int e = 0; e < zero; ++e) {
                    const Entry& entry = closures.entries[e];
                    if (entry.row != block.rows[i]) continue;
                    const int owner = block_of_v[entry.v], place = place_of_v[entry.v];
                    if (owner == b)
                        block.at[i * block.n + place] = e;
                    else if (owner < 0)
                        block.given.push_back({i, place, e});
                    else if (owner < b)
                        block.known.push_back({i, entry.v, e});
                    // entries above the diagonal blocks are structurally zero
                }
            }
            if (block.n > 2) block.lu = Lu(block.n);
            widest_ = std::max(widest_, block.n);
            blocks_.push_back(block);
        }
        left_.resize(widest_);
    }

    // Factorise K_d; false where a block is exactly singular or not finite.
    bool factor() {
        bool good = true;
        for (Block& b : blocks_) {
            if (b.n > 2) {
                double* a = b.lu.matrix();
                for (int i = 0; i < b.n * b.n; ++i) a[i] = values_[b.at[i]];
                b.lu.factor();
                b.det = b.lu.det;
                good = good && b.lu.regular && std::isfinite(b.det);
                continue;
            }
            if (b.n == 2) {
                for (int i = 0; i < 4; ++i) b.e[i] = values_[b.at[i]];
                b.det = b.e[0] * b.e[3] - b.e[1] * b.e[2];
            } else {
                b.det = b.e[0] = values_[b.at[0]];
            }
            b.inverse = 1.0 / b.det;
            good = good && std::isfinite(b.inverse);
        }
        return good;
    }

    // u = K_d⁻¹ rhs by velocity (nv), rhs by row; returns max |u|.
    double solve(const double* rhs, double* u) {
        double size = 0.0;
        for (Block& b : blocks_) {
            for (int i = 0; i < b.n; ++i) left_[i] = rhs[b.rows[i]];
            size = std::max(size, substitute(b, u));
        }
        return size;
    }

    // Column j of −K_d⁻¹ K_i by velocity.
    void solve_given(int j, double* u) {
        for (Block& b : blocks_) {
            std::fill(left_.begin(), left_.begin() + b.n, 0.0);
            for (const Link& link : b.given)
                if (link.other == j) left_[link.row] -= values_[link.entry];
            substitute(b, u);
        }
    }

    // det and rcond of each block after `factor`; returns the smallest rcond, 1 at most.
    double measure(double* det, double* rcond) {
        double worst = 1.0;
        for (Block& b : blocks_) {
            det[b.number] = b.det;
            double value = std::fabs(b.det);
            if (b.n == 1) {
                value = std::min(value, 1.0);
            } else if (b.n == 2) {
                const double s = b.e[0] * b.e[0] + b.e[1] * b.e[1] + b.e[2] * b.e[2] + b.e[3] * b.e[3];
                const double root = std::sqrt(std::max(s * s - 4.0 * b.det * b.det, 0.0));
                value = 2.0 * value / std::max(s + root, 1e-300);
            } else {
                value = std::min(b.lu.rcond() / b.reference, 1.0);
            }
            rcond[b.number] = value;
            if (!(value >= worst)) worst = value;
        }
        return worst;
    }

  private:
    struct Link {
        int row, other, entry;  // local row; velocity or independent coordinate; value
    };
    struct Block {
        int n = 0, number = 0;
        std::vector<int> rows, columns, at;
        std::vector<Link> known, given;
        double e[4] = {}, det = 0.0, inverse = 0.0, reference = 1.0;
        Lu lu;
    };

    double substitute(Block& b, double* u) {
        for (const Link& link : b.known) left_[link.row] -= values_[link.entry] * u[link.other];
        if (b.n == 1) {
            u[b.columns[0]] = left_[0] * b.inverse;
        } else if (b.n == 2) {
            const double x = left_[0], y = left_[1];
            u[b.columns[0]] = (b.e[3] * x - b.e[1] * y) * b.inverse;
            u[b.columns[1]] = (b.e[0] * y - b.e[2] * x) * b.inverse;
        } else {
            b.lu.solve(left_.data());
            for (int i = 0; i < b.n; ++i) u[b.columns[i]] = left_[i];
        }
        double size = 0.0;
        for (int column : b.columns) size = std::max(size, std::fabs(u[column]));
        return size;
    }

    Cells<double>& values_;
    std::vector<Block> blocks_;
    Cells<double> left_;
    int widest_ = 1;
};

}  // namespace rg
