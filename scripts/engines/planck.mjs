const engine = {
    gravity: (g) => world.setGravity({ x: 0, y: -g * SCALE }),
    put(y, vX, vY, omega) {
        ball.setAwake(true);
        ball.setPosition({ x: 0, y: y * SCALE });
        ball.setLinearVelocity({ x: vX * SCALE, y: -vY * SCALE });
        ball.setAngularVelocity(-omega);
    },
    step: (dt) => world.step(dt),
    look() {
        const velocity = ball.getLinearVelocity();
        const height = ball.getPosition().y / SCALE;
        return [height, velocity.x / SCALE, velocity.y / SCALE, -ball.getAngularVelocity()];
    },
};
