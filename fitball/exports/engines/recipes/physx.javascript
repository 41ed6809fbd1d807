import init from "physx-js-webidl";

const PhysX = await init();
const errors = new PhysX.PxDefaultErrorCallback();
const allocator = new PhysX.PxDefaultAllocator();
const foundation = PhysX.CreateFoundation(PhysX.PHYSICS_VERSION, allocator, errors);
const tolerances = new PhysX.PxTolerancesScale();
const physics = PhysX.CreatePhysics(PhysX.PHYSICS_VERSION, foundation, tolerances);
const description = new PhysX.PxSceneDesc(tolerances);
description.set_gravity(new PhysX.PxVec3(0, -9.81, 0));
description.set_cpuDispatcher(PhysX.DefaultCpuDispatcherCreate(0));
description.set_filterShader(PhysX.DefaultFilterShader());
// Slower balls do not bounce.
description.set_bounceThresholdVelocity(@threshold@);
const scene = physics.createScene(description);

const MULTIPLY = PhysX.PxCombineModeEnum.eMULTIPLY;
const filter = new PhysX.PxFilterData(1, 1, 0, 0);
function add(body, geometry, friction, restitution) {
    const material = physics.createMaterial(friction, friction, restitution);
    material.setFrictionCombineMode(MULTIPLY);
    material.setRestitutionCombineMode(MULTIPLY);
    const shape = physics.createShape(geometry, material, true);
    shape.setSimulationFilterData(filter);
    body.attachShape(shape);
    scene.addActor(body);
}
const at = (y) => new PhysX.PxTransform(new PhysX.PxVec3(0, y, 0), new PhysX.PxQuat(0, 0, 0, 1));
const ball = physics.createRigidDynamic(at(1));
add(ball, new PhysX.PxSphereGeometry(@radius@), @mu@, @e@);
ball.setMass(@mass@);
ball.setMassSpaceInertiaTensor(new PhysX.PxVec3(@inertia@, @inertia@, @inertia@));
ball.setLinearDamping(0);
ball.setAngularDamping(0);
ball.setMaxAngularVelocity(1e4);
const court = physics.createRigidStatic(at(-1));
add(court, new PhysX.PxBoxGeometry(50, 1, 50), 1, 1);
// 4,000 times a second, without continuous detection, which takes the spin away.
// scene.simulate(1 / 4000); scene.fetchResults(true);
