#!/bin/sh
# pybullet 3.2.7: a ball bounces less the finer the steps are, and at 16 kHz not at all.
#
# A sphere with restitution 0.75 on a plane with 1 comes at 5 m/s, without gravity and damping. Its mean
# restitution over ten heights within a step is 0.79 at 60 steps a second, 0.31 at 4,000, and 0 at
# 16,000: contacts act at a distance, and what is left of the way is taken from the rebound. With
# contactERP 0 and contactBreakingThreshold 1e-6 it is 0.75 at all of these.
#
# What it means for who refines steps to get nearer to the truth: the bounce gets worse, unless these two
# are set.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check pybullet==3.2.7 numpy==2.4.6
"$work/venv/bin/python" -W ignore - <<'EOF'
import sys

import pybullet as bullet

V, RADIUS, E = 5.0, 0.033, 0.75


def restitution(rate, **options):
    """The mean of rebound over impact speed at ten heights within a step."""
    total = 0.0
    for phase in range(10):
        bullet.connect(bullet.DIRECT)
        bullet.setTimeStep(1.0 / rate)
        bullet.setPhysicsEngineParameter(restitutionVelocityThreshold=0.01, **options)
        sphere = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=RADIUS)
        height = RADIUS + V / rate * (3.05 + phase / 10.0)
        # Fine steps begin beyond the distance at which contacts act.
        height = max(height, RADIUS + 0.05 + V / rate * phase / 10.0) if rate > 500 else height
        ball = bullet.createMultiBody(1.0, sphere, basePosition=[0, 0, height])
        court = bullet.createMultiBody(0.0, bullet.createCollisionShape(bullet.GEOM_PLANE))
        bullet.changeDynamics(ball, -1, restitution=E, linearDamping=0, angularDamping=0)
        bullet.changeDynamics(court, -1, restitution=1.0)
        bullet.resetBaseVelocity(ball, [0, 0, -V])
        for _ in range(8 if rate <= 500 else int(0.03 * rate)):
            bullet.stepSimulation()
        total += bullet.getBaseVelocity(ball)[0][2] / V
        bullet.disconnect()
    return total / 10.0


rates = (60, 240, 1000, 4000, 16000)
usual = [restitution(rate) for rate in rates]
options = {"contactERP": 0.0, "contactBreakingThreshold": 1e-6}
told = [restitution(rate, **options) for rate in rates]
print(f"pybullet 3.2.7, restitution {E}, at {rates} steps a second")
print("as it is:", [round(e, 2) for e in usual])
print("contactERP 0, contactBreakingThreshold 1e-6:", [round(e, 2) for e in told])
falls = usual[0] > 0.7 and usual[3] < 0.5 and usual[4] < 0.05
if not (falls and all(abs(e - E) < 0.01 for e in told)):
    sys.exit("the behaviour has changed: look again at what is said above")
EOF
