// Whether a mechanism that was read is one: all that is pointed to is there, and every index is in its range.
#pragma once

#include <cstdint>
#include <cstring>
#include <map>
#include <stdexcept>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include "abi.h"
#include "tree/joints.h"

namespace rg {

class Checked {
  public:
    explicit Checked(const std::map<const void*, std::uint64_t>& extents) : extents_(extents) {}

    void exported(const Exported& e) const {
        within("charts", e.charts, 1, MOST);
        within("controls", e.controls, 0, MOST);
        array("bridging", e.bridging, 1);
        within("nodes", e.bridging->count, 1, MOST);
        array("nodes", e.bridging->nodes, e.bridging->count);
        array("charts", e.chart, e.charts);
        array("ranges", e.ranges, 2 * e.controls);
        text("joints", e.joints);
        text("actuators", e.actuators);
        for (std::int32_t c = 0; c < e.charts; ++c) {
            array("chart", e.chart[c], 1);
            const ExportedChart& chart = *e.chart[c];
            array("description", chart.description, 1);
            const Description& d = *chart.description;
            whole(d, e.controls);
            const Description& first = *e.chart[0]->description;
            if (d.nq != first.nq || d.nv != first.nv || d.m != first.m) bad("charts");
            array("sizes", chart.sizes, d.nv);
            array("uneven", chart.uneven, d.m);
        }
    }

  private:
    static constexpr std::int32_t MOST = 1 << 20;

    [[noreturn]] static void bad(const char* what) {
        throw std::runtime_error(std::string("the file is damaged: ") + what + " are not what they should be");
    }
    static void within(const char* what, std::int64_t value, std::int64_t low, std::int64_t high) {
        if (value < low || value > high) bad(what);
    }
    template <typename T>
    void array(const char* what, const T* at, std::int64_t count) const {
        if (count == 0) return;
        const auto found = extents_.find(at);
        if (at == nullptr || found == extents_.end() || count < 0 ||
            found->second / sizeof(T) < static_cast<std::uint64_t>(count))
            bad(what);
    }
    void text(const char* what, const char* at) const {
        array(what, at, 1);
        if (std::memchr(at, 0, extents_.at(at)) == nullptr) bad(what);
    }
    void indices(const char* what, const std::int32_t* at, std::int64_t count, std::int64_t low, std::int64_t high) const {
        array(what, at, count);
        for (std::int64_t i = 0; i < count; ++i) within(what, at[i], low, high);
    }
    // The column `k` of rows that are `width` wide.
    void column(const char* what, const std::int32_t* at, std::int64_t rows, int width, int k, std::int64_t low,
                std::int64_t high) const {
        array(what, at, rows * width);
        for (std::int64_t i = 0; i < rows; ++i) within(what, at[width * i + k], low, high);
    }
    // Where each of `count` begins among `total`.
    void begins(const char* what, const std::int32_t* at, std::int64_t count, std::int64_t total) const {
        array(what, at, count + 1);
        if (at[0] != 0 || at[count] > total) bad(what);
        for (std::int64_t i = 0; i < count; ++i) within(what, at[i], 0, at[i + 1]);
    }

    // Whether each of `total` is named at most once, or exactly once.
    static void once(const char* what, std::initializer_list<std::pair<const std::int32_t*, std::int32_t>> lists,
                     std::int32_t total, bool all) {
        std::vector<int> times(static_cast<std::size_t>(total));
        for (const auto& list : lists)
            for (std::int32_t i = 0; i < list.second; ++i) ++times[static_cast<std::size_t>(list.first[i])];
        for (const int n : times)
            if (n > 1 || (all && n == 0)) bad(what);
    }
    // An independent velocity's number in q, −1 where it is the rate of none.
    static void number_of(const Description& d, std::int32_t k) {
        std::int32_t q = 0, v = 0;
        for (std::int32_t j = 0; j < d.joints; ++j) {
            const Numbers& n = NUMBERS[d.kind[j]];
            const std::int32_t within = d.independent[k] - v;
            if (within < n.v) {
                const bool number = d.independent_q[k] == q + within && n.q == n.v;
                if (!number && d.independent_q[k] != -1) bad("independent_q");
                if (!number && n.v == 1 && n.q == 1) bad("independent_q");
                return;
            }
            q += n.q, v += n.v;
        }
    }

