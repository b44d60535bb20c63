// Vectors and frames in space: what the kinematics of a chain of joints needs, and nothing else.
#pragma once

#include <cmath>

namespace rg {

template <typename T>
struct VecOf {
    T x = 0, y = 0, z = 0;

    T operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }
    T& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }

    friend VecOf operator+(const VecOf& a, const VecOf& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend VecOf operator-(const VecOf& a, const VecOf& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend VecOf operator*(T s, const VecOf& a) { return {s * a.x, s * a.y, s * a.z}; }
    friend VecOf& operator+=(VecOf& a, const VecOf& b) { return a = a + b; }
    friend T dot(const VecOf& a, const VecOf& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
    friend VecOf cross(const VecOf& a, const VecOf& b) {
        return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    }
};

using Vec = VecOf<double>;

// ω × (ω × r) without the outer product: ω (ω · r) − ω² r.
inline Vec centripetal(const Vec& omega, const Vec& r) {
    return dot(omega, r) * omega - dot(omega, omega) * r;
}

// A rotation by its columns: the axes of a body, seen from the world.
template <typename T>
struct AxesOf {
    VecOf<T> x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};

    const VecOf<T>& operator[](int column) const { return column == 0 ? x : column == 1 ? y : z; }
    VecOf<T> turn(const VecOf<T>& r) const { return r.x * x + r.y * y + r.z * z; }
    VecOf<T> local(const VecOf<T>& r) const { return {dot(x, r), dot(y, r), dot(z, r)}; }
    AxesOf turn(const AxesOf& a) const { return {turn(a.x), turn(a.y), turn(a.z)}; }
    // These axes turned about their own z by an angle with this cosine and sine.
    AxesOf about_z(T c, T s) const { return {c * x + s * y, c * y - s * x, z}; }
};

using Axes = AxesOf<double>;

// From a unit quaternion (x, y, z, w).
template <typename T>
AxesOf<T> axes_of_quaternion(const T* q) {
    const T x = q[0], y = q[1], z = q[2], w = q[3];
    return {{1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)},
            {2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)},
            {2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)}};
}

}  // namespace rg
