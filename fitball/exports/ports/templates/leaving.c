/* The status of a ball that moves away from the surface, which is said once. FITBALL_QUIET says nothing. */
static inline int64_t fitball_leaving_(double v_y)
{
#ifdef FITBALL_QUIET
    (void)v_y;
#else
    static bool said = false;
    if (!said)
        fprintf(stderr, "bounce.h: v_y1 = %g m/s: the ball moves away from the surface, status 6. "
                "v_y1 is positive towards the surface, and velocities are those before the solver.\n", v_y);
    said = true;
#endif
    return FITBALL_NO_IMPACT_;
}