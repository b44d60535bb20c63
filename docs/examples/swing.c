/* A four-bar linkage for five seconds, through singular configurations: swing FILE.rgcp */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "robust_gcp.h"

int main(int count, char** words) {
    char why[300] = "";
    if (count != 2) return fprintf(stderr, "usage: swing FILE.rgcp\n"), 2;
    rgcp_mechanism* linkage = rgcp_open(words[1], why, sizeof why);
    if (linkage == NULL) return fprintf(stderr, "%s: %s\n", words[1], why), 1;
    const rgcp_counts n = rgcp_count(linkage);
    rgcp_motion* motion = rgcp_new(linkage, why, sizeof why);
    if (motion == NULL) return fprintf(stderr, "%s\n", why), 1;
    printf("%d joints, %d independent\n", (int)n.nv, (int)n.m);
    if (rgcp_begin(motion, NULL, NULL, 0.0) != RGCP_OK) return fprintf(stderr, "%s\n", rgcp_why(motion)), 1;
    for (int second = 1; second <= 5; ++second) {
        if (rgcp_step(motion, 1e-3, 1000, NULL, NULL) != RGCP_OK)
            return fprintf(stderr, "%s\n", rgcp_why(motion)), 1;
        double* M = malloc((size_t)(n.m * n.m + n.m) * sizeof *M);
        if (M == NULL || rgcp_reduced(motion, M, M + n.m * n.m) != RGCP_OK) return 1;
        printf("t = %.0f s: reduced inertia %.6f kg m^2\n", rgcp_time(motion), M[0]);
        free(M);
    }
    printf("q1 = %.12f rad after %ld crossings\n", rgcp_q(motion)[0], (long)rgcp_crossings(motion));
    rgcp_free(motion);
    rgcp_close(linkage);
    return 0;
}
