/* fma(a, b, c) is a * b + c rounded once. Where the processor has no such instruction C's function is a
   hundred times as slow: there it is rounded twice, in simulations and FMUs alike. */

#include <math.h>
#include <stdint.h>
#include <string.h>

#if !defined(FP_FAST_FMA) && !defined(__FMA__) && !defined(__aarch64__)
#define fma(a, b, c) ((a) * (b) + (c))
#endif

/* -x, of bits: so compilers do not see that it is -x. */
static inline double tf_minus(double x) {
  uint64_t bits;
  memcpy(&bits, &x, sizeof bits);
  bits ^= (uint64_t)1 << 63;
  memcpy(&x, &bits, sizeof bits);
  return x;
}
