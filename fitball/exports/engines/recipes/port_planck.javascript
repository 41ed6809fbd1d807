// fitball export FIT --to esm > bounce.mjs
import Bounce from "./bounce.mjs";
import { Circle, Edge, Settings, World } from "planck";

// Lengths in centimetres. The engine would cut the spin that the port returns.
const SCALE = 100;
Settings.maxRotation = 1e9;
Settings.maxTranslation = 1e9;
const world = new World({ gravity: { x: 0, y: -9.81 * SCALE } });
const ball = world.createBody({ type: "dynamic", position: { x: 0, y: 1 * SCALE }, bullet: true });
// The engine's own restitution is 0; its response stays on, so that the ball can rest.
ball.createFixture({ shape: new Circle(@radius@ * SCALE), restitution: 0, friction: @mu@ });
ball.setMassData({ mass: @mass@, center: { x: 0, y: 0 }, I: @inertia@ * SCALE ** 2 });
const court = world.createBody();
const line = new Edge({ x: -50 * SCALE, y: 0 }, { x: 50 * SCALE, y: 0 });
court.createFixture({ shape: line, restitution: 0, friction: @mu@ });
world.on("begin-contact", (contact) => {
    const bodies = [contact.getFixtureA().getBody(), contact.getFixtureB().getBody()];
    if (!bodies.includes(ball) || !bodies.includes(court)) return;
    // Before the solver. A positive turn of the engine is backspin of a ball that flies to +x.
    const { x, y } = ball.getLinearVelocity();
    // Slower than gravity makes it in a step or two: the engine lets it rest.
    if (-y < @threshold@ * SCALE) return;
    const found = Bounce.rebound(x / SCALE, -y / SCALE, -ball.getAngularVelocity(), Bounce.BALL);
    if (found.status === 6) return;
    ball.setLinearVelocity({ x: found.v_x2 * SCALE, y: found.v_y2 * SCALE });
    ball.setAngularVelocity(-found.omega_2);
});
// A hit with topspin: ball.setLinearVelocity({ x: 20 * SCALE, y: -8 * SCALE });
// ball.setAngularVelocity(-200). A file of this is run by node if it ends in .mjs.
// 60 times a second: world.step(1 / 60); the height in m is ball.getPosition().y / SCALE
