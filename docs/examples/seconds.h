/* The clock of the examples, s; to be included first. POSIX. */
#define _POSIX_C_SOURCE 200809L
#include <time.h>

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
