"use strict";
const RPM = 30 / Math.PI, DEG = 180 / Math.PI, SVG = "http://www.w3.org/2000/svg", POINTS = 160;
const place = name => document.getElementById(name);
// The sets of the port in their order: its other members are functions.
const levels = Object.values(Bounce).filter(one => one && typeof one === "object");
const names = Object.keys(settings.sliders);
let level = 0, state = {}, start = {};

function parameters(at) {
    const own = { ...levels[level] };
    for (const name of ["mu", "cor_10"]) if (name in at) own[name] = at[name];
    return own;
}

function incident(at) {
    if (!settings.tangential) return [0, at.speed, 0];
    // Straight down is straight down.
    const along = at.angle === 90 ? 0 : Math.cos(at.angle / DEG);
    return [at.speed * along, at.speed * Math.sin(at.angle / DEG), at.spin / RPM];
}

const bounce = at => Bounce.rebound(...incident(at), parameters(at));
const number = (value, digits) => value.toFixed(digits).replace(/^-(?=[0.]*$)/, "").replace("-", "\u2212");

function draw(parent, kind, attributes, text) {
    const node = document.createElementNS(SVG, kind);
    for (const key in attributes) node.setAttribute(key, attributes[key]);
    if (text !== undefined) node.textContent = text;
    return parent.appendChild(node);
}

function arrow(svg, x1, y1, x2, y2, colour) {
    const length = Math.hypot(x2 - x1, y2 - y1), head = 10;
    if (length < head) return;
    const ux = (x2 - x1) / length, uy = (y2 - y1) / length, bx = x2 - head * ux, by = y2 - head * uy;
    draw(svg, "line", { x1, y1, x2: bx, y2: by, stroke: colour, "stroke-width": 3 });
    draw(svg, "polygon", { points: `${x2},${y2} ${bx - 5 * uy},${by + 5 * ux} ${bx + 5 * uy},${by - 5 * ux}`, fill: colour });
}

/** A ball, and round it an arrow as long as it spins fast; topspin turns clockwise when it flies to the right. */
function ball(svg, x, y, omega, colour) {
    draw(svg, "circle", { cx: x, cy: y, r: 13, fill: "var(--wash)", stroke: colour, "stroke-width": 2 });
    const turn = Math.sign(omega) * Math.min(5, Math.abs(omega) / 120);
    if (Math.abs(turn) < 0.15) return;
    const at = angle => [x + 19 * Math.sin(angle), y - 19 * Math.cos(angle)], [x1, y1] = at(-turn / 2), [x2, y2] = at(turn / 2);
    const flags = `${Math.abs(turn) > Math.PI ? 1 : 0} ${turn > 0 ? 1 : 0}`;
    draw(svg, "path", { d: `M${x1},${y1} A19,19 0 ${flags} ${x2},${y2}`, fill: "none", stroke: colour, "stroke-width": 2 });
    const ahead = turn / 2 + Math.sign(turn) * Math.PI / 2, [hx, hy] = [Math.sin(ahead), -Math.cos(ahead)];
    draw(svg, "polygon", { points: `${x2 + 7 * hx},${y2 + 7 * hy} ${x2 - 4 * hy},${y2 + 4 * hx} ${x2 + 4 * hy},${y2 - 4 * hx}`, fill: colour });
}

function flight(before, after) {
    const svg = place("flight"), ground = 215, x0 = 360, y0 = ground - 13;
    svg.replaceChildren();
    draw(svg, "line", { x1: 0, x2: 720, y1: ground, y2: ground, stroke: "currentColor", "stroke-width": 2 });
    // The longest arrow fits into the picture, whatever its direction; steep ones stand side by side.
    const room = (x, y) => Math.min(300 / Math.max(Math.abs(x), 1e-9), 165 / Math.max(Math.abs(y), 1e-9));
    const scale = Math.min(room(before[0], before[1]), room(after.v_x2, after.v_y2));
    const apart = Math.abs(scale * (before[0] + after.v_x2)) < 60 ? 40 : 0;
    const from = [x0 - apart - scale * before[0], y0 - scale * before[1]], to = [x0 + apart + scale * after.v_x2, y0 - scale * after.v_y2];
    draw(svg, "circle", { cx: x0, cy: y0, r: 13, fill: "none", stroke: "var(--quiet)", "stroke-dasharray": "3 3" });
    arrow(svg, ...from, x0 - apart, y0, "var(--blue)");
    arrow(svg, x0 + apart, y0, ...to, "var(--after)");
    ball(svg, ...from, before[2], "var(--blue)");
    ball(svg, ...to, after.omega_2, "var(--after)");
    const words = (x, y) => `${Math.hypot(x, y).toFixed(1)} m/s, ${(Math.atan2(y, x) * DEG).toFixed(1)}\u00b0`;
    place("before").textContent = `before: ${words(before[0], before[1])}`;
    place("after").textContent = `after: ${words(after.v_x2, after.v_y2)}`;
}

