/*
@head@
 *
 * Self-test: cc -DFITBALL_SELF_TEST -x c bounce.h -lm && ./a.out
 * C99 and C++11. All names begin with fitball_ or FITBALL_; those that end in an underscore are internal.
 *
@licence@
 */
#ifndef FITBALL_BOUNCE_
#define FITBALL_BOUNCE_
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#ifndef FITBALL_QUIET
#include <stdio.h>
#endif

#ifdef __cplusplus
#define FITBALL_MAKE_(type, ...) type{__VA_ARGS__}
#define FITBALL_EMPTY_ {}
#else
#define FITBALL_MAKE_(type, ...) ((type){__VA_ARGS__})
#define FITBALL_EMPTY_ {0}
#endif

/* Kernels that are expanded where they are called: a rebound then takes half the time. */
#if defined(__GNUC__)
#define FITBALL_EXPANDED_ static inline __attribute__((always_inline))
#elif defined(_MSC_VER)
#define FITBALL_EXPANDED_ static __forceinline
#else
#define FITBALL_EXPANDED_ static inline
#endif

@structs@

@constants@

#define FITBALL_@name@ (FITBALL_LEVELS_[@place@])

@functions@

#ifdef FITBALL_SELF_TEST
#include <stdio.h>
int main(void)
{
    double worst = fitball_self_test();
    printf("@impacts@ golden impacts, largest relative difference %.1e: %s\n", worst,
           worst <= @tolerance@ ? "passed" : "FAILED");
    return worst <= @tolerance@ ? 0 : 1;
}
#endif
#endif
