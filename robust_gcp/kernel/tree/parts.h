// The tree taken apart: loop clusters, each carried by one body, and joints in no loop, one by one.
#pragma once

#include <algorithm>
#include <stdexcept>
#include <vector>

#include "abi.h"
#include "tree/chain.h"

namespace rg {

// Joints whose velocities follow from inputs of their own: v = G u there, whatever the other joints do.
struct Part {
    std::vector<int> joints;      // parents first
    std::vector<int> velocities;  // of these joints, in v
    std::vector<int> inputs;      // in y
    std::vector<int> closures, couplings;
    int root = 0;                 // the body that carries them all
    int first = 0;                // where its inputs begin when those of all parts are put in a row
    int carrier = -1;             // the part of the root, −1 for the ground
    bool on_group = false;        // an untied joint whose velocities are inputs and no rates of numbers in q
    bool charted = false;         // tied, and some of its inputs are such velocities: see charts.h

    bool tied() const { return !closures.empty() || !couplings.empty(); }
    // A joint in no loop, with one velocity.
    bool single() const { return velocities.size() == 1 && inputs.size() == 1; }
    int count() const { return static_cast<int>(inputs.size()); }
};

// All joints and closures, as one.
inline Part all_of(const Description& d, const Chain& chain) {
    Part part;
    part.joints = chain.all;
    for (int i = 0; i < d.closures; ++i) part.closures.push_back(i);
    for (int i = 0; i < d.couplings; ++i) part.couplings.push_back(i);
    return part;
}

// Parts, carriers first. Joints of a closure lie on its two paths below their lowest common ancestor; parts
// that share a joint are one, and so are those between which couplings would leave a part with two roots.
class Parts {
  public:
    std::vector<Part> list;
    std::vector<int> of_joint, of_velocity;
    std::vector<int> all_velocities;

    Parts(const Description& d, const Chain& chain) : chain_(chain), owner_(chain.bodies.size()) {
        const int n = static_cast<int>(owner_.size());
        for (int j = 0; j < n; ++j) owner_[j] = j;
        std::vector<int> joint_of_v(d.nv), closure_at(d.closures), coupling_at(d.couplings, 0);
        for (int j = 1; j < n; ++j)
            for (int i = 0; i < chain.bodies[j].count; ++i) joint_of_v[chain.bodies[j].first + i] = j;
        for (int c = 0; c < d.closures; ++c)
            closure_at[c] = join_path(d.closure_joint[2 * c], d.closure_joint[2 * c + 1]);
        for (int c = 0; c < d.couplings; ++c) {
            coupling_at[c] = joint_of_v[d.coupling_at[5 * c + 2]];
            join(coupling_at[c], joint_of_v[d.coupling_at[5 * c + 4]]);
        }
        for (int f = 0; f < d.coupling_further; ++f)
            join(coupling_at[d.further_at[3 * f]], joint_of_v[d.further_at[3 * f + 2]]);
        while (join_roots()) {}
        of_joint.assign(n, -1);
        of_velocity.assign(d.nv, -1);
        for (int i = 0; i < d.nv; ++i) all_velocities.push_back(i);
        for (int j = 1; j < n; ++j) {
            const Body& b = chain.bodies[j];
            int& part = of_joint[j] = of_joint[find(j)];
            if (part < 0) {
                part = of_joint[find(j)] = static_cast<int>(list.size());
                list.push_back({});
                list.back().root = b.parent;
                list.back().carrier = of_joint[b.parent];
            }
            list[part].joints.push_back(j);
            for (int i = b.first; i < b.first + b.count; ++i) {
                list[part].velocities.push_back(i);
                of_velocity[i] = part;
            }
        }
        for (int c = 0; c < d.closures; ++c)
            if (closure_at[c] > 0) list[of_joint[closure_at[c]]].closures.push_back(c);
        for (int c = 0; c < d.couplings; ++c) list[of_joint[coupling_at[c]]].couplings.push_back(c);
        for (int k = 0; k < d.m; ++k) {
            Part& part = list[of_velocity[d.independent[k]]];
            part.inputs.push_back(k);
            if (d.independent_q[k] < 0) part.on_group = true;
        }
        int first = 0;
        for (Part& part : list) {
            part.first = first;
            first += part.count();
            if (!part.on_group || !part.tied()) continue;
            part.on_group = false;
            part.charted = true;
        }
    }

  private:
    int find(int j) {
        while (owner_[j] != j) j = owner_[j] = owner_[owner_[j]];
        return j;
    }

    // The lowest joint of a set stands for it, which also carries it.
    void join(int a, int b) {
        a = find(a);
        b = find(b);
        owner_[std::max(a, b)] = std::min(a, b);
    }

    // All joints between two bodies; returns one of them, 0 where there is none.
    int join_path(int a, int b) {
        int any = 0;
        while (a != b) {
            int& higher = a > b ? a : b;
            if (any > 0) join(any, higher);
            any = higher;
            higher = chain_.bodies[higher].parent;
        }
        return any;
    }

    // Joins what lies between the roots of a set that has several; false where no set has.
    bool join_roots() {
        std::vector<int> root(owner_.size(), -1);
        for (int j = 1; j < static_cast<int>(owner_.size()); ++j) {
            const int set = find(j), parent = chain_.bodies[j].parent;
            if (parent > 0 && find(parent) == set) continue;
            if (root[set] < 0) {
                root[set] = parent;
            } else if (root[set] != parent) {
                join(set, join_path(root[set], parent));
                return true;
            }
        }
        return false;
    }

    const Chain& chain_;
    std::vector<int> owner_;
};

}  // namespace rg