    void whole(const Description& d, std::int32_t controls) const {
        loops(d);
        indices("independent_q", d.independent_q, d.m, -1, d.nq - 1);
        array("size", d.size, d.nv);
        array("turn", d.turn, d.nv);
        array("own", d.own, 1);
        array("armature", d.armature, d.nv);
        array("damping", d.damping, d.nv);
        array("drive", d.drive, d.nv);
        array("home", d.home, d.nq);
        within("blocks", d.blocks, 0, d.rows);
        array("block_start", d.block_start, d.blocks + 1);
        begins("block_start", d.block_start, d.blocks, d.rows);
        indices("block_rows", d.block_rows, d.block_start[d.blocks], 0, d.rows - 1);
        indices("block_columns", d.block_columns, d.block_start[d.blocks], 0, d.nv - 1);
        array("reference", d.reference, d.blocks);
        once("block_rows", {{d.block_rows, d.block_start[d.blocks]}}, d.rows, false);
        once("block_columns", {{d.independent, d.m}, {d.block_columns, d.block_start[d.blocks]}}, d.nv, true);
        for (std::int32_t k = 0; k < d.m; ++k) number_of(d, k);
        forces(d, controls);
        if (d.driven != 0 || d.works != 0) bad("prescribed joints");
        within("clusters", d.clusters, 0, d.rows);
        array("cluster", d.cluster, d.clusters);
        for (std::int32_t c = 0; c < d.clusters; ++c) {
            array("cluster", d.cluster[c], 1);
            const Cluster& cluster = *d.cluster[c];
            array("loops", cluster.loops, 1);
            const Description& own = *cluster.loops;
            loops(own);
            indices("iq", cluster.iq, own.nq, 0, d.nq - 1);
            indices("iv", cluster.iv, own.nv, 0, d.nv - 1);
            indices("inputs", cluster.inputs, own.m, 0, d.m - 1);
            once("iq", {{cluster.iq, own.nq}}, d.nq, false);
            once("iv", {{cluster.iv, own.nv}}, d.nv, false);
            once("inputs", {{cluster.inputs, own.m}}, d.m, false);
            once("independent", {{own.independent, own.m}}, own.nv, false);
            array("rotates", cluster.rotates, own.nv);
            array("periodic", cluster.periodic, own.nv);
            array("balance", cluster.balance, own.nv);
        }
    }

    // Joints and rows of φ.
    void loops(const Description& d) const {
        within("joints", d.joints, 1, MOST);
        within("rows", d.rows, 0, MOST);
        within("closures", d.closures, 0, MOST);
        within("couplings", d.couplings, 0, d.rows);
        within("coupling_width", d.coupling_width, 0, 64);
        within("coupling_further", d.coupling_further, 0, MOST);
        array("parent", d.parent, d.joints);
        for (std::int32_t j = 0; j < d.joints; ++j) within("parent", d.parent[j], 0, j);
        indices("kind", d.kind, d.joints, REVOLUTE, PLANAR);
        std::int64_t nq = 0, nv = 0;
        for (std::int32_t j = 0; j < d.joints; ++j) nq += NUMBERS[d.kind[j]].q, nv += NUMBERS[d.kind[j]].v;
        if (nq != d.nq || nv != d.nv) bad("numbers of joints");
        within("m", d.m, 1, d.nv);
        array("placement", d.placement, 12 * std::int64_t{d.joints});
        array("inertia", d.inertia, 10 * std::int64_t{d.joints});
        array("gravity", d.gravity, 3);
        array("ground", d.ground, 3);
        indices("independent", d.independent, d.m, 0, d.nv - 1);
        array("scale", d.scale, d.nv);
        indices("closure_joint", d.closure_joint, 2 * std::int64_t{d.closures}, 0, d.joints);
        array("closure_point", d.closure_point, 6 * std::int64_t{d.closures});
        indices("row_closure", d.row_closure, d.rows, -1, d.closures - 1);
        indices("row_axis", d.row_axis, d.rows, -2, 2);
        array("row_weight", d.row_weight, d.rows);
        array("row_terms", d.row_terms, d.rows + 1);
        begins("row_terms", d.row_terms, d.rows, MOST);
        array("terms", d.terms, 7 * std::int64_t{d.row_terms[d.rows]});
        for (std::int32_t r = 0; r < d.rows; ++r)
            if (d.row_axis[r] == -2 && d.row_terms[r + 1] == d.row_terms[r]) bad("terms");
        for (int k : {0, 1, 3, 2, 4}) {
            const std::int64_t high = k == 0 ? d.rows : k % 2 == 1 ? d.nq : d.nv;
            column("coupling_at", d.coupling_at, d.couplings, 5, k, 0, high - 1);
        }
        array("coupling_curve", d.coupling_curve, std::int64_t{d.couplings} * d.coupling_width);
        column("further_at", d.further_at, d.coupling_further, 3, 0, 0, std::int64_t{d.couplings} - 1);
        column("further_at", d.further_at, d.coupling_further, 3, 1, 0, d.nq - 1);
        column("further_at", d.further_at, d.coupling_further, 3, 2, 0, d.nv - 1);
        array("further_arm", d.further_arm, d.coupling_further);
    }

