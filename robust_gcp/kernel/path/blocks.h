// K_d block by block: factorisation, substitution, and the sign and conditioning of each block.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "constraint/closures.h"
#include "linalg/lu.h"
#include "tree/parts.h"
#include "linalg/small.h"

namespace rg {

class Blocks {
  public:
    // Those of one part; det and rcond are told by their numbers in the description.
    Blocks(const Description& d, Closures& closures, const Parts& parts, int part)
        : values_(closures.values), inputs_(parts.list[part].count()) {
        std::vector<int> block_of_v(d.nv, -1), place_of_v(d.nv, -1);
        for (int b = 0; b < d.blocks; ++b)
            for (int i = d.block_start[b]; i < d.block_start[b + 1]; ++i) {
                block_of_v[d.block_columns[i]] = b;
                place_of_v[d.block_columns[i]] = i - d.block_start[b];
            }
        const std::vector<int>& inputs = parts.list[part].inputs;
        for (int i = 0; i < inputs_; ++i) place_of_v[d.independent[inputs[i]]] = i;
        for (int b = 0; b < d.blocks; ++b) {
            if (parts.of_velocity[d.block_columns[d.block_start[b]]] != part) continue;
            Block block;
            block.number = b;
            block.n = d.block_start[b + 1] - d.block_start[b];
            block.rows.assign(d.block_rows + d.block_start[b], d.block_rows + d.block_start[b + 1]);
            block.columns.assign(d.block_columns + d.block_start[b], d.block_columns + d.block_start[b + 1]);
            block.reference = d.reference[b];
            if (block.n > SMALL) block.parity = in_order(d, closures, block, place_of_v);
            std::vector<int> place_of_row(d.rows, -1);
            for (int i = 0; i < block.n; ++i) place_of_row[block.rows[i]] = i;
            const int entries = static_cast<int>(closures.entries.size());
            for (int e = 0; e < entries; ++e) {
                const Entry& entry = closures.entries[e];
                const int row = place_of_row[entry.row];
                if (row < 0) continue;
                const int owner = block_of_v[entry.v], place = place_of_v[entry.v];
                if (owner == b)
                    block.filled.push_back({row, place, e});
                else if (owner < 0)
                    block.given.push_back({row, place, e});
                else if (owner < b)
                    block.known.push_back({row, entry.v, e});
                // entries above the diagonal blocks are structurally zero
            }
            if (block.n > SMALL) {
                std::vector<std::pair<int, int>> places;
                for (const Link& link : block.filled) places.push_back({link.row, link.other});
                block.lu = Lu(block.n, places);
                block.last.resize(block.filled.size());
            } else {
                block.small.n = block.n;
                std::fill(block.at, block.at + SMALL * SMALL, entries);
                for (const Link& link : block.filled) block.at[block.n * link.row + link.other] = link.entry;
            }
            widest_ = std::max(widest_, block.n);
            blocks_.push_back(block);
        }
        left_.resize(widest_);
        sizes_.resize(widest_);
        changes_.resize(widest_);
    }

    bool factorised = false;  // some K_d, which is regular

    // Factorise K_d; false where a block is exactly singular or not finite.
    bool factor() {
        bool good = true;
        for (Block& b : blocks_) {
            if (b.n > SMALL) {
                double* a = b.lu.matrix();
                std::fill(a, a + b.n * b.n, 0.0);
                for (const Link& link : b.filled) a[link.other * b.n + link.row] = values_[link.entry];
                b.lu.factor();
                b.det = b.parity * b.lu.det;
                good = good && b.lu.regular && std::isfinite(b.det);
                continue;
            }
            for (int i = 0; i < b.n * b.n; ++i) b.small.e[i] = values_[b.at[i]];
            good = b.small.factor() && good;
            b.det = b.small.det;
        }
        return factorised = good;
    }

    // u = K_d⁻¹ rhs by velocity (nv), rhs by row; returns max |u|.
    double solve(const double* rhs, double* u) {
        double size = 0.0;
        for (Block& b : blocks_) {
            for (int i = 0; i < b.n; ++i) left_[i] = rhs[b.rows[i]];
            substitute(b, u);
            for (int column : b.columns) size = std::max(size, std::fabs(u[column]));
        }
        return size;
    }

    // The same of several right sides, one after the other (count, rows), side by side in u (nv, count).
    void solve(const double* rhs, std::size_t rows, double* u, int count) {
        for (Block& b : blocks_) {
            many_.resize(static_cast<std::size_t>(b.n * count));
            double* x = many_.data();
            for (int i = 0; i < b.n; ++i)
                for (int c = 0; c < count; ++c) x[i * count + c] = rhs[static_cast<std::size_t>(c) * rows + b.rows[i]];
            substitute(b, x, u, count);
        }
    }

    // λ = K_d⁻ᵀ rhs by row, rhs by velocity, which is overwritten.
    void solve_transposed(double* rhs, double* lambda) {
        for (std::size_t at = blocks_.size(); at-- > 0;) {
            Block& b = blocks_[at];
            for (int i = 0; i < b.n; ++i) left_[i] = rhs[b.columns[i]];
            if (b.n > SMALL)
                b.lu.solve_transposed(left_.data());
            else
                b.small.solve_transposed(left_.data());
            for (int i = 0; i < b.n; ++i) lambda[b.rows[i]] = left_[i];
            for (const Link& link : b.known) rhs[link.other] -= values_[link.entry] * left_[link.row];
        }
    }

