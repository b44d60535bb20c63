// The bridge of a cluster of mobility m > 1: lines across a singular surface whose nodes follow the motion; see
// maps/cluster/patch.py, whose docstrings say why.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "tracker.h"

namespace rg {

class Patch {
  public:
    Patch(const Tracker& tracker, JetPtr anchor, Vector d, const BridgeOptions& options, double zone)
        : d_(std::move(d)), space_(*anchor->space), options_(options), C_(anchor->C), origin_(anchor->y()) {
        complete_basis();
        for (const double shrink : {1.0, 0.7, 0.5, 0.35}) {
            try {
                build(tracker, anchor, zone * shrink, zone);
                return;
            } catch (const NoBridge&) {
                continue;
            } catch (const Lost&) {
                continue;
            }
        }
        throw NoBridge{};
    }

    // From what was written of one.
    template <typename R>
    Patch(R& reader, const Jet& beside, const BridgeOptions& options);
    template <typename W>
    void write(W& writer) const;

    bool near_miss = false;
    double closure = 0.0, transversality = 0.0;

    double center() const { return 0.5 * (left_ + right_); }
    double s(const Vector& y) const { return (y - origin_).dot(d_) / d_.squaredNorm(); }
    bool contains(double s) const { return left_ <= s && s <= right_; }

    // The point at y from the line through it, with the nodes moved there; null beside the line.
    JetPtr at(const Vector& y) {
        const double here = s(y);
        const Vector foot = y - here * d_;
        for (std::size_t i = 0; i < ss_.size(); ++i) trackers_[i].at(foot + ss_[i] * d_);
        return contains(here) ? interpolated(ss_, nodes(), here) : nullptr;
    }

    // The innermost node on the side of s.
    const Tracker& inner(double s) const {
        const std::size_t half = ss_.size() / 2;
        return trackers_[s > center() ? half : half - 1];
    }

  private:
    // An orthonormal basis whose first direction is d.
    void complete_basis() {
        const Eigen::Index m = d_.size();
        Matrix beside(m, m + 1);
        beside << d_, Matrix::Identity(m, m);
        basis_ = orthonormal(beside);
    }

    std::vector<JetPtr> nodes() const {
        std::vector<JetPtr> found;
        for (const Tracker& tracker : trackers_) found.push_back(tracker.anchor);
        return found;
    }

