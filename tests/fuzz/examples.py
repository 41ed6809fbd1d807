"""Valid input of every kind, to be damaged."""

from __future__ import annotations

# A scene that says all it can.
SCENE = """[source]
description = "Impacts of a ball nobody has seen"
citation = "Nobody (2026)"

[ball]
mass = { value = 0.0577, sd = 0.0005 }
radius = 0.033
inertia_ratio = 0.55

[surface]
name = "court"
mu = { value = 0.6, sd = 0.05 }

[contact_time]
value = 0.0045
sd = 0.0005

[measurement]
nominal_velocity_sd = 0.25
spin_sd = 10.0
distribution = "normal"

[model]
name = "grip-slip"

[priors]
mu = "normal(0.6, 0.1)"

[fix]
e_x = 0.2
"""
# Components with labels and sds, speed and angle in other units, and a drop test.
TABLES = (
    "id,surface,group,v_x1 [m/s],v_y1 [m/s],v_y1_sd [m/s],omega_1 [rpm],v_x2 [m/s],v_y2 [m/s],omega_2 [rad/s],note\n"
    "one,clay,A,15.62,4.81,0.05,-51,11.09,4.22,239.1,first of the day\n"
    "two,clay,A,16.00,5.02,0.05,-48,11.30,4.31,245.0,\n"
    "three,hard,B,17.10,7.15,0.05,0,11.45,5.60,262.3,\n"
    "four,hard,B,14.85,9.90,0.05,120,9.80,7.31,260.9,windy\n",
    "# a comment\nv_1 [mph],v_1_sd [mph],theta_1 [deg],theta_1_sd [deg],v_2 [mph],theta_2 [deg],contact_time [ms]\n"
    "38.1,0.5,18.2,0.4,28.0,20.1,4.9\n40.2,0.5,22.9,0.4,29.1,25.0,4.7\n42.0,0.5,35.1,0.4,30.2,37.4,4.5\n",
    "id,v_y1,v_y2\na,4,3.21\nb,6,4.68\nc,8,6.13\nd,10,7.48\n",
)
# The first of them as a lab may have it: semicolons, decimal commas, a title, a row of units, deviations; heights.
DIALECTS = (
    "Bounce test;;;;;;\nNo.;V_1;theta_1;omega_1;v_2;theta_2;surface\n;km/h;°;U/min;km/h;°;\n"
    "1;61,2 ± 0,5;16,1 ± 0,3;-51;38,0;21,5;clay\n2;60,8 ± 0,5;16,0 ± 0,3;-48;38,5;21,0;clay\n"
    "2;61,9 ± 0,5;16,9 ± 0,3;0;39,1;;hard\n",
    "ball\tdrop_height (cm)\trebound_height (cm)\tcontact_time (ms)\na\t254\t140,5\t5,1\nb\t254\t\t5,0\n"
    "c\t254\t138,25\t4,9\n",
)
IMPACTS = (
    "v=38 mph, theta=18 deg, spin=950 rpm top",
    "v=38±1 mph, theta=18±0.5 deg, spin=950±50 rpm top",
    "v_x=12, v_y=10",
    "v_y=6",
    "v_1=17 +/- 1, theta_1=0.3 rad, omega=-20 rev/s",
)
PRIORS = ("mu=normal(0.6, 0.1)", "mu = uniform(0, 1)", "cor_10=lognormal(0.7, 0.1)", "mu=loguniform(0.1, 1)")
GRIDS = ("v=10..40 m/s:4, theta=10..60 deg:4, spin=-300..300:3", "v_y=4..10:3", "v_x = 8..14 : 3, v_y=30 mph")
POINTS = ("v=30 m/s, theta=16 deg, spin=0 rpm", "v_x=12, v_y=10, spin=950 rpm top")
