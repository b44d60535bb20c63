#include "cluster/clusters.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "cluster/chart.h"
#include "cluster/explore.h"
#include "cluster/passages.h"
#include "cluster/tracker_numbers.h"
#include "cluster/patch_builder.h"
#include "cluster/product.h"

namespace rg {

constexpr double ONE_TURN = 6.283185307179586;  // as in cluster_map.py, where it says why
constexpr double LOOK_AGAIN = 1.5;  // growth of σ

struct Clusters::Inside {
    explicit Inside(const Description& d) : clusters(d.cluster, d.cluster + d.clusters), home(d.home, d.home + d.nq), det(d.blocks), rcond(d.blocks) {
        std::vector<bool> taken(static_cast<std::size_t>(d.m), false);
        for (int i = 0; i < d.clusters; ++i) {
            spaces.push_back(std::make_unique<Space>(*clusters[static_cast<std::size_t>(i)]));
            for (const int input : spaces.back()->inputs) taken[static_cast<std::size_t>(input)] = true;
        }
        for (int i = 0; i < d.m; ++i)
            if (!taken[static_cast<std::size_t>(i)]) free.push_back(i);
        independent.assign(d.independent, d.independent + d.m);
        independent_q.assign(d.independent_q, d.independent_q + d.m);
    }

    // Put every cluster's tracker on its mode.
    void enter(Point& anchor, const double* origin) {
        for (std::size_t i = 0; i < spaces.size(); ++i) {
            if (!spaces[i]->flat) {
                refer(i, anchor, origin);
                continue;
            }
            if (trackers.size() > i && trackers[i].back_at(spaces[i]->x(anchor.q()))) continue;
            const JetPtr here = at(i, anchor);
            if (trackers.size() > i)
                trackers[i].place_at(here);
            else
                trackers.push_back(tracker(here));
        }
    }

    // One of them in coordinates about the anchor; curves that were met are told of still.
    void refer(std::size_t i, Point& anchor, const double* origin) {
        left.push_back(std::move(spaces[i]));
        spaces[i] = std::make_unique<Space>(*clusters[i]);
        spaces[i]->about(anchor.q(), origin);
        Tracker made = tracker(at(i, anchor));
        if (trackers.size() > i) {
            made.touched = trackers[i].touched, made.crossed = trackers[i].crossed;
            trackers[i] = std::move(made);
        } else {
            trackers.push_back(std::move(made));
        }
    }

    JetPtr at(std::size_t i, Point& anchor) { return ++tally.svds, jet_at(*spaces[i], spaces[i]->x(anchor.q()), spaces[i]->chart); }

    Tracker tracker(const JetPtr& here) {
        return Tracker(here, options, here->space->m == 1 ? options.reach : options.reach_of_several, tally);
    }

    // The smallest singular value of all clusters' K.
    double least_sigma() const {
        double least = FAR;
        for (const Tracker& tracker : trackers) least = std::min(least, tracker.anchor->sigma());
        return least;
    }

    // That of K_d at a point that is closed, before Newton's method is asked for more.
    double conditioning(Path& path, Point& point) {
        path.prime(point);
        ++path.evaluations;
        double worst = 1.0;
        for (std::size_t i = 0; i < path.parts.list.size(); ++i) {
            if (path.loops(i) == nullptr) continue;
            const double found = path.loops(i)->blocks.measure(path.enough, det.data(), rcond.data());
            if (!(found >= worst)) worst = found;  // keeps a NaN
        }
        return worst;
    }

    // q, G and g of the whole from the clusters' points.
    void product(const std::vector<JetPtr>& jets, const Layout& l, const double* y, const double* ydot,
                 Point& point) {
        double *q = point.q(), *G = point.G(), *g = point.g();
        std::copy(home.begin(), home.end(), q);
        std::fill(G, G + static_cast<std::ptrdiff_t>(l.nv) * l.m, 0.0);
        std::fill(g, g + l.nv, 0.0);
        if (l.m == 1) std::fill(point.curvature(), point.curvature() + l.nv, 0.0);
        for (std::size_t c = 0; c < spaces.size(); ++c) add_share(*spaces[c], *jets[c], ydot, l, point);
        for (int j = 0; j < l.m; ++j) {
            const int v = independent[j];
            point.y()[j] = y[j], point.ydot()[j] = ydot[j];
            if (independent_q[j] >= 0) q[independent_q[j]] = y[j];
            g[v] = 0.0;
            for (int k = 0; k < l.m; ++k) G[v * l.m + k] = j == k ? 1.0 : 0.0;
            if (l.m == 1) point.curvature()[v] = 0.0;
        }
        std::fill(point.det(), point.det() + l.blocks, 0.0);
        std::fill(point.rcond(), point.rcond() + l.blocks, 0.0);
        point.conditioning() = point.correction = point.distance = point.turn = 0.0;
    }

