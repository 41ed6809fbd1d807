import Rapier from "@dimforge/rapier3d-compat";

await Rapier.init();
const world = new Rapier.World({ x: 0, y: -9.81, z: 0 });
const none = { x: 0, y: 0, z: 0 };
const inertia = { x: @inertia@, y: @inertia@, z: @inertia@ };
const ball = world.createRigidBody(Rapier.RigidBodyDesc.dynamic().setTranslation(0, 1, 0)
    .setAdditionalMassProperties(@mass@, none, inertia, { ...none, w: 1 }));
// Friction acts on the impulse that stops the ball, not on that of the rebound: 1 + e makes up for it.
const e = @e@, friction = @mu@ * (1 + e);
// Both coefficients are means of both colliders.
world.createCollider(
    Rapier.ColliderDesc.ball(@radius@).setDensity(0).setRestitution(e).setFriction(friction), ball);
const court = Rapier.ColliderDesc.cuboid(50, 1, 50).setTranslation(0, -1, 0);
world.createCollider(court.setRestitution(e).setFriction(friction));
function step(dt) {
    world.timestep = dt;
    world.step();
}
// 4,000 times a second: step(1 / 4000). Coarser steps turn the ball too little, or the wrong way.
