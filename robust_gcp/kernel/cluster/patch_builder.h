// Builds the line of a cluster of mobility m > 1 across a singular surface, and certifies it; see
// maps/cluster/patch_builder.py.
#pragma once

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "cluster/newton.h"
#include "cluster/patch.h"

namespace rg {

class PatchBuilder {
  public:
    PatchBuilder(const Tracker& tracker, const JetPtr& beside, const BridgeOptions& options, double zone)
        : PatchBuilder(tracker, recharted(beside, std::make_shared<Matrix>(rounded(beside->tangent(), COARSE))),
                       options, zone, Begun{}) {}

    // The best certified line of several widths.
    std::shared_ptr<Patch> build() {
        Roots mu;
        for (const auto& root : anchor_->roots(line_.d))
            if (std::abs(root) < 3.0 * zone_ && std::fabs(root.imag()) < 0.5 * std::abs(root))
                mu.push_back(root.real());
        if (mu.empty()) throw NoBridge{};
        ahead_ = nearest_of(mu).real();
        Bridged best = best_of([this](double half_width) { return attempt(half_width); }, zone_, {1.0, 0.6, 0.36},
                               {0.216, 0.13});
        return std::make_shared<Patch>(line_, origin_, std::move(best));
    }

  private:
    struct Begun {};
    static constexpr double NODES[] = {1.0, 2.0, 3.0, 4.0};  // in half widths
    static constexpr double LARGEST_ERROR = 1e-7;  // of Γ, relative: shorter lines lose it to rounding
    static constexpr double NESTED = 0.5;  // zone of the nodes' own bridges, in half widths

    PatchBuilder(const Tracker& tracker, JetPtr anchor, const BridgeOptions& options, double zone, Begun)
        : space_(*anchor->space), options_(options), tracker_(tracker), zone_(zone), anchor_(std::move(anchor)),
          line_(space_, anchor_->C, anchor_->nearest().way), origin_(anchor_->y()) {}

    Vector eta(double s) const { return origin_ + s * line_.d; }
    JetPtr at(double s) const { return line_.at(now_.ss, now_.nodes(), s); }

    std::pair<JetPtr, double> solve_at(const Vector& guess, double s, const std::shared_ptr<const Matrix>& P) const {
        return solved(space_, guess, line_.C, eta(s), P);
    }

    // The line between nodes this far from the surface.
    Bridged attempt(double w) {
        double center = ahead_;
        for (int i = 0; i < 4; ++i) {
            place_nodes(center, w);
            const double found = zero(center, w);
            if (std::fabs(found - center) < 0.1 * w) return certified(found);
            center = found;
        }
        throw NoBridge{};
    }

    // Near nodes by continuation, far nodes by extrapolation of all so far, then Newton.
    void place_nodes(double center, double w) {
        const double side = ahead_ > 0.0 ? -1.0 : 1.0;  // where the anchor stands, seen from the centre
        std::vector<double> ss, far;
        std::vector<Tracker> trackers;
        std::vector<JetPtr> jets;
        Tracker here = tracker_.nested(anchor_, NESTED * w);
        for (const double factor : NODES) {
            ss.push_back(center + side * factor * w);
            far.push_back(center - side * factor * w);
            here = here.copy();
            follow(here, ss.back());
            trackers.push_back(here);
            jets.push_back(here.anchor);
        }
        const auto guess = [this](const std::vector<double>& places, const std::vector<JetPtr>& nodes, double s) {
            return line_.at(places, nodes, s)->x;
        };
        go_beyond(ss, jets, far, w, guess,
                  [this](const Vector& x, double s, const auto& P) { return solve_at(x, s, P); });
        for (std::size_t i = trackers.size(); i < jets.size(); ++i) trackers.push_back(beside(jets[i], ss[i], w));
        now_ = Bridged{};
        for (const std::size_t i : order_of(ss)) now_.ss.push_back(ss[i]), now_.trackers.push_back(trackers[i]);
        now_.left = center - w, now_.right = center + w;
    }

    // A node from its solved point: on a line of its own where that is next to another surface.
    Tracker beside(const JetPtr& solved, double s, double w) const {
        Tracker node = tracker_.nested(solved, NESTED * w);
        follow(node, s);
        return node;
    }

    // Puts a node at s; where another surface stops it there, nodes of a shorter line may pass.
    void follow(Tracker& node, double s) const {
        try {
            node.at(eta(s));
        } catch (const Stop&) {
            throw NoBridge{};
        }
    }

    // Where the line meets the surface, to rounding.
    double zero(double start, double w) const {
        double s = start;
        for (int i = 0; i < 10; ++i) {
            const JetPtr point = at(s);
            const Roots mu = pencil_roots(space_, *point->P, point->x, point->J * line_.d, *line_.C, w);
            if (mu.empty()) throw NoBridge{};
            const std::complex<double> step = nearest_of(mu);
            s += step.real();
            if (!(now_.ss.front() <= s && s <= now_.ss.back())) throw NoBridge{};
            if (std::abs(step) < 1e-12) break;
        }
        return s;
    }

    // The line through the nodes, with what vouches for it.
    Bridged certified(double zero) {
        const Vector& outermost = now_.trackers.front().anchor->x;
        const Closure closure = closure_of(space_, options_, now_.left, now_.right, 8, outermost,
                                           [this](double s) { return at(s)->x; });
        now_.closure = closure.left, now_.near_miss = closure.open;
        const JetPtr point = at(zero);
        now_.transversality = null_pairing(space_, *point->P, point->x, point->J * line_.d, *line_.C).second;
        if (now_.transversality < options_.transversality) throw NoBridge{true};
        const auto off = [this](double s, std::size_t inner) {
            const JetPtr guess = at(s), solved = solve_at(guess->x, s, now_.trackers[inner].anchor->P).first;
            return relative(guess->bend, beside(solved, s, 0.5 * (now_.right - now_.left)).anchor->bend);
        };
        const double error =
            held_out(now_.ss, 0.5 * (now_.left + now_.right), off, [](double growth) { return growth; });
        now_.error = std::max(error, now_.closure);
        if (now_.error > LARGEST_ERROR) throw NoBridge{};
        return now_;
    }

    Space& space_;
    const BridgeOptions& options_;
    const Tracker& tracker_;
    double zone_, ahead_ = 0.0;
    JetPtr anchor_;
    Line line_;
    Vector origin_;
    Bridged now_;
};

inline bool Tracker::enter_patch(const JetPtr& here, const Vector& y) {
    if (space_->apex || leaves(*here, y)) return false;
    if (beside_ && beside_->leads_to(*here) && !beside_->serves(*here, y)) return false;
    if (left_ && left_->passes(*here, zone)) {
        patch = left_;
        return true;
    }
    std::shared_ptr<Patch> made;
    try {
        made = PatchBuilder(*this, here, *options_, zone).build();
    } catch (const NoBridge& failure) {
        return blocked(*here, failure);
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
