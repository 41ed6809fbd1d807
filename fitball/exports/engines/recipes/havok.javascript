import { readFileSync } from "node:fs";
import init from "@babylonjs/havok";

// In a page: await init(). Node does not fetch files.
const file = new URL("HavokPhysics.wasm", import.meta.resolve("@babylonjs/havok"));
const havok = await init({ wasmBinary: readFileSync(file) });
const world = havok.HP_World_Create()[1];
havok.HP_World_SetGravity(world, [0, -9.81, 0]);
// The largest velocity and spin, before bodies are added: they are 200 m/s and 100 rad/s.
havok.HP_World_SetSpeedLimit(world, 1e4, 1e4);
const add = (type, shape, place) => {
    const body = havok.HP_Body_Create()[1];
    havok.HP_Body_SetMotionType(body, type);
    havok.HP_Body_SetShape(body, shape);
    havok.HP_Body_SetQTransform(body, [place, [0, 0, 0, 1]]);
    havok.HP_World_AddBody(world, body, false);
    return body;
};
const { MotionType, MaterialCombine } = havok;
const sphere = havok.HP_Shape_CreateSphere([0, 0, 0], @radius@)[1];
const box = havok.HP_Shape_CreateBox([0, 0, 0], [0, 0, 0, 1], [100, 2, 100])[1];
// Static friction, dynamic friction, restitution, and how they combine.
const rules = [MaterialCombine.MINIMUM, MaterialCombine.MAXIMUM];
havok.HP_Shape_SetMaterial(sphere, [@mu@, @mu@, @e@, ...rules]);
havok.HP_Shape_SetMaterial(box, [@mu@, @mu@, 0, ...rules]);
const ball = add(MotionType.DYNAMIC, sphere, [0, 1, 0]);
const court = add(MotionType.STATIC, box, [0, -1, 0]);
// The inertia is that of a unit of mass [m^2].
const inertia = [@gyration@, @gyration@, @gyration@];
havok.HP_Body_SetMassProperties(ball, [[0, 0, 0], @mass@, inertia, [0, 0, 0, 1]]);
havok.HP_Body_SetLinearDamping(ball, 0);
havok.HP_Body_SetAngularDamping(ball, 0);
// With steps of a millisecond a flying ball falls asleep in the air.
havok.HP_Body_SetActivationControl(ball, havok.ActivationControl.ALWAYS_ACTIVE);
// 1,000 times a second: havok.HP_World_Step(world, 0.001)
