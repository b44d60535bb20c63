// One part's Gᵀ M G by the inertia of its joints: M by composite bodies (Featherstone, Rigid Body Dynamics Algorithms,
// 2008, chapter 6), an entry for each velocity and those of its own part that carry it, then the congruence with G.
#pragma once

#include <algorithm>
#include <vector>

#include "linalg/cells.h"
#include "tree/chain.h"
#include "tree/groups.h"
#include "tree/inertias.h"
#include "tree/parts.h"
#include "linalg/rows.h"

namespace rg {

class PartSquare {
  public:
    // `independent`: the velocity of each input.
    PartSquare(const Chain& chain, const Part& part, const std::vector<int>& independent)
        : inputs_(part.inputs), width_(inputs_.size() + (part.root > 0 ? 7 : 1)),
          rows_(inputs_.size() * width_), begin_{0}, shares_(part.velocities.size()) {
        const std::size_t count = part.velocities.size();
        std::vector<int> place(chain.freedoms.size(), -1), owner(count, -1);
        for (std::size_t i = 0; i < count; ++i) place[part.velocities[i]] = static_cast<int>(i);
        for (std::size_t a = 0; a < inputs_.size(); ++a) owner[place[independent[inputs_[a]]]] = static_cast<int>(a);
        std::vector<int> given(count, -1);  // the number of each dependent velocity
        for (std::size_t i = 0; i < count; ++i)
            if (owner[i] < 0) {
                given[i] = static_cast<int>(dependent_.size());
                dependent_.push_back(part.velocities[i]);
            }
        G_.resize(dependent_.size() * inputs_.size()), products_.resize(dependent_.size() * width_);
        for (std::size_t i = 0; i < count; ++i)
            own_.push_back(owner[i] < 0 ? &products_[given[i] * width_] : &rows_[owner[i] * width_]);
        std::vector<std::vector<Related>> of_inputs(count), of_dependent(count);
        const auto relate = [&](int i, int other, int entry) {
            if (owner[other] < 0)
                of_dependent[i].push_back({entry, given[other]});
            else
                of_inputs[i].push_back({entry, owner[other]});
        };
        for (const int j : part.joints) {
            const Body& b = chain.bodies[j];
            for (int v = b.first; v < b.first + b.count; ++v) {
                const int i = place[v];
                above_.push_back(i);
                for (int before = b.first; before < v; ++before) above_.push_back(place[before]);
                for (int p = b.parent; p != part.root; p = chain.bodies[p].parent) {
                    const int first = place[chain.bodies[p].first];
                    for (int u = 0; u < chain.bodies[p].count; ++u) above_.push_back(first + u);
                }
                for (int e = begin_.back(); e < static_cast<int>(above_.size()); ++e) {
                    relate(i, above_[e], e);
                    if (above_[e] != i) relate(above_[e], i, e);
                }
                begin_.push_back(static_cast<int>(above_.size()));
            }
        }
        entries_.resize(above_.size());
        for (std::size_t i = 0; i < count; ++i) {
            related_.insert(related_.end(), of_inputs[i].begin(), of_inputs[i].end());
            ends_.push_back({related_.size(), 0});
            related_.insert(related_.end(), of_dependent[i].begin(), of_dependent[i].end());
            ends_.back().all = related_.size();
        }
    }

    // What the velocity at place i of the part needs at one, by what moves with it: the wrench, and the rotor's own
    // inertia; and the generalised force that it takes as it moves now. S: of the part's velocities.
    void put(int i, const Wrench& needed, double rotor, double force, const Twist* S) {
        for (int e = begin_[i]; e < begin_[i + 1]; ++e) entries_[e] = dot(S[above_[e]], needed);
        entries_[begin_[i]] += rotor;
        double* more = own_[i] + inputs_.size();
        *more = -force;
        for (int k = 0; k < 3 && width_ > inputs_.size() + 1; ++k)
            more[1 + k] = needed.force[k], more[4 + k] = needed.moment[k];
    }

    // By input, in rows (inputs, width): Gᵀ M G from the diagonal on, −Gᵀ of the forces, and, where a body carries
    // the part, the wrench that the input at one needs.
    double* reduce(const double* G, std::size_t m) {
        const std::size_t count = inputs_.size();
        for (std::size_t i = 0; i < dependent_.size(); ++i)
            for (std::size_t a = 0; a < count; ++a) G_[i * count + a] = G[dependent_[i] * m + inputs_[a]];
        const Related* r = related_.data();
        for (std::size_t i = 0; i < own_.size(); ++i) {
            std::fill(own_[i], own_[i] + count, 0.0);
            const Related *inputs = related_.data() + ends_[i].inputs, *all = related_.data() + ends_[i].all;
            for (; r != inputs; ++r) own_[i][r->other] = entries_[r->entry];
            for (; r != all; ++r) shares_.add(entries_[r->entry], &G_[r->other * count]);
            shares_.into(own_[i], 0, count);
            shares_.clear();
        }
        for (std::size_t a = 0; a < count; ++a) {
            for (std::size_t i = 0; i < dependent_.size(); ++i)
                shares_.add(G_[i * count + a], &products_[i * width_]);
            shares_.into(&rows_[a * width_], a, width_);
            shares_.clear();
        }
        return rows_.data();
    }

    std::size_t width() const { return width_; }

  private:
    struct Related {
        int entry, other;  // of M; the number of an input, or of a dependent velocity
    };
    struct Ends {
        std::size_t inputs, all;
    };

    const std::vector<int> inputs_;
    const std::size_t width_;
    Cells<double> rows_;
    std::vector<int> dependent_;  // velocities
    std::vector<double*> own_;    // by place: where M G and what follows it is, for an input in its row
    std::vector<int> above_, begin_;  // of each velocity: itself and those that carry it, by place
    std::vector<Related> related_;  // by place: velocities that move with one, or move it; inputs first
    std::vector<Ends> ends_;
    Cells<double> entries_;        // of M, beside `above_`
    Cells<double> G_, products_;  // by dependent velocity
    Shares shares_;
};

}  // namespace rg
