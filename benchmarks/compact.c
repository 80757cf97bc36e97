/* The arithmetic alone: the compact form on separate component arrays short enough for the first cache,
 * with -ffast-math so that gcc vectorises it (tan from libmvec). Nothing here can ship: it tests for nothing,
 * and -ffast-math deletes tests for NaN. It tells what the formula costs when memory costs nothing.
 */
#include <math.h>

enum { COUNT = 256 };

static void once(const double *restrict in, double *restrict out)
{
    enum { n = COUNT };
    const double *a = in, *b = in + n, *c = in + 2 * n, *x = in + 3 * n, *y = in + 4 * n, *z = in + 5 * n;
    const double *chi = in + 6 * n;
    for (long i = 0; i < n; ++i) {
        double r0 = x[i] - a[i], r1 = y[i] - b[i], r2 = z[i] - c[i];
        double m0 = x[i] + a[i], m1 = y[i] + b[i], m2 = z[i] + c[i];
        double kappa = 1 / tan(0.5 * chi[i]), square = m0 * m0 + m1 * m1 + m2 * m2;
        double under = square - kappa * kappa * (r0 * r0 + r1 * r1 + r2 * r2);
        double inverse = 1 / square, along = sqrt(under > 0 ? under : 0) * inverse, across = kappa * inverse;
        double n0 = across * (m1 * r2 - m2 * r1), n1 = across * (m2 * r0 - m0 * r2);
        double n2 = across * (m0 * r1 - m1 * r0);
        out[i] = n0 + along * m0, out[i + n] = n1 + along * m1, out[i + 2 * n] = n2 + along * m2;
        out[i + 3 * n] = n0 - along * m0, out[i + 4 * n] = n1 - along * m1, out[i + 5 * n] = n2 - along * m2;
    }
}

void compact(long repeats, const double *in, double *out)
{
    for (long i = 0; i < repeats; ++i) {
        once(in, out);
        __asm__ volatile("" ::: "memory"); /* or the compiler would do it once */
    }
}
