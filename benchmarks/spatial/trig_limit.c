/* The arithmetic of A cos t + B sin t + D = 0 alone: both angles by two arc tangents and a root, on arrays short enough
 * for the first cache, with -ffast-math so that gcc vectorises it (atan2 from libmvec). Nothing here can ship: it tests
 * for nothing, has no status and no scale, and -ffast-math deletes tests for NaN.
 */
#include <math.h>

enum { COUNT = 256 };

static void once(const double *restrict in, double *restrict out)
{
    enum { n = COUNT };
    const double *a = in, *b = in + n, *d = in + 2 * n;
    for (long i = 0; i < n; ++i) {
        double square = a[i] * a[i] + b[i] * b[i] - d[i] * d[i], w = sqrt(square > 0 ? square : 0);
        out[i] = atan2(a[i] * w - b[i] * d[i], -a[i] * d[i] - b[i] * w);
        out[i + n] = atan2(-a[i] * w - b[i] * d[i], b[i] * w - a[i] * d[i]);
    }
}

void trig_limit(long repeats, const double *in, double *out)
{
    for (long i = 0; i < repeats; ++i) {
        once(in, out);
        __asm__ volatile("" ::: "memory"); /* or the compiler would do it once */
    }
}
