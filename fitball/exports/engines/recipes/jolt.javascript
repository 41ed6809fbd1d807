import init from "jolt-physics";

const Jolt = await init();
const set = new Jolt.JoltSettings();
const COURT = 0, BALL = 1;
const pairs = new Jolt.ObjectLayerPairFilterTable(2);
pairs.EnableCollision(COURT, BALL);
const layers = new Jolt.BroadPhaseLayerInterfaceTable(2, 2);
layers.MapObjectToBroadPhaseLayer(COURT, new Jolt.BroadPhaseLayer(0));
layers.MapObjectToBroadPhaseLayer(BALL, new Jolt.BroadPhaseLayer(1));
set.mObjectLayerPairFilter = pairs;
set.mBroadPhaseLayerInterface = layers;
set.mObjectVsBroadPhaseLayerFilter = new Jolt.ObjectVsBroadPhaseLayerFilterTable(
    layers, 2, pairs, 2);
const jolt = new Jolt.JoltInterface(set);
const system = jolt.GetPhysicsSystem();
system.SetGravity(new Jolt.Vec3(0, -9.81, 0));
// Contacts act within 2 cm, and slow balls do not bounce.
const settings = system.GetPhysicsSettings();
settings.mSpeculativeContactDistance = 0.001;
settings.mPenetrationSlop = 0.001;
settings.mMinVelocityForRestitution = @threshold@;
system.SetPhysicsSettings(settings);

const none = new Jolt.Quat(0, 0, 0, 1);
const sphere = new Jolt.BodyCreationSettings(
    new Jolt.SphereShape(@radius@), new Jolt.RVec3(0, 1, 0), none, Jolt.EMotionType_Dynamic, BALL);
// Restitution is the larger one of both, friction the root of the product.
sphere.mRestitution = @e@;
sphere.mFriction = @mu@;
sphere.mLinearDamping = 0;
sphere.mAngularDamping = 0;
sphere.mMaxAngularVelocity = 1e4;
// The ball is stopped where it touches, before the contact is made.
sphere.mMotionQuality = Jolt.EMotionQuality_LinearCast;
sphere.mOverrideMassProperties = Jolt.EOverrideMassProperties_MassAndInertiaProvided;
sphere.mMassPropertiesOverride.mMass = @mass@;
sphere.mMassPropertiesOverride.mInertia = Jolt.Mat44.prototype.sScaleVec3(
    new Jolt.Vec3(@inertia@, @inertia@, @inertia@));
const bodies = system.GetBodyInterface();
const ball = bodies.CreateBody(sphere);
bodies.AddBody(ball.GetID(), Jolt.EActivation_Activate);
const box = new Jolt.BodyCreationSettings(
    new Jolt.BoxShape(new Jolt.Vec3(50, 1, 50)), new Jolt.RVec3(0, -1, 0), none,
    Jolt.EMotionType_Static, COURT);
box.mRestitution = 0;
box.mFriction = @mu@;
bodies.AddBody(bodies.CreateBody(box).GetID(), Jolt.EActivation_DontActivate);
// 60 times a second: jolt.Step(1 / 60, 1)
