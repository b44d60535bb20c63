// One motion of a mechanism that was read from a file: what robust_gcp.h promises, on the steps that Python takes too.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "public/public_chart.h"
#include "public/reduced.h"
#include "robust_gcp.h"
#include "simulation/rows.h"

namespace rg {

class PublicMotion {
  public:
    explicit PublicMotion(const Exported& of) : of_(of), nv_(of.chart[0]->description->nv), m_(of.chart[0]->description->m) {
        const Description& d = *of.chart[0]->description;
        std::size_t size = 0;
        for (std::int32_t c = 0; c < of.charts; ++c) {
            charts_.emplace_back(new PublicChart(*of.chart[c]));
            size = std::max(size, static_cast<std::size_t>(charts_.back()->layout.size));
        }
        x.resize(2 * m_), ydd.resize(m_), uneven_.resize(m_), q.resize(d.nq), v.resize(nv_), tau_.resize(nv_);
        anchor.resize(size), origin.resize(d.nq), held_.assign(nv_ + of.controls, 0.0);
        safe_.resize(size + 2 * m_);
    }

    double time() const { return t0_ + step_ * static_cast<double>(at_); }
    std::int32_t chart() const { return chart_; }
    std::int64_t crossings() const { return passed_; }
    const double* G() const { return anchor.data() + layout().G; }
    const double* g() const { return anchor.data() + layout().g; }

    rgcp_status begin(const double* from, const double* u, double t) {
        if (!std::isfinite(t)) return fail(RGCP_BAD_ARGUMENT, "t must be finite");
        t0_ = t, step_ = 0.0, at_ = passed_ = 0, begun_ = false, hold(nullptr, nullptr);
        for (const auto& chart : charts_) chart->solver.renew();
        std::vector<double> speeds(m_);
        if (u != nullptr) std::copy(u, u + m_, speeds.begin());
        const double* start = from != nullptr ? from : of_.chart[0]->description->home;
        if (!std::all_of(start, start + q.size(), [](double n) { return std::isfinite(n); }) ||
            !std::all_of(speeds.begin(), speeds.end(), [](double n) { return std::isfinite(n); }))
            return fail(RGCP_BAD_ARGUMENT, "q and u must be finite");
        const int reason = set_out(0, start, speeds.data());
        if (reason != DONE) return fail(RGCP_NO_START, "no start there: ", words(reason));
        return begun_ = true, RGCP_OK;
    }

    rgcp_status step(double h, std::int64_t n, const double* tau, const double* control) {
        if (!begun_) return fail(RGCP_BAD_ARGUMENT, "nothing has begun: call rgcp_begin");
        if (!std::isfinite(h) || h == 0.0 || n < 0) return fail(RGCP_BAD_ARGUMENT, "h must be finite and not 0, n 0 or more");
        if (control != nullptr && of_.controls == 0) return fail(RGCP_BAD_ARGUMENT, "the mechanism has no actuators");
        hold(tau, control);
        if (!std::all_of(held_.begin(), held_.begin() + nv_, [](double n) { return std::isfinite(n); }))
            return fail(RGCP_BAD_ARGUMENT, "tau must be finite");
        if (h != step_) t0_ = time(), at_ = 0, step_ = h;
        std::int64_t left = n;
        do {
            std::int64_t part = std::min(left, AT_ONCE), rest = left - part;
            const int reason = run(part);
            left = rest + part;
            if (reason == DONE) continue;
            if (reason == CHART) {
                if (!change(false)) patience();
            } else if (!change(true)) {
                std::snprintf(why_, sizeof why_, "the motion stops at t = %.6g s: %s", time(), words(reason));
                return RGCP_STOPPED;
            }
        } while (left > 0);
        return RGCP_OK;
    }