    void build(const Tracker& tracker, const JetPtr& anchor, double w, double zone) {
        Roots mu;
        for (const auto& root : anchor->roots(d_))
            if (std::abs(root) < 3.0 * zone && std::fabs(root.imag()) < 0.5 * std::abs(root)) mu.push_back(root.real());
        if (mu.empty()) throw NoBridge{};
        double center = nearest_of(mu).real();
        const double side = center > 0.0 ? -1.0 : 1.0;
        for (int i = 0; i < 4; ++i) {
            place_nodes(tracker, anchor, center, side, w);
            left_ = center - w, right_ = center + w;
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
        Tracker here = tracker.nested(anchor);
        for (const double factor : options_.nodes) {
            ss.push_back(center + side * factor * w);
            here = here.copy();
            here.at(origin_ + ss.back() * d_);
            trackers.push_back(here);
            jets.push_back(here.anchor);
        }
        std::shared_ptr<const Matrix> P = jets[0]->P;
        for (std::size_t k = 0; k < options_.nodes.size(); ++k) {
            const double s = center - side * options_.nodes[k] * w;
            Vector x = interpolated(ss, jets, s)->x;
            const double first = solve(space_, x, *C_, origin_ + s * d_, *P);
            if (first > FAR_SIDE[std::min<std::size_t>(k, 1)] * w) throw NoBridge{};
            const JetPtr beyond = jet_at(space_, x, C_, P);
            P = beyond->P;
            ss.push_back(s);
            trackers.push_back(tracker.nested(beyond));
            jets.push_back(beyond);
        }
        ss_.clear(), trackers_.clear();
        for (const std::size_t i : order_of(ss)) ss_.push_back(ss[i]), trackers_.push_back(trackers[i]);
    }

    void certify(double zero) {
        const std::vector<JetPtr> jets = nodes();
        closure = 0.0;
        for (int i = 1; i < 8; ++i) {
            const double s = left_ + i * (right_ - left_) / 8.0;
            closure = std::max(closure, space_.residual(interpolated(ss_, jets, s)->x));
        }
        const double allowed = options_.closure_tolerance + space_.noise(jets[0]->x);
        if (closure > std::max(allowed, options_.geometric_tolerance)) throw NoBridge{};
        near_miss = closure > allowed;
        const JetPtr point = interpolated(ss_, jets, zero);
        transversality = null_pairing(space_, *point->P, point->x, point->J * d_, *C_).second;
        if (transversality < options_.transversality) throw NoBridge{};
    }

    // Where the line meets the surface, to rounding; nothing where it does not.
    std::optional<double> zero(double start, double w) const {
        const std::vector<JetPtr> jets = nodes();
        double s = start;
        for (int i = 0; i < 10; ++i) {
            const JetPtr point = interpolated(ss_, jets, s);
            const Roots mu = pencil_roots(space_, *point->P, point->x, point->J * d_, *C_, w);
            if (mu.empty()) return {};
            const std::complex<double> step = nearest_of(mu);
            s += step.real();
            if (!(ss_.front() <= s && s <= ss_.back())) return {};
            if (std::abs(step) < 1e-12) break;
        }
        return s;
    }

    // x by Hermite in (x, J d, Γ[d, d]), J in (J, Γ[d, ·]); Γ by values, its parts along d from these.
    JetPtr interpolated(const std::vector<double>& ss, const std::vector<JetPtr>& jets, double s) const {
        const Eigen::Index m = d_.size(), nv = space_.nv;
        const auto n = static_cast<Eigen::Index>(ss.size());
        const auto order = order_of(ss);
        double center = 0.0;
        for (const double one : ss) center += one / static_cast<double>(n);
        double half = 0.5 * (ss[order.back()] - ss[order.front()]);
        if (half == 0.0) half = 1.0;
        std::vector<double> units;
        Matrix x_data(nv, 3 * n), J_data(m * nv, 2 * n), bend_data(m * m * nv, n), along(nv, m);
        double sigma = 0.0;
        std::shared_ptr<const Matrix> P;
        for (Eigen::Index i = 0; i < n; ++i) {
            const std::size_t at = order[static_cast<std::size_t>(i)];
            const Jet& node = *jets[at];
            units.push_back((ss[at] - center) / half);
            along.setZero();  // Γ[d, ·]
            for (Eigen::Index a = 0; a < m; ++a) along += d_[a] * node.bend.middleCols(a * m, m);
            x_data.col(3 * i) = node.x;
            x_data.col(3 * i + 1) = half * node.J.lazyProduct(d_);
            x_data.col(3 * i + 2) = half * half * along.lazyProduct(d_);
            J_data.col(2 * i) = node.J.reshaped();
            J_data.col(2 * i + 1) = half * along.reshaped();
            bend_data.col(i) = node.bend.reshaped();
            if (P == nullptr || (space_.rows != space_.nd && node.sigma() > sigma))  // else any serves
                sigma = space_.rows != space_.nd ? node.sigma() : 0.0, P = node.P;
        }
        const double z = (s - center) / half;
        auto made = std::make_shared<Jet>();
        made->space = &space_, made->C = C_, made->P = P;
        Vector slope, bent, J, rates, none, values;
        NewtonForm(units, 3, x_data).evaluate(z, made->x, slope, bent);
        NewtonForm(units, 2, J_data).evaluate(z, J, rates, none);
        NewtonForm(units, 1, bend_data).evaluate(z, values, none, none);
        made->J = J.reshaped(nv, m);
        // in a basis whose first direction is d, the parts along d are derivatives of what is known better
        const double length = basis_.col(0).dot(d_);
        const Matrix row = times(rates.reshaped(nv, m), basis_) / (half * length);
        Matrix turned(nv, m * m);
        const Matrix bend = values.reshaped(nv, m * m);
        for (Eigen::Index a = 0; a < m; ++a)
            for (Eigen::Index b = 0; b < m; ++b) {
                Vector sum = Vector::Zero(nv);
                if (a == 0 && b == 0)
                    sum = bent / (half * half * length * length);
                else if (a == 0 || b == 0)
                    sum = row.col(a + b);
                else
                    for (Eigen::Index i = 0; i < m; ++i)
                        for (Eigen::Index j = 0; j < m; ++j) sum += basis_(i, a) * basis_(j, b) * bend.col(i * m + j);
                turned.col(a * m + b) = sum;
            }
        made->bend = Matrix::Zero(nv, m * m);
        for (Eigen::Index i = 0; i < m; ++i)
            for (Eigen::Index j = 0; j < m; ++j)
                for (Eigen::Index a = 0; a < m; ++a)
                    for (Eigen::Index b = 0; b < m; ++b)
                        made->bend.col(i * m + j) += basis_(i, a) * basis_(j, b) * turned.col(a * m + b);
        return made;
    }

    Vector d_;
    Space& space_;
    const BridgeOptions& options_;
    Chart C_;
    Vector origin_;
    Matrix basis_;
    double left_ = 0.0, right_ = 0.0;
    std::vector<double> ss_;
    std::vector<Tracker> trackers_;
};

inline JetPtr Tracker::on_patch(const Vector& y) {
    const std::shared_ptr<Patch> bridge = patch;
    if (JetPtr found = bridge->at(y)) {
        touched_patch = bridge;
        return found;
    }
    const Tracker& node = bridge->inner(bridge->s(y));
    anchor = node.anchor, u = node.u, curve = node.curve, patch = node.patch;
    return nullptr;
}

inline bool Tracker::enter_patch(const JetPtr& here, const Vector& way, const Vector& y) {
    std::shared_ptr<Patch> made;
    try {
        made = std::make_shared<Patch>(*this, here, way, *options_, zone);
    } catch (const NoBridge&) {
        throw Stop{};
    }
    ++tally_->built;
    const double s = made->s(y);
    if (!made->contains(s) && made->center() * (made->center() - s) > 0.0) return false;
    patch = made;
    return true;
}

}  // namespace rg