    const std::vector<const Cluster*> clusters;
    std::vector<std::unique_ptr<Space>> spaces;
    std::vector<std::unique_ptr<Space>> left;  // of curves that may be told of still
    std::vector<Tracker> trackers;
    BridgeOptions options;
    double last_resort = CHANGE;
    Tally tally;
    double looked = 0.0;  // `least_sigma` where Python looked for other rows of K last
    std::vector<double> home, det, rcond;
    std::vector<int> free, independent, independent_q;
};

Clusters::Clusters(const Description& d, Path& path)
    : some_(d.clusters > 0), path_(path), inside_(some_ ? std::make_unique<Inside>(d) : nullptr) {}
Clusters::~Clusters() = default;

void Clusters::use(const Bridging& b) {
    if (!some_) return;
    inside_->options = {{b.nodes, b.nodes + b.count}, b.error_controlled != 0, b.reach, b.reach_of_several, b.closure_tolerance, b.geometric_tolerance,
                        b.transversality};
    inside_->last_resort = b.last_resort;
}

Reason Clusters::at(Point& anchor, const double* origin, const double* y, const double* ydot, Point& point,
                    double zone) {
    Inside& in = *inside_;
    std::vector<JetPtr> jets;
    const bool careful = in.options.error_controlled;
    try {
        if (!in_zone_) {
            if (path_.turn(anchor, y) > ONE_TURN) return ZONE;
            enter(anchor, origin);
        }
        bool bridged = false;
        for (Tracker& tracker : in.trackers) {
            const Space& space = *in.spaces[jets.size()];
            if (!serves(*tracker.anchor, space.chosen, careful ? in.last_resort : CHANGE)) return careful ? REFUSED : ZONE;
            jets.push_back(tracker.at(space.wanted(y)));
            bridged = bridged || tracker.on_bridge();
        }
        const auto compose = [&] {
            in.product(jets, path_.layout, y, ydot, point);
            path_.groups.place(origin, point);
            if (path_.charted) path_.place_charts(origin, point);
        };
        compose();
        if (!bridged) {
            const bool regular = in.conditioning(path_, point) >= zone;
            if (regular) {
                const std::vector<double> q(point.q(), point.q() + path_.layout.nq);
                if (path_.settle(point, origin) && point.conditioning() >= zone &&
                    path_.apart(q.data(), point) < SAME_PLACE) {
                    in_zone_ = false;
                    return DONE;
                }
            }
            // other rows may serve; where Python found none, as long as K is not much better conditioned
            if (path_.redundant && in.least_sigma() > LOOK_AGAIN * in.looked) return ROWS;
            if (regular) compose();
        }
        ++zone_evaluations;
        path_.survey(point);
        return DONE;
    } catch (const Lost&) {
        return careful ? REFUSED : ZONE;
    } catch (const Stop&) {  // modes that touch, of one coordinate, are Python's
        const std::size_t i = jets.size();
        return !careful && i < in.spaces.size() && in.spaces[i]->m > 1 ? OBSTACLE : ZONE;
    }
}

bool Clusters::met() const {
    return some_ && std::any_of(inside_->trackers.begin(), inside_->trackers.end(), [](const Tracker& tracker) {
        return tracker.crossed || tracker.touched_patch != nullptr;
    });
}

void Clusters::passed(const Step& step, std::vector<double>& log) {
    Inside& in = *inside_;
    std::vector<Passage> found;
    for (std::size_t i = 0; i < in.trackers.size(); ++i) {
        Tracker& tracker = in.trackers[i];
        for (const CurvePtr& curve : tracker.touched) on_curve(*curve, static_cast<int>(i), step, path_, found);
        if (tracker.touched_patch) on_patch(tracker, static_cast<int>(i), step, path_, found);
        tracker.forget_touched();
    }
    std::sort(found.begin(), found.end(), [](const Passage& a, const Passage& b) { return a.time < b.time; });
    for (const Passage& one : found) {
        const std::size_t from = log.size();
        for (const double number : {one.time, double(one.cluster), double(one.corank), one.closure,
                                    one.transversality, double(one.near_miss), double(one.order)})
            log.push_back(number);
        log.resize(log.size() + static_cast<std::size_t>(path_.layout.nq));
        double* q = log.data() + from + 7;
        between(path_, step, one.time, q);
        one.space->write(one.x, q);
    }
    in.left.clear();
}

void Clusters::enter(Point& anchor, const double* origin) {
    inside_->enter(anchor, origin);
    if (!in_zone_) inside_->looked = 0.0;
    in_zone_ = true;
}

void Clusters::explore() { rg::explore(inside_->trackers); }

void Clusters::forget() {
    if (!some_) return;
    for (Tracker& tracker : inside_->trackers) tracker.forget_touched();
    inside_->left.clear();
}

bool Clusters::on_bridge(bool turning) const {
    return some_ && in_zone_ && std::any_of(inside_->trackers.begin(), inside_->trackers.end(), [=](const Tracker& t) {
        return !(turning && t.anchor->space->flat) && t.on_bridge();
    });
}

void Clusters::settle(Point& accepted) {
    if (!some_ || !in_zone_ || turning_on_bridge()) return;
    for (std::size_t i = 0; i < inside_->spaces.size(); ++i) {
        const Space& space = *inside_->spaces[i];
        if (space.charted() || space.far(inside_->trackers[i].anchor->x)) inside_->refer(i, accepted, accepted.q());
    }
}

void Clusters::renew() {
    in_zone_ = false;
    if (!some_) return;
    inside_->trackers.clear();
    inside_->left.clear();
    for (const auto& space : inside_->spaces) space->apex.reset();
}

std::vector<double> Clusters::written() const {
    if (!some_) return {};
    Writer writer;
    for (const Tracker& tracker : inside_->trackers) {
        const Space& space = *tracker.anchor->space;
        writer.array(space.apex.value_or(Vector()));
        if (!space.flat) writer.array(space.reference());
        writer.tracker(tracker);
    }
    writer.numbers.push_back(inside_->looked);
    return writer.numbers;
}

void Clusters::read(const double* numbers) {
    Inside& in = *inside_;
    Reader reader(numbers, in.options, in.tally);
    in.trackers.clear();
    for (std::size_t i = 0; i < in.spaces.size(); ++i) {
        if (!in.spaces[i]->flat) in.spaces[i] = std::make_unique<Space>(*in.clusters[i]);
        const auto& space = in.spaces[i];
        const Vector apex = reader.array();
        if (!space->flat) space->refer(reader.array());
        space->apex.reset();
        if (apex.size()) space->apex = apex;
        in.trackers.push_back(reader.tracker(*space));
    }
    const double looked = reader.number();
    in.looked = looked < 0.0 ? in.least_sigma() : looked;  // just now, in Python
    in_zone_ = true;
}

void Clusters::rounding(Request& r) const {
    r.uncertain = r.asked = 0.0, r.nearest = FAR;
    if (!some_ || !in_zone_) return;
    for (const Tracker& tracker : inside_->trackers) {
        const auto [lost, asked, near] = tracker.rounding();
        r.uncertain = std::max(r.uncertain, lost), r.asked = std::max(r.asked, asked);
        r.nearest = std::min(r.nearest, near);
    }
}

void Clusters::count(Request& r) const {
    if (!some_) return;
    r.marching_steps = inside_->tally.marching, r.svds = inside_->tally.svds;
    r.bridges_built = inside_->tally.built, r.second_order = inside_->tally.second_order;
    r.zone_evaluations = zone_evaluations;
}

void Clusters::count_anew() {
    zone_evaluations = 0;
    if (some_) inside_->tally = {};
}

}  // namespace rg
