/* fitball export FIT --to c > bounce.h && cc game.c -lchipmunk -lm */
#include <chipmunk/chipmunk.h>
#include "bounce.h"

static cpSpace *space;
static cpBody *ball;

static cpBool begin(cpArbiter *arbiter, cpSpace *of, cpDataPointer data)
{
    (void)arbiter, (void)of, (void)data;
    /* Before the solver. A positive turn of the engine is backspin of a ball that flies to +x. */
    cpVect v = cpBodyGetVelocity(ball);
    double topspin = -cpBodyGetAngularVelocity(ball);
    fitball_Rebound found = fitball_rebound(v.x, -v.y, topspin, FITBALL_BALL);
    if (found.status != 6) {
        cpBodySetVelocity(ball, cpv(found.v_x2, found.v_y2));
        cpBodySetAngularVelocity(ball, -found.omega_2);
    }
    return cpTrue;
}

static void make(void)
{
    space = cpSpaceNew();
    cpSpaceSetGravity(space, cpv(0, -9.81));
    ball = cpSpaceAddBody(space, cpBodyNew(@mass@, @inertia@));
    cpBodySetPosition(ball, cpv(0, 1));
    cpBody *ground = cpSpaceGetStaticBody(space);
    cpShape *shapes[] = {cpCircleShapeNew(ball, @radius@, cpvzero),
                         cpSegmentShapeNew(ground, cpv(-50, -1), cpv(50, -1), 1)};
    for (int k = 0; k < 2; k++) {
        cpSpaceAddShape(space, shapes[k]);
        /* The engine's own restitution is 0; its response stays on, so that the ball can rest. */
        cpShapeSetElasticity(shapes[k], 0);
        cpShapeSetFriction(shapes[k], @mu@);
        cpShapeSetCollisionType(shapes[k], 1 + k);
    }
    cpSpaceAddCollisionHandler(space, 1, 2)->beginFunc = begin;
}
/* 60 times a second: cpSpaceStep(space, 1.0 / 60.0) */
