/* Vectors of doubles whose lanes are the instances of a kernel, or runs (GCC and Clang vector extension),
   and the functions of a kernel that are worth doing in all lanes at once.

   Sine and cosine: the argument is reduced by multiples of pi/2 in three parts (Cody and Waite
   1980), and the rest, within pi/4, goes through the Taylor series. Logarithm: with
   x = 2^n m, sqrt(1/2) <= m < sqrt(2), the series of 2 artanh((m - 1)/(m + 1)). Exponential:
   reduced by multiples of ln 2 in two parts, then the Taylor series. The first terms left out
   are below 1e-17, and results within three units in the last place. A power is the exponential
   of a logarithm, whose error grows with the result's exponent: up to forty units. Arguments for
   which this does not hold are given to libm, lane by lane: what a lane shows depends on no other. */

#include <stdint.h>

#define TF_MAGIC 0x1.8p52 /* adding it rounds to an integer, which is then in the lowest bits */
#define TF_INLINE static inline __attribute__((always_inline))

/* Where the compiler has no word for it, it finds by itself that a loop is one instruction, in three times
   the time that all the rest takes. */
#ifndef __has_builtin
#define __has_builtin(name) 0
#endif
#define TF_FMA_LOOP(N) for (int i = 0; i < N; ++i) c[i] = fma(a[i], b[i], c[i])
#ifdef fma
#define TF_FMA(N) c += a * b
#elif __has_builtin(__builtin_elementwise_fma)
#define TF_FMA(N) c = __builtin_elementwise_fma(a, b, c)
#elif defined(__FMA__) && __has_builtin(__builtin_ia32_vfmaddpd256)
#define TF_FMA(N) TF_FMA_##N
#define TF_FMA_2 c = (tf_lanes2)__builtin_ia32_vfmaddpd((tf_whole2)a, (tf_whole2)b, (tf_whole2)c)
#define TF_FMA_4 c = (tf_lanes4)__builtin_ia32_vfmaddpd256((tf_whole4)a, (tf_whole4)b, (tf_whole4)c)
#ifdef __AVX512F__
#define TF_FMA_8 \
  c = (tf_lanes8)__builtin_ia32_vfmaddpd512_mask((tf_whole8)a, (tf_whole8)b, (tf_whole8)c, -1, 4)
#else
#define TF_FMA_8 TF_FMA_LOOP(8)
#endif
#else
#define TF_FMA(N) TF_FMA_LOOP(N)
#endif

/* Coefficients of the series, from the last. */
#define TF_SERIES(name, ...) static const double tf_##name[] = {__VA_ARGS__}
TF_SERIES(sine, 1.0 / 355687428096000.0, -1.0 / 1307674368000.0, 1.0 / 6227020800.0, -1.0 / 39916800,
          1.0 / 362880, -1.0 / 5040, 1.0 / 120, -1.0 / 6);
TF_SERIES(cosine, 1.0 / 20922789888000.0, -1.0 / 87178291200.0, 1.0 / 479001600.0, -1.0 / 3628800,
          1.0 / 40320, -1.0 / 720, 1.0 / 24, -0.5, 1.0);
TF_SERIES(artanh, 2.0 / 21, 2.0 / 19, 2.0 / 17, 2.0 / 15, 2.0 / 13, 2.0 / 11, 2.0 / 9, 2.0 / 7, 2.0 / 5,
          2.0 / 3);
TF_SERIES(exponential, 1.0 / 6227020800.0, 1.0 / 479001600.0, 1.0 / 39916800, 1.0 / 3628800, 1.0 / 362880,
          1.0 / 40320, 1.0 / 5040, 1.0 / 720, 1.0 / 120, 1.0 / 24, 1.0 / 6, 1.0 / 2, 1.0, 1.0);
#define TF_SUM(N, name, z) tf_##N##_series(z, tf_##name, sizeof tf_##name / sizeof *tf_##name)

