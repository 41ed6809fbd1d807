import { Body, ContactMaterial, Material, Plane, Sphere, Vec3, World } from "cannon-es";

const world = new World({ gravity: new Vec3(0, -9.81, 0) });
const felt = new Material("felt");
const hard = new Material("hard");
const ball = new Body({ mass: @mass@, material: felt, linearDamping: 0, angularDamping: 0 });
ball.addShape(new Sphere(@radius@));
ball.position.set(0, 1, 0);
// The engine takes the inertia of the box round the ball.
ball.inertia.set(@inertia@, @inertia@, @inertia@);
ball.invInertia.set(1 / @inertia@, 1 / @inertia@, 1 / @inertia@);
world.addBody(ball);
const court = new Body({ mass: 0, material: hard });
court.addShape(new Plane());
court.quaternion.setFromEuler(-Math.PI / 2, 0, 0);
world.addBody(court);
world.addContactMaterial(new ContactMaterial(felt, hard, {
    restitution: @e@, friction: @mu@,
    contactEquationStiffness: 1e9, contactEquationRelaxation: 1000,
    frictionEquationStiffness: 1e9, frictionEquationRelaxation: 1000,
}));
// Friction is limited by mu m g times one second: g becomes what this ball's impact needs.
world.frictionGravity = new Vec3();
function step(dt) {
    world.frictionGravity.set(0, -(1 + @e@) * Math.abs(ball.velocity.y), 0);
    world.step(dt);
}
// 60 times a second: step(1 / 60)
