// Arrays that share no cache line with anything else: two threads with a workspace each would otherwise
// slow each other down where small arrays of both lie side by side.
#pragma once

#include <cmath>
#include <cstddef>
#include <new>
#include <vector>

#include "linalg/memory.h"

namespace rg {

template <typename T>
struct OwnLines {
    using value_type = T;

    OwnLines() = default;
    template <typename U>
    OwnLines(const OwnLines<U>&) {}

    T* allocate(std::size_t n) {
        const std::size_t lines = (n * sizeof(T) + CACHE_LINE - 1) / CACHE_LINE;
        return static_cast<T*>(::operator new(lines * CACHE_LINE, std::align_val_t{CACHE_LINE}));
    }
    void deallocate(T* p, std::size_t) { ::operator delete(p, std::align_val_t{CACHE_LINE}); }

    bool operator==(const OwnLines&) const { return true; }
    bool operator!=(const OwnLines&) const { return false; }
};

template <typename T>
using Cells = std::vector<T, OwnLines<T>>;

// Whether no number of many is infinite or no number: 0 times each adds up to zero, in two sums.
inline bool all_finite(const double* x, std::size_t count) {
    typedef double Pair __attribute__((vector_size(16), aligned(8), may_alias));
    Pair first = {0.0, 0.0}, second = {0.0, 0.0};
    std::size_t i = 0;
    for (; i + 4 <= count; i += 4) {
        first += 0.0 * *reinterpret_cast<const Pair*>(x + i);
        second += 0.0 * *reinterpret_cast<const Pair*>(x + i + 2);
    }
    first += second;
    double rest = first[0] + first[1];
    for (; i < count; ++i) rest += 0.0 * x[i];
    return rest == 0.0;
}

// The larger magnitude of both; keeps a NaN.
inline void keep(double& worst, double value) {
    const double magnitude = std::fabs(value);
    if (!(magnitude <= worst)) worst = magnitude;
}

}  // namespace rg
