// What a joint is: its kind, its numbers in q, its velocities, where they take its frame, and Pinocchio's
// type of it. A new kind is added here, and in mechanism/tree/joints.py, which counts the kinds alike.
#pragma once

#include <cmath>
#include <cstdint>

#include "linalg/spatial.h"

namespace rg {

// Joints whose motion subspace is constant in their own frame. Revolute and prismatic joints are about or along z:
// the caller turns the frames.
enum Kind : std::int32_t { REVOLUTE, PRISMATIC, CONTINUOUS, SPHERICAL, TRANSLATION, FREE_FLYER, PLANAR };

// One velocity of a joint: a column of the joint's axes, turning about it or sliding along it.
struct Freedom {
    int column = 2;
    bool turning = true;
};

struct Numbers {
    int q, v;  // how many
    Freedom freedoms[6];
};

constexpr bool SLIDES = false, TURNS = true;

constexpr Numbers NUMBERS[] = {
    {1, 1, {{2, TURNS}}},
    {1, 1, {{2, SLIDES}}},
    {2, 1, {{2, TURNS}}},
    {4, 3, {{0, TURNS}, {1, TURNS}, {2, TURNS}}},
    {3, 3, {{0, SLIDES}, {1, SLIDES}, {2, SLIDES}}},
    {7, 6, {{0, SLIDES}, {1, SLIDES}, {2, SLIDES}, {0, TURNS}, {1, TURNS}, {2, TURNS}}},
    {4, 3, {{0, SLIDES}, {1, SLIDES}, {2, TURNS}}},
};

inline bool is_revolute(int kind) { return kind == REVOLUTE || kind == CONTINUOUS; }

// The joint's axes, from those of its place on the parent, `base`; its origin r is shifted from there.
template <typename T>
AxesOf<T> moved(int kind, const T* q, const AxesOf<T>& base, VecOf<T>& r) {
    switch (kind) {
        case REVOLUTE: return base.about_z(std::cos(q[0]), std::sin(q[0]));
        case PRISMATIC: r += q[0] * base.z; return base;
        case CONTINUOUS: return base.about_z(q[0], q[1]);
        case SPHERICAL: return base.turn(axes_of_quaternion(q));
        case TRANSLATION: r += base.turn(VecOf<T>{q[0], q[1], q[2]}); return base;
        case FREE_FLYER:
            r += base.turn(VecOf<T>{q[0], q[1], q[2]});
            return base.turn(axes_of_quaternion(q + 3));
        default:  // PLANAR
            r += base.turn(VecOf<T>{q[0], q[1], 0});
            return base.about_z(q[2], q[3]);
    }
}

}  // namespace rg
