// What ends the search for a point of a mode, thrown.
#pragma once

namespace rg {

// Newton left the mode; a smaller step may help.
struct Lost {};
// No certified bridge exists here; a shorter one may.
struct NoBridge {
    bool tangential = false;  // the modes part at higher than second order
};
// A place that Python has to judge.
struct Stop {};

}  // namespace rg
