// Vectors and frames in space: what the kinematics of a chain of joints needs, and nothing else.
#pragma once

#include <cmath>

namespace rg {

struct Vec {
    double x = 0.0, y = 0.0, z = 0.0;

    double operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }
    double& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
};

inline Vec operator+(const Vec& a, const Vec& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec operator-(const Vec& a, const Vec& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec operator*(double s, const Vec& a) { return {s * a.x, s * a.y, s * a.z}; }
inline Vec& operator+=(Vec& a, const Vec& b) { return a = a + b; }
inline double dot(const Vec& a, const Vec& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec cross(const Vec& a, const Vec& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// ω × (ω × r) without the outer product: ω (ω · r) − ω² r.
inline Vec centripetal(const Vec& omega, const Vec& r) {
    return dot(omega, r) * omega - dot(omega, omega) * r;
}

// A rotation by its columns: the axes of a body, seen from the world.
struct Axes {
    Vec x{1.0, 0.0, 0.0}, y{0.0, 1.0, 0.0}, z{0.0, 0.0, 1.0};

    const Vec& operator[](int column) const { return column == 0 ? x : column == 1 ? y : z; }
    Vec turn(const Vec& r) const { return r.x * x + r.y * y + r.z * z; }
    Vec local(const Vec& r) const { return {dot(x, r), dot(y, r), dot(z, r)}; }
    Axes turn(const Axes& a) const { return {turn(a.x), turn(a.y), turn(a.z)}; }
    // These axes turned about their own z by an angle with this cosine and sine.
    Axes about_z(double c, double s) const { return {c * x + s * y, c * y - s * x, z}; }
};

// From a unit quaternion (x, y, z, w).
inline Axes axes_of_quaternion(const double* q) {
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    return {{1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)},
            {2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)},
            {2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)}};
}

}  // namespace rg
