// matter-js by settings, 500 pixels a metre; its velocities are pixels in 1/60 s.
import Matter from "matter-js";

const SCALE = 500, FRAME = 1 / 60;
const space = Matter.Engine.create({ gravity: { x: 0, y: 0 } });
const look = { restitution: @e@, friction: @mu@, frictionStatic: 0, frictionAir: 0, slop: 0 };
const ball = Matter.Bodies.circle(0, -SCALE, @radius@ * SCALE, look);
const court = Matter.Bodies.rectangle(0, 5000, 100000, 10000, { isStatic: true, ...look });
Matter.Composite.add(space.world, [ball, court]);
const engine = {
    gravity: (g) => (space.gravity.y = g),
    put(y, vX, vY, omega) {
        Matter.Body.setPosition(ball, { x: 0, y: -y * SCALE });
        Matter.Body.setVelocity(ball, { x: vX * SCALE * FRAME, y: vY * SCALE * FRAME });
        Matter.Body.setAngularVelocity(ball, omega * FRAME);
    },
    step: (dt) => Matter.Engine.update(space, 1000 * dt),
    look() {
        const { x, y } = Matter.Body.getVelocity(ball), per = SCALE * FRAME;
        const omega = Matter.Body.getAngularVelocity(ball) / FRAME;
        return [-ball.position.y / SCALE, x / per, -y / per, omega];
    },
};
