// p2-es by settings.
import { Body, Circle, ContactMaterial, Material, Plane, World } from "p2-es";

const world = new World({ gravity: [0, 0] });
const ball = new Body({ mass: @mass@, damping: 0, angularDamping: 0 });
ball.addShape(new Circle({ radius: @radius@, material: new Material() }));
ball.inertia = @inertia@;
ball.invInertia = ball.invInertiaSolve = 1 / @inertia@;
world.addBody(ball);
const court = new Body({ mass: 0 });
court.addShape(new Plane({ material: new Material() }));
world.addBody(court);
const pair = [ball.shapes[0].material, court.shapes[0].material];
world.addContactMaterial(new ContactMaterial(...pair, { restitution: @e@, friction: @mu@ }));
const engine = {
    gravity: (g) => (world.gravity[1] = -g),
    put(y, vX, vY, omega) {
        ball.position = [0, y];
        ball.velocity = [vX, -vY];
        ball.angularVelocity = -omega;
    },
    step: (dt) => world.step(dt),
    look: () => [ball.position[1], ball.velocity[0], ball.velocity[1], -ball.angularVelocity],
};
