// Interactive view of the structure: orthographic, z upright, drawn only after changes.
const section = document.querySelector("#space");
const canvas = section?.querySelector("canvas");
const gl = canvas?.getContext("webgl2", { antialias: true, premultipliedAlpha: false });
if (gl) start(JSON.parse(document.querySelector("#space-data").textContent)).catch((error) => console.warn(error));

async function start(given) {
  const bytes = await inflated(given.arrays);
  const draw = drawer(gl, given, bytes);
  const view = document.querySelector("#space-view");
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const low = given.low, span = given.span;
  const centre = low.map((value, i) => value + span[i] / 2);
  const radius = Math.hypot(...span) / 2;
  const home = { azimuth: Math.atan2(given.eye[1], given.eye[0]), elevation: Math.asin(given.eye[2]), size: 1, x: 0, y: 0 };
  let camera = { ...home }, state = given.first, phase = Math.PI / 2, playing = false, waiting = false, group = 0, gauges = "seen";

  // Right, up and towards the eye, as rows.
  function axes({ azimuth, elevation }) {
    const [s, c, u, w] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation)];
    return [[-s, c, 0], [-u * c, -u * s, w], [w * c, w * s, u]];
  }
  const along = (axis, point) => axis.reduce((sum, value, i) => sum + value * (point[i] - centre[i]), 0);

  // Half the visible height that contains the whole box.
  function reach(turn) {
    const half = (axis) => axis.reduce((sum, value, i) => sum + Math.abs(value) * span[i] / 2, 0);
    return 1.12 * Math.max(half(turn[1]), half(turn[0]) * view.clientHeight / view.clientWidth);
  }

  const tags = given.gauges.map((gauge, i) => {
    const tag = document.createElement("span");
    Object.assign(tag, { className: "tag", textContent: gauge.label });
    Object.assign(tag.style, { background: gauge.colour, color: gauge.ink });
    tag.dataset.gauge = gauge.label;
    tag.setAttribute("aria-hidden", "true");
    tag.addEventListener("click", () => pick(i));
    view.append(tag);
    return tag;
  });

  function project(turn, scale, point) {
    const [width, height] = [view.clientWidth, view.clientHeight];
    return [
      (1 + along(turn[0], point) * height / width / scale + camera.x) * width / 2,
      (1 - along(turn[1], point) / scale - camera.y) * height / 2,
    ];
  }

  function amount() {
    return state < 0 ? 0 : given.states[state].largest * Math.sin(phase);
  }

  function paint() {
    waiting = false;
    const ratio = devicePixelRatio || 1, [width, height] = [view.clientWidth, view.clientHeight];
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const turn = axes(camera), scale = reach(axes(home)) / camera.size;
    draw.frame({
      turn, centre, state, group, gauges, ratio, amount: amount(), depth: 0.5 / radius,
      zoom: [height / width / scale, 1 / scale], pan: [camera.x, camera.y],
    });
    const taken = [];
    const free = (x, top, half) => taken.every(([a, b, c]) => Math.abs(a - x) > half + c + 3 || Math.abs(b - top) > 23);
    given.gauges.forEach((gauge, i) => {
      tags[i].hidden = gauge.group !== group;
      if (tags[i].hidden) return;
      const moved = draw.shift(state, gauge.anchor).map((value, k) => gauge.position[k] + amount() * value);
      const [x, y] = project(turn, scale, moved), tag = tags[i];
      // A label is above its gauge and above earlier labels, or below them at the edge of the view.
      const half = tag.offsetWidth / 2;
      let top = y - 26;
      while (!free(x, top, half)) top -= 6;
      if (top < 0) for (top = y + 8; !free(x, top, half);) top += 6;
      taken.push([x, top, half]);
      tag.style.transform = `translate(-50%, 0) translate(${x.toFixed(1)}px, ${top.toFixed(1)}px)`;
      const facing = gauge.normal.reduce((sum, value, k) => sum + value * turn[2][k], 0);
      tag.classList.toggle("behind", gauge.normal.some(Boolean) && facing < 0.02);
      Object.assign(tag.dataset, { x: x.toFixed(1), y: y.toFixed(1) });
    });
    triad(turn);
    view.dataset.ready = "true";
    if (playing) {
      phase += 0.06;
      ask();
    }
  }
  function ask() {
    if (!waiting) requestAnimationFrame(paint);
    waiting = true;
  }

  // Directions of the axes, in the corner.
  const arms = [...section.querySelectorAll("#space-axes g")];
  function triad([right, up, toward]) {
    arms.forEach((arm, k) => {
      const [x, y] = [30 * right[k], -30 * up[k]];
      arm.style.opacity = toward[k] < -0.02 ? 0.45 : 1;
      for (const [name, value] of [["x2", x], ["y2", y]]) arm.firstChild.setAttribute(name, value.toFixed(1));
      for (const [name, value] of [["x", 1.3 * x], ["y", 1.3 * y]]) arm.lastChild.setAttribute(name, value.toFixed(1));
    });
  }

  // Rotate to a camera along the shorter path, at once with reduced motion.
  function go(target) {
    const from = { ...camera }, begin = performance.now();
    const turned = (target.azimuth - from.azimuth) % (2 * Math.PI);
    const by = turned - 2 * Math.PI * Math.round(turned / (2 * Math.PI));
    function step(now) {
      const t = still.matches ? 1 : Math.min((now - begin) / 350, 1), eased = t * t * (3 - 2 * t);
      for (const key of Object.keys(home)) {
        camera[key] = from[key] + eased * (key === "azimuth" ? by : target[key] - from[key]);
      }
      ask();
      if (t < 1) requestAnimationFrame(step);
    }
    requestAnimationFrame(step);
  }

  function rotate(right, down) {
    camera.azimuth -= right;
    camera.elevation = Math.max(-1.55, Math.min(1.55, camera.elevation + down));
    ask();
  }
  // Zoom about a point in the view, from −1 to 1.
  function zoom(factor, x = 0, y = 0) {
    const size = Math.max(0.2, Math.min(200, camera.size * factor)), by = size / camera.size;
    Object.assign(camera, { size, x: x + (camera.x - x) * by, y: y + (camera.y - y) * by });
    ask();
  }

  function pick(i) {
    const gauge = given.gauges[i], panel = document.querySelector("#space-picked"), list = document.createElement("dl");
    for (const [name, text] of [["gauge", gauge.label], ...gauge.details]) {
      list.append(element("dt", name), element("dd", text));
    }
    panel.replaceChildren(list);
    tags.forEach((tag, k) => tag.classList.toggle("picked", k === i));
    for (const chip of section.querySelectorAll(".chip")) {
      chip.setAttribute("aria-pressed", String(Number(chip.dataset.index) === i));
    }
    const n = gauge.normal, target = { ...camera };
    if (tags[i].classList.contains("behind")) {
      const elevation = Math.max(-1.2, Math.min(1.2, Math.asin(Math.max(-1, Math.min(1, n[2])))));
      target.elevation = elevation + (elevation < 1 ? 0.25 : 0);
      if (Math.hypot(n[0], n[1]) > 1e-6) target.azimuth = Math.atan2(n[1], n[0]) + 0.4;
    }
    // Move it into the frame if necessary.
    const turn = axes(target), scale = reach(axes(home)) / target.size;
    const x = along(turn[0], gauge.position) * view.clientHeight / view.clientWidth / scale;
    const y = along(turn[1], gauge.position) / scale;
    if (Math.max(Math.abs(x + target.x), Math.abs(y + target.y)) > 0.9) Object.assign(target, { x: -x, y: -y });
    go(target);
    ask();
  }

  const held = new Map();
  let moved = 0;
  view.addEventListener("contextmenu", (event) => event.preventDefault());
  view.addEventListener("pointerdown", (event) => {
    if (!held.size) moved = 0;
    held.set(event.pointerId, [event.clientX, event.clientY]);
    if (!event.target.closest(".tag")) view.setPointerCapture(event.pointerId);
  });
  view.addEventListener("pointermove", (event) => {
    const before = held.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    const others = [...held].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    held.set(event.pointerId, [event.clientX, event.clientY]);
    moved += Math.abs(dx) + Math.abs(dy);
    const box = view.getBoundingClientRect();
    if (others.length) {
      const [ox, oy] = others[0], apart = (x, y) => Math.hypot(x - ox, y - oy) || 1;
      const [mx, my] = [(event.clientX + ox) / 2 - box.left, (event.clientY + oy) / 2 - box.top];
      zoom(apart(event.clientX, event.clientY) / apart(...before), 2 * mx / box.width - 1, 1 - 2 * my / box.height);
      camera.x += dx / box.width;
      camera.y -= dy / box.height;
    } else if (event.shiftKey || event.buttons & 2) {
      camera.x += 2 * dx / box.width;
      camera.y -= 2 * dy / box.height;
      ask();
    } else rotate(0.008 * dx, 0.008 * dy);
  });
  for (const name of ["pointerup", "pointercancel"]) view.addEventListener(name, (event) => held.delete(event.pointerId));
  view.addEventListener("click", (event) => {
    const box = view.getBoundingClientRect();
    if (moved > 5 || event.target.closest(".tag")) return;
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    const away = tags.map((tag) =>
      tag.hidden ? Infinity : Math.hypot(tag.dataset.x - x, tag.dataset.y - y) + 8 * tag.classList.contains("behind"));
    const nearest = away.indexOf(Math.min(...away));
    if (away[nearest] < 20) pick(nearest);
  });
  view.addEventListener("wheel", (event) => {
    // The page scrolls until the view is clicked.
    if (document.activeElement !== view) return;
    event.preventDefault();
    const box = view.getBoundingClientRect();
    const [x, y] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    zoom(Math.exp(-0.0015 * event.deltaY), 2 * x - 1, 1 - 2 * y);
  }, { passive: false });
  const keys = {
    ArrowLeft: () => rotate(-0.1, 0), ArrowRight: () => rotate(0.1, 0), ArrowUp: () => rotate(0, -0.1),
    ArrowDown: () => rotate(0, 0.1), "+": () => zoom(1.25), "=": () => zoom(1.25), "-": () => zoom(0.8), 0: () => go(home),
  };
  view.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
  });

  const eyes = { home, x: { azimuth: 0, elevation: 0 }, y: { azimuth: Math.PI / 2, elevation: 0 }, z: { elevation: 1.55 } };
  section.addEventListener("click", ({ target }) => {
    if (target.dataset.eye) go({ ...camera, size: 1, x: 0, y: 0, ...eyes[target.dataset.eye] });
    if (target.dataset.zoom) zoom(Number(target.dataset.zoom));
    if (target.classList.contains("chip")) pick(Number(target.dataset.index));
  });

  const choice = document.querySelector("#space-shape"), hold = document.querySelector("#space-play");
  // A browser may restore the selection of an earlier visit.
  if (choice) choice.value = String(state);
  const bars = [...section.querySelectorAll("#space-bars > div")];
  choice?.addEventListener("change", () => {
    state = Number(choice.value);
    phase = Math.PI / 2;
    // Mode shapes oscillate; states with a contour are of one instant.
    const moves = given.states[state]?.largest > 0 && !given.states[state].stops.length;
    playing = moves && !still.matches;
    hold.hidden = !moves;
    hold.textContent = playing ? "Hold" : "Move";
    for (const bar of bars) bar.hidden = Number(bar.dataset.state) !== state;
    ask();
  });
  hold?.addEventListener("click", () => {
    playing = !playing;
    hold.textContent = playing ? "Hold" : "Move";
    ask();
  });
  document.querySelector("#space-true")?.addEventListener("click", ({ target }) => {
    gauges = gauges === "seen" ? "scale" : "seen";
    target.setAttribute("aria-pressed", String(gauges === "scale"));
    ask();
  });
  document.querySelector("#space-layout")?.addEventListener("change", ({ target }) => {
    group = Number(target.value);
    for (const chip of section.querySelectorAll(".chip")) chip.hidden = given.gauges[chip.dataset.index].group !== group;
    ask();
  });

  section.hidden = false;
  new ResizeObserver(ask).observe(view);
  ask();
}

async function inflated(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function element(name, text) {
  const made = document.createElement(name);
  made.textContent = text;
  return made;
}
