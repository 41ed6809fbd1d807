#!/bin/sh
# @babylonjs/havok 1.3.14: with steps of a millisecond a bouncing ball falls asleep in the air and
# hangs there.
#
# A ball with restitution 0.75 is dropped from a metre on a box, under gravity, with steps of 1/1000
# s. After 12 s it hangs half a metre over the box: its height no longer changes, its velocity is
# still 0.8 m/s. A ball of which the activation control is ALWAYS_ACTIVE comes to rest on the box, and
# so does one with steps of 1/60 s.
#
# What it means for a game or a simulation with fine steps: switch deactivation off for balls, with
# HP_Body_SetActivationControl.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
npm install --silent --prefix "$work" @babylonjs/havok@1.3.14
cat >"$work/drop.mjs" <<'EOF'
import { readFileSync } from "node:fs";
import init from "@babylonjs/havok";

const file = new URL("HavokPhysics.wasm", import.meta.resolve("@babylonjs/havok"));
const havok = await init({ wasmBinary: readFileSync(file) });

/** Heights of the ball over the box after 11 and 12 s, and its velocity then. */
function drop(dt, awake) {
    const world = havok.HP_World_Create()[1];
    havok.HP_World_SetGravity(world, [0, -9.81, 0]);
    const add = (type, shape, y) => {
        const body = havok.HP_Body_Create()[1];
        havok.HP_Shape_SetMaterial(shape, [0.5, 0.5, 0.75, havok.MaterialCombine.MINIMUM, havok.MaterialCombine.MAXIMUM]);
        havok.HP_Body_SetMotionType(body, type);
        havok.HP_Body_SetShape(body, shape);
        havok.HP_Body_SetQTransform(body, [[0, y, 0], [0, 0, 0, 1]]);
        havok.HP_World_AddBody(world, body, false);
        return body;
    };
    const { DYNAMIC, STATIC } = havok.MotionType;
    const ball = add(DYNAMIC, havok.HP_Shape_CreateSphere([0, 0, 0], 0.033)[1], 1.033);
    havok.HP_Body_SetMassProperties(ball, [[0, 0, 0], 0.0576, [6e-4, 6e-4, 6e-4], [0, 0, 0, 1]]);
    add(STATIC, havok.HP_Shape_CreateBox([0, 0, 0], [0, 0, 0, 1], [100, 2, 100])[1], -1);
    if (awake) havok.HP_Body_SetActivationControl(ball, havok.ActivationControl.ALWAYS_ACTIVE);
    const height = () => havok.HP_Body_GetQTransform(ball)[1][0][1] - 0.033;
    const steps = Math.round(1 / dt), seen = [];
    for (let k = 1; k <= 12 * steps; ++k) {
        havok.HP_World_Step(world, dt);
        if (k >= 11 * steps && k % steps === 0) seen.push(height());
    }
    return [...seen, havok.HP_Body_GetLinearVelocity(ball)[1][1]];
}

const words = ([first, last, v]) => `height ${first.toFixed(4)} m after 11 s, ${last.toFixed(4)} m after 12 s, velocity ${v.toFixed(3)} m/s`;
const fine = drop(1 / 1000, false), awake = drop(1 / 1000, true), coarse = drop(1 / 60, false);
console.log(`havok 1.3.14, a ball dropped from 1 m with restitution 0.75`);
console.log(`1/1000 s:               ${words(fine)}`);
console.log(`1/1000 s, kept awake:   ${words(awake)}`);
console.log(`1/60 s:                 ${words(coarse)}`);
const hangs = fine[0] === fine[1] && fine[1] > 0.1 && Math.abs(fine[2]) > 0.1;
const rest = [awake, coarse].every(([, last, v]) => Math.abs(last) < 0.01 && Math.abs(v) < 0.01);
if (!(hangs && rest)) {
    console.error("the behaviour has changed: look again at what is said above");
    process.exit(1);
}
EOF
cd "$work" && node drop.mjs