function table(before, after) {
    const [v_x, v_y, omega] = before, body = place("rebound"), angle = (y, x) => Math.atan2(y, x) * DEG;
    const [x2, y2, spin] = sphere(...before, settings.spheres[level], parameters(state));
    const rows = settings.tangential ? [
        ["v_x, along the court [m/s]", v_x, after.v_x2, x2, 2], ["v_y, towards it, then away [m/s]", v_y, after.v_y2, y2, 2],
        ["speed [m/s]", Math.hypot(v_x, v_y), Math.hypot(after.v_x2, after.v_y2), Math.hypot(x2, y2), 2],
        ["angle to the court [deg]", angle(v_y, v_x), angle(after.v_y2, after.v_x2), angle(y2, x2), 1],
        ["spin, topspin positive [rpm]", omega * RPM, after.omega_2 * RPM, spin * RPM, 0],
    ] : [["v_y, towards the court, then away [m/s]", v_y, after.v_y2, y2, 2]];
    body.replaceChildren();
    for (const [name, first, second, other, digits] of rows) {
        const row = body.insertRow();
        for (const cell of [name, number(first, digits), number(second, digits), number(other, digits)]) row.insertCell().textContent = cell;
        row.cells[0].className = "left";
    }
    const row = body.insertRow(), time = after.contact_time;
    for (const cell of ["restitution, v_y2/v_y1", "", number(after.v_y2 / v_y, 3), number(y2 / v_y, 3)]) row.insertCell().textContent = cell;
    row.cells[0].className = "left";
    place("other").textContent = `${number(3.6 * state.speed, 0)} km/h, ${number(state.speed / 0.44704, 0)} mph; v_y1 = ${number(v_y, 1)} m/s`
        + (time > 0 ? `; contact ${number(1e3 * time, 2)} ms` : "");
}

function said(before, after) {
    const words = [], range = settings.measured[level], phases = [];
    for (let rest = after.regime; rest > 0; rest = Math.floor(rest / 8)) phases.push(settings.phases[rest % 8]);
    if (after.status > 0) words.push(`The model has no answer here: ${settings.reasons[after.status]}. A rigid ball of the same restitution and friction instead.`);
    else words.push(!settings.tangential ? "A drop: vertical motion alone." : `The contact point: ${phases.join(", ") || "no slip"}.`);
    if (range === null) words.push("Nothing was fitted: no measured impact supports these numbers.");
    else if (after.extrapolated) words.push(`Extrapolated: v_y1 was measured from ${range[0].toPrecision(3)} to ${range[1].toPrecision(3)} m/s, and no measured impact has nearly this speed, angle and spin.`);
    const moved = Object.entries(settings.moved).filter(([name]) => name in state && state[name] !== start[name]);
    if (moved.length) words.push(`Not the ${settings.measured[level] === null ? "set" : "fitted"} ${moved.map(([, words]) => words).join(" and ")}.`);
    place("said").className = `lead ${after.status > 0 ? "poor" : range === null || after.extrapolated || moved.length ? "part" : ""}`.trim();
    place("said").replaceChildren(...words.map(text => Object.assign(document.createElement("p"), { textContent: text })));
    place("thin").textContent = moved.length ? "Thin grey: at the start's friction and restitution." : "";
}

function ticks(low, high) {
    const raw = (high - low) / 6, unit = 10 ** Math.floor(Math.log10(raw)), step = unit * [1, 2, 5, 10].find(factor => factor * unit >= 0.999 * raw);
    const found = [], digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k) found.push([k * step, number(k * step, digits)]);
    return found;
}

