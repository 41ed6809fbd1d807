import { Circle, Edge, Settings, World } from "planck";

// Lengths in centimetres: contacts act within 0.5 of a unit, and slow balls do not bounce.
const SCALE = 100;
// The largest turn and way in one step, which are pi/2 and 2 units.
Settings.maxRotation = 1e9;
Settings.maxTranslation = 1e9;
Settings.velocityThreshold = @threshold@ * SCALE;
const world = new World({ gravity: { x: 0, y: -9.81 * SCALE } });
const ball = world.createBody({ type: "dynamic", position: { x: 0, y: 1 * SCALE }, bullet: true });
// Restitution is the larger one of both, friction the root of the product.
ball.createFixture({ shape: new Circle(@radius@ * SCALE), restitution: @e@, friction: @mu@ });
ball.setMassData({ mass: @mass@, center: { x: 0, y: 0 }, I: @inertia@ * SCALE ** 2 });
const court = world.createBody();
const line = new Edge({ x: -50 * SCALE, y: 0 }, { x: 50 * SCALE, y: 0 });
court.createFixture({ shape: line, restitution: 0, friction: @mu@ });
// A hit with topspin: ball.setLinearVelocity({ x: 20 * SCALE, y: -8 * SCALE });
// ball.setAngularVelocity(-200). A file of this is run by node if it ends in .mjs.
// 60 times a second: world.step(1 / 60); the height in m is ball.getPosition().y / SCALE
