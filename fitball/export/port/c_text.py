"""The hand-written ends of a C port: helpers, what calls the kernel, the self-test. `@@` is the prefix of names."""

from __future__ import annotations

HELPERS = """
static inline double @@min_real(double a, double b) { return b < a ? b : a; }
static inline double @@max_real(double a, double b) { return b > a ? b : a; }
static inline int64_t @@min_whole(int64_t a, int64_t b) { return b < a ? b : a; }
static inline int64_t @@max_whole(int64_t a, int64_t b) { return b > a ? b : a; }
COMPLEX_HELPER
"""

# How a kernel is called, by its convention (see `models.capabilities`).
CALLS = {
    "impulse": """
    const @@tidddi_ k = @@THE_KERNEL(row, v_x1, v_y1, omega_1);
    found.status = (int)k.f0;
    found.v_x2 = k.f1;
    found.v_y2 = k.f2;
    found.omega_2 = k.f3;
    found.regime = k.f4;
""",
    "two-mass": """
    static const int64_t codes[] = {CODE_LIST};
    double function[SERIES_SIZE] = {0}, twist[SERIES_SIZE] = {0}, drive[SERIES_SIZE] = {0}, stack[STACK_SIZE] = {0};
    const @@Scratch scratch = {function, twist, drive, stack};
    const @@Bounce solved = @@THE_KERNEL(row, codes, v_x1, v_y1, omega_1, THE_COR, scratch);
    found.status = (int)solved.status;
    found.v_x2 = solved.v_x2;
    found.v_y2 = solved.v_y2;
    found.omega_2 = solved.omega_2;
    found.contact_time = solved.contact_time;
    found.regime = solved.regime;
""",
    "thesis": """
    row[4] = EPS_10 + EPS_SLOPE * (v_y1 - ANCHOR);
    const @@tiddddi_ k = @@THE_KERNEL(row, CODE_LIST, THE_COR, v_x1, v_y1, omega_1);
    found.status = (int)k.f0;
    found.v_x2 = k.f1;
    found.v_y2 = k.f2;
    found.omega_2 = k.f3;
    found.contact_time = k.f4;
    found.regime = k.f5;
""",
}

FACE = """
/* Rebound: speeds [m/s], spin [rad/s], contact time [s] (NaN for a model without one), phases packed (three bits
   each, first phase lowest). `status` is 0, or says why the numbers are NaN: see @@reason. */
typedef struct { double v_x2, v_y2, omega_2, contact_time; int64_t regime; int status; } @@rebound_t;

#define @UP@BAD_INPUT (-1)

static inline @@rebound_t @@rebound(double v_x1, double v_y1, double omega_1COR_PARAMETER)
{
    /* The fitted parameter set and the ball, SI. */
    double row[] = {
PARAMETER_ROW
    };
    @@rebound_t found = {NAN, NAN, NAN, NAN, 0, @UP@BAD_INPUT};
    if (!isfinite(v_x1) || !isfinite(v_y1) || !isfinite(omega_1) || !(v_y1 > 0.0)) {
        return found;
    }
CALL_THE_KERNEL
    return found;
}

/* The name of phase number `place` (from 0) of a packed regime, "" behind the last. */
static inline const char *@@phase(int64_t regime, int place)
{
    static const char *const names[] = {PHASE_NAMES};
    const int64_t phase = place < 0 || place > 20 ? 0 : (regime >> (3 * place)) & 7;
    return phase < (int64_t)(sizeof names / sizeof names[0]) ? names[phase] : "";
}

/* Why an impact could not be evaluated. */
static inline const char *@@reason(int status)
{
    switch (status) {
    case 0: return "";
    case @UP@BAD_INPUT: return "expected finite numbers, and v_y1 > 0 towards the court";
REASON_CASES
    default: return "unknown status";
    }
}
"""

SELF_TEST = """
#ifdef @UP@SELF_TEST
#include <stdio.h>

int main(void)
{
    static const struct { double in[4], out[4]; int64_t regime; } golden[] = {
GOLDEN_ROWS
    };
    const int count = (int)(sizeof golden / sizeof golden[0]);
    double worst = 0.0;
    bool same = true;
    for (int i = 0; i < count; ++i) {
        const double *in = golden[i].in, *out = golden[i].out;
        const @@rebound_t r = @@rebound(GOLDEN_INCIDENT);
        const double speed = sqrt(in[0] * in[0] + in[1] * in[1] + BALL_RADIUS * in[2] * BALL_RADIUS * in[2]);
        const double error[4] = {
            fabs(r.v_x2 - out[0]) / speed, fabs(r.v_y2 - out[1]) / speed,
            BALL_RADIUS * fabs(r.omega_2 - out[2]) / speed,
            isnan(out[3]) ? 0.0 : fabs(r.contact_time - out[3]) / out[3]
        };
        for (int j = 0; j < 4; ++j) {
            same = same && !isnan(error[j]);
            worst = @@max_real(worst, error[j]);
        }
        same = same && r.status == 0 && r.regime == golden[i].regime;
    }
    const bool passed = same && worst <= TOLERANCE_;
    printf("MODEL_NAME: %d golden impacts, largest relative difference %.1e: %s\\n",
           count, worst, passed ? "passed" : "FAILED");
    return passed ? 0 : 1;
}
#endif
"""