    // Builds the bridges that lie ahead and behind.
    rgcp_status prepare() {
        if (!begun_) return fail(RGCP_BAD_ARGUMENT, "nothing has begun: call rgcp_begin");
        std::int64_t none = 0;
        if (const int reason = run(none)) return fail(RGCP_STOPPED, words(reason));
        charts_[chart_]->solver.explore();
        return RGCP_OK;
    }

    rgcp_status reduced(double* M, double* b) {
        if (!begun_) return fail(RGCP_BAD_ARGUMENT, "nothing has begun: call rgcp_begin");
        PublicChart& c = *charts_[chart_];
        std::int64_t none = 0;
        run(none);  // under what is held now
        reduced_inertia(c.of, c.other.path.chain, q.data(), G(), M);
        for (int k = 0; k < m_; ++k) b[k] = std::inner_product(M + k * m_, M + (k + 1) * m_, ydd.begin(), 0.0);
        return RGCP_OK;
    }

    rgcp_status derivatives(const double* tau, double* acceleration, double* rows) {
        if (!begun_) return fail(RGCP_BAD_ARGUMENT, "nothing has begun: call rgcp_begin");
        PublicChart& c = *charts_[chart_];
        for (std::int32_t i = 0; i < c.of.pulls; ++i)
            if (c.of.pull_at[4 * i + 2] < 0) return fail(RGCP_NO_DERIVATIVES, "no derivatives of springs along tendons");
        if (c.derivation == nullptr) c.derivation.reset(new Derivation(c.of));
        std::int32_t status = DONE;
        States s{};
        s.count = 1, s.q = q.data(), s.v = v.data(), s.tau = tau, s.zone = of_.zone, s.close = 1e-6;
        s.same = std::numeric_limits<double>::quiet_NaN(), s.at_rest = 1.0, s.ydd = acceleration, s.rows = rows, s.status = &status;
        c.derivation->at(s);
        if (status != DONE) return fail(RGCP_NO_DERIVATIVES, "no derivatives here: ", words(status));
        return RGCP_OK;
    }

    // The numbers of a state one after the other: handed to `each`, which reads or writes them.
    template <typename Each>
    void state(Each each) {
        each(&chart_, sizeof chart_), each(&in_zone_, sizeof in_zone_), each(&at_, sizeof at_), each(&passed_, sizeof passed_);
        each(&t0_, sizeof t0_), each(&step_, sizeof step_), each(&limit_, sizeof limit_);
        for (std::vector<double>* part : {&x, &ydd, &anchor, &origin, &held_, &uneven_, &q, &v})
            each(part->data(), part->size() * sizeof(double));
    }

    std::size_t save(unsigned char* to, std::size_t room) {
        if (!begun_) return 0;
        std::int64_t count = 0;
        const double* numbers = trackers_.data();
        if (in_zone_ && going_)
            numbers = charts_[chart_]->solver.trackers(count);
        else if (in_zone_)
            count = static_cast<std::int64_t>(trackers_.size());
        std::size_t size = 0;
        const auto put = [&](const void* from, std::size_t bytes) {
            if (to != nullptr && bytes > 0 && size + bytes <= room) std::memcpy(to + size, from, bytes);
            size += bytes;
        };
        const std::uint64_t kind = identity();
        put(&kind, sizeof kind);
        state(put);
        put(&count, sizeof count), put(numbers, static_cast<std::size_t>(count) * sizeof(double));
        return size;
    }