/* Written out, sums of one vector do not wait for those of the vector before; Clang does so by itself. */
#ifdef __clang__
#define TF_UNROLLED
#else
#define TF_UNROLLED _Pragma("GCC unroll 16")
#endif

/* What the series cannot do is done by libm, apart: written out each time, it takes compilers longer than
   all the rest. */
typedef void (*tf_apart)(int n, const int64_t* is, const double* x, const double* a, double* y);
#define TF_APART(name, call)                                                                      \
  static __attribute__((noinline, cold, unused)) void tf_apart_##name(                            \
      int n, const int64_t* is, const double* x, const double* a, double* y) {                    \
    (void)a;                                                                                      \
    for (int i = 0; i < n; ++i) if (is[i]) y[i] = call;                                           \
  }
TF_APART(sin, sin(x[i]))
TF_APART(cos, cos(x[i]))
TF_APART(log, log(x[i]))
TF_APART(exp, exp(x[i]))
TF_APART(pow, pow(x[i], a[i]))

/* Bits are unsigned, as sums and shifts of them may wrap; but to the right the sign is shifted too. */
#define TF_FUNCTIONS(N)                                                                           \
  typedef double tf_lanes##N __attribute__((vector_size(8 * N), aligned(8), may_alias));          \
  typedef uint64_t tf_bits##N __attribute__((vector_size(8 * N), aligned(8), may_alias));         \
  typedef int64_t tf_signed##N __attribute__((vector_size(8 * N), aligned(8), may_alias));        \
  typedef double tf_whole##N __attribute__((vector_size(8 * N)));                                 \
  TF_INLINE tf_lanes##N tf_##N##_all(double x) { return x - (tf_lanes##N){0}; }                   \
  TF_INLINE tf_lanes##N tf_##N##_fma(tf_lanes##N a, tf_lanes##N b, tf_lanes##N c) {               \
    TF_FMA(N);                                                                                    \
    return c;                                                                                     \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_series(tf_lanes##N z, const double* coefficients, int count) {   \
    tf_lanes##N y = {0};                                                                          \
    TF_UNROLLED                                                                                   \
    for (int i = 0; i < count; ++i) y = tf_##N##_fma(y, z, tf_##N##_all(coefficients[i]));        \
    return y;                                                                                     \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_where(tf_signed##N is, tf_lanes##N a, tf_lanes##N b) {           \
    return (tf_lanes##N)(((tf_signed##N)a & is) | ((tf_signed##N)b & ~is));                       \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_one(tf_signed##N is) {                                           \
    return tf_##N##_where(is, tf_##N##_all(1.0), tf_##N##_all(0.0));                              \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_fabs(tf_lanes##N x) {                                            \
    return (tf_lanes##N)((tf_bits##N)x & 0x7fffffffffffffff);                                     \
  }                                                                                               \
  TF_INLINE tf_signed##N tf_##N##_outside(tf_lanes##N x, double low, double high) {               \
    return ~((x > tf_##N##_all(low)) & (x < tf_##N##_all(high)));                                 \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_mended(tf_signed##N is, tf_apart f, tf_lanes##N x,               \
                                         tf_lanes##N a, tf_lanes##N y) {                          \
    int64_t any = 0;                                                                              \
    for (int i = 0; i < N; ++i) any |= is[i];                                                     \
    if (__builtin_expect(any != 0, 0)) { /* of copies: what has an address stays in memory */     \
      tf_signed##N where = is;                                                                    \
      tf_lanes##N from = x, by = a, to = y;                                                       \
      f(N, (const int64_t*)&where, (const double*)&from, (const double*)&by, (double*)&to);       \
      return to;                                                                                  \
    }                                                                                             \
    return y;                                                                                     \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_quarter(tf_lanes##N x, uint64_t shift) {                         \
    tf_lanes##N n = x * 0x1.45f306dc9c883p-1 + TF_MAGIC;                                          \
    tf_bits##N quadrant = (tf_bits##N)n + shift;                                                  \
    n -= TF_MAGIC;                                                                                \
    tf_lanes##N r = (x - n * 0x1.921fb544p+0) - n * 0x1.0b4611a4p-34;                             \
    r = tf_##N##_fma(-n, tf_##N##_all(0x1.13198a2e03707p-65), r);                                 \
    tf_lanes##N z = r * r;                                                                        \
    tf_lanes##N s = tf_##N##_fma(r * z, TF_SUM(N, sine, z), r), c = TF_SUM(N, cosine, z);         \
    tf_bits##N odd = -(quadrant & 1);                                                             \
    tf_bits##N chosen = ((tf_bits##N)s & ~odd) | ((tf_bits##N)c & odd);                           \
    return (tf_lanes##N)(chosen ^ ((quadrant & 2) << 62));                                        \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_sin(tf_lanes##N x) {                                             \
    tf_lanes##N y = tf_##N##_quarter(x, 0);                                                       \
    tf_signed##N other = tf_##N##_outside(x, -1e5, 1e5);                                          \
    return tf_##N##_mended(other, tf_apart_sin, x, x, y);                                         \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_cos(tf_lanes##N x) {                                             \
    tf_lanes##N y = tf_##N##_quarter(x, 1);                                                       \
    tf_signed##N other = tf_##N##_outside(x, -1e5, 1e5);                                          \
    return tf_##N##_mended(other, tf_apart_cos, x, x, y);                                         \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_log_inside(tf_lanes##N x) {                                      \
    const uint64_t half = 0x3fe6a09e667f3bcd; /* sqrt(1/2) */                                     \
    tf_signed##N n = (tf_signed##N)((tf_bits##N)x - half) >> 52;                                  \
    tf_lanes##N m = (tf_lanes##N)((tf_bits##N)x - ((tf_bits##N)n << 52));                         \
    tf_lanes##N power = (tf_lanes##N)(n + 0x4338000000000000) - TF_MAGIC;                         \
    tf_lanes##N s = (m - 1.0) / (m + 1.0), z = s * s;                                             \
    tf_lanes##N tail = s * z * TF_SUM(N, artanh, z);                                              \
    return power * 0x1.62e42fefa3800p-1 + (2.0 * s + (tail + power * 0x1.ef35793c76730p-45));     \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_exp_inside(tf_lanes##N x) {                                      \
    tf_lanes##N n = x * 0x1.71547652b82fep+0 + TF_MAGIC;                                          \
    tf_bits##N power = (tf_bits##N)n << 52;                                                       \
    n -= TF_MAGIC;                                                                                \
    tf_lanes##N r = (x - n * 0x1.62e42fefa3800p-1) - n * 0x1.ef35793c76730p-45;                   \
    return (tf_lanes##N)((tf_bits##N)TF_SUM(N, exponential, r) + power);                          \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_log(tf_lanes##N x) {                                             \
    tf_lanes##N y = tf_##N##_log_inside(x);                                                       \
    tf_signed##N other = tf_##N##_outside(x, 1e-300, 1e300);                                      \
    return tf_##N##_mended(other, tf_apart_log, x, x, y);                                         \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_exp(tf_lanes##N x) {                                             \
    tf_lanes##N y = tf_##N##_exp_inside(x);                                                       \
    tf_signed##N other = tf_##N##_outside(x, -700.0, 700.0);                                      \
    return tf_##N##_mended(other, tf_apart_exp, x, x, y);                                         \
  }                                                                                               \
  TF_INLINE tf_lanes##N tf_##N##_pow(tf_lanes##N x, tf_lanes##N a) {                              \
    tf_lanes##N z = a * tf_##N##_log_inside(x);                                                   \
    tf_lanes##N y = tf_##N##_exp_inside(z);                                                       \
    tf_signed##N other = tf_##N##_outside(x, 1e-300, 1e300) | tf_##N##_outside(z, -20.0, 20.0);   \
    return tf_##N##_mended(other, tf_apart_pow, x, a, y);                                         \
  }

TF_FUNCTIONS(2)
TF_FUNCTIONS(4)
