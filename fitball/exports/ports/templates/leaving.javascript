/** The status of a ball that moves away from the surface, which is said once by `Bounce.warn`: not a place to call the port from. */
function leaving_(v_y) {
    const said = offered.warn;
    offered.warn = null;
    if (said) said(`Bounce: v_y1 = ${v_y} m/s: the ball moves away from the surface, status 6. v_y1 is positive towards the surface, and velocities are those before the solver.`);
    return NO_IMPACT_;
}