/* What stands before the equations: the macro TF_VARIANT tells apart the builds of them for different
   processors, and none of their functions is seen outside of the library. After every #include: what
   those declare has to stay visible. */

#ifndef TF_VARIANT
#define TF_VARIANT _ordinary
#endif
#define TF_JOIN2(a, b) a##b
#define TF_JOIN(a, b) TF_JOIN2(a, b)
#if defined(__GNUC__) && !defined(_WIN32)
#pragma GCC visibility push(hidden)
#endif