function curve(svg, axis, x, courses, point) {
    const left = 44, right = 282, top = 8, bottom = 176, every = courses.flatMap(([y]) => y).filter(Number.isFinite);
    let low = Math.min(0, ...every), high = Math.max(...every, low + 1e-6);
    [low, high] = [low - 0.05 * (high - low), high + 0.05 * (high - low)];
    const px = value => left + (value - x[0]) / (x[x.length - 1] - x[0]) * (right - left), py = value => bottom - (value - low) / (high - low) * (bottom - top);
    svg.replaceChildren();
    for (const [value, text] of ticks(x[0], x[x.length - 1])) {
        draw(svg, "line", { x1: px(value), x2: px(value), y1: top, y2: bottom, stroke: "var(--line)" });
        draw(svg, "text", { x: px(value), y: bottom + 15, "text-anchor": "middle" }, text);
    }
    for (const [value, text] of ticks(low, high)) {
        draw(svg, "line", { x1: left, x2: right, y1: py(value), y2: py(value), stroke: "var(--line)" });
        draw(svg, "text", { x: left - 5, y: py(value) + 4, "text-anchor": "end" }, text);
    }
    draw(svg, "text", { x: (left + right) / 2, y: bottom + 31, "text-anchor": "middle" }, axis);
    for (const [y, colour, width] of courses) {
        let d = "", pen = "M";
        y.forEach((value, k) => {
            if (Number.isFinite(value)) d += `${pen}${px(x[k]).toFixed(1)},${py(value).toFixed(1)}`;
            pen = Number.isFinite(value) ? "L" : "M";
        });
        draw(svg, "path", { d, fill: "none", stroke: colour, "stroke-width": width });
    }
    draw(svg, "circle", { cx: px(point[0]), cy: py(point[1]), r: 5, fill: "var(--after)", stroke: "var(--paper)" });
}

const CURVES = settings.tangential
    ? [["v_x2", "v_x2, along the court after [m/s]", 1], ["v_y2", "v_y2, away from it after [m/s]", 1], ["omega_2", "spin after [rpm]", RPM]]
    : [["v_y2", "v_y2, away from the court after [m/s]", 1]];

function curves(after) {
    const axis = settings.tangential ? "angle" : "speed", { low, high } = settings.sliders[axis];
    const x = Array.from({ length: POINTS + 1 }, (_, k) => low + (high - low) * k / POINTS);
    const own = { ...state, ...Object.fromEntries(Object.keys(settings.moved).filter(name => name in state).map(name => [name, start[name]])) };
    const moved = Object.keys(settings.moved).some(name => own[name] !== state[name]);
    const now = x.map(value => bounce({ ...state, [axis]: value })), then = moved ? x.map(value => bounce({ ...own, [axis]: value })) : [];
    CURVES.forEach(([name, , factor], k) => {
        const courses = [[now.map(one => factor * one[name]), "var(--blue)", 2]];
        if (moved) courses.unshift([then.map(one => factor * one[name]), "var(--quiet)", 1]);
        curve(place("plots").children[k].firstChild, settings.tangential ? "angle to the court [deg]" : "speed [m/s]", x, courses, [state[axis], factor * after[name]]);
    });
}

const vector = (x, y, z = 0) => ({ x, y, z }), NONE = vector(0, 0), DOWN = vector(0, -9.81), STEP = 1 / 60, STEPS = 120;

/** A rebound of an engine's rigid ball: restitution `e`; friction `mu` stops the slip or slides. */
function sphere(v_x, v_y, omega, { e, mu }, own) {
    const radius = own.ball_radius, a = own.inertia_ratio, slip = v_x - radius * omega;
    const p = Math.sign(slip) * Math.min(mu * (1 + e) * v_y, Math.abs(slip) * a / (1 + a));
    return [v_x - p, e * v_y, omega + p / (a * radius)];
}

/** The way of the fitted ball over two seconds, by steps of the port: from a step before it touches the court at x = 0. */
function wayOfPort([v_x, v_y, omega], own) {
    const early = STEP / 2, court = { normal: vector(0, 1), height: 0, velocity: NONE };
    const at = vector(-v_x * early, own.ball_radius + v_y * early - 4.905 * early * early);
    let ball = { position: at, velocity: vector(v_x, -v_y + 9.81 * early), spin: vector(0, 0, -omega), turn: NONE, ahead: 0, bounces: 0, status: 0, extrapolated: false };
    const way = [[at.x, at.y]];
    for (let k = 0; k < STEPS; ++k) {
        ball = Bounce.step(ball, DOWN, STEP, court, own);
        way.push([ball.position.x, ball.position.y]);
    }
    return way;
}

