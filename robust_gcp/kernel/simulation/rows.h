// Many motions of one mechanism under torques that are held, a row of numbers each; see kernel/simulation/rows.py.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "simulation/solver.h"

namespace rg {

class RowsOf {
  public:
    RowsOf(Solver& shared, const Request& like, Rows& rows)
        : shared_(shared), like_(like), rows_(rows), layout_(shared.path.layout), n_(2 * layout_.m) {
        before_.resize(static_cast<std::size_t>(n_ + layout_.size + layout_.nq + layout_.m));
    }

    void run() {
        for (std::int64_t k = 0; k < rows_.count; ++k) one(rows_.which[k]);
    }

  private:
    void one(std::int64_t i) {
        Solver* const own = static_cast<Solver*>(rows_.own[i]);
        Solver& solver = own != nullptr ? *own : shared_;
        const std::int64_t steps = rows_.left[i];
        times_.resize(static_cast<std::size_t>(steps + 1));
        for (std::int64_t j = 0; j <= steps; ++j)
            times_[j] = rows_.t0[i] + rows_.step * static_cast<double>(rows_.at[i] + j);
        Request r = like_;
        r.x = rows_.x + i * n_;
        r.anchor = rows_.anchor + i * layout_.size;
        r.origin = rows_.origin + i * layout_.nq;
        r.ydd = rows_.ydd + i * layout_.m;
        r.held = rows_.held + i * rows_.width;
        r.control = rows_.width > layout_.nv ? r.held + layout_.nv : nullptr;
        r.times = times_.data();
        r.limit = rows_.limit[i];
        if (r.sizes != nullptr) r.uneven = rows_.uneven + i * layout_.m;
        r.first = r.steps = 0;
        r.trackers = rows_.trackers[i];
        r.beginning = rows_.going[i] ? GO_ON : r.trackers != nullptr ? IN_ZONE : REGULAR;
        if (own == nullptr) keep(r);
        solver.run(r);  // no step: it takes the state up
        r.beginning = TURNED;
        r.steps = steps;
        solver.run(r);
        if (own == nullptr && (r.in_zone || r.logged > 0)) {
            put_back(r);
            rows_.status[i] = ALONE;
            return;
        }
        const std::int64_t taken = std::max<std::int64_t>(r.completed, 0);
        rows_.at[i] += taken;
        rows_.left[i] = steps - taken;
        rows_.passed[i] += r.logged;
        rows_.status[i] = r.reason;
        rows_.going[i] = own != nullptr;
        rows_.in_zone[i] = r.in_zone;
        std::copy(r.anchor + layout_.q, r.anchor + layout_.q + layout_.nq, rows_.q + i * layout_.nq);
        solver.velocity(rows_.v + i * layout_.nv);
    }

    void keep(const Request& r) {
        double* to = std::copy(r.x, r.x + n_, before_.data());
        to = std::copy(r.anchor, r.anchor + layout_.size, to);
        to = std::copy(r.origin, r.origin + layout_.nq, to);
        std::copy(r.ydd, r.ydd + layout_.m, to);
    }

    void put_back(const Request& r) const {
        const double* from = before_.data();
        for (const auto& [to, count] : {std::pair(r.x, n_), std::pair(r.anchor, layout_.size),
                                        std::pair(r.origin, layout_.nq), std::pair(r.ydd, layout_.m)}) {
            std::copy(from, from + count, to);
            from += count;
        }
    }

    Solver& shared_;
    const Request& like_;
    Rows& rows_;
    const Layout& layout_;
    const int n_;
    std::vector<double> before_, times_;  // a row before its steps; the ends of these
};

}  // namespace rg