    // −K_d⁻¹ K_i, by velocity and input of the part (nv, inputs).
    void solve_given(double* u) {
        for (Block& b : blocks_) {
            many_.assign(static_cast<std::size_t>(b.n * inputs_), 0.0);
            for (const Link& link : b.given) many_[link.row * inputs_ + link.other] -= values_[link.entry];
            substitute(b, many_.data(), u, inputs_);
        }
    }

    // det and rcond of each block after `factor`; returns the smallest rcond, 1 at most. Where that of a large
    // block is above `enough` by how little K_d has changed since it was found, a lower bound stands for it:
    // 1/‖K⁻¹‖ ≥ 1/‖K₀⁻¹‖ − ‖K − K₀‖.
    double measure(double enough, double* det, double* rcond) {
        double worst = 1.0;
        for (Block& b : blocks_) {
            det[b.number] = b.det;
            const double value = b.n > SMALL ? stretch(b, enough) : b.small.rcond(b.reference);
            rcond[b.number] = value;
            if (!(value >= worst)) worst = value;
        }
        return worst;
    }

  private:
    struct Link {
        int row, other, entry;  // local row; velocity, column of the block or input of the part; value
    };
    struct Block {
        int n = 0, number = 0;
        std::vector<int> rows, columns;
        std::vector<Link> filled, known, given;
        double det = 0.0, reference = 1.0;
        int at[SMALL * SMALL] = {};  // entries of a small block, row by row
        Small small;                 // that block
        double parity = 1.0;  // of the order of its rows and columns
        Lu lu;
        Cells<double> last;   // entries with which 1/‖K⁻¹‖₁ was found, and that
        double least = 0.0;
    };

    // Rows and columns of a block loop by loop, columns that several loops share at the end: elimination then
    // condenses each loop onto these, and leaves zero what is between others. Returns the order's parity.
    static double in_order(const Description& d, const Closures& closures, Block& b, std::vector<int>& place_of_v) {
        const auto loop_of = [&](int row) { return d.row_closure[row] < 0 ? d.closures + row : d.row_closure[row]; };
        std::vector<int> owner(d.nv, -1);
        const int shared = d.closures + d.rows;
        for (const Entry& entry : closures.entries) {
            if (std::find(b.rows.begin(), b.rows.end(), entry.row) == b.rows.end()) continue;
            const int loop = loop_of(entry.row);
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

    // 1/(‖K‖₁ ‖K⁻¹‖₁) of a large block, against that at the start.
    double stretch(Block& b, double enough) {
        if (!b.lu.regular || !std::isfinite(b.det)) return 0.0;
        std::fill(sizes_.begin(), sizes_.begin() + b.n, 0.0);
        std::fill(changes_.begin(), changes_.begin() + b.n, 0.0);
        const double* last = b.last.data();
        for (const Link& link : b.filled) {
            const double value = values_[link.entry];
            sizes_[link.other] += std::fabs(value);
            changes_[link.other] += std::fabs(value - *last++);
        }
        const double unit = b.reference * *std::max_element(sizes_.begin(), sizes_.begin() + b.n);
        const double change = *std::max_element(changes_.begin(), changes_.begin() + b.n);
        if (b.least - change >= enough * unit) return std::min((b.least - change) / unit, 1.0);
        for (std::size_t i = 0; i < b.last.size(); ++i) b.last[i] = values_[b.filled[i].entry];
        b.least = b.lu.least_stretch();
        return unit > 0.0 ? std::min(b.least / unit, 1.0) : 0.0;
    }

    void substitute(Block& b, double* x, double* u, int count) {
        for (const Link& link : b.known)
            for (int c = 0; c < count; ++c) x[link.row * count + c] -= values_[link.entry] * u[link.other * count + c];
        if (b.n > SMALL) b.lu.solve(x, count);
        for (int c = 0; b.n <= SMALL && c < count; ++c) {
            double own[SMALL];
            for (int i = 0; i < b.n; ++i) own[i] = x[i * count + c];
            b.small.solve(own);
            for (int i = 0; i < b.n; ++i) x[i * count + c] = own[i];
        }
        for (int i = 0; i < b.n; ++i) std::copy(x + i * count, x + (i + 1) * count, u + b.columns[i] * count);
    }

    void substitute(Block& b, double* u) {
        for (const Link& link : b.known) left_[link.row] -= values_[link.entry] * u[link.other];
        if (b.n > SMALL)
            b.lu.solve(left_.data());
        else
            b.small.solve(left_.data());
        for (int i = 0; i < b.n; ++i) u[b.columns[i]] = left_[i];
    }

    Cells<double>& values_;
    std::vector<Block> blocks_;
    Cells<double> left_, sizes_, changes_, many_;
    int inputs_ = 0, widest_ = 1;
};

}  // namespace rg
