// The bridge of a cluster of mobility m > 1: lines across a singular surface whose nodes follow the motion; see
// maps/cluster/patch.py, whose docstrings say why.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "line.h"
#include "tracker.h"

namespace rg {

// What a line crosses a surface by: its nodes' trackers, and the certificate.
struct Bridged {
    double left = 0.0, right = 0.0;  // s of the innermost nodes
    std::vector<double> ss;
    std::vector<Tracker> trackers;
    bool near_miss = false;
    double closure = 0.0, transversality = 0.0;
};

class Patch {
  public:
    Patch(const Tracker& tracker, const JetPtr& beside, const BridgeOptions& options, double zone)
        : Patch(tracker, recharted(beside, std::make_shared<Matrix>(CurveBuilder::coarse(beside->tangent()))),
                options, zone, Begun{}) {}

    // From what was written of one.
    template <typename R>
    static Patch read(R& reader, Space& space, const BridgeOptions& options);
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
        return contains(here) ? line_.at(now_.ss, nodes(), here) : nullptr;
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

    // The innermost node on the side of s.
    const Tracker& inner(double s) const {
        const std::size_t half = now_.ss.size() / 2;
        return now_.trackers[s > center() ? half : half - 1];
    }

  private:
    struct Begun {};

    Patch(Line line, const BridgeOptions& options)
        : space_(*line.space), options_(options), line_(std::move(line)) {}
    static constexpr double NESTED = 0.5;  // zone of the nodes' own bridges, in half widths

    Patch(const Tracker& tracker, const JetPtr& anchor, const BridgeOptions& options, double zone, Begun)
        : space_(*anchor->space), options_(options), line_(space_, anchor->C, anchor->nearest().way),
          origin_(anchor->y()) {
        constexpr double SHRINKS[] = {1.0, 0.6, 0.36}, GOOD = 1e-9;
        double least = FAR;
        Bridged best;
        for (const double shrink : SHRINKS) {
            double error = FAR;
            try {
                build(tracker, anchor, zone * shrink, zone);
                error = std::max(held_out(), now_.closure);
            } catch (const NoBridge&) {
                continue;
            } catch (const Lost&) {
                continue;
            }
            if (error < least) least = error, best = now_;
            if (error <= GOOD && !now_.near_miss) break;
        }
        if (best.ss.empty()) throw NoBridge{};
        now_ = best;
    }

    std::vector<JetPtr> nodes() const {
        std::vector<JetPtr> found;
        for (const Tracker& tracker : now_.trackers) found.push_back(tracker.anchor);
        return found;
    }

    void build(const Tracker& tracker, const JetPtr& anchor, double w, double zone) {
        Roots mu;
        for (const auto& root : anchor->roots(line_.d))
            if (std::abs(root) < 3.0 * zone && std::fabs(root.imag()) < 0.5 * std::abs(root)) mu.push_back(root.real());
        if (mu.empty()) throw NoBridge{};
        double center = nearest_of(mu).real();
        const double side = center > 0.0 ? -1.0 : 1.0;
        for (int i = 0; i < 4; ++i) {
            place_nodes(tracker, anchor, center, side, w);
            now_.left = center - w, now_.right = center + w;
            const std::optional<double> found = zero(center, w);
            if (!found) throw NoBridge{};
            if (std::fabs(*found - center) < 0.1 * w) return certify(*found);
            center = *found;
        }
        throw NoBridge{};
    }

