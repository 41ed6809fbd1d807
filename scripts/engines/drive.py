"""Runs a recipe for a physics engine of Python: impacts to rebounds, in a process of its own.

    python drive.py ENGINE RECIPE < job.json

The job has `impacts` (v_x1, v_y1, omega_1), `radius`, `hertz`, and `phases`: shares of a step at
which the ball touches. Without gravity each ball is set so that it touches in the fourth step, and
seen after it has left. With `seconds` a ball is dropped instead from `height`, with gravity. The
answer is JSON: rebounds, or the lowest point, speed and spin of the last tenth of the time.
"""

import json
import sys
from collections.abc import Callable
from math import ceil
from typing import Any, NamedTuple

# What a recipe defines, by name.
Names = dict[str, Any]


class Adapter(NamedTuple):
    """What is asked of an engine: to set gravity, to put the ball at a height with velocity along
    the court and towards it and topspin, to make a step [s], and to look: height, velocity along
    the court and away from it, topspin.
    """

    gravity: Callable[[Names, float], None]
    put: Callable[[Names, float, float, float, float], None]
    step: Callable[[Names, float], None]
    look: Callable[[Names], tuple[float, float, float, float]]


def _pymunk_gravity(names: Names, g: float) -> None:
    names["space"].gravity = (0.0, -g)


def _pymunk_put(names: Names, y: float, v_x: float, v_y: float, omega: float) -> None:
    ball = names["ball"]
    ball.position = (0.0, y)
    ball.velocity = (v_x, -v_y)
    ball.angular_velocity = -omega


def _pymunk_step(names: Names, dt: float) -> None:
    names["space"].step(dt)


def _pymunk_look(names: Names) -> tuple[float, float, float, float]:
    ball = names["ball"]
    return ball.position.y, ball.velocity.x, ball.velocity.y, -ball.angular_velocity


def _pybullet_gravity(names: Names, g: float) -> None:
    names["pybullet"].setGravity(0.0, 0.0, -g)


def _pybullet_put(names: Names, y: float, v_x: float, v_y: float, omega: float) -> None:
    bullet = names["pybullet"]
    bullet.resetBasePositionAndOrientation(names["ball"], [0.0, 0.0, y], [0.0, 0.0, 0.0, 1.0])
    bullet.resetBaseVelocity(names["ball"], [v_x, 0.0, -v_y], [0.0, omega, 0.0])


def _pybullet_step(names: Names, dt: float) -> None:
    names["pybullet"].setTimeStep(dt)
    # With a port the recipe has a step of its own.
    names.get("step", names["pybullet"].stepSimulation)()


def _pybullet_look(names: Names) -> tuple[float, float, float, float]:
    place, _ = names["pybullet"].getBasePositionAndOrientation(names["ball"])
    velocity, spin = names["pybullet"].getBaseVelocity(names["ball"])
    return place[2], velocity[0], velocity[2], spin[1]


def _mujoco_gravity(names: Names, g: float) -> None:
    names["model"].opt.gravity[:] = (0.0, 0.0, -g)


def _mujoco_put(names: Names, y: float, v_x: float, v_y: float, omega: float) -> None:
    names["mujoco"].mj_resetData(names["model"], names["data"])
    names["data"].qpos[:] = (0.0, 0.0, y, 1.0, 0.0, 0.0, 0.0)
    names["data"].qvel[:] = (v_x, 0.0, -v_y, 0.0, omega, 0.0)


def _mujoco_step(names: Names, dt: float) -> None:
    names["model"].opt.timestep = dt
    names["mujoco"].mj_step(names["model"], names["data"])


def _mujoco_look(names: Names) -> tuple[float, float, float, float]:
    # Spin of a free joint is in the ball's own axes, which turn about y alone.
    data = names["data"]
    return data.qpos[2], data.qvel[0], data.qvel[2], data.qvel[4]


def _box2d_gravity(names: Names, g: float) -> None:
    names["world"].gravity = (0.0, -g * names["SCALE"])


def _box2d_put(names: Names, y: float, v_x: float, v_y: float, omega: float) -> None:
    ball = names["ball"]
    scale = names["SCALE"]
    ball.awake = True
    ball.position = (0.0, y * scale)
    ball.linearVelocity = (v_x * scale, -v_y * scale)
    ball.angularVelocity = -omega


def _box2d_step(names: Names, dt: float) -> None:
    names["world"].Step(dt, 8, 3)


def _box2d_look(names: Names) -> tuple[float, float, float, float]:
    ball = names["ball"]
    scale = names["SCALE"]
    velocity = ball.linearVelocity
    return ball.position.y / scale, velocity.x / scale, velocity.y / scale, -ball.angularVelocity


ADAPTERS = {
    "pymunk": Adapter(_pymunk_gravity, _pymunk_put, _pymunk_step, _pymunk_look),
    "pybullet": Adapter(_pybullet_gravity, _pybullet_put, _pybullet_step, _pybullet_look),
    "mujoco": Adapter(_mujoco_gravity, _mujoco_put, _mujoco_step, _mujoco_look),
    "box2d": Adapter(_box2d_gravity, _box2d_put, _box2d_step, _box2d_look),
}
# Steps before the one in which the ball touches.
BEFORE = 3
# Longest time that a contact lasts [s], of engines whose contact is a spring.
CONTACT = 0.02


def rebounds(adapter: Adapter, names: Names, job: Names) -> list[list[float]]:
    """Rebounds of all impacts at all phases of the step: v_x2, v_y2, omega_2."""
    dt = 1.0 / job["hertz"]
    count = 2 * BEFORE + 2 + ceil(CONTACT / dt)
    adapter.gravity(names, 0.0)
    after = []
    for v_x, v_y, omega in job["impacts"]:
        for phase in job["phases"]:
            # A step apart, so that the engine forgets the contact before.
            adapter.put(names, 1.0, 0.0, 0.0, 0.0)
            adapter.step(names, dt)
            adapter.put(names, job["radius"] + v_y * dt * (BEFORE + phase), v_x, v_y, omega)
            for _ in range(count):
                adapter.step(names, dt)
            after.append(list(adapter.look(names)[1:]))
    return after


def rest(adapter: Adapter, names: Names, job: Names) -> list[float]:
    """Height of a dropped ball over the court: highest and lowest of the last tenth of the time;
    its largest speed and spin then.
    """
    dt = 1.0 / job["hertz"]
    adapter.gravity(names, 9.81)
    adapter.put(names, job["height"] + job["radius"], 0.0, 0.0, 0.0)
    count = round(job["seconds"] / dt)
    seen = []
    for k in range(count):
        adapter.step(names, dt)
        if k >= 0.9 * count:
            y, v_x, v_y, omega = adapter.look(names)
            seen.append((y - job["radius"], abs(v_x), abs(v_y), abs(omega)))
    heights, along, up, spins = zip(*seen, strict=True)
    return [max(heights), min(heights), max(along), max(up), max(spins)]


def main() -> None:
    """Run the job."""
    engine, recipe = sys.argv[1:]
    with open(recipe, encoding="utf-8") as file:  # noqa: PTH123
        code = compile(file.read(), recipe, "exec")
    names: Names = {}
    exec(code, names)
    job = json.load(sys.stdin)
    run = rest if "seconds" in job else rebounds
    print(json.dumps(run(ADAPTERS[engine], names, job)))


if __name__ == "__main__":
    main()
