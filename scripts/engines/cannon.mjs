const engine = {
    gravity: (g) => world.gravity.set(0, -g, 0),
    put(y, vX, vY, omega) {
        ball.position.set(0, y, 0);
        ball.velocity.set(vX, -vY, 0);
        ball.angularVelocity.set(0, 0, -omega);
    },
    step,
    look: () => [ball.position.y, ball.velocity.x, ball.velocity.y, -ball.angularVelocity.z],
};
