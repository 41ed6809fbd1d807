// oimo by settings, on a court 20 m thick: it throws out a ball whose centre is below the surface.
import OIMO from "oimo";

const world = new OIMO.World({ timestep: 1 / 60, gravity: [0, 0, 0], worldscale: 1 });
const material = { density: 1, friction: @mu@, restitution: @e@ };
const sphere = { type: "sphere", size: [@radius@], pos: [0, 1, 0], move: true, ...material };
const ball = world.add(sphere);
world.add({ type: "box", size: [100, 20, 100], pos: [0, -10, 0], ...material });
const engine = {
    gravity: (g) => world.gravity.set(0, -g, 0),
    put(y, vX, vY, omega) {
        ball.awake();
        ball.position.set(0, y, 0);
        ball.linearVelocity.set(vX, -vY, 0);
        ball.angularVelocity.set(0, 0, -omega);
    },
    step(dt) {
        world.timeStep = dt;
        world.step();
    },
    look() {
        const { x, y } = ball.linearVelocity;
        return [ball.position.y, x, y, -ball.angularVelocity.z];
    },
};
