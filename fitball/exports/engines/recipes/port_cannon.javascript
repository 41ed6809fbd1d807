// fitball export FIT --to esm > bounce.mjs
import Bounce from "./bounce.mjs";
import { Body, ContactMaterial, Material, Plane, Sphere, Vec3, World } from "cannon-es";

const world = new World({ gravity: new Vec3(0, -9.81, 0) });
const felt = new Material("felt");
const hard = new Material("hard");
const ball = new Body({ mass: @mass@, material: felt, linearDamping: 0, angularDamping: 0 });
ball.addShape(new Sphere(@radius@));
ball.position.set(0, 1, 0);
world.addBody(ball);
const court = new Body({ mass: 0, material: hard });
court.addShape(new Plane());
court.quaternion.setFromEuler(-Math.PI / 2, 0, 0);
world.addBody(court);
// The engine's own restitution is 0; its response stays on, so that the ball can rest.
world.addContactMaterial(new ContactMaterial(felt, hard, { restitution: 0, friction: @mu@ }));
ball.addEventListener("collide", ({ body }) => {
    // Before the solver. Vectors are passed as they are.
    if (body !== court) return;
    const up = { x: 0, y: 1, z: 0 };
    const found = Bounce.rebound_3d(ball.velocity, ball.angularVelocity, up, Bounce.BALL);
    if (found.status === 6) return;
    const { velocity, spin } = found;
    ball.velocity.set(velocity.x, velocity.y, velocity.z);
    ball.angularVelocity.set(spin.x, spin.y, spin.z);
});
const step = (dt) => world.step(dt);
// 60 times a second: step(1 / 60)
