"use strict";
// Names of the page: `state` holds what the sliders say [m/s, deg, rpm, -, -].
const RPM = 30 / Math.PI, POINTS = 200, SVG = "http://www.w3.org/2000/svg";
const names = Object.keys(settings.sliders).filter(name => document.getElementById(name));
const start = {};
for (const name in settings.sliders) {
    start[name] = settings.sliders[name].start;
}
let state = { ...start };
const scratch = settings.followed ? port.newScratch() : null;

function rowOf(at) {
    const row = port.ROW.slice();
    if (settings.place.mu !== null) row[settings.place.mu] = at.mu;
    if (settings.place.cor !== null) row[settings.place.cor] = at.cor;
    return row;
}

function incident(at) {
    if (!settings.tangential) return [0, at.speed, 0];
    const theta = at.angle * Math.PI / 180;
    // Straight down is straight down.
    return [at.angle === 90 ? 0 : at.speed * Math.cos(theta), at.speed * Math.sin(theta), at.spin / RPM];
}

function bounce(at) {
    return port.solve(...incident(at), settings.toldCor ? at.cor : NaN, rowOf(at));
}

// ---- drawing

function draw(parent, kind, attributes, text) {
    const node = document.createElementNS(SVG, kind);
    for (const key in attributes) node.setAttribute(key, attributes[key]);
    if (text !== undefined) node.textContent = text;
    parent.appendChild(node);
    return node;
}

function ticks(low, high, count) {
    const raw = (high - low) / count, unit = 10 ** Math.floor(Math.log10(raw));
    const step = unit * [1, 2, 5, 10].find(factor => unit * factor >= raw * 0.999);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k) found.push(k * step);
    const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return found.map(value => ({ value, text: (Math.abs(value) < 1e-12 ? 0 : value).toFixed(digits).replace("-", "\u2212") }));
}

