#include "linalg/memory.h"

namespace rg {

void* take(std::size_t bytes, bool aligned) {
    if (budget != nullptr) return budget->take(bytes);
    void* p = nullptr;
    if (aligned ? posix_memalign(&p, CACHE_LINE, bytes) != 0 : (p = std::malloc(bytes > 0 ? bytes : 1)) == nullptr)
        throw std::bad_alloc();
    return p;
}

void give(void* p) noexcept {
    if (budget != nullptr && budget->holds(p))
        budget->give(p);
    else
        std::free(p);
}

}  // namespace rg

// Every `new` of the library, and no other's: the names stay inside.
void* operator new(std::size_t bytes) { return rg::take(bytes, false); }
void operator delete(void* p) noexcept { rg::give(p); }
void operator delete(void* p, std::size_t) noexcept { rg::give(p); }
void* operator new(std::size_t bytes, std::align_val_t) { return rg::take(bytes, true); }
void operator delete(void* p, std::align_val_t) noexcept { rg::give(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { rg::give(p); }
