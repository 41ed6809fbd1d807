const engine = {
    gravity: (g) => havok.HP_World_SetGravity(world, [0, -g, 0]),
    put(y, vX, vY, omega) {
        havok.HP_Body_SetQTransform(ball, [[0, y, 0], [0, 0, 0, 1]]);
        havok.HP_Body_SetLinearVelocity(ball, [vX, -vY, 0]);
        havok.HP_Body_SetAngularVelocity(ball, [0, 0, -omega]);
    },
    step(dt) {
        havok.HP_World_Step(world, dt);
    },
    look() {
        const [, [place]] = havok.HP_Body_GetQTransform(ball);
        const [, velocity] = havok.HP_Body_GetLinearVelocity(ball);
        const [, spin] = havok.HP_Body_GetAngularVelocity(ball);
        return [place[1], velocity[0], velocity[1], -spin[2]];
    },
};
