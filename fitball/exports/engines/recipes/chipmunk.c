/* cc game.c -lchipmunk -lm */
#include <chipmunk/chipmunk.h>

static cpSpace *space;
static cpBody *ball;

static void make(void)
{
    space = cpSpaceNew();
    cpSpaceSetGravity(space, cpv(0, -9.81));
    ball = cpSpaceAddBody(space, cpBodyNew(@mass@, @inertia@));
    cpBodySetPosition(ball, cpv(0, 1));
    cpShape *shape = cpSpaceAddShape(space, cpCircleShapeNew(ball, @radius@, cpvzero));
    cpShapeSetElasticity(shape, @e@);
    cpShapeSetFriction(shape, @mu@);
    /* Both coefficients are products: a court that is left alone has 0. */
    cpBody *ground = cpSpaceGetStaticBody(space);
    cpShape *court = cpSegmentShapeNew(ground, cpv(-50, -1), cpv(50, -1), 1);
    cpSpaceAddShape(space, court);
    cpShapeSetElasticity(court, 1);
    cpShapeSetFriction(court, 1);
}
/* 60 times a second: cpSpaceStep(space, 1.0 / 60.0) */