    // Near nodes by continuation, far nodes by extrapolation of all so far, then Newton.
    void place_nodes(const Tracker& tracker, const JetPtr& anchor, double center, double side, double w) {
        std::vector<double> ss;
        std::vector<Tracker> trackers;
        std::vector<JetPtr> jets;
        Tracker here = tracker.nested(anchor, NESTED * w);
        for (const double factor : options_.nodes) {
            ss.push_back(center + side * factor * w);
            here = here.copy();
            here.at(origin_ + ss.back() * line_.d);
            trackers.push_back(here);
            jets.push_back(here.anchor);
        }
        std::shared_ptr<const Matrix> P = jets[0]->P;
        for (std::size_t k = 0; k < options_.nodes.size(); ++k) {
            const double s = center - side * options_.nodes[k] * w;
            Vector x = line_.at(ss, jets, s)->x;
            const double first = solve(space_, x, *line_.C, origin_ + s * line_.d, *P);
            if (first > FAR_SIDE[std::min<std::size_t>(k, 1)] * w) throw NoBridge{};
            const JetPtr beyond = jet_at(space_, x, line_.C, P);
            P = beyond->P;
            ss.push_back(s);
            trackers.push_back(tracker.nested(beyond, NESTED * w));
            jets.push_back(beyond);
        }
        now_.ss.clear(), now_.trackers.clear();
        for (const std::size_t i : order_of(ss)) now_.ss.push_back(ss[i]), now_.trackers.push_back(trackers[i]);
    }

    void certify(double zero) {
        const std::vector<JetPtr> jets = nodes();
        now_.closure = 0.0;
        for (int i = 1; i < 8; ++i) {
            const double s = now_.left + i * (now_.right - now_.left) / 8.0;
            now_.closure = std::max(now_.closure, space_.residual(line_.at(now_.ss, jets, s)->x));
        }
        const double allowed = options_.closure_tolerance + space_.noise(jets[0]->x);
        if (now_.closure > std::max(allowed, options_.geometric_tolerance)) throw NoBridge{};
        now_.near_miss = now_.closure > allowed;
        const JetPtr point = line_.at(now_.ss, jets, zero);
        now_.transversality = null_pairing(space_, *point->P, point->x, point->J * line_.d, *line_.C).second;
        if (now_.transversality < options_.transversality) throw NoBridge{};
    }

    // Where the line meets the surface, to rounding; nothing where it does not.
    std::optional<double> zero(double start, double w) const {
        const std::vector<JetPtr> jets = nodes();
        double s = start;
        for (int i = 0; i < 10; ++i) {
            const JetPtr point = line_.at(now_.ss, jets, s);
            const Roots mu = pencil_roots(space_, *point->P, point->x, point->J * line_.d, *line_.C, w);
            if (mu.empty()) return {};
            const std::complex<double> step = nearest_of(mu);
            s += step.real();
            if (!(now_.ss.front() <= s && s <= now_.ss.back())) return {};
            if (std::abs(step) < 1e-12) break;
        }
        return s;
    }

    // Relative error of Γ on the line, from solved points that the polynomials do not know.
    double held_out() const {
        const std::vector<JetPtr> jets = nodes();
        const std::vector<double>& ss = now_.ss;
        const std::size_t n = ss.size();
        double worst = 0.0;
        const std::size_t pairs[2][2] = {{n / 2 - 1, n / 2 - 2}, {n / 2, n / 2 + 1}};
        for (const auto& [inner, outer] : pairs) {
            const double at = 0.5 * (ss[inner] + ss[outer]);
            const JetPtr guess = line_.at(ss, jets, at);
            const Matrix known =
                solved(space_, guess->x, line_.C, origin_ + at * line_.d, jets[inner]->P).first->bend;
            const double off = (known - guess->bend).cwiseAbs().maxCoeff() / (1.0 + known.cwiseAbs().maxCoeff());
            double growth = 1.0;
            for (const double node : ss) growth *= std::fabs((node - center()) / (node - at));
            worst = std::max(worst, off * growth);
        }
        return worst;
    }

    Space& space_;
    const BridgeOptions& options_;
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

inline bool Tracker::enter_patch(const JetPtr& here, const Vector& y) {
    if (beside_ && beside_->leads_to(*here) && !beside_->serves(*here, y)) return false;
    std::shared_ptr<Patch> made;
    try {
        made = std::make_shared<Patch>(*this, here, *options_, zone);
    } catch (const NoBridge&) {
        throw Stop{};
    }
    ++tally_->built;
    if (!made->serves(*here, y)) {
        beside_ = made;
        return false;
    }
    patch = made;
    return true;
}

}  // namespace rg