    rgcp_status restore(const unsigned char* from, std::size_t size) {
        std::uint64_t kind = 0;
        std::size_t needed = sizeof kind + sizeof(std::int64_t);
        state([&](void*, std::size_t bytes) { needed += bytes; });
        if (from != nullptr && size >= sizeof kind) std::memcpy(&kind, from, sizeof kind);
        std::int64_t count = 0;
        if (from != nullptr && size >= needed) std::memcpy(&count, from + needed - sizeof count, sizeof count);
        std::int32_t chart = 0;
        if (from != nullptr && size >= needed) std::memcpy(&chart, from + sizeof kind, sizeof chart);
        const std::size_t rest = size < needed ? 0 : (size - needed) / sizeof(double);
        if (from == nullptr || size < needed || kind != identity() || count < 0 || static_cast<std::uint64_t>(count) != rest ||
            (size - needed) % sizeof(double) != 0 || chart < 0 || chart >= of_.charts)
            return fail(RGCP_BAD_ARGUMENT, "these bytes are no state of this mechanism");
        std::size_t at = sizeof kind;
        state([&](void* to, std::size_t bytes) { std::memcpy(to, from + at, bytes), at += bytes; });
        trackers_.resize(static_cast<std::size_t>(count));
        if (count > 0) std::memcpy(trackers_.data(), from + needed, static_cast<std::size_t>(count) * sizeof(double));
        charts_[chart_]->solver.renew();
        going_ = 0, begun_ = true;
        return RGCP_OK;
    }

    rgcp_status fail(rgcp_status status, const char* what, const char* more = "") {
        std::snprintf(why_, sizeof why_, "%s%s", what, more);
        return status;
    }
    const char* why() const { return why_; }
    void give_up() { begun_ = false; }  // left in the middle of a step

    std::vector<double> x, anchor, origin, ydd, q, v;

  private:
    static constexpr double PATIENCE = 1.2;  // as in simulation/runs/coordinates.py
    static constexpr double STEEPER = 0.8;
    static constexpr std::int64_t AT_ONCE = 1024;  // steps, whose times take memory
    static constexpr std::int32_t CONTROL_ROWS = 4;  // as in dynamics/prescribed/zero_order_hold.py

    const Layout& layout() const { return charts_[chart_]->layout; }
    std::uint64_t identity() const {
        return (static_cast<std::uint64_t>(q.size()) << 40) ^ (static_cast<std::uint64_t>(anchor.size()) << 16) ^
               static_cast<std::uint64_t>(held_.size() * 64 + static_cast<std::size_t>(m_));
    }

    void hold(const double* tau, const double* control) {
        for (int i = 0; i < nv_; ++i) held_[i] = tau != nullptr ? tau[i] : 0.0;
        for (int c = 0; c < of_.controls; ++c) {
            const double low = of_.ranges[2 * c], high = of_.ranges[2 * c + 1];
            held_[nv_ + c] = control != nullptr ? std::min(std::max(control[c], low), high)
                                                : std::numeric_limits<double>::quiet_NaN();
        }
    }

    Request request() {
        Request r{};
        r.zone = of_.zone, r.bridging = of_.bridging, r.tau = tau_.data(), r.safe = safe_.data();
        r.sizes = charts_[chart_]->watch.sizes, r.control_rows = CONTROL_ROWS, r.control = held_.data();
        return r;
    }

    // As many of the steps that are left as the kernel takes.
    int run(std::int64_t& left) {
        Solver& solver = charts_[chart_]->solver;
        void* own = &solver;
        const std::int64_t row = 0;
        const double* trackers = in_zone_ && !going_ ? trackers_.data() : nullptr;
        std::int32_t status = DONE;
        const Request like = request();
        Rows rows{};
        rows.count = 1, rows.which = &row, rows.step = step_, rows.t0 = &t0_, rows.at = &at_, rows.left = &left;
        rows.passed = &passed_, rows.own = &own, rows.going = &going_, rows.trackers = &trackers, rows.in_zone = &in_zone_;
        rows.status = &status, rows.limit = &limit_, rows.uneven = uneven_.data();
        rows.width = static_cast<std::int32_t>(held_.size()), rows.held = held_.data();
        rows.x = x.data(), rows.anchor = anchor.data(), rows.origin = origin.data(), rows.ydd = ydd.data();
        rows.q = q.data(), rows.v = v.data();
        RowsOf(solver, like, rows).run();
        return status;
    }

