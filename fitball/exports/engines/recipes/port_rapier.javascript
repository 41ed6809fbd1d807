// fitball export FIT --to esm > bounce.mjs
import Bounce from "./bounce.mjs";
import Rapier from "@dimforge/rapier3d-compat";

await Rapier.init();
const world = new Rapier.World({ x: 0, y: -9.81, z: 0 });
const none = { x: 0, y: 0, z: 0 }, up = { x: 0, y: 1, z: 0 };
const inertia = { x: @inertia@, y: @inertia@, z: @inertia@ };
const ball = world.createRigidBody(Rapier.RigidBodyDesc.dynamic().setTranslation(0, 1, 0)
    .setCcdEnabled(true)
    .setAdditionalMassProperties(@mass@, none, inertia, { ...none, w: 1 }));
// The engine's own restitution is 0; its response stays on, so that the ball can rest.
world.createCollider(Rapier.ColliderDesc.ball(@radius@).setDensity(0).setRestitution(0)
    .setFriction(@mu@).setActiveEvents(Rapier.ActiveEvents.COLLISION_EVENTS), ball);
const court = Rapier.ColliderDesc.cuboid(50, 1, 50).setTranslation(0, -1, 0);
world.createCollider(court.setRestitution(0).setFriction(@mu@));
const events = new Rapier.EventQueue(true);
function step(dt) {
    world.timestep = dt;
    // Events come after the solver: velocities are kept from before the step.
    const velocity = ball.linvel(), spin = ball.angvel();
    world.step(events);
    events.drainCollisionEvents((_one, _other, started) => {
        if (!started || velocity.y >= -@threshold@) return;
        const found = Bounce.rebound_3d(velocity, spin, up, Bounce.BALL);
        ball.setLinvel(found.velocity, true);
        ball.setAngvel(found.spin, true);
    });
}
// 1,000 times a second: step(1 / 1000). It turns bodies by pi/4 in a step at most: 785 rad/s.
