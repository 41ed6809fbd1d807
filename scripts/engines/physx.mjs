const engine = {
    gravity: (g) => scene.setGravity(new PhysX.PxVec3(0, -g, 0)),
    put(y, vX, vY, omega) {
        ball.setGlobalPose(at(y));
        ball.setLinearVelocity(new PhysX.PxVec3(vX, -vY, 0));
        ball.setAngularVelocity(new PhysX.PxVec3(0, 0, -omega));
    },
    step(dt) {
        scene.simulate(dt);
        scene.fetchResults(true);
    },
    look() {
        const velocity = ball.getLinearVelocity(), v = [velocity.x, velocity.y];
        return [ball.getGlobalPose().p.y, ...v, -ball.getAngularVelocity().z];
    },
};
