// Steps on the groups of joints: q ⊕ w, and the rate of w for which q ⊕ w moves with a given velocity.
// Velocities are in the joint's own axes, as Pinocchio's are.
#pragma once

#include <cmath>

#include "tree/joints.h"
#include "linalg/spatial.h"

namespace rg {

struct Twist {
    Vec linear, angular;
};

inline Twist operator+(const Twist& a, const Twist& b) { return {a.linear + b.linear, a.angular + b.angular}; }
inline Twist operator*(double s, const Twist& a) { return {s * a.linear, s * a.angular}; }
inline Twist& operator+=(Twist& a, const Twist& b) { return a = a + b; }

// [w, v] of se(3).
inline Twist bracket(const Twist& w, const Twist& v) {
    return {cross(w.angular, v.linear) + cross(w.linear, v.angular), cross(w.angular, v.angular)};
}

// (sin x)/x, (1 − cos x)/x² and (x − sin x)/x³ at x² = s.
struct Exponential {
    double sine, versine, third;

    explicit Exponential(double s) {
        if (s < 0.04) {
            sine = 1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0))));
            versine = 0.5 * (1.0 - s / 12.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0))));
            third = (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))) / 6.0;
            return;
        }
        const double x = std::sqrt(s);
        sine = std::sin(x) / x;
        const double half = std::sin(0.5 * x);
        versine = 2.0 * half * half / s;
        third = (1.0 - sine) / s;
    }
};

// dexp⁻¹(w) v = v + ½ [w, v] + a [w, [w, v]] + b [w, [w, [w, [w, v]]]]: all there is, since ad_w has the
// eigenvalues 0 and ±iθ, these twice; a and b from (θ/2) cot(θ/2) = 1 − aθ² + bθ⁴ and its derivative.
// (Iserles, Munthe-Kaas, Nørsett, Zanna, Lie-group methods, Acta Numerica 9, 2000, section 3.)
inline Twist velocity_in_chart(const Twist& w, const Twist& v) {
    const double s = dot(w.angular, w.angular);
    double a, b;
    if (s < 0.3) {  // Σ |B₂ₖ|/(2k)! sᵏ: terms fall by 4π² each
        constexpr double c[] = {1.0 / 12.0,          1.0 / 720.0,         1.0 / 30240.0,
                                1.0 / 1209600.0,     1.0 / 47900160.0,    691.0 / 1307674368000.0,
                                1.0 / 74724249600.0, 3617.0 / 10670622842880000.0};
        a = b = 0.0;
        double power = 1.0;  // s^(k−2)
        for (int k = 2; k <= 8; ++k) {
            b -= (k - 1) * c[k - 1] * power;
            power *= s;
            a -= (k - 2) * c[k - 1] * power;
        }
        a += c[0];
    } else {
        const double half = 0.5 * std::sqrt(s), sine = std::sin(half), cot = std::cos(half) / sine;
        const double value = half * cot, slope = 0.125 * (cot / half - 1.0 / (sine * sine));
        b = (s * slope - value + 1.0) / (s * s);
        a = 2.0 * b * s - slope;
    }
    const Twist one = bracket(w, v), two = bracket(w, one);
    return v + 0.5 * one + a * two + b * bracket(w, bracket(w, two));
}

// A joint's entries of v as a motion of its body, and back.
inline Twist twist_of(int kind, const double* v) {
    Twist twist;
    const Numbers& numbers = NUMBERS[kind];
    for (int i = 0; i < numbers.v; ++i) {
        const Freedom& freedom = numbers.freedoms[i];
        (freedom.turning ? twist.angular : twist.linear)[freedom.column] = v[i];
    }
    return twist;
}

inline void entries_of(int kind, const Twist& twist, double* v) {
    const Numbers& numbers = NUMBERS[kind];
    for (int i = 0; i < numbers.v; ++i) {
        const Freedom& freedom = numbers.freedoms[i];
        v[i] = (freedom.turning ? twist.angular : twist.linear)[freedom.column];
    }
}

// ẇ for which q ⊕ w moves with the velocity v.
inline void rate_in_chart(int kind, const double* w, const double* v, double* rate) {
    entries_of(kind, velocity_in_chart(twist_of(kind, w), twist_of(kind, v)), rate);
}

// ẅ for which q ⊕ w moves with the velocity v and the acceleration a, by the terms of dexp⁻¹ to the second order
// in w: the next ones, of the fourth, have the factor 1/720.
inline void bend_in_chart(int kind, const double* w, const double* rate, const double* v, const double* a, double* bend) {
    const Twist at = twist_of(kind, w), turning = twist_of(kind, rate), velocity = twist_of(kind, v);
    const Twist one = bracket(turning, velocity),
                two = bracket(turning, bracket(at, velocity)) + bracket(at, one);
    entries_of(kind, velocity_in_chart(at, twist_of(kind, a)) + 0.5 * one + (1.0 / 12.0) * two, bend);
}

