// Eigen's arrays, which lie where those of the library do.
#pragma once

#include <Eigen/Core>
#include <cstring>

#include "linalg/memory.h"

namespace Eigen {
namespace internal {

template <>
inline void* conditional_aligned_malloc<true>(std::size_t bytes) {
    return rg::take(bytes, false);
}
template <>
inline void conditional_aligned_free<true>(void* p) {
    rg::give(p);
}
template <>
inline void* conditional_aligned_realloc<true>(void* p, std::size_t bytes, std::size_t before) {
    void* const moved = rg::take(bytes, false);
    if (p != nullptr) std::memcpy(moved, p, before < bytes ? before : bytes);
    rg::give(p);
    return moved;
}

}  // namespace internal
}  // namespace Eigen
