#!/bin/sh
# Godot 3.2.3 (Debian's godot3-server), 2D: a ball with spin rebounds wrongly from a LineShape2D, and
# as a rigid sphere should from a RectangleShape2D.
#
# A disc of restitution 0.75 and friction 0.57 (mass 1, inertia 0.56 R^2) comes at 12 m/s along and 12
# m/s towards the court, with backspin, at 60 steps a second and 1,000 pixels a metre. From a rectangle
# it leaves at 0.75 x 12 = 9 m/s whatever its height within the step. From a line in the same place it
# leaves at 5 to 14 m/s, by the height within the step: more than restitution 1 allows.
#
# What it means for a court in Godot 3: make it a rectangle.
set -eu
command -v godot3-server >/dev/null || { echo "godot3-server is not installed" >&2; exit 1; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/project.godot" <<'EOF'
config_version=4
[application]
run/main_scene="res://main.tscn"
[physics]
common/physics_fps=60
EOF
cat >"$work/main.tscn" <<'EOF'
[gd_scene load_steps=2 format=2]
[ext_resource path="res://main.gd" type="Script" id=1]
[node name="Main" type="Node2D"]
script = ExtResource( 1 )
EOF
cat >"$work/main.gd" <<'EOF'
extends Node2D

const SCALE = 1000.0
const RADIUS = 0.033
var balls = []
var steps = 0

func _ready():
    Physics2DServer.area_set_param(get_world_2d().space, Physics2DServer.AREA_PARAM_GRAVITY, 0.0)
    var box = RectangleShape2D.new()
    box.extents = Vector2(50.0, 1.0) * SCALE
    for shape in [box, LineShape2D.new()]:
        for phase in [0.1, 0.3, 0.5, 0.7, 0.9]:
            # Each ball has a court on a layer of its own.
            var layer = 1 << balls.size()
            var court = StaticBody2D.new()
            court.physics_material_override = material(0.0, 1.0)
            court.position.y = SCALE if shape == box else 0.0
            add(court, shape, layer)
            var ball = RigidBody2D.new()
            ball.inertia = 0.56 * RADIUS * RADIUS * SCALE * SCALE
            ball.linear_damp = 0.0
            ball.angular_damp = 0.0
            ball.physics_material_override = material(0.75, 0.57)
            var circle = CircleShape2D.new()
            circle.radius = RADIUS * SCALE
            add(ball, circle, layer)
            ball.position = Vector2(0.0, -(RADIUS + 12.0 / 60.0 * (3.0 + phase)) * SCALE)
            ball.linear_velocity = Vector2(12.0, 12.0) * SCALE
            ball.angular_velocity = -300.0
            balls.append(ball)

func material(bounce, friction):
    var made = PhysicsMaterial.new()
    made.bounce = bounce
    made.friction = friction
    return made

func add(body, shape, layer):
    var node = CollisionShape2D.new()
    node.shape = shape
    body.add_child(node)
    body.collision_layer = layer
    body.collision_mask = layer
    add_child(body)

func _physics_process(_dt):
    steps += 1
    if steps == 9:
        for ball in balls:
            print("v ", -ball.linear_velocity.y / SCALE)
        get_tree().quit()
EOF
echo "godot3-server $(HOME=$work godot3-server --version 2>/dev/null)"
HOME=$work godot3-server --path "$work" --fixed-fps 60 2>/dev/null | grep '^v ' >"$work/seen"
python3 - "$work/seen" <<'EOF'
import sys

with open(sys.argv[1], encoding="utf-8") as file:
    speeds = [float(line.split()[1]) for line in file]
box, line = speeds[:5], speeds[5:]
print(f"rebound speed from a rectangle: {[round(v, 2) for v in box]}, 9 expected")
print(f"rebound speed from a line:      {[round(v, 2) for v in line]}")
right = all(abs(v - 9.0) < 0.05 for v in box)
if not (right and min(line) < 6.0 and max(line) > 12.0):
    sys.exit("the behaviour has changed: look again at what is said above")
EOF
