// The shortest line between two points round a sphere or a cylinder: see mechanism/actuation/wrapping.py.
#pragma once

#include <algorithm>
#include <cmath>

#include "linalg/spatial.h"

namespace rg {

struct Flat {
    double x = 0.0, y = 0.0;
};

inline double dot(const Flat& a, const Flat& b) { return a.x * b.x + a.y * b.y; }
inline double turn(const Flat& a, const Flat& b) { return a.x * b.y - a.y * b.x; }
inline double apart(const Flat& a, const Flat& b) { return std::hypot(b.x - a.x, b.y - a.y); }

struct Wrapped {
    bool some = false;
    Vec first, last;
    double length = 0.0;
};

struct OnCircle {
    bool some = false;
    Flat first, last;
    double arc = 0.0;
};

constexpr double TINY = 1e-15;

inline bool between(const Flat& p, const Flat& a, const Flat& b) {
    const double whole = turn(a, b);
    return turn(a, p) * whole > 0.0 && turn(p, b) * whole > 0.0;
}

inline OnCircle round_circle(const Flat& a, const Flat& b, double radius, const Flat* side) {
    const double aa = dot(a, a), bb = dot(b, b), square = radius * radius;
    const Flat d{b.x - a.x, b.y - a.y};
    const double dd = dot(d, d);
    if (std::min(aa, bb) < square || radius < TINY || dd < TINY) return {};
    const bool around = side != nullptr && between(*side, {-a.x, -a.y}, {-b.x, -b.y});
    const double share = std::min(std::max(-dot(d, a) / dd, 0.0), 1.0);
    const Flat nearest{a.x + share * d.x, a.y + share * d.y};
    if (dot(nearest, nearest) > square && !around) return {};
    const double way = (turn(a, b) < 0.0) != around ? 1.0 : -1.0;
    const double before = way * radius * std::sqrt(aa - square), after = way * radius * std::sqrt(bb - square);
    OnCircle found;
    found.some = true;
    found.first = {(a.x * square + before * a.y) / aa, (a.y * square - before * a.x) / aa};
    found.last = {(b.x * square - after * b.y) / bb, (b.y * square + after * b.x) / bb};
    double angle = std::acos(std::min(std::max(dot(found.first, found.last) / square, -1.0), 1.0));
    if (-turn(found.first, found.last) * way < 0.0) angle = 2.0 * M_PI - angle;
    found.arc = radius * angle;
    return found;
}

// Sine of the angle at which a line from the distance `far`, at the angle x, meets the radius; and its slope.
inline double bending(double x, double far, double radius, double& slope) {
    const double square = far * far + radius * radius - 2.0 * far * radius * std::cos(x), sine = far * std::sin(x);
    slope = (far * std::cos(x) - sine * sine * radius / square) / std::sqrt(square);
    return sine / std::sqrt(square);
}

inline OnCircle through_circle(const Flat& a, const Flat& b, double radius) {
    const double la = std::sqrt(dot(a, a)), lb = std::sqrt(dot(b, b));
    const Flat d{b.x - a.x, b.y - a.y};
    if (std::min(la, lb) <= radius || radius < TINY) return {};
    const double dd = dot(d, d);
    if (dd > TINY) {
        const double share = -dot(d, a) / dd;
        if (share > 0.0 && share < 1.0 && std::hypot(a.x + share * d.x, a.y + share * d.y) <= radius) return {};
    }
    const double G = std::acos(std::min(std::max(dot(a, b) / (la * lb), -1.0), 1.0));
    if (M_PI - G < 1e-12) return {};
    double low = std::max(0.0, G - std::acos(radius / lb)), high = std::min(G, std::acos(radius / la));
    double x = 0.5 * (low + high);
    for (int i = 0; i < 60; ++i) {
        double slope, back;
        const double f = bending(x, la, radius, slope) - bending(G - x, lb, radius, back);
        (f < 0.0 ? low : high) = x;
        const double step = slope + back > 0.0 ? -f / (slope + back) : 0.0;
        const double next = step != 0.0 && low < x + step && x + step < high ? x + step : 0.5 * (low + high);
        if (std::fabs(next - x) <= 1e-16 * (1.0 + G)) break;
        x = next;
    }
    const double way = turn(a, b) > 0.0 ? 1.0 : -1.0, c = radius * std::cos(x) / la, s = way * radius * std::sin(x) / la;
    OnCircle found;
    found.some = true;
    found.first = found.last = {c * a.x - s * a.y, c * a.y + s * a.x};
    return found;
}

// Orthonormal axes of the plane of two points and the origin, the first along `a`.
inline void plane_of(const Vec& a, const Vec& b, Vec plane[2]) {
    plane[0] = (1.0 / std::sqrt(dot(a, a))) * a;
    Vec normal = cross(a, b);
    if (std::sqrt(dot(normal, normal)) < TINY) {  // on one line: any plane through it
        const Vec size{std::fabs(plane[0].x), std::fabs(plane[0].y), std::fabs(plane[0].z)};
        Vec other{1.0, 1.0, 1.0};
        other[size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2] = 0.0;
        normal = cross(plane[0], other);
    }
    const Vec second = cross(normal, plane[0]);
    plane[1] = (1.0 / std::sqrt(dot(second, second))) * second;
}

inline Wrapped wrapped(const Vec& start, const Vec& end, const Vec& centre, const Axes& R, double radius, bool cylinder,
                       const Vec* side) {
    const Vec a = R.local(start - centre), b = R.local(end - centre);
    if (std::min(dot(a, a), dot(b, b)) < TINY * TINY) return {};
    Vec plane[2] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}};
    if (!cylinder) plane_of(a, b, plane);
    const auto flat = [&](const Vec& p) { return Flat{dot(plane[0], p), dot(plane[1], p)}; };
    const Flat flat_a = flat(a), flat_b = flat(b);
    Flat toward;
    bool inside = false;
    if (side != nullptr) {
        const Vec local = R.local(*side - centre);
        inside = dot(local, local) < radius * radius;
        toward = flat(local);
        const double size = std::sqrt(dot(toward, toward));
        toward = size > TINY ? Flat{toward.x / size * radius, toward.y / size * radius} : Flat{radius, 0.0};
    }
    const OnCircle found = inside ? through_circle(flat_a, flat_b, radius)
                                  : round_circle(flat_a, flat_b, radius, side != nullptr ? &toward : nullptr);
    if (!found.some) return {};
    Vec one = found.first.x * plane[0] + found.first.y * plane[1];
    Vec two = found.last.x * plane[0] + found.last.y * plane[1];
    double arc = found.arc;
    if (cylinder) {
        const double before = apart(flat_a, found.first), after = apart(flat_b, found.last);
        const double climb = (b.z - a.z) / (before + arc + after);
        one.z = a.z + climb * before;
        two.z = a.z + climb * (before + arc);
        arc = std::hypot(arc, two.z - one.z);
    }
    return {true, centre + R.turn(one), centre + R.turn(two), arc};
}

}  // namespace rg
