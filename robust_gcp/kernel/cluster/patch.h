// The bridge of a cluster of mobility m > 1: lines across a singular surface whose nodes follow the motion; see
// maps/cluster/patch.py, whose docstrings say why.
#pragma once

#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "cluster/line.h"
#include "cluster/tracker.h"

namespace rg {

// What a line crosses a surface by: its nodes' trackers, and the certificate.
struct Bridged {
    double left = 0.0, right = 0.0;  // s of the innermost nodes
    std::vector<double> ss;
    std::vector<Tracker> trackers;
    bool near_miss = false;
    double closure = 0.0, transversality = 0.0, error = 0.0;

    std::vector<JetPtr> nodes() const {
        std::vector<JetPtr> found;
        for (const Tracker& tracker : trackers) found.push_back(tracker.anchor);
        return found;
    }
};

class Patch {
  public:
    Patch(Line line, Vector origin, Bridged now)
        : line_(std::move(line)), origin_(std::move(origin)), now_(std::move(now)) {}

    // From what was written of one.
    template <typename R>
    static Patch read(R& reader, Space& space);
    template <typename W>
    void write(W& writer) const;

    const Bridged& bridged() const { return now_; }

    double center() const { return 0.5 * (now_.left + now_.right); }
    double s(const Vector& eta) const { return (eta - origin_).dot(line_.d) / line_.d.squaredNorm(); }
    bool contains(double s) const { return now_.left <= s && s <= now_.right; }

    // η of the point at y in the chart of another point near by, to second order.
    Vector towards(const Jet& near, const Vector& y) const {
        return line_.C->transpose() * near.predicted(y - near.y());
    }

    // The point with Cᵀ x = y in that chart, by Newton in η from a guess; null beside the line.
    JetPtr at(const Vector& y, const Chart& C, Vector eta) {
        constexpr int MAX_NEWTON = 12;
        constexpr double CONVERGED = 1e-11;
        for (int i = 0; i < MAX_NEWTON; ++i) {
            const JetPtr found = point(eta);
            if (found == nullptr) return nullptr;
            const Vector step = solution(transposed_times(*C, found->J), y - C->transpose() * found->x);
            if (!step.allFinite()) throw Lost{};
            if (step.cwiseAbs().maxCoeff() < CONVERGED) {
                auto moved = std::make_shared<Jet>(*found);
                const Eigen::Index m = step.size();
                moved->x += found->J * step;
                for (Eigen::Index a = 0; a < m; ++a) moved->J += step[a] * found->bend.middleCols(a * m, m);
                return recharted(moved, C);
            }
            eta += step;
        }
        throw Lost{};
    }

    // The point at η from the line through it, with the nodes moved there; null beside the line.
    JetPtr point(const Vector& eta) {
        const double here = s(eta);
        const Vector foot = eta - here * line_.d;
        for (std::size_t i = 0; i < now_.ss.size(); ++i) now_.trackers[i].at(foot + now_.ss[i] * line_.d);
        return contains(here) ? line_.at(now_.ss, now_.nodes(), here) : nullptr;
    }

    // Whether the surface next to a solved point is the one that the line crosses near its middle.
    bool leads_to(const Jet& here) const {
        const Distance& nearest = here.nearest();  // σ grows that way
        const double ahead = s(line_.C->transpose() * (here.x - here.J * (nearest.size * nearest.way)));
        return std::fabs(ahead - center()) < 0.25 * (now_.right - now_.left);
    }

    // Whether the point at y, from a solved one, lies on the line or beyond it.
    bool serves(const Jet& here, const Vector& y) const {
        const double begun = s(line_.C->transpose() * here.x), there = s(towards(here, y));
        return contains(there) || (begun - center()) * (there - center()) <= 0.0;
    }

    // Whether the line, moved there, goes through a point at a singular place, which does not tell its mode.
    bool passes(const Jet& here, double zone) {
        constexpr double UPON = 0.1, SAME = 1e-8;  // lines are certified to less
        const Vector eta = line_.C->transpose() * here.x;
        if (here.nearest().size > UPON * zone || !contains(s(eta))) return false;
        try {
            const JetPtr found = point(eta);
            return found != nullptr && (found->x - here.x).norm() < SAME;
        } catch (const Lost&) {
        } catch (const Stop&) {
        }
        return false;
    }

    // The innermost node on the side of s.
    const Tracker& inner(double s) const {
        const std::size_t half = now_.ss.size() / 2;
        return now_.trackers[s > center() ? half : half - 1];
    }

  private:
    Line line_;
    Vector origin_;
    Bridged now_;
};

inline JetPtr Tracker::on_patch(const Vector& y) {
    const std::shared_ptr<Patch> bridge = patch;
    const Vector eta = bridge->towards(*anchor, y);
    if (JetPtr found = bridge->at(y, C, eta)) {
        touched_patch = bridge;
        return found;
    }
    const Tracker& node = bridge->inner(bridge->s(eta));
    u = node.u, curve = node.curve, patch = node.patch, anchor = recharted(node.anchor, C);
    return nullptr;
}

}  // namespace rg