// The unit quaternion q exp(w), normalised to first order, as rounding drifts.
inline void turn_quaternion(const double* q, const Vec& w, double* moved) {
    const double s = 0.25 * dot(w, w);
    const Exponential half(s);
    const Vec d = 0.5 * half.sine * w;
    const double c = 1.0 - s * half.versine;
    const double x = q[0], y = q[1], z = q[2], e = q[3];
    double r[4] = {e * d.x + x * c + y * d.z - z * d.y, e * d.y + y * c + z * d.x - x * d.z,
                   e * d.z + z * c + x * d.y - y * d.x, e * c - x * d.x - y * d.y - z * d.z};
    const double fit = 0.5 * (3.0 - (r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]));
    for (int i = 0; i < 4; ++i) moved[i] = fit * r[i];
}

// The unit complex number (cos, sin) turned by an angle.
inline void turn_circle(const double* q, double angle, double* moved) {
    const double c = std::cos(angle), s = std::sin(angle);
    const double x = c * q[0] - s * q[1], y = s * q[0] + c * q[1];
    const double fit = 0.5 * (3.0 - (x * x + y * y));
    moved[0] = fit * x;
    moved[1] = fit * y;
}

// q ⊕ w of one joint; `moved` may be q.
inline void integrate_joint(int kind, const double* q, const double* w, double* moved) {
    switch (kind) {
        case REVOLUTE:
        case PRISMATIC: moved[0] = q[0] + w[0]; return;
        case CONTINUOUS: turn_circle(q, w[0], moved); return;
        case SPHERICAL: turn_quaternion(q, {w[0], w[1], w[2]}, moved); return;
        case TRANSLATION:
            for (int i = 0; i < 3; ++i) moved[i] = q[i] + w[i];
            return;
        default: break;
    }
    const Twist step = twist_of(kind, w);
    const Vec& turn = step.angular;
    const Exponential e(dot(turn, turn));
    const Vec across = cross(turn, step.linear);
    const Vec slide = step.linear + e.versine * across + e.third * cross(turn, across);
    if (kind == PLANAR) {
        moved[0] = q[0] + q[2] * slide.x - q[3] * slide.y;
        moved[1] = q[1] + q[3] * slide.x + q[2] * slide.y;
        turn_circle(q + 2, turn.z, moved + 2);
        return;
    }
    const Vec there = axes_of_quaternion(q + 3).turn(slide);
    for (int i = 0; i < 3; ++i) moved[i] = q[i] + there[i];
    turn_quaternion(q + 3, turn, moved + 3);
}

// w for which the unit quaternion q exp(w) is another, up to its sign.
inline Vec quaternion_difference(const double* q, const double* other) {
    const Vec a{q[0], q[1], q[2]}, b{other[0], other[1], other[2]};
    Vec d = q[3] * b - other[3] * a - cross(a, b);
    double c = q[3] * other[3] + dot(a, b);
    if (c < 0.0) {
        d = -1.0 * d;
        c = -c;
    }
    const double s = std::sqrt(dot(d, d));
    return (s > 0.0 ? 2.0 * std::atan2(s, c) / s : 2.0) * d;
}

// w of one joint with q ⊕ w = another q.
inline void joint_difference(int kind, const double* q, const double* other, double* w) {
    const auto turn_of_circle = [&](int at) {
        const double x = q[at], y = q[at + 1], c = other[at], s = other[at + 1];
        return std::atan2(x * s - y * c, x * c + y * s);
    };
    Twist apart;
    switch (kind) {
        case REVOLUTE:
        case PRISMATIC: w[0] = other[0] - q[0]; return;
        case CONTINUOUS: w[0] = turn_of_circle(0); return;
        case TRANSLATION:
            for (int i = 0; i < 3; ++i) w[i] = other[i] - q[i];
            return;
        case SPHERICAL: apart.angular = quaternion_difference(q, other); return entries_of(kind, apart, w);
        default: break;
    }
    const double x = other[0] - q[0], y = other[1] - q[1];
    Vec slide;
    if (kind == PLANAR) {
        apart.angular.z = turn_of_circle(2);
        slide = {q[2] * x + q[3] * y, q[2] * y - q[3] * x, 0.0};
    } else {
        const Axes axes = axes_of_quaternion(q + 3);
        const Vec there{x, y, other[2] - q[2]};
        apart.angular = quaternion_difference(q + 3, other + 3);
        slide = {dot(axes.x, there), dot(axes.y, there), dot(axes.z, there)};
    }
    // the slide that turning with it makes of it, which `integrate_joint` has
    apart.linear = velocity_in_chart({{}, -1.0 * apart.angular}, {slide, {}}).linear;
    entries_of(kind, apart, w);
}

}  // namespace rg
