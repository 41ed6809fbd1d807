// Runs the recipe above for the `engine` above; a job and its answer are those of drive.py.
import { readFileSync as readJob } from "node:fs";
const job = JSON.parse(readJob(0, "utf8"));
const dt = 1 / job.hertz, BEFORE = 3, CONTACT = 0.02;

function rebounds() {
    const count = 2 * BEFORE + 2 + Math.ceil(CONTACT / dt), after = [];
    engine.gravity(0);
    for (const [vX, vY, omega] of job.impacts) {
        for (const phase of job.phases) {
            // A step apart, so that the engine forgets the contact before.
            engine.put(1, 0, 0, 0);
            engine.step(dt);
            engine.put(job.radius + vY * dt * (BEFORE + phase), vX, vY, omega);
            for (let k = 0; k < count; ++k) engine.step(dt);
            after.push(engine.look().slice(1));
        }
    }
    return after;
}

function rest() {
    const count = Math.round(job.seconds / dt), seen = [];
    engine.gravity(9.81);
    engine.put(job.height + job.radius, 0, 0, 0);
    for (let k = 0; k < count; ++k) {
        engine.step(dt);
        if (k >= 0.9 * count) seen.push(engine.look());
    }
    const most = (column, of) => Math.max(...seen.map((row) => of(row[column])));
    const lowest = Math.min(...seen.map((row) => row[0])) - job.radius;
    const highest = most(0, (height) => height - job.radius);
    return [highest, lowest, most(1, Math.abs), most(2, Math.abs), most(3, Math.abs)];
}

console.log(JSON.stringify("seconds" in job ? rest() : rebounds()));
