// Arrays that share no cache line with anything else: two threads with a workspace each would otherwise
// slow each other down where small arrays of both lie side by side.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace rg {

constexpr std::size_t CACHE_LINE = 64;

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

}  // namespace rg
