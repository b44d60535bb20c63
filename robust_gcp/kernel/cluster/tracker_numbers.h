// The state of a tracker as plain numbers, for Python to go on from, and back; see maps/cluster/tracker_numbers.py. An array is
// its rows, its columns, and its numbers column by column.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "cluster/patch.h"

namespace rg {

class Writer {
  public:
    std::vector<double> numbers;

    void tracker(const Tracker& t) {
        std::vector<CurvePtr> curves = t.known_curves.curves;
        const auto place = [&curves](const CurvePtr& one) {
            const auto at = static_cast<std::size_t>(std::find(curves.begin(), curves.end(), one) - curves.begin());
            if (at == curves.size()) curves.push_back(one);
            return static_cast<double>(at);
        };
        const double used = t.curve ? place(t.curve) : -1.0;
        std::vector<double> touched;
        for (const CurvePtr& one : t.touched)
            if (one->shape().space == t.anchor->space) touched.push_back(place(one));  // others were told of
        number(t.u), number(t.zone), jet(*t.anchor);
        array(t.known_curves.ahead), number(t.known_curves.unlooked);
        number(static_cast<double>(t.known_curves.misses.size()));
        for (const KnownCurves::Miss& one : t.known_curves.misses) array(one.x), number(one.since);
        number(static_cast<double>(curves.size()));
        number(used);
        list(touched);
        for (const CurvePtr& one : curves) curve(*one);
        number(t.patch ? 1.0 : 0.0);
        if (t.patch) t.patch->write(*this);
    }

    void number(double x) { numbers.push_back(x); }

    void array(const Matrix& values) {
        number(static_cast<double>(values.rows()));
        number(static_cast<double>(values.cols()));
        numbers.insert(numbers.end(), values.data(), values.data() + values.size());
    }

    template <typename T>
    void list(const std::vector<T>& values) {
        Matrix column(static_cast<Eigen::Index>(values.size()), 1);
        for (std::size_t i = 0; i < values.size(); ++i)
            column(static_cast<Eigen::Index>(i), 0) = static_cast<double>(values[i]);
        array(column);
    }

    void jet(const Jet& j) {
        array(j.x), array(*j.C), array(j.J), array(j.bend), array(*j.P);
        number(j.sigma()), number(j.solved ? 1.0 : 0.0);
    }

  private:
    void curve(const Curve& c) {
        const CurveShape& s = c.shape();
        array(*s.C), array(s.reference), array(c.shift());
        list(s.through.us);
        for (const JetPtr& node : s.through.nodes) jet(*node);
        number(s.left), number(s.right);
        list(s.roots), list(s.corank);
        number(s.closure), number(s.transversality), number(s.error), number(s.near_miss ? 1.0 : 0.0);
        list(s.orders);
        array(s.inside ? s.series.table() : Matrix(0, 1));
    }
};

class Reader {
  public:
    Reader(const double* numbers, const BridgeOptions& options, Tally& tally)
        : at_(numbers), options_(options), tally_(tally) {}

    Tracker tracker(Space& space) {
        const double u = number(), zone = number();
        Tracker made(jet(space), options_, zone, tally_);
        made.u = u;
        made.known_curves.ahead = array(), made.known_curves.unlooked = number();
        for (int i = static_cast<int>(number()); i > 0; --i) {
            const Vector at = array();
            made.known_curves.misses.push_back({at, number()});
        }
        const int count = static_cast<int>(number()), used = static_cast<int>(number());
        const std::vector<double> touched = list();
        for (int i = 0; i < count; ++i) made.known_curves.curves.push_back(curve(space));
        if (used >= 0) made.curve = made.known_curves.curves[static_cast<std::size_t>(used)];
        if (number() != 0.0) made.patch = std::make_shared<Patch>(Patch::read(*this, space));
        made.touched_patch = made.patch;
        made.crossed = !touched.empty();
        for (const double at : touched) made.touched.push_back(made.known_curves.curves[static_cast<std::size_t>(at)]);
        return made;
    }

    double number() { return *at_++; }

    Matrix array() {
        const auto rows = static_cast<Eigen::Index>(number()), columns = static_cast<Eigen::Index>(number());
        Matrix values = Eigen::Map<const Matrix>(at_, rows, columns);
        at_ += rows * columns;
        return values;
    }

    std::vector<double> list() {
        const Matrix values = array();
        return {values.data(), values.data() + values.size()};
    }

    JetPtr jet(Space& space) {
        auto made = std::make_shared<Jet>();
        made->space = &space;
        made->x = array();
        const Matrix C = array();
        made->C = C == *space.chart ? space.chart : std::make_shared<Matrix>(C);
        made->J = array(), made->bend = array();
        made->P = std::make_shared<Matrix>(array());
        made->given = number();
        if (number() == 0.0) return made;
        Vector phi;
        Matrix K;
        space.linear(made->x, phi, K);
        const Matrix rows = determining(space, *made->P, K);
        space.factor(rows, *made->C);
        return jet_of(space, made->x, made->C, rows, made->P);
    }

  private:
    CurvePtr curve(Space& space) {
        auto made = std::make_shared<CurveShape>();
        made->space = &space;
        made->C = std::make_shared<Matrix>(array());
        made->reference = array();
        const Vector shift = array();
        const std::vector<double> us = list();
        std::vector<JetPtr> nodes;
        for (std::size_t i = 0; i < us.size(); ++i) nodes.push_back(jet(space));
        made->through = Hermite(us, nodes);
        made->left = number(), made->right = number();
        made->roots = list();
        for (const double r : list()) made->corank.push_back(static_cast<int>(r));
        made->closure = number(), made->transversality = number(), made->error = number();
        made->near_miss = number() != 0.0;
        for (const double k : list()) made->orders.push_back(static_cast<int>(k));
        const Matrix table = array();
        made->inside = table.size() > 0;
        made->series = made->inside ? Series(table, made->left, made->right)
                                    : Series(made->through, made->left, made->right);
        return std::make_shared<Curve>(made, shift);
    }

    const double* at_;
    const BridgeOptions& options_;
    Tally& tally_;
};

template <typename W>
void Patch::write(W& writer) const {
    writer.array(line_.d), writer.array(*line_.C), writer.array(origin_);
    writer.number(now_.left), writer.number(now_.right);
    writer.number(now_.closure), writer.number(now_.transversality), writer.number(now_.error);
    writer.number(now_.near_miss ? 1.0 : 0.0);
    writer.list(now_.ss);
    for (const Tracker& tracker : now_.trackers) writer.tracker(tracker);
}

template <typename R>
Patch Patch::read(R& reader, Space& space) {
    const Vector d = reader.array();
    const Matrix C = reader.array();
    const Vector origin = reader.array();
    Bridged now;
    now.left = reader.number(), now.right = reader.number();
    now.closure = reader.number(), now.transversality = reader.number(), now.error = reader.number();
    now.near_miss = reader.number() != 0.0;
    now.ss = reader.list();
    for (std::size_t i = 0; i < now.ss.size(); ++i) now.trackers.push_back(reader.tracker(space));
    const Chart chart = C == *space.chart ? space.chart : std::make_shared<Matrix>(C);
    return {Line(space, chart, d), origin, now};
}

}  // namespace rg
