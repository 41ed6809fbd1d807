const engine = {
    gravity: (g) => (world.gravity = { x: 0, y: -g, z: 0 }),
    put(y, vX, vY, omega) {
        ball.setTranslation({ x: 0, y, z: 0 }, true);
        ball.setLinvel({ x: vX, y: -vY, z: 0 }, true);
        ball.setAngvel({ x: 0, y: 0, z: -omega }, true);
    },
    step: (dt) => step(dt),
    look() {
        const velocity = ball.linvel();
        return [ball.translation().y, velocity.x, velocity.y, -ball.angvel().z];
    },
};
