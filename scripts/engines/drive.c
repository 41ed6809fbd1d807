/* Runs the recipe above: `impacts` or `rest` and numbers as arguments of standard input, answers as
   drive.py has them. */
#include <stdio.h>
#include <string.h>

static void put(double y, double v_x, double v_y, double omega)
{
    cpBodySetPosition(ball, cpv(0, y));
    cpBodySetVelocity(ball, cpv(v_x, -v_y));
    cpBodySetAngularVelocity(ball, -omega);
}

static void impacts(double dt, double radius)
{
    double v_x, v_y, omega, share;
    int first = 1;
    cpSpaceSetGravity(space, cpvzero);
    while (scanf("%lf %lf %lf %lf", &v_x, &v_y, &omega, &share) == 4) {
        /* A step apart, so that the engine forgets the contact before. */
        put(1, 0, 0, 0);
        cpSpaceStep(space, dt);
        put(radius + v_y * dt * (3 + share), v_x, v_y, omega);
        for (int k = 0; k < 10; k++)
            cpSpaceStep(space, dt);
        cpVect v = cpBodyGetVelocity(ball);
        printf("%s[%.17g,%.17g,%.17g]", first ? "[" : ",", v.x, v.y, -cpBodyGetAngularVelocity(ball));
        first = 0;
    }
    printf("]\n");
}

static void rest(double dt, double radius)
{
    double height, seconds, most[5] = {-1, 1, 0, 0, 0};
    if (scanf("%lf %lf", &height, &seconds) != 2)
        return;
    int count = (int)(seconds / dt + 0.5);
    put(height + radius, 0, 0, 0);
    for (int k = 0; k < count; k++) {
        cpSpaceStep(space, dt);
        if (k < 0.9 * count)
            continue;
        cpVect v = cpBodyGetVelocity(ball);
        double y = cpBodyGetPosition(ball).y - radius, omega = cpBodyGetAngularVelocity(ball);
        most[0] = cpfmax(most[0], y);
        most[1] = cpfmin(most[1], y);
        most[2] = cpfmax(most[2], cpfabs(v.x));
        most[3] = cpfmax(most[3], cpfabs(v.y));
        most[4] = cpfmax(most[4], cpfabs(omega));
    }
    printf("[%g,%g,%g,%g,%g]\n", most[0], most[1], most[2], most[3], most[4]);
}

int main(void)
{
    char kind[16];
    double hertz, radius;
    if (scanf("%15s %lf %lf", kind, &hertz, &radius) != 3)
        return 1;
    make();
    (strcmp(kind, "rest") ? impacts : rest)(1 / hertz, radius);
    return 0;
}
