// The triangular factor of Gᵀ M G entry by entry, for many right sides: the parts' squares of the sweep, and between
// them what a part asks of the inputs that carry it, where one right side goes round by wrenches and twists.
#pragma once

#include <cstddef>
#include <vector>

#include "cells.h"
#include "groups.h"
#include "inertias.h"
#include "parts.h"

namespace rg {

// What the sweep has after its elimination: L with inverse pivots of each part and where they begin, ways of all
// bodies, and by input in a row L⁻¹ of what the inputs ask of the body that carries them.
struct Swept {
    const double* factors;
    const std::size_t* factors_at;
    const Twist* ways;
    const Wrench* push;
};

class TreeFactor {
  public:
    TreeFactor() = default;

    // `ways_at`: where the ways of a body begin, one for each input of its part; m inputs.
    TreeFactor(const std::vector<Part>& parts, const std::vector<std::size_t>& ways_at, std::size_t m)
        : above_(m), below_(m) {
        std::size_t entries = 0;
        for (const Part& part : parts)
            for (int a : part.inputs)
                for (int root = part.root, c = part.carrier; c >= 0; root = parts[c].root, c = parts[c].carrier)
                    for (std::size_t b = 0; b < parts[c].inputs.size(); ++b, ++entries) {
                        above_[a].push_back({parts[c].inputs[b], entries, ways_at[root] + b});
                        below_[parts[c].inputs[b]].push_back({a, entries, 0});
                    }
        asked_.resize(entries), sources_.reserve(m);
    }

    // How many there are between inputs and those that carry them.
    std::size_t entries() const { return asked_.size(); }

    // (Gᵀ M G)⁻¹ of rows (m, width) in y.
    void solve(const std::vector<Part>& parts, const Swept& swept, double* rows, std::size_t width) {
        rows_ = rows, width_ = width;
        for (std::size_t i = parts.size(); i-- > 0;) {
            const Part& part = parts[i];
            const int count = part.count();
            const double* L = swept.factors + swept.factors_at[i];
            for (int a = 0; a < count; ++a) {
                const int own = part.inputs[a];
                for (const Entry& below : below_[own]) source(asked_[below.at], below.input);
                for (int b = 0; b < a; ++b) source(L[a * count + b], part.inputs[b]);
                combine(own, L[a * count + a]);
                for (const Entry& above : above_[own])
                    asked_[above.at] = dot(swept.ways[above.way], swept.push[part.first + a]);
            }
        }
        for (std::size_t i = 0; i < parts.size(); ++i) {
            const Part& part = parts[i];
            const int count = part.count();
            const double* L = swept.factors + swept.factors_at[i];
            for (int a = count; a-- > 0;) {
                const int own = part.inputs[a];
                for (const Entry& above : above_[own]) source(asked_[above.at], above.input);
                for (int b = a + 1; b < count; ++b) source(L[b * count + a], part.inputs[b]);
                combine(own, L[a * count + a]);
            }
        }
    }

  private:
    // Between two inputs: the other one, where `asked_` has it, and the other one's way where it carries this one.
    struct Entry {
        int input;
        std::size_t at, way;
    };
    struct Source {
        double share;
        const double* row;
    };

    double* row(int input) { return rows_ + static_cast<std::size_t>(input) * width_; }

    void source(double share, int input) {
        if (share != 0.0) sources_.push_back({share, row(input)});
    }

    // A row less shares of the sources, times its inverse pivot; eight columns at a time, which registers hold.
    void combine(int input, double inverse) {
        typedef double Pair __attribute__((vector_size(16), aligned(8), may_alias));
        double* own = row(input);
        std::size_t c = 0;
        for (; c + 8 <= width_; c += 8) {
            Pair* to = reinterpret_cast<Pair*>(own + c);
            Pair first = to[0], second = to[1], third = to[2], fourth = to[3];
            for (const Source& from : sources_) {
                const Pair* x = reinterpret_cast<const Pair*>(from.row + c);
                first -= from.share * x[0], second -= from.share * x[1];
                third -= from.share * x[2], fourth -= from.share * x[3];
            }
            to[0] = inverse * first, to[1] = inverse * second, to[2] = inverse * third, to[3] = inverse * fourth;
        }
        for (; c < width_; ++c) {
            for (const Source& from : sources_) own[c] -= from.share * from.row[c];
            own[c] *= inverse;
        }
        sources_.clear();
    }

    std::vector<std::vector<Entry>> above_, below_;  // of each input: those that carry it, and that it carries
    Cells<double> asked_;
    std::vector<Source> sources_;
    double* rows_ = nullptr;
    std::size_t width_ = 0;
};

}  // namespace rg
