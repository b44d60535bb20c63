/* Each step's time, the least of some runs of one motion, in memory taken beforehand: latency FILE.rgcp [STEPS]. POSIX. */
#include "seconds.h"

#include <stdio.h>
#include <stdlib.h>

#include "robust_gcp.h"

enum { RUNS = 10 };

int main(int count, char** words) {
    char why[300] = "";
    if (count < 2) return fprintf(stderr, "usage: latency FILE.rgcp [STEPS]\n"), 2;
    const long n = count > 2 ? atol(words[2]) : 10000;
    double* least = malloc((size_t)n * sizeof *least);
    rgcp_mechanism* linkage = rgcp_open(words[1], why, sizeof why);
    if (linkage == NULL || least == NULL) return fprintf(stderr, "%s: %s\n", words[1], why), 1;
    size_t used = 0;
    long crossings = 0;
    for (int run = 0; run < RUNS; ++run) {
        rgcp_motion* motion = rgcp_new_within(linkage, 4u << 20, why, sizeof why);
        if (motion == NULL) return fprintf(stderr, "%s: %s\n", words[1], why), 1;
        if (rgcp_begin(motion, NULL, NULL, 0.0) != RGCP_OK || rgcp_prepare(motion) != RGCP_OK)
            return fprintf(stderr, "%s\n", rgcp_why(motion)), 1;
        for (long k = 0; k < n; ++k) {
            const double start = seconds();
            if (rgcp_step(motion, 1e-3, 1, NULL, NULL) != RGCP_OK) return fprintf(stderr, "%s\n", rgcp_why(motion)), 1;
            const double taken = seconds() - start;
            if (run == 0 || taken < least[k]) least[k] = taken;
        }
        used = rgcp_used(motion), crossings = (long)rgcp_crossings(motion);
        rgcp_free(motion);
    }
    double sum = 0.0, worst = 0.0;
    for (long k = 0; k < n; ++k) sum += least[k], worst = least[k] > worst ? least[k] : worst;
    printf("%ld steps through %ld crossings in %zu bytes\n", n, crossings, used);
    printf("a step: mean %.2f us, worst %.2f us, %.1f times\n", 1e6 * sum / (double)n, 1e6 * worst, worst * (double)n / sum);
    rgcp_close(linkage);
    free(least);
    return 0;
}
