/* A loop of 1 kHz with a linkage in it, and its jitter: loop FILE.rgcp [SECONDS]. POSIX. */
#include "seconds.h"

#include <stdio.h>
#include <stdlib.h>

#include "robust_gcp.h"

int main(int count, char** words) {
    char why[300] = "";
    if (count < 2) return fprintf(stderr, "usage: loop FILE.rgcp [SECONDS]\n"), 2;
    const long n = (long)(1000.0 * (count > 2 ? atof(words[2]) : 5.0));
    rgcp_mechanism* linkage = rgcp_open(words[1], why, sizeof why);
    rgcp_motion* motion = linkage == NULL ? NULL : rgcp_new(linkage, why, sizeof why);
    if (motion == NULL) return fprintf(stderr, "%s: %s\n", words[1], why), 1;
    if (rgcp_begin(motion, NULL, NULL, 0.0) != RGCP_OK) return fprintf(stderr, "%s\n", rgcp_why(motion)), 1;
    double late = 0.0, longest = 0.0, sum = 0.0;
    const double begun = seconds();
    for (long k = 0; k < n; ++k) {
        const double due = begun + 1e-3 * (double)k;
        for (double now = seconds(); now < due; now = seconds()) {
            const struct timespec rest = {0, (long)(1e9 * (due - now))};
            nanosleep(&rest, NULL);
        }
        const double start = seconds();
        if (rgcp_step(motion, 1e-3, 1, NULL, NULL) != RGCP_OK) return fprintf(stderr, "%s\n", rgcp_why(motion)), 1;
        const double taken = seconds() - start;
        if (start - due > late) late = start - due;
        if (taken > longest) longest = taken;
        sum += taken;
    }
    printf("%ld steps through %ld crossings\n", n, (long)rgcp_crossings(motion));
    printf("a step: mean %.1f us, longest %.1f us; latest start %.1f us\n", 1e6 * sum / (double)n, 1e6 * longest, 1e6 * late);
    rgcp_free(motion);
    rgcp_close(linkage);
    return 0;
}