/** Axes with ticks; returns the maps from values to places. */
function axes(svg, x, y, label) {
    const [, , width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    const left = 52, right = width - 8, top = 10, bottom = height - 36;
    svg.replaceChildren();
    const back = draw(svg, "g", {});
    const px = value => left + (value - x[0]) / (x[1] - x[0]) * (right - left);
    const py = value => bottom - (value - y[0]) / (y[1] - y[0]) * (bottom - top);
    for (const tick of ticks(...x, 5)) {
        draw(svg, "line", { x1: px(tick.value), x2: px(tick.value), y1: top, y2: bottom, stroke: "var(--line)" });
        draw(svg, "text", { x: px(tick.value), y: bottom + 15, "text-anchor": "middle" }, tick.text);
    }
    for (const tick of ticks(...y, 5)) {
        draw(svg, "line", { x1: left, x2: right, y1: py(tick.value), y2: py(tick.value), stroke: "var(--line)" });
        draw(svg, "text", { x: left - 5, y: py(tick.value) + 4, "text-anchor": "end" }, tick.text);
    }
    draw(svg, "text", { x: (left + right) / 2, y: height - 5, "text-anchor": "middle" }, label);
    return { px, py, back, left, right, top, bottom, svg };
}

function ends(values) {
    let low = Math.min(...values), high = Math.max(...values);
    if (!(high - low > 1e-9 * (1 + Math.abs(high)))) { low -= 1; high += 1; }
    const room = 0.06 * (high - low);
    return [low - room, high + room];
}

function line(plot, points, colour, more) {
    let path = "", pen = "M";
    for (const [x, y] of points) {
        if (Number.isFinite(y)) {
            path += `${pen}${plot.px(x).toFixed(2)},${plot.py(y).toFixed(2)}`;
            pen = "L";
        } else {
            pen = "M";
        }
    }
    draw(plot.svg, "path", { d: path, fill: "none", stroke: colour, "stroke-width": 2, "stroke-linejoin": "round", ...more });
}

function arrow(svg, x1, y1, x2, y2, colour) {
    const length = Math.hypot(x2 - x1, y2 - y1);
    if (length < 2) return;
    const [ux, uy] = [(x2 - x1) / length, (y2 - y1) / length], head = Math.min(11, length);
    draw(svg, "line", { x1, y1, x2: x2 - ux * head * 0.8, y2: y2 - uy * head * 0.8, stroke: colour, "stroke-width": 3 });
    const [bx, by] = [x2 - ux * head, y2 - uy * head], wing = head * 0.45;
    draw(svg, "polygon", {
        points: `${x2},${y2} ${bx - uy * wing},${by + ux * wing} ${bx + uy * wing},${by - ux * wing}`, fill: colour,
    });
}

/** A ball with an arrow round it, as long as it spins fast; topspin turns clockwise when it flies to the right. */
function ball(svg, x, y, spin, colour) {
    draw(svg, "circle", { cx: x, cy: y, r: 13, fill: "var(--soft)", stroke: colour, "stroke-width": 2 });
    const turn = Math.sign(spin) * Math.min(300, Math.abs(spin) * RPM / 20) * Math.PI / 180;
    if (Math.abs(turn) < 0.15) return;
    const at = angle => [x + 19 * Math.sin(angle), y - 19 * Math.cos(angle)];
    const [from, to] = [at(-turn / 2), at(turn / 2)];
    const large = Math.abs(turn) > Math.PI ? 1 : 0, sweep = turn > 0 ? 1 : 0;
    draw(svg, "path", {
        d: `M${from} A19,19 0 ${large} ${sweep} ${to}`, fill: "none", stroke: colour, "stroke-width": 2,
    });
    const along = turn / 2 + Math.sign(turn) * Math.PI / 2;
    const [hx, hy] = [Math.sin(along), -Math.cos(along)];
    draw(svg, "polygon", {
        points: `${to[0] + 7 * hx},${to[1] + 7 * hy} ${to[0] - 4 * hy},${to[1] + 4 * hx} ${to[0] + 4 * hy},${to[1] - 4 * hx}`,
        fill: colour,
    });
}

function flight(before, after) {
    const svg = document.getElementById("flight"), ground = 215, x0 = 360, y0 = ground - 13;
    svg.replaceChildren();
    draw(svg, "line", { x1: 0, x2: 720, y1: ground, y2: ground, stroke: "currentColor", "stroke-width": 2 });
    const fastest = Math.max(Math.hypot(before[0], before[1]), Math.hypot(after.v_x2, after.v_y2));
    // The longest line fits into the picture, whatever its direction.
    const room = (vx, vy) => Math.min(300 / Math.max(Math.abs(vx), 1e-9), 165 / Math.max(Math.abs(vy), 1e-9));
    const scale = Math.min(room(before[0], before[1]), room(after.v_x2, after.v_y2), 300 / fastest);
    const from = [x0 - scale * before[0], y0 - scale * before[1]], to = [x0 + scale * after.v_x2, y0 - scale * after.v_y2];
    const steep = Math.abs(from[0] - to[0]) < 60;
    const [a, b] = steep ? [x0 - 40, x0 + 40] : [x0, x0];
    draw(svg, "circle", { cx: x0, cy: y0, r: 13, fill: "none", stroke: "var(--faint)", "stroke-dasharray": "3 3" });
    // Arrows end at the rims of the balls.
    const short = (x1, y1, x2, y2) => {
        const length = Math.hypot(x2 - x1, y2 - y1), share = Math.max(0, length - 14) / Math.max(length, 1e-9);
        return [x1, y1, x1 + share * (x2 - x1), y1 + share * (y2 - y1)];
    };
    arrow(svg, ...short(from[0] - (x0 - a), from[1], a, y0), "var(--one)");
    arrow(svg, ...short(b, y0, to[0] + (b - x0), to[1]), "var(--two)");
    ball(svg, from[0] - (x0 - a), from[1], before[2], "var(--one)");
    ball(svg, to[0] + (b - x0), to[1], after.omega_2, "var(--two)");
    const words = (vx, vy) => `${Math.hypot(vx, vy).toFixed(1)} m/s, ${(Math.atan2(vy, vx) * 180 / Math.PI).toFixed(1)}\u00b0`;
    document.getElementById("before").textContent = `before: ${words(before[0], before[1])}`;
    document.getElementById("after").textContent = `after: ${words(after.v_x2, after.v_y2)}`;
}

// ---- numbers

function energy(vx, vy, omega) {
    const { mass, inertia } = settings.ball;
    return 0.5 * mass * (vx * vx + vy * vy) + 0.5 * inertia * omega * omega;
}

function rows(before, after) {
    const [vx, vy, omega] = before, degrees = (y, x) => Math.atan2(y, x) * 180 / Math.PI;
    const along = settings.tangential ? [
        ["v_x2", "along the court [m/s]", vx, after.v_x2, 3],
        ["v_y2", "towards, then away from it [m/s]", vy, after.v_y2, 3],
        ["omega_2", "spin [rad/s]", omega, after.omega_2, 1],
        ["spin_2", "spin [rpm]", omega * RPM, after.omega_2 * RPM, 0],
        ["speed_2", "speed [m/s]", Math.hypot(vx, vy), Math.hypot(after.v_x2, after.v_y2), 3],
        ["angle_2", "angle to the court [deg]", degrees(vy, vx), degrees(after.v_y2, after.v_x2), 2],
    ] : [["v_y2", "towards, then away from the court [m/s]", vy, after.v_y2, 3]];
    return [...along, ["energy_2", "kinetic energy [J]", energy(vx, vy, omega), energy(after.v_x2, after.v_y2, after.omega_2), 3]];
}

function number(value, digits) {
    return value.toFixed(digits).replace("-", "\u2212");
}

function table(before, after) {
    const body = document.querySelector("#rebound tbody");
    body.replaceChildren();
    const add = (name, cells, value) => {
        const row = body.insertRow();
        row.dataset.name = name;
        row.dataset.value = value;
        for (const cell of cells) row.insertCell().textContent = cell;
    };
    for (const [name, label, first, second, digits] of rows(before, after)) {
        add(name, [label, number(first, digits), number(second, digits), number(second - first, digits)], second);
    }
    add("restitution", ["restitution, v_y2/v_y1", "", number(after.v_y2 / before[1], 4), ""], after.v_y2 / before[1]);
    const times = [["contact_time", "contact time [ms]", 1e3, 3], ["gap_time", "time between the flights [ms]", 1e3, 3]];
    if (settings.tangential) {
        times.push(["gap_path", "path between the flights [mm]", 1e3, 1], ["gap_turn", "turn between the flights [deg]", 180 / Math.PI, 1]);
    }
    for (const [name, label, factor, digits] of times) {
        if (!Number.isNaN(after[name])) add(name, [label, "", number(factor * after[name], digits), ""], after[name]);
    }
}

function said(before, after) {
    const place = document.getElementById("said"), words = [];
    place.dataset.status = after.status;
    place.dataset.extrapolated = after.extrapolated;
    place.dataset.regime = after.status === 0 ? port.regimeName(after.regime) : "";
    place.classList.toggle("beyond", after.status !== 0 || after.extrapolated !== 0);
    if (after.status !== 0) {
        words.push(`No rebound: ${port.REASONS[after.status]}.`);
    } else {
        words.push(settings.tangential ? `The contact point: ${place.dataset.regime || "it grazes"}.` : "A drop: vertical motion alone.");
        if (after.extrapolated & port.BEYOND_SPEEDS) {
            const low = port.V_Y1_LOW.toPrecision(3), high = port.V_Y1_HIGH.toPrecision(3);
            words.push(`v_y1 = ${before[1].toFixed(2)} m/s lies outside of the valid range, ${low} to ${high} m/s: `
                + "restitution and offset are those of its nearer end.");
        }
        if (after.extrapolated & port.BEYOND_RESTITUTION) words.push("The restitution lies beyond what the model solves: taken as its end.");
        if (after.extrapolated & port.WITHOUT_TWIST) words.push("The model has no solution here: the ball is taken as rigid.");
    }
    const moved = ["mu", "cor"].filter(name => names.includes(name) && state[name] !== start[name] && !(name === "cor" && settings.toldCor));
    if (moved.length) words.push(`Not the start's own ${moved.map(name => ({ mu: "friction", cor: "restitution" })[name]).join(" and ")}.`);
    place.textContent = words.join(" ");
}

// ---- courses and curves

function courses(before, after) {
    const lower = document.getElementById("phases");
    const codes = after.extrapolated & port.WITHOUT_TWIST ? port.RIGID : port.CODES;
    const row = rowOf(state), cor = settings.toldCor ? Math.min(Math.max(state.cor, port.COR_LOW), port.COR_HIGH) : NaN;
    const moments = [];
    for (let k = 0; k <= POINTS && after.status === 0; ++k) {
        moments.push(port.total_moment(row, codes, ...before, cor, Math.min(Math.max(k / POINTS, 1e-5), 1 - 1e-9), scratch));
    }
    if (!moments.length || moments.some(moment => moment.status !== 0)) {
        lower.textContent = "No course: the model has no solution here.";
        for (const id of ["forces", "speeds"]) document.getElementById(id).replaceChildren();
        return;
    }
    const time = moments.map(moment => 1e3 * moment.time), radius = settings.ball.radius;
    const last = 1e3 * after.contact_time;
    const course = (name, factor = 1) => moments.map(moment => factor * moment[name]);
    const forces = [course("normal_force")], speeds = [course("v_y")];
    if (settings.tangential) {
        forces.push(course("friction_force"));
        speeds.splice(0, 1, course("v_x"), course("omega_shell", radius), course("omega_core", radius));
    }
    const shades = ["", "slide", "back", "grip", "hold", "free"];
    for (const [id, label, lines] of [["forces", "time [ms]; forces [N]", forces], ["speeds", "time [ms]; velocities [m/s]", speeds]]) {
        const plot = axes(document.getElementById(id), [0, last], ends([0, ...lines.flat()]), label);
        moments.forEach((moment, k) => {
            if (!moment.phase) return;
            const left = plot.px(k ? (time[k - 1] + time[k]) / 2 : 0), right = plot.px(k < POINTS ? (time[k] + time[k + 1]) / 2 : last);
            draw(plot.back, "rect", { x: left, y: plot.top, width: right - left + 0.3, height: plot.bottom - plot.top, fill: `var(--${shades[moment.phase]})` });
        });
        line(plot, [[0, 0], [last, 0]], "currentColor", { "stroke-width": 1 });
        ["one", "two", "three"].forEach((colour, k) => lines[k] && line(plot, time.map((t, j) => [t, lines[k][j]]), `var(--${colour})`));
    }
    if (!settings.tangential) return;
    const met = [...new Set(moments.map(moment => moment.phase))].filter(Boolean);
    lower.replaceChildren("Phases:", ...met.flatMap(phase => {
        const key = document.createElement("span");
        key.className = "key";
        key.style.background = `var(--${shades[phase]})`;
        return [key, settings.phases[phase]];
    }));
}

const CURVES = settings.tangential ? { v_x2: 1, v_y2: 1, omega_2: RPM } : { v_y2: 1 };

function curves(after) {
    const axis = settings.tangential ? "angle" : "speed", { low, high } = settings.sliders[axis];
    const values = Array.from({ length: 161 }, (_, k) => low + (high - low) * k / 160);
    const moved = state.mu !== start.mu || state.cor !== start.cor;
    const found = values.map(value => bounce({ ...state, [axis]: value }));
    const first = moved ? values.map(value => bounce({ ...state, mu: start.mu, cor: start.cor, [axis]: value })) : [];
    for (const name in CURVES) {
        const course = list => list.map((item, k) => [values[k], CURVES[name] * item[name]]);
        const every = [...course(found), ...course(first)].map(pair => pair[1]).filter(Number.isFinite);
        if (!every.length) every.push(0);
        const plot = axes(document.getElementById(`curve-${name}`), [low, high], ends(every), settings.tangential ? "angle to the court [deg]" : "v_y1 [m/s]");
        found.forEach((item, k) => {
            if (item.status === 0 && item.extrapolated & port.BEYOND_SPEEDS) {
                const half = (high - low) / 320, from = Math.max(low, values[k] - half), to = Math.min(high, values[k] + half);
                draw(plot.back, "rect", { x: plot.px(from), y: plot.top, width: plot.px(to) - plot.px(from) + 0.3, height: plot.bottom - plot.top, fill: "var(--free)" });
            }
        });
        if (moved) line(plot, course(first), "var(--faint)", { "stroke-width": 1.2 });
        line(plot, course(found), "var(--one)");
        if (after.status === 0) {
            draw(plot.svg, "circle", { cx: plot.px(state[axis]), cy: plot.py(CURVES[name] * after[name]), r: 5.5, fill: "var(--two)", stroke: "var(--paper)", "stroke-width": 1.5 });
        }
    }
}

function show() {
    const before = incident(state), after = bounce(state);
    said(before, after);
    if (after.status === 0) {
        flight(before, after);
        table(before, after);
    } else {
        document.getElementById("flight").replaceChildren();
        document.querySelector("#rebound tbody").replaceChildren();
    }
    if (settings.followed) courses(before, after);
    curves(after);
    const kmh = (3.6 * state.speed).toFixed(0), mph = (state.speed / 0.44704).toFixed(0);
    document.getElementById("other").textContent = `${kmh} km/h, ${mph} mph; v_y1 = ${before[1].toFixed(2)} m/s`
        + (settings.tangential ? `, v_x1 = ${number(before[0], 2)} m/s; spin ${number(state.spin / RPM, 0)} rad/s` : "");
}

// A number that is typed and not yet one leaves everything as it is.
function set(name, text, from) {
    const value = Number(text), { low, high, step } = settings.sliders[name];
    if (text.trim() === "" || !(value >= low && value <= high)) return;
    state[name] = value;
    const digits = Math.max(0, -Math.round(Math.log10(step)));
    if (from !== "range") document.getElementById(name).value = value;
    if (from !== "number") document.getElementById(`${name}-number`).value = Number(value.toFixed(digits + 3));
    show();
}

for (const name of names) {
    const { low, high, step } = settings.sliders[name];
    for (const [kind, id] of [["range", name], ["number", `${name}-number`]]) {
        const input = document.getElementById(id);
        Object.assign(input, { min: low, max: high, step: kind === "range" ? step : "any" });
        input.addEventListener("input", () => set(name, input.value, kind));
    }
}

function reset() {
    state = { ...start };
    for (const name of names) {
        document.getElementById(name).value = start[name];
        document.getElementById(`${name}-number`).value = Number(start[name].toPrecision(6));
    }
    show();
}

document.getElementById("controls").addEventListener("submit", event => event.preventDefault());
document.getElementById("reset").addEventListener("click", reset);
reset();
