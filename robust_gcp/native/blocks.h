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

// Largest φ, dimensionless, for whose correction K_d of a point near by serves.
constexpr double NEAR = 1e-11;

// A correction, dimensionless, after which φ and K are as good as evaluated anew.
constexpr double SETTLED = 2e-14;

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
        const std::vector<int>& inputs = parts.list[part].inputs;
        for (std::size_t i = 0; i < inputs.size(); ++i) place_of_v[d.independent[inputs[i]]] = static_cast<int>(i);
        for (int b = 0; b < d.blocks; ++b) {
            if (parts.of_velocity[d.block_columns[d.block_start[b]]] != part) continue;
            Block block;
            block.number = b;
            block.n = d.block_start[b + 1] - d.block_start[b];
            block.rows.assign(d.block_rows + d.block_start[b], d.block_rows + d.block_start[b + 1]);
            block.columns.assign(d.block_columns + d.block_start[b], d.block_columns + d.block_start[b + 1]);
            block.reference = d.reference[b];
            if (block.n > 2) block.parity = in_order(d, closures, block, place_of_v);
            std::vector<int> at(static_cast<std::size_t>(block.n) * block.n, zero);
            for (int i = 0; i < block.n; ++i) {
                for (int e = 0; e < zero; ++e) {
                    const Entry& entry = closures.entries[e];
                    if (entry.row != block.rows[i]) continue;
                    const int owner = block_of_v[entry.v], place = place_of_v[entry.v];
                    if (owner == b) {
                        at[i * block.n + place] = e;
                        block.filled.push_back({i, place, e});
                    } else if (owner < 0) {
                        block.given.push_back({i, place, e});
                    } else if (owner < b) {
                        block.known.push_back({i, entry.v, e});
                    }
                    // entries above the diagonal blocks are structurally zero
                }
            }
            if (block.n <= 2) std::copy(at.begin(), at.end(), block.at);
            if (block.n > 2) {
                block.lu = Lu(block.n);
                block.last.resize(block.filled.size());
            }
            widest_ = std::max(widest_, block.n);
            blocks_.push_back(block);
        }
        inputs_ = parts.list[part].count();
        left_.resize(static_cast<std::size_t>(widest_) * std::max(inputs_, 1));
    }

    // Factorise K_d; false where a block is exactly singular or not finite.
    bool factor() {
        bool good = true;
        for (Block& b : blocks_) {
            if (b.n > 2) {
                load(b);
                b.lu.factor();
                b.det = b.parity * b.lu.det;
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

    // −K_d⁻¹ K_i by velocity and the part's inputs, (nv, inputs).
    void solve_inputs(double* U) {
        const int count = inputs_;
        for (Block& b : blocks_) {
            double* left = left_.data();
            std::fill(left, left + b.n * count, 0.0);
            for (const Link& link : b.given) left[link.row * count + link.other] -= values_[link.entry];
            for (const Link& link : b.known) {
                const double entry = values_[link.entry];
                for (int c = 0; c < count; ++c) left[link.row * count + c] -= entry * U[link.other * count + c];
            }
            if (b.n == 1) {
                for (int c = 0; c < count; ++c) left[c] *= b.inverse;
            } else if (b.n == 2) {
                for (int c = 0; c < count; ++c) solve_two(b, left[c], left[count + c]);
            } else {
                b.lu.solve(left, count);
            }
            for (int i = 0; i < b.n; ++i) std::copy(left + i * count, left + (i + 1) * count, U + b.columns[i] * count);
        }
    }

    // det and rcond of each block after `factor`; returns the smallest rcond, 1 at most. Where that of a large
    // block is surely above `enough`, by how little K_d has changed since it was found, a lower bound stands
    // for it: ‖K⁻¹‖ ≤ 1/(1/‖K₀⁻¹‖ − ‖K − K₀‖).
    double measure(double enough, double* det, double* rcond) {
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
                value = (b.least - b.change) / b.lu.norm() / b.reference;
                if (!(value >= enough)) value = found(b) / b.reference;
                value = std::min(value, 1.0);
            }
            rcond[b.number] = value;
            if (!(value >= worst)) worst = value;
        }
        return worst;
    }

  private:
    struct Link {
        int row, other, entry;  // local row; velocity, or which of the part's inputs; value
    };
    struct Block {
        int n = 0, number = 0;
        std::vector<int> rows, columns;
        int at[4] = {};                    // entries of a small block
        std::vector<Link> known, given;
        std::vector<Link> filled;          // entries of a large block: local row and column, value
        double parity = 1.0;               // of the order of its rows and columns
        double e[4] = {}, det = 0.0, inverse = 0.0, reference = 1.0;
        Lu lu;
        Cells<double> last;         // where rcond was found last
        double least = 0.0, change = 0.0;  // 1/‖K⁻¹‖₁ there, and ‖K − K₀‖₁ since then
    };

    // Rows and columns of a block loop by loop, columns that several loops share at the end: elimination then
    // condenses each loop onto these, and leaves zero what is between others. Returns the order's parity.
    static double in_order(const Description& d, const Closures& closures, Block& b, std::vector<int>& place_of_v) {
        const auto loop_of = [&](int row) { return d.row_closure[row] < 0 ? d.closures + row : d.row_closure[row]; };
        std::vector<int> owner(d.nv, -1);
        const int shared = d.closures + d.rows;
        for (const Entry& entry : closures.entries) {
            const int loop = loop_of(entry.row);
            if (std::find(b.rows.begin(), b.rows.end(), entry.row) == b.rows.end()) continue;
            owner[entry.v] = owner[entry.v] < 0 || owner[entry.v] == loop ? loop : shared;
        }
        double parity = sorted(b.rows, [&](int row) { return loop_of(row); });
        parity *= sorted(b.columns, [&](int v) { return owner[v]; });
        for (int i = 0; i < b.n; ++i) place_of_v[b.columns[i]] = i;
        return parity;
    }

    // Sorts by a key and keeps what is equal in its order; −1 for an odd number of exchanges.
    template <typename Key>
    static double sorted(std::vector<int>& items, Key key) {
        double parity = 1.0;
        for (std::size_t i = 1; i < items.size(); ++i)
            for (std::size_t j = i; j > 0 && key(items[j]) < key(items[j - 1]); --j) {
                std::swap(items[j], items[j - 1]);
                parity = -parity;
            }
        return parity;
    }

    // A large block's entries, and how far they are from those with which rcond was found.
    void load(Block& b) {
        double *a = b.lu.matrix(), *sums = left_.data();
        const int n = b.n;
        std::fill(a, a + n * n, 0.0);
        std::fill(sums, sums + n, 0.0);
        const double* last = b.last.data();
        for (const Link& link : b.filled) {
            const double value = values_[link.entry];
            a[link.row * n + link.other] = value;
            sums[link.other] += std::fabs(value - *last++);
        }
        b.change = *std::max_element(sums, sums + n);
    }

    double found(Block& b) {
        for (std::size_t i = 0; i < b.last.size(); ++i) b.last[i] = values_[b.filled[i].entry];
        b.least = b.lu.least_stretch();
        b.change = 0.0;
        return b.least > 0.0 ? b.least / b.lu.norm() : 0.0;
    }

    static void solve_two(const Block& b, double& x, double& y) {
        const double first = (b.e[3] * x - b.e[1] * y) * b.inverse;
        y = (b.e[0] * y - b.e[2] * x) * b.inverse;
        x = first;
    }

    double substitute(Block& b, double* u) {
        for (const Link& link : b.known) left_[link.row] -= values_[link.entry] * u[link.other];
        if (b.n == 1) {
            u[b.columns[0]] = left_[0] * b.inverse;
        } else if (b.n == 2) {
            solve_two(b, left_[0], left_[1]);
            u[b.columns[0]] = left_[0];
            u[b.columns[1]] = left_[1];
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
    int widest_ = 1, inputs_ = 0;
};

}  // namespace rg
