/* How often 4000 steps, begun, prepared and saved, ask the system for memory: counting FILE.rgcp BYTES. glibc. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

#include "robust_gcp.h"

extern void* __libc_malloc(size_t);
extern void* __libc_calloc(size_t, size_t);
extern void* __libc_realloc(void*, size_t);
extern void* __libc_memalign(size_t, size_t);
static volatile long counted = 0;

void* malloc(size_t size) { return ++counted, __libc_malloc(size); }
void* calloc(size_t count, size_t size) { return ++counted, __libc_calloc(count, size); }
void* realloc(void* p, size_t size) { return ++counted, __libc_realloc(p, size); }
void* aligned_alloc(size_t to, size_t size) { return ++counted, __libc_memalign(to, size); }
void* memalign(size_t to, size_t size) { return ++counted, __libc_memalign(to, size); }
int posix_memalign(void** p, size_t to, size_t size) {
    ++counted, *p = __libc_memalign(to, size);
    return *p == NULL ? ENOMEM : 0;
}

int main(int count, char** words) {
    char why[300] = "";
    static char state[1 << 16];
    if (count < 3) return 2;
    rgcp_mechanism* mechanism = rgcp_open(words[1], why, sizeof why);
    rgcp_motion* motion = mechanism == NULL ? NULL : rgcp_new_within(mechanism, (size_t)atol(words[2]), why, sizeof why);
    if (motion == NULL) return fprintf(stderr, "%s\n", why), 1;
    const long before = counted;
    int bad = rgcp_begin(motion, NULL, NULL, 0.0) != RGCP_OK || rgcp_prepare(motion) != RGCP_OK;
    for (int k = 0; k < 4000 && !bad; ++k) {
        bad = rgcp_step(motion, 1e-3, 1, NULL, NULL) != RGCP_OK;
        if (k % 100 == 0) bad = bad || rgcp_save(motion, state, sizeof state) != RGCP_OK;
    }
    if (bad) return fprintf(stderr, "%s\n", rgcp_why(motion)), 1;
    printf("%ld %ld\n", counted - before, (long)rgcp_crossings(motion));
    rgcp_free(motion);
    rgcp_close(mechanism);
    return 0;
}
