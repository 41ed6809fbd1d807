#!/bin/sh
# cannon-es 0.20.0: the friction of an impact is limited by mu m g times one second, not by the force of
# the contact: a ball that hits harder is not braked more, and without gravity it is not braked at all.
#
# A sphere with friction 0.5 and restitution 0 in a ContactMaterial comes at 60 m/s along a plane and
# slides throughout. At 5, 10 and 20 m/s towards the plane it loses the same, 4.9 m/s: 0.5 x 9.81. Friction
# takes mu v_y: 2.5, 5 and 10 m/s. With gravity 0 it loses nothing.
#
# What it means for balls and everything that hits hard: set `world.frictionGravity` before each step to
# what the impact needs, (1 + e) v_y.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
npm install --silent --prefix "$work" cannon-es@0.20.0
cat >"$work/slide.mjs" <<'EOF'
import { Body, ContactMaterial, Material, Plane, Sphere, Vec3, World } from "cannon-es";

/** The velocity along the plane that a ball loses, which comes at `vY` under gravity `g`. */
function lost(vY, g) {
    const world = new World({ gravity: new Vec3(0, -g, 0) });
    const soft = new Material("soft"), hard = new Material("hard");
    world.addContactMaterial(new ContactMaterial(soft, hard, { friction: 0.5, restitution: 0 }));
    const ball = new Body({ mass: 1, material: soft, linearDamping: 0, angularDamping: 0 });
    ball.addShape(new Sphere(0.1));
    ball.position.set(0, 0.1 + vY / 20, 0);
    ball.velocity.set(60, -vY, 0);
    world.addBody(ball);
    const court = new Body({ mass: 0, material: hard });
    court.addShape(new Plane());
    court.quaternion.setFromEuler(-Math.PI / 2, 0, 0);
    world.addBody(court);
    // To the end of the first step of contact.
    for (let k = 0; k < 60 && ball.velocity.x === 60 && k < 5; ++k) world.step(1 / 60);
    return 60 - ball.velocity.x;
}

const speeds = [5, 10, 20], heavy = speeds.map((vY) => lost(vY, 9.81)), none = speeds.map((vY) => lost(vY, 0));
console.log("cannon-es 0.20.0: velocity that friction 0.5 takes at 5, 10, 20 m/s towards the plane");
console.log(`gravity 9.81: ${heavy.map((v) => v.toFixed(2)).join(", ")} m/s; 2.50, 5.00, 10.00 expected`);
console.log(`gravity 0:    ${none.map((v) => v.toFixed(2)).join(", ")} m/s`);
const same = heavy.every((v) => Math.abs(v - heavy[0]) < 0.01), zero = none.every((v) => Math.abs(v) < 1e-9);
if (!(same && zero && Math.abs(heavy[0] - 0.5 * 9.81) < 0.2)) {
    console.error("the behaviour has changed: look again at what is said above");
    process.exit(1);
}
EOF
cd "$work" && node slide.mjs
