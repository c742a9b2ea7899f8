/* Definitions before the equations. The macro TF_VARIANT distinguishes the builds for different
   processors. The functions are hidden outside the library. This text must come after every #include,
   because included declarations must stay visible. */

#ifndef TF_VARIANT
#define TF_VARIANT _ordinary
#endif
#define TF_JOIN2(a, b) a##b
#define TF_JOIN(a, b) TF_JOIN2(a, b)
#if defined(__GNUC__) && !defined(_WIN32)
#pragma GCC visibility push(hidden)
#endif
