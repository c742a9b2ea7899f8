/* Declarations of the programs of the plan, which model.c defines, and a list for each processor variant.
   TF_PROGRAMS lists their names; the macro TF_VARIANT is their suffix. */

#define TF_ARGUMENTS (const double*, const double*, const double*, const double*, double*)
#define TF_DECLARE(name) void tf_run_##name##_ordinary TF_ARGUMENTS;
#define TF_ORDINARY(name) tf_run_##name##_ordinary,
#define TF_DECLARE_FAST(name) void tf_run_##name##_fast TF_ARGUMENTS;
#define TF_QUICK(name) tf_run_##name##_fast,
#if defined(__GNUC__) && !defined(_WIN32)
#pragma GCC visibility push(hidden)
#endif
TF_PROGRAMS(TF_DECLARE)
#ifdef TF_FAST
TF_PROGRAMS(TF_DECLARE_FAST)
#endif
#if defined(__GNUC__) && !defined(_WIN32)
#pragma GCC visibility pop
#endif
