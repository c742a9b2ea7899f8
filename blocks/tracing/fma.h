/* fma(a, b, c) is a * b + c rounded once. Where the processor has no such instruction C's function is a
   hundred times as slow: there it is rounded twice, in simulations and FMUs alike. */

#include <math.h>

#if !defined(FP_FAST_FMA) && !defined(__FMA__) && !defined(__aarch64__)
#define fma(a, b, c) ((a) * (b) + (c))
#endif

