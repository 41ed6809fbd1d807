#!/bin/sh
# mujoco 4.0.0: in a short contact friction does not reach its coefficient. The damping of `solref` is
# also the rate at which friction brakes a slip.
#
# A ball comes at 25 m/s along and 8 m/s towards a plane and slides. Stiffness and damping of the contact
# are direct, `solref="-355470 -116.8"`, friction is 0.57, steps are 1/40 of a ms, the cone is elliptic.
# Friction that slides takes mu (1 + e) v_y, 8.1 m/s. It takes 4.6: in 5 ms the slip is braked at a rate of
# 117 1/s, and does not meet the cone. With a pair whose `solreffriction` is fast, impratio 1e-4 and
# noslip_iterations 20, it takes what it should.
#
# What it means for balls, feet and tools that touch for milliseconds: friction is viscous there unless
# the pair says otherwise; a friction coefficient fitted to such contacts is not one.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check mujoco==4.0.0 numpy==2.4.6
"$work/venv/bin/python" -W ignore - <<'EOF'
import sys

import mujoco

MU, V_X, V_Y, RADIUS = 0.57, 25.0, 8.0, 0.033
SOFT = 'solref="-355470 -116.8" solimp="0.99 0.99 0.001 0.5 2"'


def rebound(option, geom, contact):
    """What is lost along the plane, and the restitution."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>
      <option timestep="2.5e-5" cone="elliptic" gravity="0 0 0" {option}/>
      <worldbody><geom name="court" type="plane" size="50 50 1"/>
        <body pos="0 0 0.04"><freejoint/>
          <inertial pos="0 0 0" mass="0.0576" diaginertia="3.5e-5 3.5e-5 3.5e-5"/>
          <geom name="ball" type="sphere" size="{RADIUS}" {geom}/></body></worldbody>
      {contact}</mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[:3] = V_X, 0.0, -V_Y
    for _ in range(800):
        mujoco.mj_step(model, data)
    return V_X - data.qvel[0], data.qvel[2] / V_Y


usual = rebound("", f'{SOFT} condim="3" friction="{MU} 0 0" priority="1"', "")
pair = rebound(
    'impratio="1e-4" noslip_iterations="20"',
    "",
    f'<contact><pair geom1="court" geom2="ball" condim="3" friction="{MU} {MU} 0 0 0" {SOFT} '
    'solreffriction="-1 -30000"/></contact>',
)
print(f"mujoco {mujoco.__version__}: velocity that friction takes from a ball that slides")
shares = []
for name, (lost, e) in (("friction of the geom", usual), ("friction of the pair", pair)):
    full = MU * (1.0 + e) * V_Y
    shares.append(lost / full)
    print(f"{name}: {lost:.2f} m/s of mu (1 + e) v_y = {full:.2f} m/s, restitution {e:.3f}")
if not (shares[0] < 0.7 and 0.97 < shares[1] < 1.03):
    sys.exit("the behaviour has changed: look again at what is said above")
EOF
