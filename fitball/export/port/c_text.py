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
    @@Bounce solved = @@THE_KERNEL(row, codes, v_x1, v_y1, omega_1, THE_COR, scratch);
    if (solved.status != 0) {
        static const int64_t rigid[] = {RIGID_LIST};
        solved = @@THE_KERNEL(row, rigid, v_x1, v_y1, omega_1, THE_COR, scratch);
        found.extrapolated = @UP@WITHOUT_TWIST;
    }
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
    if (k.f0 != 0) {
        const double push = (1.0 + THE_COR) * v_y1, inertia = row[9] / (row[7] * row[8] * row[8]);
        const double stop = (v_x1 - row[8] * omega_1) * inertia / (1.0 + inertia), limit = row[3] * push;
        const double lost = @@min_real(@@max_real(stop, -limit), limit);
        found.v_x2 = v_x1 - lost;
        found.v_y2 = THE_COR * v_y1;
        found.omega_2 = omega_1 + lost / (inertia * row[8]);
        found.regime = stop > limit ? 1 : stop < -limit ? 2 : 3;
        found.status = 0;
        found.extrapolated = @UP@WITHOUT_TWIST;
    }
""",
}

# What becomes of the restitution that a model is told.
CLAMP_COR = """
    if (!isfinite(cor)) {
        return bad;
    }
    const double told = cor;
    cor = @@min_real(@@max_real(told, COR_LOW_END), COR_HIGH_END);
    extrapolated |= cor != told ? @UP@BEYOND_RESTITUTION : 0;
"""

FACE = """
/* Rebound: speeds [m/s], spin [rad/s], contact time [s] (NaN for a model without one), phases packed (three bits
   each, first phase lowest). `status` is 0, or says why the numbers are NaN: see @@reason. `extrapolated` is 0 where
   the model is used as it was fitted, else a sum of
   - @UP@BEYOND_SPEEDS: v_y1 lies outside of the valid range. Restitution and offset stay what they are at its nearer
     end; the rest is computed (all speeds and spins of a bounce scale together then).
   - @UP@BEYOND_RESTITUTION: the cor that was given lies outside of what the model solves, and was taken as its end.
   - @UP@WITHOUT_TWIST: the model has no solution for this impact; the ball is taken as rigid, sliding or rolling. */
typedef struct { double v_x2, v_y2, omega_2, contact_time; int64_t regime; int status, extrapolated; } @@rebound_t;

#define @UP@BAD_INPUT (-1)
#define @UP@BEYOND_SPEEDS 1
#define @UP@BEYOND_RESTITUTION 2
#define @UP@WITHOUT_TWIST 4

RANGE_COMMENT
#define @UP@V_Y1_LOW VALID_LOW
#define @UP@V_Y1_HIGH VALID_HIGH
#define @UP@CALIBRATED_V_Y1_LOW CALIBRATED_LOW
#define @UP@CALIBRATED_V_Y1_HIGH CALIBRATED_HIGH

/* The fitted model as it is. */
static inline @@rebound_t @@solve(double v_x1, double v_y1, double omega_1COR_PARAMETER)
{
    /* The fitted parameter set and the ball, SI. */
    double row[] = {
PARAMETER_ROW
    };
    @@rebound_t found = {NAN, NAN, NAN, NAN, 0, @UP@BAD_INPUT, 0};
CALL_THE_KERNEL
    return found;
}

/* The rebound of any impact with finite numbers and v_y1 >= 0; v_x1 is along the court in the direction of travel. A
   ball that flies the other way is its mirror image: give -v_x1 and -omega_1, and turn v_x2 and omega_2 round. */
static inline @@rebound_t @@rebound(double v_x1, double v_y1, double omega_1COR_PARAMETER)
{
    const @@rebound_t bad = {NAN, NAN, NAN, NAN, 0, @UP@BAD_INPUT, 0};
    if (!isfinite(v_x1) || !isfinite(v_y1) || !isfinite(omega_1) || !(v_y1 >= 0.0)) {
        return bad;
    }
    int extrapolated = 0;
CLAMP_COR
    const double at_end = @@min_real(@@max_real(v_y1, @UP@V_Y1_LOW), @UP@V_Y1_HIGH);
    const double scale = v_y1 / at_end;
    const double moving = fabs(v_x1) + BALL_RADIUS * fabs(omega_1);
    /* So slow towards the court that friction changes nothing else. */
    const bool grazes = v_y1 <= @@max_real(GRAZING_SHARE * moving, TINY_SPEED);
    extrapolated |= scale != 1.0 ? @UP@BEYOND_SPEEDS : 0;
    @@rebound_t found = grazes ? @@solve(0.0, at_end, 0.0COR_ARGUMENT)
                               : @@solve(v_x1 / scale, at_end, omega_1 / scaleCOR_ARGUMENT);
    found.v_x2 = grazes ? v_x1 : found.v_x2 * scale;
    found.v_y2 *= scale;
    found.omega_2 = grazes ? omega_1 : found.omega_2 * scale;
    found.regime = grazes ? 0 : found.regime;
    found.extrapolated |= extrapolated;
    /* Numbers too large to be squared or scaled. */
    return isfinite(found.v_x2) && isfinite(found.v_y2) && isfinite(found.omega_2) ? found : bad;
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
    case @UP@BAD_INPUT: return "expected finite numbers, and v_y1 >= 0 towards the court";
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