/** The same of an engine's ball, flights by formula. */
function wayOfSphere(before, own, how) {
    let [v_x, v_y, omega] = sphere(...before, how, own), x = 0, begun = STEP / 2;
    const way = [[-before[0] * begun, own.ball_radius + before[1] * begun - 4.905 * begun * begun]];
    for (let k = 1; k <= STEPS; ++k) {
        const t = k * STEP;
        for (let lasts = 2 * v_y / 9.81; lasts > STEP && t - begun > lasts; lasts = 2 * v_y / 9.81) {
            x += v_x * lasts;
            begun += lasts;
            [v_x, v_y, omega] = sphere(v_x, v_y, omega, how, own);
        }
        const time = t - begun, flies = 2 * v_y / 9.81 > STEP;
        way.push([x + v_x * time, own.ball_radius + (flies ? v_y * time - 4.905 * time * time : 0)]);
    }
    return way;
}

function ways(before) {
    const own = parameters(state), how = settings.spheres[level], svg = place("way");
    const fitted = wayOfPort(before, own), other = wayOfSphere(before, own, how), all = [...fitted, ...other];
    const left = Math.min(...all.map(([x]) => x), -0.5), right = Math.max(...all.map(([x]) => x), 0.5), high = Math.max(...all.map(([, y]) => y), 0.5);
    // A unit is a pixel, so that numbers are read on phones too.
    const width = svg.clientWidth || 720;
    svg.setAttribute("viewBox", `0 0 ${width} 190`);
    const px = x => 20 + (width - 40) * (x - left) / (right - left), py = y => 160 - 145 * y / high;
    svg.replaceChildren();
    draw(svg, "line", { x1: 0, x2: width, y1: 160, y2: 160, stroke: "currentColor", "stroke-width": 2 });
    for (const [value, text] of ticks(left, right)) draw(svg, "text", { x: px(value), y: 178, "text-anchor": "middle" }, `${text} m`);
    const line = way => way.map(([x, y], k) => `${k ? "L" : "M"}${px(x).toFixed(1)},${py(y).toFixed(1)}`).join("");
    draw(svg, "path", { d: line(other), fill: "none", stroke: "var(--blue)", "stroke-width": 2, "stroke-dasharray": "6 4" });
    draw(svg, "path", { d: line(fitted), fill: "none", stroke: "var(--after)", "stroke-width": 2 });
    const ends = [fitted, other].map(way => way[way.length - 1]);
    place("sphere").textContent = `e ${how.e.toFixed(3)}${settings.tangential ? `, mu ${how.mu.toFixed(3)}` : ""}`;
    place("apart").textContent = `${number(Math.hypot(ends[0][0] - ends[1][0], ends[0][1] - ends[1][1]), 2)} m apart after 2 s`;
}

function show() {
    const before = incident(state), after = bounce(state);
    for (const one of [said, flight, table]) one(before, after);
    ways(before);
    curves(after);
}

// A number that is typed and not yet one leaves everything as it is.
function set(name, text, from) {
    const { low, high, step } = settings.sliders[name], value = Number(text);
    if (text.trim() === "" || !(value >= low && value <= high)) return;
    state[name] = value;
    if (from !== name) place(name).value = value;
    if (from === name) place(`${name}-number`).value = Number(value.toFixed(Math.max(0, -Math.round(Math.log10(step))) + 1));
    show();
}

function reset(all) {
    for (const name of names) {
        start[name] = name in settings.moved ? levels[level][name] : settings.sliders[name].start;
        if (all || name in settings.moved) state[name] = start[name];
        place(name).value = state[name];
        place(`${name}-number`).value = Number(state[name].toPrecision(4));
    }
    show();
}

for (const [, words] of CURVES) {
    const figure = document.createElement("figure");
    draw(figure, "svg", { viewBox: "0 0 290 212", role: "img", "aria-label": words });
    figure.appendChild(Object.assign(document.createElement("figcaption"), { textContent: words }));
    place("plots").appendChild(figure);
}
for (const name of names) {
    const { low, high, step } = settings.sliders[name];
    for (const id of [name, `${name}-number`]) {
        Object.assign(place(id), { min: low, max: high, step: id === name ? step : "any" });
        place(id).addEventListener("input", () => set(name, place(id).value, id));
    }
}
if (place("level")) place("level").addEventListener("change", () => { level = Number(place("level").value); reset(false); });
place("controls").addEventListener("submit", event => event.preventDefault());
place("reset").addEventListener("click", () => reset(true));
addEventListener("resize", show);
reset(true);
