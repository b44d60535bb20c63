// Every `new` of the library, and no other's: the names stay inside.
#include "linalg/memory.h"

void* operator new(std::size_t bytes) { return rg::take(bytes, false); }
void operator delete(void* p) noexcept { rg::give(p); }
void operator delete(void* p, std::size_t) noexcept { rg::give(p); }
void* operator new(std::size_t bytes, std::align_val_t) { return rg::take(bytes, true); }
void operator delete(void* p, std::align_val_t) noexcept { rg::give(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { rg::give(p); }
