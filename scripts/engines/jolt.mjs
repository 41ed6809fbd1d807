const engine = {
    gravity: (g) => system.SetGravity(new Jolt.Vec3(0, -g, 0)),
    put(y, vX, vY, omega) {
        const id = ball.GetID();
        bodies.SetPositionAndRotation(id, new Jolt.RVec3(0, y, 0), none, Jolt.EActivation_Activate);
        bodies.SetLinearAndAngularVelocity(id, new Jolt.Vec3(vX, -vY, 0), new Jolt.Vec3(0, 0, -omega));
    },
    step: (dt) => jolt.Step(dt, 1),
    look() {
        const velocity = ball.GetLinearVelocity(), v = [velocity.GetX(), velocity.GetY()];
        return [ball.GetPosition().GetY(), ...v, -ball.GetAngularVelocity().GetZ()];
    },
};
