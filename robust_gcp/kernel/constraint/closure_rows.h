// What a closure is made of: its cut points, the rows of φ, and the velocities that enter them.
#pragma once

#include <cstddef>
#include <vector>

#include "linalg/spatial.h"

namespace rg {

// A velocity that moves the two cut points against each other.
struct Lever {
    int joint, v, column;
    bool turning;
    int side;  // 0: moves the first point, 1: the second
};

struct Term {  // of a rotation row: w (u · n), u fixed in body 1 and n in body 2; of a row along n: n
    double w;
    Vec u, n;
    std::size_t first, second;  // which of the loop's directions in body 1 and 2 these are
};

// Rows that are along no world axis: of rotation, and of position along n fixed in body 2.
enum Sort { ROTATION = -1, ALONG = -2 };

struct Row {
    int axis;  // world axis of a position row, or one of Sort
    double weight;
    std::vector<Term> terms;
};

struct Loop {  // one closure: its two cut points
    int joint[2];
    Vec point[2], arm[2], at[2];
    std::vector<Vec> fixed[2], turned[2];  // directions that rows ask for: in the bodies, and as they are
    std::vector<Lever> levers;
    int first_row = 0, rows = 0;
};

}  // namespace rg