    // Goes to a configuration with velocities u in a chart; the reason where that is no start.
    int set_out(std::int32_t c, const double* from, const double* u) {
        PublicChart& chart = *charts_[c];
        const Description& d = chart.of;
        std::vector<double> state(2 * m_), point(anchor.size()), acceleration(m_), start(from, from + q.size());
        for (int k = 0; k < m_; ++k) {
            state[k] = d.independent_q[k] < 0 ? 0.0 : start[d.independent_q[k]];
            state[m_ + k] = u[k];
        }
        std::copy(start.begin(), start.end(), point.begin() + chart.layout.q);
        Request r = request();
        const double now = time();
        r.times = &now, r.x = state.data(), r.anchor = point.data(), r.ydd = acceleration.data(), r.held = held_.data();
        r.control = of_.controls > 0 ? held_.data() + nv_ : nullptr;
        chart.other.set_out(r);
        if (r.reason != DONE) return r.reason;
        chart_ = c, x = state, anchor = point, ydd = acceleration;
        std::copy(point.begin() + chart.layout.q, point.begin() + chart.layout.q + chart.layout.nq, q.begin());
        origin = q;
        std::fill(v.begin(), v.end(), 0.0);
        for (int i = 0; i < nv_; ++i)
            for (int k = 0; k < m_; ++k) v[i] += anchor[chart.layout.G + i * m_ + k] * u[k];
        limit_ = chart.watch.limit;
        std::copy(chart.watch.uneven, chart.watch.uneven + m_, uneven_.begin());
        going_ = 0, in_zone_ = r.in_zone;
        if (in_zone_) trackers_ = chart.other.clusters.written();
        return DONE;
    }

    // Takes the coordinates in which the others move least; false where none serve better.
    bool change(bool lost) {
        const std::vector<double> here = q, fast = v;
        const std::int32_t before = chart_;
        double least = lost ? std::numeric_limits<double>::infinity() : STEEPER * charts_[chart_]->steepness(G());
        std::int32_t chosen = before;
        const Kept kept = keep();
        std::vector<double> u(m_);
        const auto go = [&](std::int32_t c) {
            for (int k = 0; k < m_; ++k) u[k] = fast[charts_[c]->of.independent[k]];
            return set_out(c, here.data(), u.data()) == DONE;
        };
        for (std::int32_t c = 0; c < of_.charts; ++c)
            if (c != before && go(c) && charts_[chart_]->steepness(G()) < least) least = charts_[chart_]->steepness(G()), chosen = c;
        if (chosen != before && go(chosen)) {
            charts_[chosen]->solver.renew();
            return true;
        }
        put_back(kept);
        return false;
    }

    // Goes on in the present coordinates although others would be named better.
    void patience() {
        limit_ = std::max(PATIENCE * limit_, PATIENCE * charts_[chart_]->steepness(G()));
        for (double& u : uneven_) u *= PATIENCE;
    }

    struct Kept {
        std::vector<double> x, anchor, origin, ydd, q, v, uneven;
        std::int32_t chart, going, in_zone;
        double limit;
    };
    Kept keep() const { return {x, anchor, origin, ydd, q, v, uneven_, chart_, going_, in_zone_, limit_}; }
    void put_back(const Kept& k) {
        x = k.x, anchor = k.anchor, origin = k.origin, ydd = k.ydd, q = k.q, v = k.v, uneven_ = k.uneven;
        chart_ = k.chart, going_ = k.going, in_zone_ = k.in_zone, limit_ = k.limit;
    }

    const Exported& of_;
    const int nv_, m_;
    std::vector<std::unique_ptr<PublicChart>> charts_;
    std::vector<double> tau_, safe_, held_, uneven_, trackers_;
    double t0_ = 0.0, step_ = 0.0, limit_ = 0.0;
    std::int64_t at_ = 0, passed_ = 0;
    std::int32_t chart_ = 0, going_ = 0, in_zone_ = 0;
    bool begun_ = false;
    char why_[240] = "";
};

}  // namespace rg
