// q = γ(y), G and g as the product of the clusters' own maps; see maps/cluster/cluster_map.py.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "abi.h"
#include "path/path.h"

namespace rg {

class Series;

// A step between two accepted outputs, with ÿ at its ends, and y and ẏ within where that is known better.
struct Step {
    double t0, t1;
    Point *before, *after;
    const double *ydd0, *ydd1;
    const Series* solved = nullptr;
};

constexpr double SAME_PLACE = 1e-6;  // as in regular_ground.py

class Clusters {
  public:
    Clusters(const Description& d, Path& path);
    ~Clusters();

    // Whether the kernel follows the clusters at all.
    bool some() const { return some_; }
    bool in_zone() const { return in_zone_; }
    // The same as a request tells it: 2 on a bridge.
    std::int32_t place() const { return in_zone_ ? 1 + on_bridge() : 0; }
    // Whether a cluster is on a bridge; `turning`: one with joints on groups, whose coordinates are not renewed.
    bool on_bridge(bool turning = false) const;
    // Whether a singular place may have been passed since the last step that was looked through.
    bool met() const;
    std::int64_t zone_evaluations = 0;

    void use(const Bridging& options);
    // On regular ground from now on.
    void leave() { in_zone_ = false; }
    // Every cluster by itself from now on, from a point of the mode; `origin` as in `Path::step`.
    void enter(Point& anchor, const double* origin);
    // What was met so far was told of.
    void forget();
    // Builds bridges that lie both ways of where every cluster is by itself; see explore.h.
    void explore();
    bool turning_on_bridge() const { return on_bridge(true); }
    // At an output, where charts are about it now: coordinates anew of clusters that are in charts, or whose joints
    // have turned far from what these are about.
    void settle(Point& accepted);
    // As if nothing had been done.
    void renew();
    // The point at y, where the regular path was not good enough from the anchor; ZONE or ROWS where Python has to say
    // what to do, REFUSED where nothing is to be done at that distance. `origin` as in `Path::step`.
    Reason at(Point& anchor, const double* origin, const double* y, const double* ydot, Point& point, double zone);
    // Appends what a step passed, in the order of time: time, cluster, corank, closure, transversality, whether
    // it is a near miss, q.
    void passed(const Step& step, std::vector<double>& log);
    // The state of all trackers as plain numbers, and back; with what was counted since.
    std::vector<double> written() const;
    void read(const double* numbers);
    // What rounding costs of G beside singular places without a bridge.
    void rounding(Request& r) const;
    void count(Request& r) const;
    void count_anew();

  private:
    struct Inside;

    bool some_, in_zone_ = false;
    Path& path_;
    std::unique_ptr<Inside> inside_;
};

}  // namespace rg
