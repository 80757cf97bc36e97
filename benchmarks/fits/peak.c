/* How many sums of products this processor's vector units make: independent chains, nothing read or written. */
#if defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX__)
#define LANES 4
#else
#define LANES 2
#endif
typedef double vec __attribute__((vector_size(8 * LANES)));
#define CHAINS 12

int lanes(void) { return LANES; }

double peak(long rounds, double factor) {
  vec x[CHAINS];
  for (int i = 0; i < CHAINS; ++i)
    for (int k = 0; k < LANES; ++k)
      x[i][k] = i + k;
  const vec f = factor - (vec){0}, one = 1.0 - (vec){0};
  for (long n = 0; n < rounds; ++n)
    _Pragma("GCC unroll 12") for (int i = 0; i < CHAINS; ++i) x[i] = x[i] * f + one;
  double sum = 0;
  for (int i = 0; i < CHAINS; ++i)
    for (int k = 0; k < LANES; ++k)
      sum += x[i][k];
  return sum;
}