    void forces(const Description& d, std::int32_t controls) const {
        for (const std::int32_t count : {d.springs, d.lines, d.paths, d.pulls}) within("forces", count, 0, MOST);
        column("spring_at", d.spring_at, d.springs, 2, 0, 0, d.nq - 1);
        column("spring_at", d.spring_at, d.springs, 2, 1, 0, d.nv - 1);
        array("spring", d.spring, 2 * std::int64_t{d.springs});
        indices("line_joint", d.line_joint, 2 * std::int64_t{d.lines}, 0, d.joints);
        array("line", d.line, 9 * std::int64_t{d.lines});
        array("path_at", d.path_at, 4 * std::int64_t{d.paths});
        std::int64_t arms = 0, stretches = 0;
        for (std::int32_t p = 0; p < d.paths; ++p) {
            const std::int32_t* at = d.path_at + 4 * p;
            for (int k = 0; k < 4; ++k) within("path_at", at[k], 0, MOST);
            arms = std::max<std::int64_t>(arms, std::int64_t{at[0]} + at[1]);
            stretches = std::max<std::int64_t>(stretches, std::int64_t{at[2]} + at[3]);
        }
        column("arm_at", d.arm_at, arms, 2, 0, 0, d.nq - 1);
        column("arm_at", d.arm_at, arms, 2, 1, 0, d.nv - 1);
        array("arm", d.arm, arms);
        for (int k : {0, 1, 3}) column("stretch_at", d.stretch_at, stretches, 5, k, 0, d.joints);
        column("stretch_at", d.stretch_at, stretches, 5, 2, -1, 1);
        column("stretch_at", d.stretch_at, stretches, 5, 4, -1, d.joints);
        array("stretch", d.stretch, 23 * stretches);
        column("pull_at", d.pull_at, d.pulls, 4, 0, 0, std::int64_t{d.paths} - 1);
        column("pull_at", d.pull_at, d.pulls, 4, 1, 0, 2);
        column("pull_at", d.pull_at, d.pulls, 4, 2, -1, std::int64_t{controls} - 1);
        column("pull_at", d.pull_at, d.pulls, 4, 3, -1, d.pulls);
        for (std::int32_t p = 0; p < d.pulls; ++p)
            if (d.pull_at[4 * p + 1] != 0 && d.pull_at[4 * p + 2] < 0) bad("pull_at");
        array("pull", d.pull, 15 * std::int64_t{d.pulls});
        if (d.pulls > 0) array("effort", d.effort, 2 * std::int64_t{d.nv});
    }

    const std::map<const void*, std::uint64_t>& extents_;
};

}  // namespace rg
