// Rapier by settings: restitution and friction of the page's ball, which it does not keep.
import Rapier from "@dimforge/rapier3d-compat";

await Rapier.init();
const world = new Rapier.World({ x: 0, y: 0, z: 0 });
const none = { x: 0, y: 0, z: 0 };
const inertia = { x: @inertia@, y: @inertia@, z: @inertia@ };
const ball = world.createRigidBody(Rapier.RigidBodyDesc.dynamic()
    .setAdditionalMassProperties(@mass@, none, inertia, { ...none, w: 1 }));
world.createCollider(
    Rapier.ColliderDesc.ball(@radius@).setDensity(0).setRestitution(@e@).setFriction(@mu@), ball);
const court = Rapier.ColliderDesc.cuboid(50, 1, 50).setTranslation(0, -1, 0);
world.createCollider(court.setRestitution(@e@).setFriction(@mu@));
const step = (dt) => {
    world.timestep = dt;
    world.step();
};
