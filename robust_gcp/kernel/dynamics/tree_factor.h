// The triangular factor of Gᵀ M G entry by entry, for many right sides: the parts' squares of the sweep, and between
// them what a part asks of the inputs that carry it, where one right side goes round by wrenches and twists.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "linalg/cells.h"
#include "tree/groups.h"
#include "tree/inertias.h"
#include "tree/parts.h"
#include "linalg/rows.h"

namespace rg {

// What the sweep has after its elimination: U = Lᵀ with inverse pivots of each part and where they begin, X of bodies
// that carry parts, and by input in a row L⁻¹ of what the inputs ask of the body that carries them.
struct Swept {
    const double* factors;
    const std::size_t* factors_at;
    const Twist* ways;
    const Wrench* push;
};

// Right sides in three blocks of m columns: two with a row's entries in columns of the inputs that carry it or that it
// carries, `coupled` in any; and ones, for the inverse itself. What is zero by that is passed over, and of the inverse,
// which is symmetric, one half is found.
class TreeFactor {
  public:
    TreeFactor() = default;

    // `ways_at`: where the ways of a body begin, one for each input of its part; m inputs.
    TreeFactor(const std::vector<Part>& parts, const std::vector<std::size_t>& ways_at, std::size_t m, bool coupled)
        : above_(m), below_(m), out_(m), back_(m), tree_(parts.size()), m_(m) {
        std::size_t entries = 0;
        for (const Part& part : parts)
            for (int a : part.inputs)
                for (int root = part.root, c = part.carrier; c >= 0; root = parts[c].root, c = parts[c].carrier)
                    for (std::size_t b = 0; b < parts[c].inputs.size(); ++b, ++entries) {
                        above_[a].push_back({parts[c].inputs[b], entries, ways_at[root] + b});
                        below_[parts[c].inputs[b]].push_back({a, entries, 0});
                    }
        asked_.resize(entries), sources_ = Shares(m);
        for (std::size_t i = 0; i < parts.size(); ++i)
            tree_[i] = parts[i].carrier < 0 ? i : tree_[static_cast<std::size_t>(parts[i].carrier)];
        for (std::size_t i = 0; i < parts.size(); ++i)
            for (std::size_t a = 0; a < parts[i].inputs.size(); ++a) {
                order_.push_back(parts[i].inputs[a]);
                plan(parts, i, a, coupled);
            }
        // the order of the back substitution: parts first to last, the inputs of each last to first
        auto at = order_.begin();
        for (const Part& part : parts) {
            std::reverse(at, at + part.count());
            at += part.count();
        }
    }

    // How many there are between inputs and those that carry them.
    std::size_t entries() const { return asked_.size(); }

    // (Gᵀ M G)⁻¹ of rows (m, 3m) that are `width` apart, in y.
    void solve(const std::vector<Part>& parts, const Swept& swept, double* rows, std::size_t width) {
        rows_ = rows, width_ = width;
        for (std::size_t i = parts.size(); i-- > 0;) {
            const Part& part = parts[i];
            const int count = part.count();
            const double* U = swept.factors + swept.factors_at[i];
            for (int a = 0; a < count; ++a) {
                const int own = part.inputs[a];
                for (const Entry& below : below_[own]) source(asked_[below.at], below.input);
                for (int b = 0; b < a; ++b) source(U[b * count + a], part.inputs[b]);
                combine(own, U[a * count + a], out_[own]);
                for (const Entry& above : above_[own])
                    asked_[above.at] = dot(swept.ways[above.way], swept.push[part.first + a]);
            }
        }
        for (std::size_t i = 0; i < parts.size(); ++i) {
            const Part& part = parts[i];
            const int count = part.count();
            const double* U = swept.factors + swept.factors_at[i];
            for (int a = count; a-- > 0;) {
                const int own = part.inputs[a];
                for (const Entry& above : above_[own]) source(asked_[above.at], above.input);
                for (int b = a + 1; b < count; ++b) source(U[a * count + b], part.inputs[b]);
                combine(own, U[a * count + a], back_[own]);
            }
        }
        for (std::size_t i = 0; i < m_; ++i)
            for (std::size_t j = 0; j < i; ++j) row(order_[i])[2 * m_ + order_[j]] = row(order_[j])[2 * m_ + order_[i]];
    }

  private:
    // Between two inputs: the other one, where `asked_` has it, and the other one's way where it carries this one.
    struct Entry {
        int input;
        std::size_t at, way;
    };
    struct Run {
        std::size_t begin, end;
    };

    // Where the row of an input of a part has entries, after each of the passes.
    void plan(const std::vector<Part>& parts, std::size_t part, std::size_t local, bool coupled) {
        const auto carries = [&](std::size_t c, std::size_t other) {
            for (int i = static_cast<int>(other); i >= 0; i = parts[i].carrier)
                if (i == static_cast<int>(c)) return true;
            return false;
        };
        std::vector<char> out(3 * m_, 0), back(3 * m_, 0);
        for (std::size_t other = 0; other < parts.size(); ++other)
            for (std::size_t b = 0; b < parts[other].inputs.size(); ++b) {
                const auto k = static_cast<std::size_t>(parts[other].inputs[b]);
                const bool up = carries(part, other), own = other == part;
                out[k] = out[m_ + k] = coupled || up || carries(other, part);
                back[k] = back[m_ + k] = coupled || tree_[other] == tree_[part];
                out[2 * m_ + k] = own ? b <= local : up;
                back[2 * m_ + k] = tree_[other] == tree_[part] && (own ? b <= local : other > part);
            }
        const int input = parts[part].inputs[local];
        out_[input] = runs(out);
        back_[input] = runs(back);
    }

    // Columns that are asked for, with what fills up the registers.
    static std::vector<Run> runs(const std::vector<char>& asked) {
        std::vector<Run> all;
        for (std::size_t c = 0; c < asked.size(); ++c) {
            if (!asked[c]) continue;
            const std::size_t end = std::min(c + WIDE, asked.size());
            if (!all.empty() && all.back().end == c)
                all.back().end = end;
            else
                all.push_back({c, end});
            c = end - 1;
        }
        return all;
    }

    double* row(int input) { return rows_ + static_cast<std::size_t>(input) * width_; }

    void source(double share, int input) { sources_.add(-share, row(input)); }

    // A row less shares of the sources, times its inverse pivot.
    void combine(int input, double inverse, const std::vector<Run>& runs) {
        for (const Run& run : runs) sources_.into(row(input), run.begin, run.end, inverse);
        sources_.clear();
    }

    std::vector<std::vector<Entry>> above_, below_;  // of each input: those that carry it, and that it carries
    std::vector<std::vector<Run>> out_, back_;  // of each input: what the passes find of its row
    std::vector<std::size_t> tree_;  // of each part: the part on the ground that carries it
    std::vector<int> order_;         // of inputs in the back substitution
    Cells<double> asked_;
    Shares sources_;  // of the row at hand
    double* rows_ = nullptr;
    std::size_t m_ = 0, width_ = 0;
};

}  // namespace rg
