#!/bin/sh
# Rapier 0.21.0: the friction of a bounce is that of a ball which does not bounce. It acts on the impulse
# that stops the ball, not on the one that throws it back: mu v_y, not mu (1 + e) v_y.
#
# A sphere with friction 0.3 comes at 30 m/s along a cuboid and 10 m/s towards it, without gravity, and
# slides throughout. With restitution 0 it loses 3 m/s, as Coulomb's law says. With 0.75 it leaves at
# 7.5 m/s, a normal impulse of 17.5 m/s, and should lose 5.25 m/s: it loses 3 at 240, 4,000 and 16,000
# steps a second. Version 0.19.3 loses 5.25 at 240 and 4,000.
#
# What it means for balls: a slide takes 1/(1 + e) of what friction asks. Balls that slide need mu (1 + e)
# in place of mu on both colliders; where resting bodies share them, they hold too well.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
npm install --silent --prefix "$work" now@npm:@dimforge/rapier3d-compat@0.21.0 \
    before@npm:@dimforge/rapier3d-compat@0.19.3
cat >"$work/slide.mjs" <<'EOT'
const { default: Rapier } = await import(process.argv[2]);
await Rapier.init();

/** The velocities that a ball of restitution `e` loses along the plane and has away from it. */
function bounce(e, hertz) {
    const world = new Rapier.World({ x: 0, y: 0, z: 0 });
    world.timestep = 1 / hertz;
    const moving = Rapier.RigidBodyDesc.dynamic().setTranslation(0, 0.5, 0).setLinvel(30, -10, 0);
    const ball = world.createRigidBody(moving);
    const court = Rapier.ColliderDesc.cuboid(50, 1, 50).setTranslation(0, -1, 0);
    world.createCollider(Rapier.ColliderDesc.ball(0.05).setRestitution(e).setFriction(0.3), ball);
    world.createCollider(court.setRestitution(e).setFriction(0.3));
    for (let k = 0; k < 0.1 * hertz; ++k) world.step();
    return [30 - ball.linvel().x, ball.linvel().y];
}

let good = true;
for (const [e, hertz] of [[0, 4000], [0.75, 240], [0.75, 4000], [0.75, 16000]]) {
    if (process.argv[2] === "before" && hertz > 4000) continue;
    const [along, up] = bounce(e, hertz), coulomb = 3 * (1 + e);
    const expected = process.argv[2] === "now" ? 3 : coulomb;
    console.log(`e ${e}, ${hertz} Hz: ${along.toFixed(2)} m/s lost, ${up.toFixed(2)} m/s up; Coulomb ${coulomb}`);
    good &&= Math.abs(along - expected) < 0.01 && Math.abs(up - 10 * e) < 0.01;
}
if (!good) {
    console.error("the behaviour has changed: look again at what is said above");
    process.exit(1);
}
EOT
cd "$work"
for version in now before; do
    echo "Rapier $version: $(node -p "require('./node_modules/$version/package.json').version")"
    node slide.mjs "$version" 2>"$work/said" || { cat "$work/said" >&2; exit 1; }
done
