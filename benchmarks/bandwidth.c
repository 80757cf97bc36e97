/* What this machine's memory allows: STREAM's triad, and the traffic of solve_axis without its arithmetic.
 *
 * A plain store reads the line it is about to overwrite, so the bus carries a third more than STREAM counts;
 * a non-temporal store does not. Every function returns 0, or 1 where this machine has no such store.
 */
#include <stddef.h>

#if defined(__AVX512F__)
#include <immintrin.h>
#define WIDTH 8
typedef __m512d pack;
#define LOAD _mm512_loadu_pd
#define STORE _mm512_storeu_pd
#define STREAM _mm512_stream_pd
#elif defined(__AVX__)
#include <immintrin.h>
#define WIDTH 4
typedef __m256d pack;
#define LOAD _mm256_loadu_pd
#define STORE _mm256_storeu_pd
#define STREAM _mm256_stream_pd
#elif defined(__SSE2__)
#include <emmintrin.h>
#define WIDTH 2
typedef __m128d pack;
#define LOAD _mm_loadu_pd
#define STORE _mm_storeu_pd
#define STREAM _mm_stream_pd
#endif

int triad(double *restrict a, const double *restrict b, const double *restrict c, double s, ptrdiff_t n)
{
    for (ptrdiff_t i = 0; i < n; ++i) a[i] = b[i] + s * c[i];
    return 0;
}

#ifdef WIDTH

int triad_streaming(double *restrict a, const double *restrict b, const double *restrict c, double s, ptrdiff_t n)
{
    for (ptrdiff_t i = 0; i + WIDTH <= n; i += WIDTH) STREAM(a + i, LOAD(b + i) + s * LOAD(c + i));
    _mm_sfence();
    return 0;
}

/* 64 solves a step: 3 x 64 and 3 x 64 and 64 numbers in, 6 x 64 numbers and 64 bytes (8 numbers' worth) out. */
#define TRAFFIC(NAME, PUT)                                                                                   \
    int NAME(const double *restrict rho, const double *restrict rho_prime, const double *restrict angle,     \
             double *restrict axes, double *restrict status, ptrdiff_t n)                                    \
    {                                                                                                        \
        for (ptrdiff_t i = 0; i + 64 <= n; i += 64) {                                                        \
            for (int k = 0; k < 192; k += WIDTH) {                                                           \
                pack x = LOAD(rho + 3 * i + k), y = LOAD(rho_prime + 3 * i + k);                             \
                PUT(axes + 6 * i + 2 * k, x + y);                                                            \
                PUT(axes + 6 * i + 2 * k + WIDTH, x - y);                                                    \
            }                                                                                                \
            for (int k = 0; k < 8; k += WIDTH) {                                                             \
                pack sum = LOAD(angle + i + k);                                                              \
                for (int j = 8; j < 64; j += 8) sum += LOAD(angle + i + j + k);                              \
                PUT(status + i / 8 + k, sum);                                                                \
            }                                                                                                \
        }                                                                                                    \
        _mm_sfence();                                                                                        \
        return 0;                                                                                            \
    }
TRAFFIC(traffic, STORE)
TRAFFIC(traffic_streaming, STREAM)

#else

int triad_streaming(double *a, const double *b, const double *c, double s, ptrdiff_t n)
{
    (void)a, (void)b, (void)c, (void)s, (void)n;
    return 1;
}
int traffic(const double *rho, const double *rho_prime, const double *angle, double *axes, double *status, ptrdiff_t n)
{
    (void)rho, (void)rho_prime, (void)angle, (void)axes, (void)status, (void)n;
    return 1;
}
int traffic_streaming(const double *rho, const double *rho_prime, const double *angle, double *axes, double *status,
                      ptrdiff_t n)
{
    return traffic(rho, rho_prime, angle, axes, status, n);
}

#endif
