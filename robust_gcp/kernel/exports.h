// What the functions that Python calls have in common.
#pragma once

#include <cstdint>
#include <cstring>
#include <exception>

#include "abi.h"

#define RG_EXPORT extern "C" __attribute__((visibility("default")))

namespace rg {

// A workspace for a mechanism, or null with the reason in `why`.
template <typename Workspace>
void* made(const Description& description, char* why, std::int32_t length) {
    try {
        return new Workspace(description);
    } catch (const std::exception& error) {
        std::strncpy(why, error.what(), static_cast<std::size_t>(length) - 1);
        return nullptr;
    }
}

}  // namespace rg
